import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lot_studies import TUMBLE, record, shaken, small
from lots_found import counted
from report_answers import wrong_lots

from imubayes.algebra.factor import noise_scale
from imubayes.campaign import Mission
from imubayes.campaign.preparation import prepare
from imubayes.inference import UNKNOWN
from imubayes.inference.linear import linear_of
from imubayes.inference.mcmc.ensembles import Limits, Target, run_ensembles
from imubayes.inference.prior import class_sd
from imubayes.population import Record, simulate_unit, spreads
from imubayes.population.lots import (
    DECISION,
    agreements,
    check,
    exposures,
    flown,
    in_mission,
    linear_end,
    lot_of,
    measure,
    unit_of,
)
from imubayes.population.needs import InLot, PopulationTerm
from imubayes.population.pooled import Pooled
from imubayes.population.spreads import population
from imubayes.reporting.lots_page import lots_json
from imubayes.scenes.propagation import Budget
from imubayes.scenes.relevance import basic_left, exposure
from imubayes.selection.decision import LOOSE, loose_fit
from imubayes.selection.panel import Votes
from imubayes.sensors.catalogue import sensor
from imubayes.sensors.lots import draw_lot
from imubayes.sensors.noise import Noise
from imubayes.sensors.terms import Library, columns
from imubayes.study.schema import read
from imubayes.units import STANDARD_GRAVITY
from imubayes.work import silent


@pytest.fixture(scope="module")
def found():
    return measure(small())


def test_classes_are_what_their_units_say_one_by_one(found):
    study, second = found.study, found.classes[1]
    lot = lot_of(study, 1)
    units = [unit_of(study, 1, number, lot) for number in range(2)]
    assert second.terms == population([units], lot.sensor_class, study.library, [lot])
    sd = class_sd(lot.sensor_class, study.library)
    assert second.missions[0].terms == weighed(units, study, second.terms, sd).terms
    assert second.order.value == np.median([unit.verdicts.count("needed") for unit in units])


def test_published_answers_follow_from_the_verdicts_of_the_units(found):
    assert [*wrong_lots(json.loads(lots_json(found)))] == []


def checked(one, cells):
    """Hold a class against the truth that needs every term, and has these cells in its first scene."""
    shown = counted(one, 2).terms[: len(cells)]
    terms = tuple(replace(cell, known=known) for known, cell in zip(shown, cells, strict=True))
    return check([replace(one, terms=shown, missions=(replace(one.missions[0], terms=terms),))])


def test_check_counts_cells_by_what_is_said_and_what_is_true(found):
    one = found.classes[0]
    term = one.missions[0].terms[0]
    said_true = [(0.2, 0.2), (0.2, 0.05), (0.05, 0.2), (0.3, 0.3), (0.01, 0.0), (0.05, 0.099)]
    told = checked(
        one, [replace(term, share=term.share._replace(value=s), true_share=t) for s, t in said_true]
    )
    assert told.cells == (6, 3)
    assert told.precision.value == pytest.approx(2 / 3)
    assert told.recall.value == pytest.approx(2 / 3)


def test_check_counts_shares_that_hold_the_truth_and_how_far_the_two_ways_to_it_are_apart(found):
    one = found.classes[0]
    term = one.missions[0].terms[0]
    share = term.share._replace(value=0.2, low=0.1, high=0.4)
    # (true, linear, held, seen): in and off by 10 %, outside and off by half, off by 1 %, too small, ended
    cells = [
        (0.2, 0.22, (2, 2), (2, 1)),
        (0.6, 0.3, (0, 1), (0, 0)),
        (2.0, 2.02, (0, 0), (1, 1)),
        (1e-3, 1.0, (1, 0), (2, 2)),
        (9.0, 40.0, (0, 0), (2, 0)),
    ]
    terms = [replace(term, share=share, true_share=t, linear_share=s, held=h, seen=k) for t, s, h, k in cells]
    terms[3] = replace(terms[3], share=share._replace(value=1e-3, low=0.0))
    ended = replace(one, missions=(replace(one.missions[0], beyond=(40.0, 9.0)),))
    told = checked(ended, terms)
    assert [(c.events, c.of) for c in (told.shares, told.unit_shares, told.linear_shares)] == [
        (1, 3),
        (2, 6),
        (3, 6),
    ]
    assert (told.seen_shares.events, told.seen_shares.of) == (2, 3)
    assert told.off == pytest.approx((0.1, 0.5))
    assert told.beyond == 1


