import pytest
from small_studies import FLEET, SIMULATED, study_of


def test_study_has_what_its_file_says(tmp_path):
    study = study_of(tmp_path, FLEET)
    assert (study.title, study.seed, study.part, study.processes, study.simulated) == ("study", 4, 8, 2, True)
    assert [study.units[k].name for k in (0, 11)] == ["mems_tactical-01", "mems_tactical-12"]
    assert study.sensor_class.id == "mems_tactical"
    assert study.spec.sensor_class is study.sensor_class
    assert study.spec.reference == {"gravity": 1e-5}
    assert [run.name for run in study.spec.runs] == ["tumble"]
    assert study.text == FLEET


IN_FOLDERS = FLEET.replace(SIMULATED, 'file = "t.csv"')
IN_FILES = FLEET.replace(SIMULATED, "")


@pytest.mark.parametrize(
    ("text", "pattern", "files", "names"),
    [
        (IN_FOLDERS, "lot/*", ("B2/t.csv", "A1/t.csv", "notes.txt", ".git/t.csv"), ["A1", "B2"]),
        (IN_FOLDERS, "{folder}/lot/*/cold", ("A1/cold/t.csv", "A2/cold/t.csv"), ["A1/cold", "A2/cold"]),
        (IN_FILES, "lot/*.csv", ("B2.csv", "A1.csv"), ["A1", "B2"]),
        (IN_FILES, "lot/*", ("A1.csv", "A1.parquet"), ["A1.csv", "A1.parquet"]),
    ],
    ids=["folders in the order of their names", "deep and absolute", "files that hold a run", "of one name"],
)
def test_units_are_what_matches(tmp_path, text, pattern, files, names):
    for name in files:
        file = tmp_path / "lot" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("t [s]\n", encoding="utf-8")
    study = study_of(tmp_path, text.replace("12", f'"{pattern.format(folder=tmp_path)}"', 1))
    assert [(unit.number, unit.name) for unit in study.units] == [*enumerate(names)]
    places = sorted(files) if text is IN_FILES else names
    assert [unit.place for unit in study.units] == [tmp_path / "lot" / place for place in places]
    assert study.spec.runs[0].shown == ("t.csv" if text is IN_FOLDERS else "")
    assert not study.simulated
