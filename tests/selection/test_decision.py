"""Verdicts on simulated sensors of known truth: what a test sees, and what it must not claim to see."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from decisions import campaign_of, typical

import imubayes as ib
from imubayes.algebra.factor import reorder
from imubayes.errors import TermError
from imubayes.inference.prior import ScalePrior
from imubayes.inference.summary import Summary, summarize
from imubayes.selection.decision import WIDTHS, select
from imubayes.selection.enumerate import enumerate_models

CLASSES = ("mems_industrial", "mems_tactical", "mems_industrial")
SPHERE = ("b0", "b2", "c_jj", "c_kk")
EVEN = {"K2 alone": ("b2",), "Kpp = Koo": ("c_jj", "c_kk"), "Koo alone": ("c_kk",)}
LEAN = {"powers": 3, "asymmetry": 0}  # 12 terms at 1 g: the slide library of 14 is among the slow ones
RATES = np.radians([0.0, 10.0, 50.0, 150.0, 300.0, -10.0, -50.0, -150.0, -300.0])


@cache
def procedure(name):
    return {
        "tumble": ib.tumble(angles=12, planes=3, rate=1.0),
        "centrifuge": ib.centrifuge([1, 5, 20], rate=1.0),
        "rate table": ib.rate_table(RATES, rate=1.0),
    }[name]


def chosen(class_id, procedures, truth, seed):
    plans = [procedure(name) for name in procedures]
    return campaign_of(class_id, plans, seed=seed, truth=truth, **LEAN).selection


def by_name(selection):
    return {term.name: term for term in selection.terms}


def needed(selection):
    return {term.name for term in selection.terms if term.verdict == "needed"}


def assert_within_four_sd(selection, truth):
    for term in selection.terms:
        if term.verdict != "untested":
            assert abs(term.full_mean - truth.get(term.name, 0.0)) < 4.0 * term.full_sd, term.name


def even_truth(class_id, which, seed):
    """A bias of 1.5 to 3, even terms of 1 to 2, odd ones of 1.5 typical sizes of the class; signs vary."""
    sd, sign = typical(class_id), (-1.0) ** seed
    truth = {name: (1.0 + 0.5 * seed) * sd[name] for name in EVEN[which]}
    return truth | {
        "b0": sign * (1.5 + 0.75 * seed) * sd["b0"],
        "b1": 1.5 * sd["b1"],
        "m_j": -1.5 * sd["m_j"],
    }


@pytest.mark.parametrize(("class_id", "which", "seed"), [*zip(CLASSES, EVEN, range(3), strict=True)])
def test_tumble_alone_leaves_even_terms_inseparable_whichever_is_true(class_id, which, seed):
    truth = even_truth(class_id, which, seed)
    selection = chosen(class_id, ["tumble"], truth, seed)
    terms = by_name(selection)
    assert needed(selection) == {"b0", "b1", "m_j"}
    for name in ("b2", "c_jj", "c_kk"):
        assert terms[name].verdict == "inseparable"
        assert "a centrifuge run would separate them" in terms[name].reason
    for name in SPHERE:
        assert terms[name].confounded_with == tuple(other for other in SPHERE if other != name)
    assert abs(terms["b0"].mean - truth["b0"]) < 4.0 * terms["b0"].sd
    assert_within_four_sd(selection, truth)
    # the others could hide a bias of g^2 times their size: the error bar says so
    hidden = 9.80665**2 * min(typical(class_id)[name] for name in ("b2", "c_jj", "c_kk"))
    assert terms["b0"].sd > 0.3 * hidden


@pytest.mark.parametrize(("class_id", "which"), [*zip(CLASSES, EVEN, strict=True)])
def test_centrifuge_separates_them_and_finds_the_true_one(class_id, which):
    truth = even_truth(class_id, which, 2)
    selection = chosen(class_id, ["tumble", "centrifuge"], truth, 2)
    terms = by_name(selection)
    assert needed(selection) == {"b0", "b1", "m_j", *EVEN[which]}
    assert all(terms[name].verdict != "inseparable" for name in SPHERE)
    assert all(terms[name].confounded_with == () for name in SPHERE)
    assert_within_four_sd(selection, truth)


@pytest.mark.parametrize("seed", range(2))
def test_zero_terms_are_never_needed_and_strong_ones_always(seed):
    sd = typical("quartz_flexure_servo")
    truth = {
        "b0": 2.0 * sd["b0"],
        "b1": -1.5 * sd["b1"],
        "m_k": sd["m_k"],
        "b2": 1.5 * sd["b2"],
        "c_ij": sd["c_ij"],
    }
    selection = chosen("quartz_flexure_servo", ["tumble", "centrifuge"], truth, seed)
    strong = {t.name for t in selection.terms if t.name in truth and abs(truth[t.name]) > 8.0 * t.full_sd}
    assert {"b0", "b1", "m_k", "b2"} <= strong <= needed(selection) <= set(truth)
    assert_within_four_sd(selection, truth)


@pytest.fixture(scope="module")
def campaign():
    """One selection that the laws below are checked on, with its summary and prior."""
    sd = typical("mems_tactical")
    truth = {
        "b0": 2.0 * sd["b0"],
        "b1": sd["b1"],
        "b2": 1.5 * sd["b2"],
        "m_j": sd["m_j"],
        "c_ij": 0.1 * sd["c_ij"],
    }
    return campaign_of(
        "mems_tactical", [procedure("tumble"), procedure("centrifuge")], seed=4, truth=truth, **LEAN
    )


def excited(campaign):
    """Summary and prior of the columns that the test excites."""
    summary, prior = campaign.summary, campaign.prior
    tested = summary.factor.column_norms > 0.0
    names = tuple(name for name, told in zip(summary.names, tested, strict=True) if told)
    return Summary(reorder(summary.factor, names)), ScalePrior(prior.sd[tested])


def test_inclusion_range_is_that_of_the_enumerations_at_each_width(campaign):
    selection, (summary, prior) = campaign.selection, excited(campaign)
    by_width = {w: enumerate_models(summary, ScalePrior(w * prior.sd)) for w in WIDTHS}
    for term in selection.terms:
        if term.verdict == "untested":
            continue
        own = [m.inclusion[m.names.index(term.name)] for m in by_width.values()]
        assert term.inclusion_range == pytest.approx((min(own), max(own)), abs=1e-9)
        assert term.inclusion == pytest.approx(own[WIDTHS.index(1.0)], abs=1e-9)
    assert selection.log_evidence == pytest.approx(by_width[1.0].log_evidence, rel=1e-12)


def test_full_library_moments_are_those_of_ridge_regression(campaign):
    """Given the noise scale the posterior is N(A^-1 X'y, s^2 A^-1); the scale is known to 1/sqrt(2n) here."""
    summary, prior = excited(campaign)
    sd, R = prior.sd, summary.factor.R
    precision = (R[:-1, :-1].T @ R[:-1, :-1] * sd * sd[:, None]) + np.eye(len(sd))  # in prior sds
    mean = sd * np.linalg.solve(precision, sd * (R[:-1, :-1].T @ R[:-1, -1]))
    width = sd * np.sqrt(np.diag(np.linalg.inv(precision)))
    terms = by_name(campaign.selection)
    for name, expected, spread in zip(summary.names, mean, width, strict=True):
        assert terms[name].full_sd == pytest.approx(spread, rel=0.1)
        assert abs(terms[name].full_mean - expected) < 0.1 * spread


def test_largest_effect_is_the_mean_times_the_reach_of_its_column(campaign):
    summary, _, _, selection = campaign
    terms = by_name(selection)
    assert terms["b0"].effect == pytest.approx(abs(terms["b0"].mean))
    largest = max(run.ranges["f_i"][1] for run in summary.runs)
    assert terms["b1"].effect == pytest.approx(abs(terms["b1"].mean) * largest)


def test_untested_terms_keep_their_prior(campaign):
    untested = [t for t in campaign[-1].terms if t.verdict == "untested"]
    assert {t.name for t in untested} == {"s_i", "s_j", "s_k"}
    for term in untested:
        assert term.mean == term.full_mean == term.effect == 0.0
        assert term.full_sd == term.prior_sd
        assert term.sd == pytest.approx(term.prior_sd * math.sqrt(term.inclusion))
        assert term.q05 == pytest.approx(-term.q95)
        assert term.limit95 == pytest.approx(1.959964 * term.prior_sd, rel=1e-5)  # given that it is there


def gyro_without_cross_rates():
    """Extended library of first order without c_ij ... c_kk: 13 terms that a rate table excites."""
    lib = ib.library("gyroscope", powers=1, asymmetry=-1, set="extended")
    return replace(lib, terms=tuple(t for t in lib.terms if t.group != "cross terms"))


@pytest.mark.parametrize("size", [0.0, 4.0])
def test_gyro_bias_at_one_g_is_needed_when_large_and_never_given_to_its_g_squared_terms(size):
    sensor, lib = ib.sensor("mems_tactical", kind="gyroscope"), gyro_without_cross_rates()
    prior = ib.prior(sensor, lib)
    sd = dict(zip(lib.names, prior.sd.tolist(), strict=True))
    truth = {"b0": size * sd["b0"], "b1": 2.0 * sd["b1"], "g_j": 2.0 * sd["g_j"]}
    runs = ib.simulate(sensor, [procedure("rate table")], seed=1, truth=truth)
    selection = select(summarize(runs, lib, sensor=sensor), prior)
    terms, hidden = by_name(selection), ("b0", "S_ii", "S_jj", "S_kk")
    for name in hidden:
        assert terms[name].confounded_with == tuple(other for other in hidden if other != name)
    assert needed(selection) == ({"b0", "b1", "g_j"} if size else {"b1", "g_j"})
    assert all(terms[name].verdict in ("inseparable", "not needed") for name in hidden[1:])
    assert abs(terms["b0"].mean - truth["b0"]) < 4.0 * terms["b0"].sd


@pytest.mark.parametrize("rows", [6, 12, 100])
def test_rows_no_more_than_the_columns_tell_no_scale_of_the_noise(rows):
    rng, lib = np.random.default_rng(rows), ib.library("accelerometer", powers=2, asymmetry=-1)
    X = rng.normal(size=(rows, len(lib.names)))
    summary = Summary.from_arrays(X, X[:, 0] + rng.normal(size=rows), lib.names)
    scales = select(summary, ScalePrior(np.full(len(lib.names), 2.0)), lib).models.scales.at
    assert (scales.tolist() == [1.0]) == (rows <= len(lib.names))


def test_plain_arrays_have_no_verdicts():
    plain = Summary.from_arrays(np.eye(5)[:, :2], np.ones(5), ("b0", "b1"))
    with pytest.raises(TermError, match="give the library"):
        select(plain, ScalePrior([1.0, 1.0]))


def test_a_term_of_another_component_is_in_every_model(campaign):
    """The same terms, some of them as another component's: they are named, not decided."""
    summary, prior, _, selection = campaign
    lib = ib.library("accelerometer", **LEAN)
    named = replace(
        summary,
        factor=replace(
            summary.factor,
            names=tuple(f"{'ay' if t.group == 'bias and scale' else 'ax'}.{t.name}" for t in lib.terms),
        ),
        reach={},
    )
    rest = replace(lib, terms=tuple(t for t in lib.terms if t.group != "bias and scale"))
    part = by_name(select(named, prior, rest, component="ax"))
    assert set(part) == set(rest.names)
    whole = by_name(selection)
    for name in ("m_j", "m_k", "c_jk"):
        assert part[name].verdict == whole[name].verdict
        assert abs(part[name].full_mean - whole[name].full_mean) < 0.1 * whole[name].full_sd


@cache
def drawn(seed):
    """Decision on a random problem: terms from none to far above the noise, and one untested."""
    rng, names = np.random.default_rng(seed), ("b0", "b1", "b2", "b3", "m_j", "m_k", "s_k")
    X = rng.normal(size=(80, 7)) + rng.choice([0.0, 1.0]) * rng.normal(size=(80, 1))
    X[:, 6] = 0.0
    theta = rng.integers(0, 2, size=7) * 10.0 ** rng.uniform(-2.0, 0.5, size=7)
    lib = ib.library("accelerometer", powers=3, asymmetry=-1)
    own = replace(lib, terms=tuple(term for term in lib.terms if term.name in names))
    summary = ib.Summary.from_arrays(X, X @ theta + rng.normal(size=80), own.names)
    return select(summary, ScalePrior(10.0 ** rng.uniform(0.0, 1.5, size=7)), own)


def test_no_verdict_speaks_against_the_model_or_an_inclusion_above_one_half():
    terms = [(term, selection.model) for selection in map(drawn, range(40)) for term in selection.terms]
    assert {"needed", "not needed", "undecided", "untested"} == {term.verdict for term, _ in terms}
    assert any(0.05 < term.inclusion <= 0.5 and term.verdict == "not needed" for term, _ in terms)
    assert any(term.reason.startswith("there, but below a tenth") for term, _ in terms)
    assert any(term.inclusion > 0.5 and term.verdict == "untested" for term, _ in terms)
    for term, model in terms:
        there = term.inclusion >= 0.5 and term.verdict != "untested"
        assert (term.name in model) == there
        assert not (there and term.verdict == "not needed")
