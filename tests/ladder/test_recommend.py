from dataclasses import replace
from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from imubayes.inference.intervals import frequency
from imubayes.ladder.trade.plan import NAMES
from imubayes.ladder.trade.recommend import allowed, faults, front, recommended
from imubayes.ladder.trade.record import Place
from imubayes.ladder.trade.score import Rate, Score

FINE = Place("means", 1.0, 1.0, 1.0, 1e7, 0.05, 0.02, 0.01, 0, 0.0, 0, 0.0, 0.1, 1)
NOTHING = Rate(0, 10, frequency(0, 10))


def _place(name, seconds, rms):
    return replace(FINE, rung=name, seconds=seconds, whole_seconds=seconds, rms=rms, largest=3.0 * rms)


def _score(rung, held):
    return Score(rung, 5, Rate(held, 100, frequency(held, 100)), 1.0, NOTHING, NOTHING, NOTHING, 0.0, 0.0)


PLACES = st.lists(
    st.tuples(st.floats(1e-2, 1e3), st.floats(0.0, 10.0)), min_size=1, max_size=len(NAMES), unique=True
).map(lambda each: [_place(name, *values) for name, values in zip(NAMES, each, strict=False)])


@given(PLACES, st.floats(1e-3, 0.5))
def test_nothing_on_the_front_is_beaten_and_everything_beside_it_is(places, floor):
    kept = front(places, floor)

    def beaten(one):
        return any(
            other.seconds <= one.seconds and max(other.largest, floor) <= max(one.largest, floor)
            for other in places
            if other is not one
        )

    assert kept
    for one in places:
        assert one.rung in kept or beaten(one)
    chosen = [one for one in places if one.rung in kept]
    errors = [max(one.largest, floor) for one in sorted(chosen, key=lambda one: one.seconds)]
    assert all(later < earlier for earlier, later in pairwise(errors))


def test_the_cheapest_rung_without_faults_is_recommended():
    places = [_place("means", 0.1, 3.0), _place("plug-in", 1.0, 0.02), _place("collapsed", 9.0, 0.0)]
    assert recommended(places, [], "collapsed", 0.01) == "plug-in"
    # too short intervals rule it out, too long ones do not
    assert recommended(places, [_score("plug-in", 70)], "collapsed", 0.01) == "collapsed"
    assert recommended(places, [_score("plug-in", 99)], "collapsed", 0.01) == "plug-in"


def test_where_nothing_is_good_enough_the_best_is_recommended_with_its_faults():
    places = [_place("means", 0.1, 3.0), _place("plug-in", 1.0, 0.0)]
    assert recommended(places, [_score("plug-in", 50)], "plug-in", 0.0) == "plug-in"
    assert "intervals hold only 50%" in faults(places[1], _score("plug-in", 50), 0.0)[0].replace(" %", "%")


def test_differences_within_monte_carlo_error_are_no_fault():
    off = replace(FINE, largest=0.3)
    assert faults(off, None, 0.01)
    assert not faults(off, None, 0.2)
    assert allowed(0.0) == 0.1
