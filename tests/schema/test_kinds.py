"""A study file is one study, of one kind."""

from itertools import combinations
from pathlib import Path

import pytest
from small_studies import written

from imubayes.cli import kinds
from imubayes.cli.console import Waiting
from imubayes.errors import InputError, StudyError
from imubayes.study.schema import FORMS, OF_SENSORS, OF_THE_TOOL, SENSORS, read, read_study

STUDIES = Path(__file__).parents[2] / "studies"
SENSOR = '[[sensor]]\nid = "A"\nkind = "accelerometer"\n'
KIND = {
    "accelerometer_grades": "lots",
    "basic_vs_generalized": "lots",
    "fleet": "fleet",
    "mems_vs_fog": "lots",
    "scenes": "lots",
    "scenes_accelerometers": "lots",
}


@pytest.mark.parametrize(("one", "other"), list(combinations(FORMS, 2)))
def test_two_kinds_in_one_file_are_refused_by_name(one, other, tmp_path):
    path = written(tmp_path, f"[{other}]\n[{one}]\n")
    for reader in (read, read_study):
        with pytest.raises(StudyError, match=rf"holds \[{one}\] .* and \[{other}\] .* a file for each"):
            reader(path)


@pytest.mark.parametrize("kind", FORMS)
@pytest.mark.parametrize("table", OF_SENSORS)
def test_table_that_a_kind_has_no_use_for_is_refused(kind, table, tmp_path):
    if table in FORMS[kind].beside:
        return
    text = {"sensor": SENSOR, "scene": "[[scene]]\nname = 'x'\n", "appendix": "[[appendix]]\ntitle = 'x'\n"}
    path = written(tmp_path, f"[{kind}]\n{text.get(table, f'[{table}]' + chr(10) + 'x = 1')}\n")
    with pytest.raises(StudyError, match=rf"study.toml: {table}: {FORMS[kind].what} .*: leave it out"):
        read(path)


@pytest.mark.parametrize("path", sorted(STUDIES.glob("*.toml")), ids=lambda path: path.stem)
def test_every_study_that_ships_is_of_its_kind(path):
    if path.stem.startswith("plan"):
        return
    expected = KIND.get(path.stem, SENSORS)
    assert read(path)[0] == expected
    if expected in FORMS:
        with pytest.raises(StudyError, match=rf"{expected}: {FORMS[expected].what} has no .*imubayes run"):
            read_study(path)


@pytest.mark.parametrize(("table", "name"), OF_THE_TOOL.items())
def test_table_of_a_study_about_the_tool_is_refused_with_the_command_that_runs_it(table, name, tmp_path):
    path = written(tmp_path, f"[study]\n[{table}]\nx = 1\n")
    for reader in (read, read_study):
        with pytest.raises(StudyError, match=rf"study.toml: {table}: .* run 'python -m studies.{name}'"):
            reader(path)
    assert (STUDIES / name / "__main__.py").is_file()


def test_every_kind_that_is_read_can_be_run():
    assert kinds.KINDS.keys() == {SENSORS, *FORMS}


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
