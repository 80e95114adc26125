"""Results made by hand, for the tests that print them."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from results_found import (
    judged_result,
    repeatability,
    sampled_result,
    sensor_result,
    study_result,
)

from imubayes.campaign.study import SensorResult, StudyResult
from imubayes.population.sessions import Repeatability


@pytest.fixture
def result() -> StudyResult:
    return study_result()


@pytest.fixture
def make_sensor() -> Callable[..., SensorResult]:
    return sensor_result


@pytest.fixture
def make_study() -> Callable[..., StudyResult]:
    return study_result


@pytest.fixture
def make_sampled() -> Callable[..., SensorResult]:
    return sampled_result


@pytest.fixture
def make_judged() -> Callable[..., SensorResult]:
    return judged_result


@pytest.fixture
def make_sessions() -> Callable[..., Repeatability]:
    return repeatability