def test_linear_propagation_ends_where_it_is_off_what_takes_the_budget(found):
    scene = found.classes[0].missions[0]
    term = scene.terms[0]
    # (true, linear): within the budget, near enough, off, farther off
    cells = [(0.1, 0.9), (50.0, 55.0), (36.0, 42.0), (30.0, 42.0), (36.0, 800.0)]
    terms = [replace(term, true_share=t, linear_share=s) for t, s in cells]
    assert linear_end([replace(scene, terms=tuple(terms))]) == (42.0, 30.0)
    assert linear_end([replace(scene, terms=tuple(terms[:3]))]) == (np.inf, np.inf)
    apart = [replace(scene, terms=tuple(terms[3:4])), replace(scene, terms=tuple(terms[4:]))]
    assert linear_end(apart) == (42.0, 30.0)


@pytest.mark.parametrize(("hidden", "untold"), [(0, 0), (1, 1), (2, 1)])
def test_cells_of_terms_that_half_of_the_units_leave_open_are_counted_apart(found, hidden, untold):
    one = counted(found.classes[0], 2)
    told = check([counted(one, 2 - hidden, hidden, of=one.terms[0].name)])
    assert (told.cells[0], told.untold) == (len(one.terms) - untold, untold)


def test_coverage_counts_means_and_spreads_apart_of_what_is_tested(found):
    one = found.classes[0]
    untested = tuple(
        replace(unit, verdicts=("untested", *("needed",) * (len(unit.verdicts) - 1))) for unit in one.units
    )
    held = [_true(t, t.mean.value, t.spread.high * (2.0 if k == 1 else 1.0)) for k, t in enumerate(one.terms)]
    lost = (_true(held[0], 1e9, 1e9), *held[1:])
    told = check([replace(one, units=untested, terms=lost)])
    n = len(held) - 1
    means, spreads = told.population_mean, told.population_spread
    assert (means.events, means.of, means.share.value) == (n, n, 1.0)
    assert (spreads.events, spreads.of) == (n - 1, n)
    assert spreads.share.value == pytest.approx((n - 1) / n)


def _true(term, mean, spread):
    return replace(term, lots=tuple(replace(lot, true_mean=mean, true_spread=spread) for lot in term.lots))


STUDY = small()
LIB = STUDY.library


def unit(theta, number=0, scatter=0.0) -> Record:
    """A unit whose test says the truth, but for a scatter of the draws."""
    noise = scatter * np.random.default_rng(number).standard_normal((200, len(theta)))
    return record(theta, draws=theta + noise * np.abs(theta))


NOTHING = [
    PopulationTerm(name, 1, (InLot(0, 0, UNKNOWN, UNKNOWN),), Pooled(0.5, UNKNOWN, 1.0)) for name in LIB.names
]


def weighed(units, study=STUDY, terms=NOTHING, sd=1.0):
    """Units in the only scene of a study."""
    (mission,), (seen,) = study.missions, exposures(study.missions, study.library)
    (true,) = flown(seen, [np.array([unit.truth for unit in units])])
    return in_mission(units, terms, mission, seen, true, sd, basic=study.basic)


def outputs(scene) -> np.ndarray:
    inputs = scene.inputs
    return columns(LIB, inputs.channels, len(inputs))


def test_shares_are_medians_of_the_rms_effect_over_the_budget():
    thetas = [np.full(len(LIB.terms), size) for size in (1e-5, 4e-5, 2e-5)]
    found = weighed([unit(theta, k) for k, theta in enumerate(thetas)])
    rms = 2e-5 * np.sqrt(np.mean(outputs(STUDY.missions[0].scene) ** 2, axis=0))
    for term, expected in zip(found.terms, rms, strict=True):
        assert term.rms == pytest.approx(expected, rel=1e-9)
        assert term.share.value == pytest.approx(expected / 1e-3, rel=1e-9)
        assert term.true_share == pytest.approx(term.share.value, rel=1e-9)


