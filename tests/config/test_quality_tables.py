from pathlib import Path

import pytest

from imubayes.errors import StudyError
from imubayes.quality.trials import MODELLED, TREATMENTS
from imubayes.study.schema import read, read_study


def _read(folder: Path, text: str):
    path = folder / "quality.toml"
    path.write_text(text)
    return read(path)[1]


def test_empty_table_is_a_study_with_the_defaults(tmp_path):
    study = _read(tmp_path, "[quality]\n")
    assert (study.title, study.seed, study.sensors, study.treatments) == ("quality", 0, 200, (MODELLED,))
    assert (study.misspecified, study.powers, study.asymmetry) == (200, 3, 2)
    assert study.text == study.path.read_text()


def test_committed_study_asks_for_two_hundred_sensors_under_every_treatment():
    study = read(Path(__file__).parents[2] / "studies" / "decision_quality.toml")[1]
    assert study.sensors >= 200
    assert study.treatments == TREATMENTS


def test_no_more_sensors_are_misspecified_than_there_are(tmp_path):
    assert _read(tmp_path, "[quality]\nsensors = 3\nmisspecified = 10\n").misspecified == 3


@pytest.mark.parametrize(
    ("text", "key", "said"),
    [
        ("[quality]\nsensors = 0\n", "quality.sensors", "came 0"),
        ("[quality]\nsensor = 3\n", "quality.sensor", "did you mean 'sensors'?"),
        ('[quality]\ntreatments = ["as modeled"]\n', "quality.treatments[0]", "did you mean 'as modelled'?"),
        ('[quality]\ntreatments = ["noise assumed white"]\n', "quality.treatments", "expected 'as modelled'"),
        ('[quality]\ntreatments = ["as modelled", "as modelled"]\n', "quality.treatments[1]", "already"),
        ("[quality]\npowers = 99\n", "quality", "powers = 99 is out of range"),
        ("[quality]\n[sampling]\ness = 50\n", "sampling", "leave it out"),
    ],
)
def test_error_names_the_key_and_what_to_do(tmp_path, text, key, said):
    with pytest.raises(StudyError) as caught:
        _read(tmp_path, text)
    assert f"quality.toml: {key}: " in str(caught.value)
    assert said in str(caught.value)


def test_study_of_quality_has_no_runs_to_check(tmp_path):
    path = tmp_path / "quality.toml"
    path.write_text("[quality]\n")
    with pytest.raises(StudyError, match="imubayes run"):
        read_study(path)
