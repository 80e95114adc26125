from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet as pq
from trades import SHORT, in_this_process, measured, mission, problem, told, trade

from imubayes.campaign.fidelity import NEEDS_ROWS
from imubayes.errors import InputError
from imubayes.ladder.answer import change
from imubayes.ladder.problem import ground_of, problem_of
from imubayes.ladder.rungs import stand
from imubayes.ladder.trade import measure
from imubayes.ladder.trade.differ import apart, best_of, difference
from imubayes.ladder.trade.plan import Subject, rungs_of
from imubayes.ladder.trade.subjects import with_options
from imubayes.ladder.trade.told import told_of
from imubayes.reporting.trade_words import trade_answer
from imubayes.rig import streams
from imubayes.rig.recordings import RunSpec
from imubayes.rig.runs import read_run
from imubayes.scenes.relevance import exposure


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


def test_a_streamed_component_is_traded_without_every_row_and_without_repeats(monkeypatch, tmp_path):
    one = problem()
    run = one.runs[0]
    table = {"t [s]": run.inputs.t, "output [m/s^2]": run.output}
    table |= {f"{name} [m/s^2]": values for name, values in run.inputs.channels.items() if name[0] == "f"}
    pq.write_table(pa.table(table), tmp_path / "run.parquet")
    spec = replace(one.spec, runs=(RunSpec("r", "tumble", file=tmp_path / "run.parquet"),))
    monkeypatch.setattr(streams, "STREAMED", 100)
    streamed = problem_of(spec, [read_run(spec.runs[0], spec.kind, spec.library)])
    monkeypatch.setattr(measure, "measured", in_this_process)
    asked = trade(subjects=(Subject("long", streamed),), rungs=("means", "plug-in", "raw"), missions=())
    found = measure.measure(asked)
    assert [place.rung for place in found.places] == ["means", "plug-in"]
    assert found.standings[0].skipped == (("raw", NEEDS_ROWS),)
    assert found.scores == found.dear == ()
    assert any("no simulated repeats" in text for text in trade_answer(found))