def test_intervals_are_counted_apart_of_units_whose_tests_leave_the_prior_no_say():
    theta, p = np.full(len(LIB.terms), 1e-5), len(LIB.terms)
    held, off = unit(theta, 0, 0.5), replace(unit(theta, 1, 0.5), truth=3.0 * theta)
    blind = replace(held, full_sd=np.full(p, 0.3))  # the prior's sd is one
    sharp = [replace(one, full_sd=np.full(p, 0.1)) for one in (held, held, off)]
    found = weighed([blind, *sharp])
    assert {(term.held[1], term.seen) for term in found.terms} == {(3, (3, 2))}


def test_a_term_is_required_in_the_units_where_nothing_else_keeps_the_budget():
    large, small_one = np.zeros(len(LIB.terms)), np.zeros(len(LIB.terms))
    large[LIB.names.index("b0")], small_one[LIB.names.index("b0")] = 5e-3, 1e-4
    found = weighed([unit(large), unit(small_one), unit(large), unit(large)])
    required = {term.name: term.required for term in found.terms}
    assert required.pop("b0") == 0.75
    assert set(required.values()) == {0.0}
    assert (found.order.value, found.within) == (1.0, 1.0)
    assert found.noise_share == pytest.approx(1e-4 / 1e-3)


def test_a_calibration_that_leaves_too_much_is_not_within_the_budget():
    theta = np.zeros(len(LIB.terms))
    theta[0] = 0.1
    found = weighed([unit(theta, 0, 0.5), unit(theta, 1)])
    assert found.within == 0.5


def test_what_the_basic_triad_leaves_is_the_residual_of_least_squares_over_the_scene():
    theta = np.random.default_rng(5).standard_normal(len(LIB.terms))
    scene = shaken()
    X = outputs(scene)
    basic = X[:, [LIB.names.index(name) for name in ("b0", "b1", "m_j", "m_k")]]
    y = X @ theta
    left = y - basic @ np.linalg.lstsq(basic, y, rcond=None)[0]
    seen = exposure(scene, LIB, Budget("output", 1.0))
    assert basic_left(seen, theta[None]) == pytest.approx(np.sqrt(np.mean(left**2)), rel=1e-9)


def test_what_the_test_does_not_know_of_the_triad_itself_is_not_held_against_it():
    """A bias known to 0.01 m/s^2 leaves nothing that the larger model would not; a b2 is its own."""
    seen = exposure(shaken(), LIB, Budget("output", 1.0), axis="z")
    draws = np.zeros((4_000, len(LIB.terms)))
    draws[:, LIB.names.index("b0")] = 0.01 * np.random.default_rng(2).standard_normal(4_000)
    assert basic_left(seen, draws) < 1e-12
    draws[:, LIB.names.index("b2")] = 1e-6
    assert basic_left(seen, draws) > 1e-6


def test_input_axis_of_a_mission_decides_which_component_is_weighed():
    up, level = (
        replace(STUDY, missions=(Mission("rest", shaken(still=True), Budget("output", 1.0), axis=axis),))
        for axis in ("z", "x")
    )
    theta = np.ones(len(LIB.terms))
    scale = LIB.names.index("b1")
    assert weighed([unit(theta)], up).terms[scale].rms == pytest.approx(9.8)
    assert weighed([unit(theta)], level).terms[scale].rms == 0.0


LOT = lot_of(STUDY, 0)
SPEC = replace(STUDY.specs[0], library=STUDY.library, truth=LOT.truth(0))


@pytest.fixture(scope="module")
def ready():
    runs = simulate_unit(SPEC, LOT, 0, np.random.default_rng(1))
    return prepare(SPEC, runs, silent, np.random.default_rng(2))


