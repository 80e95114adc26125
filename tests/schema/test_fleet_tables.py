from pathlib import Path

from small_studies import FLEET, SIMULATED, study_of


def _units(folder: Path, *files: str) -> None:
    for name in files:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("t [s]\n", encoding="utf-8")


def test_study_has_what_its_file_says(tmp_path):
    study = study_of(tmp_path, FLEET)
    assert (study.title, study.seed, study.part, study.processes, study.simulated) == ("study", 4, 8, 2, True)
    assert [study.units[k].name for k in (0, 11)] == ["mems_tactical-01", "mems_tactical-12"]
    assert study.sensor_class.id == "mems_tactical"
    assert study.spec.sensor_class is study.sensor_class
    assert study.spec.reference == {"gravity": 1e-5}
    assert [run.name for run in study.spec.runs] == ["tumble"]
    assert study.text == FLEET


def test_units_are_the_folders_that_match_in_the_order_of_their_names(tmp_path):
    _units(tmp_path, "lot/B2/t.csv", "lot/A1/t.csv", "lot/notes.txt", "lot/.git/t.csv")
    study = study_of(tmp_path, FLEET.replace("12", '"lot/*"', 1).replace(SIMULATED, 'file = "t.csv"'))
    assert [(unit.number, unit.name) for unit in study.units] == [(0, "A1"), (1, "B2")]
    assert [unit.place for unit in study.units] == [tmp_path / "lot" / name for name in ("A1", "B2")]
    assert study.spec.runs[0].shown == "t.csv"
    assert not study.simulated


def test_units_can_be_files_that_hold_their_only_run(tmp_path):
    _units(tmp_path, "lot/B2.csv", "lot/A1.csv")
    study = study_of(tmp_path, FLEET.replace("12", '"lot/*.csv"', 1).replace(SIMULATED, ""))
    assert [unit.name for unit in study.units] == ["A1", "B2"]
    assert study.spec.runs[0].shown == ""


def test_units_of_one_name_keep_what_tells_them_apart(tmp_path):
    _units(tmp_path, "lot/A1.csv", "lot/A1.parquet")
    study = study_of(tmp_path, FLEET.replace("12", '"lot/*"', 1).replace(SIMULATED, ""))
    assert [unit.name for unit in study.units] == ["A1.csv", "A1.parquet"]


def test_pattern_can_be_absolute_and_deep(tmp_path):
    _units(tmp_path, "lot/A1/cold/t.csv", "lot/A2/cold/t.csv")
    pattern = f'"{tmp_path}/lot/*/cold"'
    study = study_of(tmp_path, FLEET.replace("12", pattern, 1).replace(SIMULATED, 'file = "t.csv"'))
    assert [unit.name for unit in study.units] == ["A1/cold", "A2/cold"]
