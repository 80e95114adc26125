"""A study file is one study, of one kind."""

from pathlib import Path

import pytest

from imubayes.cli import kinds
from imubayes.cli.console import Waiting
from imubayes.errors import InputError, StudyError
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


def test_kind_without_methods_to_trade_says_so():
    with pytest.raises(InputError, match=r"\[fleet\] has no methods to trade"):
        kinds.trade(STUDIES / "fleet.toml", [], [], Waiting(), repeats=0, limit=1.0)


@pytest.mark.parametrize("name", sorted({kind: name for name, kind in KIND.items()}.values()))
def test_kind_that_leaves_no_choice_of_methods_refuses_their_options(name, tmp_path):
    asked = kinds.Asked(tmp_path, {"budget": "5 s"})
    with pytest.raises(InputError, match="leave them out"):
        kinds.run(STUDIES / f"{name}.toml", asked, Waiting())


def test_scheduler_is_for_a_fleet_alone(tmp_path):
    with pytest.raises(InputError, match="--scheduler shares out"):
        kinds.run(STUDIES / "quickstart.toml", kinds.Asked(tmp_path, scheduler="local"), Waiting())
