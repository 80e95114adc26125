import time
from dataclasses import replace

import pytest
from ladders import ground, problem
from threadpoolctl import threadpool_limits

from imubayes.ladder import LADDER, Size, costs
from imubayes.ladder.costs import REFERENCE, calibrate, foreseen, law_of, measured_speeds, within
from imubayes.ladder.problem import size_of
from imubayes.ladder.rungs import stand

SIZE = Size(rows=36_000, columns=20, candidates=17, runs=2)


@pytest.fixture(autouse=True)
def _own_cache(tmp_path, monkeypatch):
    monkeypatch.setattr(costs, "cache_folder", lambda: tmp_path / "cache")


@pytest.mark.parametrize("rung", ["means", "sparse", "plug-in", "averaged"])
def test_a_rung_takes_no_more_than_thrice_the_seconds_foreseen_and_a_fifth_at_least(rung, monkeypatch):
    """What is around the rung in a run is foreseen with it: up to two thirds of a short one."""
    one = problem(rate=20.0, dwell=15.0)
    # a busy machine takes longer by the clock: for the speeds as for the work
    monkeypatch.setattr(time, "perf_counter", time.process_time)
    with threadpool_limits(1, user_api="blas"):  # as a run has it: threads that wait count as work, too
        stand(rung, ground(one))  # compiled, and imported
        law = law_of(measured_speeds())
        start = time.perf_counter()
        stand(rung, ground(one))
    ratio = (time.perf_counter() - start) / foreseen(rung, size_of(one), law)
    assert 0.2 < ratio < 3.0


@pytest.mark.parametrize("budget", [0.0, 0.3, 1.0, 10.0, 1e6])
def test_chosen_rung_is_the_best_that_fits(budget):
    names = [*LADDER]
    chosen = names.index(within(budget, SIZE, REFERENCE))
    seconds = [foreseen(name, SIZE, REFERENCE) for name in names]
    assert chosen == 0 or seconds[chosen] <= budget
    assert all(later > budget for later in seconds[chosen + 1 :])


def test_machine_is_measured_once_and_another_one_again(monkeypatch):
    first = calibrate()
    monkeypatch.setattr(costs, "measured_speeds", lambda: pytest.fail("was kept"))
    assert calibrate() == first
    monkeypatch.setattr(costs, "_machine", lambda: ["another"])
    assert costs.kept_speeds() is None


@pytest.mark.parametrize(
    "text", ["", "[]", '{"speeds": {"small": 1.0}}', '{"machine": 1, "speeds": {"small": "x"}}']
)
def test_broken_cache_is_measured_again(text, tmp_path):
    (tmp_path / "cache").mkdir()
    (tmp_path / "cache" / costs.FILE).write_text(text)
    assert costs.kept_speeds() is None


def test_cache_that_cannot_be_written_is_no_error(tmp_path, monkeypatch):
    (tmp_path / "cache").write_text("a file where the folder would be")
    monkeypatch.setattr(costs, "measured_speeds", lambda: costs.USUAL)
    assert calibrate() == REFERENCE and costs.kept_speeds() is None


def test_rows_that_are_read_again_cost_as_often_as_they_are_read():
    """5.2 million rows on 15 terms: one pass for a single noise, thirty where it is averaged over."""
    long = Size(rows=5_200_000, columns=15, candidates=12, runs=1, streamed=5_200_000)
    once, often = (foreseen(name, long, REFERENCE) for name in ("plug-in", "averaged"))
    assert once < 5.0
    assert often > 20.0 * once
    assert within(5.0, long, REFERENCE) == "plug-in"
    assert within(1e9, long, REFERENCE) == "raw"


def test_what_is_read_at_every_step_is_little_beside_what_is_whitened_for_each_walker():
    held = Size(rows=1_000_000, columns=16, candidates=6, runs=1)
    more = foreseen("raw", replace(held, streamed=held.rows), REFERENCE) / foreseen("raw", held, REFERENCE)
    assert 1.01 < more < 1.1
