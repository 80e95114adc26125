"""A study file is one study, of one kind."""

from pathlib import Path

import pytest

from imubayes.cli import kinds
from imubayes.errors import StudyError
from imubayes.study.schema import FORMS, OF_THE_TOOL, SENSORS, read, read_study

STUDIES = Path(__file__).parents[2] / "studies"
KIND = {
    "accelerometer_grades": "lots",
    "basic_vs_generalized": "lots",
    "fleet": "fleet",
    "mems_vs_fog": "lots",
    "scenes": "lots",
    "scenes_accelerometers": "lots",
}


@pytest.mark.parametrize("path", sorted(STUDIES.glob("*.toml")), ids=lambda path: path.stem)
def test_every_study_that_ships_is_of_its_kind(path):
    if path.stem.startswith("plan"):
        return
    expected = KIND.get(path.stem, SENSORS)
    assert read(path)[0] == expected
    if expected in FORMS:
        with pytest.raises(StudyError, match=rf"{expected}: {FORMS[expected].what} has no .*imubayes run"):
            read_study(path)


def test_every_kind_that_is_read_can_be_run():
    assert kinds.KINDS.keys() == {SENSORS, *FORMS}
    assert all((STUDIES / name / "__main__.py").is_file() for name in OF_THE_TOOL.values())
