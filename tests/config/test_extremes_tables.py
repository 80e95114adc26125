"""Studies of the extremes as files."""

from __future__ import annotations

import pytest

from imubayes.errors import StudyError
from imubayes.extremes.cases import FAMILIES, cases
from imubayes.study.schema import read, read_study


def _written(folder, table: str):
    path = folder / "study.toml"
    path.write_text(f"[study]\nseed = 4\n[extremes]\n{table}\n")
    return path


def test_without_families_all_of_them_are_measured(tmp_path):
    study = read(_written(tmp_path, ""))[1]
    assert study.families == tuple(FAMILIES)
    assert (study.seed, study.every) == (4, 1)


@pytest.mark.parametrize(
    ("table", "expected"),
    [
        ('families = ["powrs"]', r"extremes\.families\[0\].*did you mean 'powers'"),
        ('families = ["noise", "noise"]', r"extremes\.families\[1\].*each once"),
        ("every = 0", r"extremes\.every"),
        ("[[scene]]", r"scene.*leave it out"),
    ],
)
def test_a_table_that_cannot_be_measured_is_refused_by_its_key(tmp_path, table, expected):
    with pytest.raises(StudyError, match=expected):
        read(_written(tmp_path, table))[1]


def test_a_study_of_the_extremes_is_no_study_of_sensors(tmp_path):
    with pytest.raises(StudyError, match="has no"):
        read_study(_written(tmp_path, ""))


def test_a_thinned_grid_keeps_both_ends_of_each_family():
    for name in FAMILIES:
        whole, thin = (list(cases([name], seed=1, every=every)) for every in (1, 5))
        assert (thin[0].label, thin[-1].label) == (whole[0].label, whole[-1].label)
        assert len(thin) < len(whole) or len(whole) <= 2