def test_estimates_without_shrinkage_are_ridge_regression_with_the_bench_held_to_its_prior(ready):
    """By the singular values of scaled columns; the condition, below 1e6, takes six digits of sixteen."""
    summary, prior = ready.summary, ready.prior
    mean, cov = loose_fit(summary, prior)
    p, scale = len(STUDY.library.terms), noise_scale(summary.factor, prior.sd)
    sd = prior.sd * np.where(np.arange(len(prior.sd)) < p, LOOSE, 1.0)
    assert summary.extras
    rows = np.vstack((summary.factor.R[:, :-1], np.diag(scale / sd)))
    size = np.linalg.norm(rows, axis=0)
    U, s, Vt = np.linalg.svd(rows / size, full_matrices=False)
    root = Vt.T / s / size[:, None]
    seen = np.concatenate((summary.factor.R[:, -1], np.zeros(len(sd))))
    np.testing.assert_allclose(mean, root @ (U.T @ seen), rtol=1e-8, atol=1e-8 * np.abs(mean).max())
    np.testing.assert_allclose(np.diag(cov), scale**2 * np.sum(root**2, axis=1), rtol=1e-8)
    np.testing.assert_allclose(cov, cov.T, rtol=1e-12)


def test_a_bias_that_is_seen_beside_other_terms_has_the_mean_and_spread_of_its_units():
    """A tumble in one plane sees b0 beside the constant part of b2 and c_jj; their priors leave it narrow."""
    study = small(units=12)
    plane = replace(TUMBLE, simulate={**TUMBLE.simulate, "planes": 1})
    study = replace(study, specs=tuple(replace(one, runs=(plane,)) for one in study.specs))
    for k, entry in enumerate(study.classes):
        lot = lot_of(study, k)
        units = [unit_of(study, k, number, lot) for number in range(12)]
        terms = {one.name: one for one in population([units], entry, study.library, [lot])}
        b0, bias = terms["b0"], lot.theta[:, lot.names.index("b0")]
        assert b0.spread.low < bias.std(ddof=1) < b0.spread.high < 4.0 * b0.spread.low
        assert b0.mean.low < bias.mean() < b0.mean.high
        # of b2 and c_jj it sees the difference alone: what of it is which stays as open as their sizes are
        assert all(terms[name].spread.high > 5.0 * terms[name].spread.low for name in ("b2", "c_jj"))


def test_intervals_hold_terms_of_which_a_test_sees_the_difference_alone(monkeypatch):
    """A tumble in one plane by the formula: b0 + (b2 + c_jj)/2, and (b2 - c_jj)/2 far finer than either."""
    monkeypatch.setattr(spreads, "pooled", lambda *_: None)
    monkeypatch.setattr(spreads, "of_versions", lambda _: (None,) * 3)
    rng, held = np.random.default_rng(5), []
    lib = Library("accelerometer", tuple(t for t in LIB.terms if t.name in ("b0", "b2", "c_jj")))
    for name in ("quartz_flexure_servo", "strategic_piga"):
        entry = sensor(name, kind="accelerometer")
        half = 0.5 * STANDARD_GRAVITY**2
        noise = 0.1 * half * min(class_sd(entry, lib)[1:])
        seen = np.array([[1.0, half, half], [0.0, half, -half]]) / noise
        for _ in range(80):
            lot, units = draw_lot(entry, lib, 10, rng), []
            for theta in lot.theta:
                rows = np.column_stack((seen, seen @ theta + rng.standard_normal(2)))
                units.append(record(theta, R=np.linalg.qr(np.vstack((rows, np.zeros((2, 4)))), mode="r")))
            for term in population([units], entry, lib, [lot])[1:]:
                both = (term.mean, term.true_mean), (term.spread, term.true_spread)
                held.append([found.low <= true <= found.high for found, true in both])
    shares = np.mean(held, axis=0)
    assert np.all((shares > 0.8) & (shares < 0.95))


