from dataclasses import replace

import numpy as np
from lot_studies import record, small

from imubayes.inference.mcmc.ensembles import Limits, Target, run_ensembles
from imubayes.population import Record
from imubayes.population.lots import lot_of, unit_of
from imubayes.population.needs import DECISION, agreements
from imubayes.selection.panel import Votes

NAMES = ("b0", "b1", "b2", "b3")
SURE = ("needed", "needed", "not needed", "undecided")


def voted(keeps, truth, verdicts=SURE) -> Record:
    """A unit of sds of 1, about which the decision and BIC have voted on b0, b1, b2 and b3."""
    table = np.array([[1.0, 1.0, 0.0, 1.0], keeps])
    votes = Votes(NAMES, (DECISION, "bic"), table, table, ())
    return record(np.array(truth), verdicts=verdicts, votes=votes)


def test_a_planted_disagreement_is_counted_by_term_direction_and_truth():
    """BIC drops b1 twice, once of 20 sd; it keeps b2 once, of half a sd; b3 is left open."""
    units = [voted([1, 0, 1, 1], [9, 20, 0.5, 5]), voted([1, 0, 0, 0], [9, 2, 0.5, 9])]
    assert agreements([replace(units[0], votes=None)], NAMES) == ()
    decision, bic = agreements([*units, replace(units[0], votes=None)], NAMES)
    assert (decision.method, decision.share.value, decision.of) == (DECISION, 1.0, 6)
    assert (bic.units, bic.of, bic.share.value) == (2, 6, 0.5)
    assert (bic.drops, bic.keeps) == ({"b1": 2}, {"b2": 1})
    assert (bic.false, bic.missed) == ((1, 2), (2, 4))
    assert (decision.false, decision.missed) == ((0, 2), (0, 4))


def test_the_first_units_of_each_lot_are_asked_and_their_records_stay_what_they_were():
    study = small(methods=1)
    lot = lot_of(study, 0)
    asked, second = (unit_of(study, 0, number, lot) for number in range(2))
    alone = unit_of(replace(study, methods=0), 0, 0, lot)
    assert second.votes is None and alone.votes is None
    assert np.array_equal(asked.draws, alone.draws) and asked.verdicts == alone.verdicts
    methods = {one.method: one for one in agreements([asked, second], study.library.names)}
    assert {"bic", "loo", "stlsq", "collapsed"} <= methods.keys() and methods["bic"].units == 1
    assert 0.99 < asked.rhat < 1.05 and np.isnan(second.rhat)
    pulls = np.abs(asked.full_mean / asked.full_sd)
    told = dict(zip(asked.votes.terms, asked.votes.keeps[-1], strict=True))
    plain = {
        name: pull > 1.96 for name, pull in zip(study.library.names, pulls, strict=True) if abs(pull - 2) > 1
    }
    assert len(plain) > 4 and all(told[name] == kept for name, kept in plain.items() if name in told)


def test_chains_end_after_so_many_steps_whether_they_have_mixed_or_not():
    target = Target(
        ("x",), lambda x: -0.5 * x[:, 0] ** 2, (("differential", None, 1.0),), _start, lambda x: x
    )
    found = run_ensembles(target, Limits(seed=1, steps=100)).found
    assert not found.converged and found.steps == 90  # a tenth is dropped


def _start(rng, size):
    return rng.standard_normal((size, 1))
