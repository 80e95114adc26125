import os
import signal

import numpy as np
import pytest
from fleet_studies import after, backwards, fleet, here, recorded
from pyarrow import parquet

from imubayes.errors import InputError
from imubayes.population import part_found
from imubayes.population.dataset import GROWING, UNITS
from imubayes.population.fleet import ENDED, lot_of, measure
from imubayes.study.schema import read
from imubayes.work import Engine, Lost, as_done


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    return folder, measure(fleet(8), folder, here())


def _rows(folder):
    return parquet.read_table(folder / "units")


def _times(folder, within=UNITS) -> dict[str, int]:
    return {file.name: file.stat().st_mtime_ns for file in (folder / within).iterdir()}


def test_every_unit_and_term_is_a_row_and_truth_lies_beside_it(whole):
    folder, result = whole
    study, table = result.study, _rows(folder)
    p = len(study.spec.library.terms)
    assert table.column("unit").to_pylist() == [unit.name for unit in study.units for _ in range(p)]
    lot = lot_of(study)
    assert lot is not None
    assert np.array_equal(np.array(table.column("truth")).reshape(8, p), lot.theta)
    assert (result.units, result.resumed, result.broken) == (8, 0, ())
    assert result.counts.sum(axis=0).tolist() == [8] * p
    assert [term.true_mean for term in result.terms] == lot.mean.tolist()


def test_order_in_which_parts_are_done_changes_no_digit(whole, tmp_path):
    folder, result = whole
    other = measure(fleet(8), tmp_path, backwards())
    assert _rows(tmp_path).equals(_rows(folder))
    assert other.terms == result.terms
    assert other.worst == result.worst


def test_interrupted_study_goes_on_with_what_is_unfinished(whole, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        measure(fleet(8), tmp_path, here(), progress=after(2))
    before = _times(tmp_path, GROWING)
    assert sorted(before) == ["part-00000.parquet", "part-00001.parquet"]
    jobs: list[int] = []
    result = measure(fleet(8), tmp_path, here(jobs), resume=True)
    assert (sum(jobs), result.resumed) == (1, 6)
    assert _times(tmp_path).items() > before.items()
    assert not (tmp_path / GROWING).exists()
    assert _rows(tmp_path).equals(_rows(whole[0]))
    assert result.terms == whole[1].terms


def test_poisoned_file_costs_only_its_unit_and_is_read_when_it_is_mended(tmp_path):
    study, out = recorded(tmp_path), tmp_path / "out"
    file = tmp_path / "units" / "A4" / "tumble.csv"
    good = file.read_text()
    file.write_text(good.replace("\n", "\nrubbish,", 1))
    result = measure(study, out, here())
    (broken,) = result.broken
    assert (broken.number, broken.name) == (3, "A4")
    assert str(file) in broken.error
    assert result.units == 4
    assert "A4" not in _rows(out).column("unit").to_pylist()
    # it is tried again, and only it; what is finished stays as it is
    before, tried = _times(out), list[str]()
    again = measure(study, out, noting(tried), resume=True)
    assert (tried, again.resumed, again.broken) == (["A4"], 4, (broken,))
    assert _times(out) == before
    file.write_text(good)
    mended = measure(study, out, noting(tried), resume=True)
    assert (tried, mended.resumed) == (["A4", "A4"], 4)
    assert (mended.units, mended.broken) == (5, ())
    measure(study, tmp_path / "fresh", here())
    assert _rows(out).equals(_rows(tmp_path / "fresh"))


def noting(tried: list[str]) -> Engine:
    """Engine of this process; keeps the names of the units that it was given."""

    def do(work, given):
        tried.extend(unit.name for _, part in given for unit in part)
        return as_done(work, given, 1)

    return "this process", do


def test_unit_that_is_added_before_the_others_is_the_only_one_that_is_done(tmp_path):
    study, out, tried = recorded(tmp_path), tmp_path / "out", list[str]()
    measure(study, out, here())
    (tmp_path / "units" / "A5").rename(tmp_path / "units" / "A0")
    more = read(study.path)[1]
    assert more is not None
    result = measure(more, out, noting(tried), resume=True)
    assert (tried, result.resumed) == (["A0"], 4)
    fresh = measure(more, tmp_path / "fresh", here())
    assert _rows(out).equals(_rows(tmp_path / "fresh"))
    assert result.worst == fresh.worst


@pytest.mark.parametrize("out", [".", "link"])
def test_recordings_in_the_folder_of_the_results_are_refused_before_any_is_touched(tmp_path, out):
    study = recorded(tmp_path, ("A1", "A2"))
    (tmp_path / "link").symlink_to(tmp_path, target_is_directory=True)
    before = {file: file.read_bytes() for file in tmp_path.rglob("*.csv")}
    with pytest.raises(InputError, match=r"A1: is a unit of this study.* choose another --out"):
        measure(study, tmp_path / out, here())
    assert {file: file.read_bytes() for file in tmp_path.rglob("*.csv")} == before


def test_fleet_of_broken_units_only_is_an_error(tmp_path):
    study = recorded(tmp_path, ("A1", "A2"))
    for name in ("A1", "A2"):
        (tmp_path / "units" / name / "tumble.csv").write_text("")
    with pytest.raises(InputError, match=r"none of 2 units could be read; A1: .*tumble.csv"):
        measure(study, tmp_path / "out", here())
    assert list((tmp_path / "out").iterdir()) == []


def deadly(study, part):
    """Analyse a part, unless unit 4 is in it: it ends the process."""
    if any(unit.number == 4 for unit in part):
        os.kill(os.getpid(), signal.SIGKILL)
    return part_found(study, part)


def spared(study, part):
    """Say what an engine says of a part that would end its process; analyse the others."""
    return Lost() if any(unit.number == 4 for unit in part) else part_found(study, part)


@pytest.mark.parametrize(
    ("work", "processes"), [(spared, 1), pytest.param(deadly, 2, marks=pytest.mark.slow)]
)
def test_unit_that_ends_its_process_is_broken_and_its_neighbours_are_not(whole, tmp_path, work, processes):
    made_up = "made up", lambda _, jobs: as_done(work, jobs, processes)
    result = measure(fleet(8), tmp_path, made_up)
    assert [(one.number, one.error) for one in result.broken] == [(4, ENDED)]
    usual = _rows(whole[0])
    assert _rows(tmp_path).equals(usual.filter(np.array(usual.column("number")) != 4))


def test_study_that_is_begun_anew_and_interrupted_loses_nothing(tmp_path):
    study, out = recorded(tmp_path), tmp_path / "out"
    measure(study, out, here())
    before = _times(out)
    with pytest.raises(KeyboardInterrupt):
        measure(study, out, here(), progress=after(1))
    assert _times(out) == before
    assert measure(study, out, here(), resume=True).resumed == 5
