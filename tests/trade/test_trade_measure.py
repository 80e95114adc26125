import numpy as np
import pytest
from trades import SHORT, in_this_process, measured, mission, problem, told, trade

from imubayes.errors import InputError
from imubayes.ladder.answer import change
from imubayes.ladder.problem import ground_of
from imubayes.ladder.rungs import stand
from imubayes.selection.relevance import exposure
from imubayes.trade import measure
from imubayes.trade.differ import apart, best_of, difference
from imubayes.trade.plan import rungs_of
from imubayes.trade.subjects import with_options
from imubayes.trade.told import told_of


@pytest.fixture(scope="module")
def found():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(measure, "measured", in_this_process)
        return measure.measure(trade())


def test_a_trade_measures_every_rung_and_repeats_each(found):
    assert [one.rung for one in found.places] == ["means", "plug-in"]
    assert [one.repeats for one in found.scores] == [6, 6]
    assert found.best == "plug-in"
    means, best = found.places
    assert best.rms == best.largest == 0.0 < means.rms <= means.largest
    assert 0.0 < means.seconds <= best.seconds
    assert found.dear == ()
    assert np.isfinite([one.scene_terms for one in found.scores]).all()


def test_the_largest_difference_is_what_the_ladder_calls_a_change():
    ground = ground_of(problem(), np.random.default_rng(1), lambda message: None, SHORT)
    below, best = (stand(name, ground) for name in ("sparse", "plug-in"))
    one, other = (told_of(answer, 100.0, np.random.default_rng(1)) for answer in (below, best))
    coefficients, _ = change(below, best)
    assert apart(one, other).max() == pytest.approx(coefficients, rel=1e-12)
    excited = [v != "untested" for v in other.verdicts]
    got = difference(one, other)
    assert got.largest == pytest.approx(apart(one, other)[excited].max(), rel=1e-12)
    assert got.inclusion == pytest.approx(np.abs(one.inclusion - other.inclusion)[excited].max(), rel=1e-12)


def test_chains_that_are_too_short_are_held_against_others_and_not_others_against_them():
    assert best_of([told("collapsed", ess=900.0), told("raw", ess=50.0)]).rung == "collapsed"


def test_what_a_scene_requires_of_the_best_rung_does_not_differ_from_itself():
    one = problem()
    seen = {"shaken": exposure(mission().scene, one.library, mission().budget)}
    p = len(one.library.terms)
    big, none = (np.tile(np.where(np.arange(p) == 0, size, 0.0), (4, 1)) for size in (1.0, 0.0))
    shape = {
        "names": one.library.names,
        "inclusion": np.ones(p),
        "limit95": np.ones(p),
        "prior_sd": np.ones(p),
    }
    shape |= {key: np.zeros(p) for key in ("mean", "full_mean", "monte_carlo")}
    shape |= {"full_sd": np.ones(p), "verdicts": ("needed",) * p}
    pair = [measured(told("means", draws=none, **shape), 0.1), measured(told(draws=big, **shape), 1.0)]
    standing = measure.standing_of("a", pair, seen)
    assert standing.differences[1].scenes[0].terms == ()
    # a bias of 1 m/s^2 is a thousand budgets of 1 mm/s^2
    assert standing.differences[0].scenes[0].terms == (one.library.names[0],)
    assert standing.differences[0].scenes[0].share == pytest.approx(1000.0, rel=1e-6)


def test_a_rung_whose_process_ends_is_left_out_and_said(monkeypatch):
    def dying(problem, rung, limits, seed):
        return None if rung == "plug-in" else in_this_process(problem, rung, limits, seed)

    monkeypatch.setattr(measure, "measured", dying)
    found = measure.measure(trade(repeats=0))
    assert [one.rung for one in found.places] == ["means"]
    assert found.standings[0].skipped == (("plug-in", "its process ended: is memory short?"),)


@pytest.mark.parametrize("asked", [["means"], ["means", "mean"]])
def test_rungs_that_cannot_be_traded_are_refused(asked):
    with pytest.raises(InputError):
        rungs_of(asked)


def test_a_negative_number_of_repeats_is_refused():
    with pytest.raises(InputError, match="-1 repeats"):
        with_options(trade(), repeats=-1)
