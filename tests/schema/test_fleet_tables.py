from pathlib import Path

import pytest

from imubayes.errors import StudyError
from imubayes.study.schema import read, read_study

STUDIES = Path(__file__).parents[2] / "studies"

SMALL = """
[study]
seed = 4
[fleet]
kind = "accelerometer"
class = "mems_tactical"
units = 12
[fleet.library]
powers = 2
asymmetry = -1
[fleet.reference]
gravity = "1e-5 m/s^2"
[[fleet.run]]
name = "tumble"
procedure = "tumble"
simulate = { angles = 4, planes = 2, dwell = "4 s", rate = "1 Hz" }
"""

SIMULATED = 'simulate = { angles = 4, planes = 2, dwell = "4 s", rate = "1 Hz" }'


def _read(folder: Path, text: str):
    path = folder / "fleet.toml"
    path.write_text(text, encoding="utf-8")
    return read(path)[1]


def _units(folder: Path, *files: str) -> None:
    for name in files:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("t [s]\n", encoding="utf-8")


def test_study_has_what_its_file_says(tmp_path):
    study = _read(tmp_path, SMALL)
    assert (study.title, study.seed, study.part, study.processes, study.simulated) == ("fleet", 4, 8, 2, True)
    assert [study.units[k].name for k in (0, 11)] == ["mems_tactical-01", "mems_tactical-12"]
    assert study.sensor_class.id == "mems_tactical"
    assert study.spec.sensor_class is study.sensor_class
    assert study.spec.reference == {"gravity": 1e-5}
    assert [run.name for run in study.spec.runs] == ["tumble"]
    assert study.text == SMALL


def test_study_without_the_table_is_no_fleet():
    assert read(STUDIES / "quickstart.toml")[0] != "fleet"


def test_fleet_is_no_other_study(tmp_path):
    path = _read(tmp_path, SMALL).path
    assert read(path)[0] != "lots"
    with pytest.raises(StudyError, match=r"fleet: .*'imubayes run' it"):
        read_study(path)


def test_units_are_the_folders_that_match_in_the_order_of_their_names(tmp_path):
    _units(tmp_path, "lot/B2/t.csv", "lot/A1/t.csv", "lot/notes.txt", "lot/.git/t.csv")
    study = _read(tmp_path, SMALL.replace("12", '"lot/*"', 1).replace(SIMULATED, 'file = "t.csv"'))
    assert [(unit.number, unit.name) for unit in study.units] == [(0, "A1"), (1, "B2")]
    assert [unit.place for unit in study.units] == [tmp_path / "lot" / name for name in ("A1", "B2")]
    assert study.spec.runs[0].shown == "t.csv"
    assert not study.simulated


def test_units_can_be_files_that_hold_their_only_run(tmp_path):
    _units(tmp_path, "lot/B2.csv", "lot/A1.csv")
    study = _read(tmp_path, SMALL.replace("12", '"lot/*.csv"', 1).replace(SIMULATED, ""))
    assert [unit.name for unit in study.units] == ["A1", "B2"]
    assert study.spec.runs[0].shown == ""


def test_units_of_one_name_keep_what_tells_them_apart(tmp_path):
    _units(tmp_path, "lot/A1.csv", "lot/A1.parquet")
    study = _read(tmp_path, SMALL.replace("12", '"lot/*"', 1).replace(SIMULATED, ""))
    assert [unit.name for unit in study.units] == ["A1.csv", "A1.parquet"]


def test_pattern_can_be_absolute_and_deep(tmp_path):
    _units(tmp_path, "lot/A1/cold/t.csv", "lot/A2/cold/t.csv")
    pattern = f'"{tmp_path}/lot/*/cold"'
    study = _read(tmp_path, SMALL.replace("12", pattern, 1).replace(SIMULATED, 'file = "t.csv"'))
    assert [unit.name for unit in study.units] == ["A1/cold", "A2/cold"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("units = 12", "units = 1", r"fleet\.units: expected 2 units or more, came 1"),
        ("units = 12", "units = 1.5", r"fleet\.units: expected a number of simulated units.*came 1\.5"),
        ("units = 12", "units = true", r"fleet\.units: expected a number of simulated units.*came True"),
        ("units = 12", 'units = "none/*"', r"fleet\.units: 'none/\*' matches 0 folders or files"),
        ("units = 12", "", r"fleet\.units: the key is missing"),
        ('"mems_tactical"', '"mems_tacticl"', r"fleet\.class: .*mems_tactical"),
        ("[fleet.library]", "[fleet.libary]", r"fleet\.libary: unknown key: did you mean 'library'"),
        (SIMULATED, 'file = "t.csv"', r"fleet\.run\[0\]: a number of units are simulated"),
        ("angles = 4", "angles = 0", r"fleet\.run\[0\]\.simulate\.angles: "),
        ("planes = 2", "planes = 9", r"fleet\.run\[0\]\.simulate: .*planes"),
        ("seed = 4", 'seed = 4\nmethod = "full"', r"study\.method: a study of a fleet is exact"),
        ("[study]", "[sampling]\ness = 10.0\n[study]", r"sampling: a study of a fleet describes"),
        ('procedure = "tumble"\n' + SIMULATED, "", r"fleet\.run\[0\]\.procedure: the key is missing"),
    ],
)
def test_wrong_key_or_value_is_named(tmp_path, old, new, message):
    assert old in SMALL
    with pytest.raises(StudyError, match=message):
        _read(tmp_path, SMALL.replace(old, new, 1))


@pytest.mark.parametrize(
    ("files", "run", "message"),
    [
        (("lot/A/t.csv", "lot/B/t.csv"), SIMULATED, "units are recorded: expected a file in each"),
        (("lot/A/t.csv", "lot/B/t.csv"), "", "expected either file or simulate, came neither"),
        (("lot/A.csv", "lot/B.csv"), 'file = "t.csv"', "units are files, such as A: leave it out"),
        (
            ("lot/A.csv", "lot/B.csv"),
            '[[fleet.run]]\nname = "two"\nprocedure = "tumble"',
            "units are files, such as A: expected one run, came 2",
        ),
    ],
)
def test_runs_must_be_there_as_units_are(tmp_path, files, run, message):
    _units(tmp_path, *files)
    with pytest.raises(StudyError, match=message):
        _read(tmp_path, SMALL.replace("12", '"lot/*"', 1).replace(SIMULATED, run))


def test_free_tumble_is_not_one_component(tmp_path):
    _units(tmp_path, "lot/A/t.csv", "lot/B/t.csv")
    free = SMALL.replace("12", '"lot/*"', 1).replace(SIMULATED, 'file = "t.csv"\ngravity = "9.81 m/s^2"')
    with pytest.raises(StudyError, match=r"run\[0\]\.procedure: a unit of a fleet is one component"):
        _read(tmp_path, free.replace('"tumble"\nfile', '"free-tumble"\nfile'))
