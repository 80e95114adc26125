from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from ladders import in_memory_and_streamed
from trades import in_this_process, mission, problem, told, trade

from imubayes.errors import InputError
from imubayes.inference import Rate, frequency
from imubayes.ladder import trade as table
from imubayes.ladder.trade import RungTotals, allowed, faults, front, recommended
from imubayes.ladder.trade.components import NAMES, Score, Subject, rungs_of
from imubayes.scenes.relevance import exposure


@pytest.fixture(scope="module")
def found():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(table, "measured", in_this_process)
        return table.measure(trade())


def test_a_trade_measures_every_rung_and_repeats_each(found):
    assert [one.rung for one in found.places] == ["means", "plug-in"]
    assert [one.repeats for one in found.scores] == [6, 6]
    assert found.best == "plug-in"
    means, best = found.places
    assert best.rms == best.largest == 0.0 < means.rms <= means.largest
    assert 0.0 < means.seconds <= best.seconds
    assert found.dear == ()
    assert np.isfinite([one.scene_terms for one in found.scores]).all()


def test_what_a_scene_requires_of_the_best_rung_does_not_differ_from_itself():
    one = problem()
    seen = {"shaken": exposure(mission().scene, one.library, mission().budget)}
    p = len(one.library.terms)
    big, none = (np.tile(np.where(np.arange(p) == 0, size, 0.0), (4, 1)) for size in (1.0, 0.0))
    ones, zeros = np.ones(p), np.zeros(p)
    shape = {"names": one.library.names, "verdicts": ("needed",) * p, "full_sd": ones}
    shape |= {"inclusion": ones, "limit95": ones, "prior_sd": ones}
    shape |= {"mean": zeros, "full_mean": zeros, "monte_carlo": zeros}
    pair = [told("means", draws=none, **shape), told(draws=big, **shape)]
    means, best = (found.difference.scenes[0] for found in table.standing_of("a", pair, seen).measured)
    assert best.terms == ()
    # a bias of 1 m/s^2 is a thousand budgets of 1 mm/s^2
    assert means.terms == (one.library.names[0],)
    assert means.share == pytest.approx(1000.0, rel=1e-6)


def test_a_rung_whose_process_ends_is_left_out_and_said(monkeypatch):
    def dying(problem, rung, limits, seed):
        return None if rung == "plug-in" else in_this_process(problem, rung, limits, seed)

    monkeypatch.setattr(table, "measured", dying)
    found = table.measure(trade(repeats=0))
    assert [one.rung for one in found.places] == ["means"]
    assert found.standings[0].skipped == (("plug-in", "its process ended: is memory short?"),)


@pytest.mark.parametrize("asked", [["means"], ["means", "mean"]])
def test_rungs_that_cannot_be_traded_are_refused(asked):
    with pytest.raises(InputError):
        rungs_of(asked)


def test_a_streamed_component_is_traded_with_repeats(monkeypatch, tmp_path):
    streamed = in_memory_and_streamed(tmp_path, 1200)[1]
    monkeypatch.setattr(table, "measured", in_this_process)
    asked = trade(subjects=(Subject("long", streamed),), rungs=("means", "plug-in"), missions=())
    found = table.measure(asked)
    assert [place.rung for place in found.places] == ["means", "plug-in"]
    assert not found.dear
    assert [(one.rung, one.repeats) for one in found.scores] == [("means", 6), ("plug-in", 6)]
    # that many intervals of 90 % hold fewer once in a thousand times
    assert found.scores[1].coverage.events >= 0.6 * found.scores[1].coverage.of > 0.0


FINE = RungTotals("means", 1.0, 1.0, 1.0, 1e7, 0.05, 0.02, 0.01, 0, 0.0, 0, 0.0, 0.1, 1)
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
    assert "intervals hold only 50 %" in next(faults(places[1], _score("plug-in", 50), 0.0))


def test_a_singular_solution_is_no_number_of_posterior_sds():
    assert [*faults(replace(FINE, largest=1e17), None, 0.0)] == ["its solution is singular"]
    assert "off by 9e+05 posterior sd" in next(faults(replace(FINE, largest=9e5), None, 0.0))


def test_differences_within_monte_carlo_error_are_no_fault():
    off = replace(FINE, largest=0.3)
    assert any(faults(off, None, 0.01))
    assert not any(faults(off, None, 0.2))
    assert allowed(0.0) == 0.1
