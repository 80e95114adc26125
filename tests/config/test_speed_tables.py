"""The [speed] table: what it gives, and what it refuses."""

from __future__ import annotations

from pathlib import Path

import pytest

from imubayes.errors import StudyError
from imubayes.study.schema import read, read_study

PROJECT = Path(__file__).parents[2]


def _written(folder: Path, text: str) -> Path:
    path = folder / "study.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_study_of_speed_reads_as_it_is_written():
    study = read(PROJECT / "studies/speed.toml")[1]
    assert study is not None
    assert study.contests["enumeration"] == (20, 23, 26)
    assert all(len(sizes) >= 3 for sizes in study.growth.values())


def test_another_study_is_none_of_speed():
    assert read(PROJECT / "studies/quickstart.toml")[0] != "speed"


def test_a_study_of_speed_has_no_runs():
    with pytest.raises(StudyError, match=r"speed: a study of speed has no \[\[sensor\]\]"):
        read_study(PROJECT / "studies/speed.toml")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[speed]\nenumeration = [27]", r"speed\.enumeration\[0\]: expected a size from 8 to 26, came 27"),
        ("[speed]\nleast_squares = [1000, 5]", r"speed\.least_squares\[1\]: expected a size from 100"),
        ("[speed]\nenumerations = [20]", r"speed\.enumerations: unknown key: did you mean 'enumeration'"),
        ("[speed]\nrepeats = 0", r"speed\.repeats: "),
        ("[speed.growth]\nrows = [10, 20]", r"growth\.rows: expected 3 sizes or more, each larger"),
        ("[speed.growth]\nruns = [1, 4, 2]", r"growth\.runs: expected 3 sizes or more, each larger"),
        ("[speed.growth]\nunit = [1, 2, 3]", r"growth\.unit: unknown key: did you mean 'units'"),
        ("[speed]\n[[sensor]]\nid = 'a'", r"sensor: a study of speed makes its own problems"),
    ],
)
def test_a_wrong_key_or_size_is_named(tmp_path, text, said):
    with pytest.raises(StudyError, match=said):
        read(_written(tmp_path, text))[1]
