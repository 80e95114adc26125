from hypothesis import given
from hypothesis import strategies as st

from imubayes.ladder.trade.afford import counts
from imubayes.ladder.trade.plan import FEWEST, NAMES

SECONDS = st.lists(st.floats(1e-3, 1e3), min_size=1, max_size=len(NAMES)).map(
    lambda each: dict(zip(NAMES, sorted(each), strict=False))
)


@given(SECONDS, st.integers(0, 100), st.floats(0.0, 1e4), st.integers(1, 8))
def test_repeats_fit_into_the_time_and_better_rungs_have_no_more_of_them(seconds, repeats, left, processes):
    found = counts(seconds, repeats, left, processes)
    taken = sum(count * seconds[rung] for rung, count in found.items())
    assert taken <= left * processes * (1.0 + 1e-9)
    assert list(found) == list(seconds)[: len(found)]
    numbers = list(found.values())
    assert all(min(FEWEST, repeats) <= count <= repeats for count in numbers)
    assert (
        len(found) == len(seconds) or not repeats or left * processes - taken < FEWEST * max(seconds.values())
    )


def test_no_time_affords_nothing():
    assert counts({"means": 0.1}, 20, -3.0, 2) == {}
