"""A result made by hand, for the tests that print it."""

import pytest
from results_found import study_result

from imubayes.study import StudyResult


@pytest.fixture
def result() -> StudyResult:
    return study_result()