def test_truths_lie_within_what_the_test_says_of_them():
    """Squares of the standardised errors of all terms of a unit are chi-squared of its degrees."""
    study = small(units=6)
    lot = lot_of(study, 0)
    lib, sizes = study.specs[0].library, []
    own = [name == carrier for name, carrier in zip(lib.names, lib.carriers, strict=True)]
    for number in range(6):
        unit = unit_of(study, 0, number, lot)
        # untested terms have a prior a thousand times as wide as they are
        loose = np.diag(1.0 / (LOOSE * class_sd(study.classes[0], lib)) ** 2)
        cov = np.linalg.inv(unit.R[:-1, :-1].T @ unit.R[:-1, :-1] + loose)
        left = (cov @ (unit.R[:-1, :-1].T @ unit.R[:-1, -1]) - unit.truth)[own]
        sizes.append(float(left @ np.linalg.solve(cov[np.ix_(own, own)], left)))
    p = sum(own)
    assert 0.3 * p < np.mean(sizes) < p + 4.0 * np.sqrt(2.0 * p / 6.0)


def test_errors_of_the_bench_move_the_output_and_not_what_the_rig_says():
    spec = replace(STUDY.specs[0], runs=(TUMBLE,), reference={"gravity": 1.0, "turn_on": 100.0})
    lot = replace(LOT, noise=tuple(Noise(0.0, 0.0, 0.0) for _ in LOT.noise), theta=np.zeros_like(LOT.theta))
    (run,) = simulate_unit(replace(spec, truth=lot.truth(0)), lot, 0, np.random.default_rng(4))
    own = linear_of(run, STUDY.library)
    drawn = np.random.default_rng(4).standard_normal(2) * [1.0, 100.0]
    up = run.inputs.channels["f_i"] / 9.80665
    np.testing.assert_allclose(own.y, drawn[0] * up + drawn[1], atol=1e-9)


def test_an_asymmetry_stays_on_its_jump_where_the_rig_says_that_the_axis_is_level():
    """Mutation: by the sign of what an arcsecond leaves of the input, all of it would show."""
    spec = replace(STUDY.specs[0], runs=(TUMBLE,), reference={"fixture": 1e-4}, truth={"b0p": 1.0})
    lot = replace(LOT, noise=tuple(Noise(0.0, 0.0, 0.0) for _ in LOT.noise))
    (run,) = simulate_unit(spec, lot, 0, np.random.default_rng(4))
    own = run.inputs.channels["f_i"]
    np.testing.assert_allclose(run.output - own, np.sign(own), atol=0.01)
    assert np.any(own == 0.0) and np.abs(run.output[own == 0.0]).max() > 1e-5


SCENES = read(Path(__file__).parents[2] / "studies" / "scenes.toml")[1]
ARCSECOND = np.pi / 180.0 / 3600.0


@pytest.mark.parametrize(
    ("class_id", "arcseconds", "number"), [("ifog_strategic", 5, 2), ("hrg_navigation", 20, 4)]
)
def test_errors_of_a_bench_settle_where_they_are_thousands_of_times_the_noise(class_id, arcseconds, number):
    """Plain relinearisation runs astray here; the coefficients must be the truth within their own sds."""
    spec = next(one for one in SCENES.specs if one.id == class_id)
    spec = replace(spec, reference={**spec.reference, "fixture": arcseconds * ARCSECOND})
    study = replace(SCENES, specs=(spec,))
    lot = lot_of(study, 0)
    spec = replace(spec, truth=lot.truth(number))
    runs = simulate_unit(spec, lot, number, np.random.default_rng(7))
    ready = prepare(spec, runs, silent, np.random.default_rng(8))
    mean, cov = loose_fit(ready.summary, ready.prior)
    p = len(study.library.terms)
    off = (mean[:p] - lot.theta[number]) / np.sqrt(np.diag(cov)[:p])
    # of 20 standard normals one in 12,000 sets holds one beyond 4.5
    assert np.abs(off).max() < 4.5
    assert off @ off / p < 2.5


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
    moves = ((None, 1.0),)
    target = Target(
        ("x",), lambda x: -0.5 * x[:, 0] ** 2, moves, lambda rng, n: rng.normal(size=(n, 1)), np.copy
    )
    found = run_ensembles(target, Limits(seed=1, steps=100)).found
    assert not found.converged and found.steps == 90  # a tenth is dropped
