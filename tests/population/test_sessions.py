"""Recorded units, session by session: closed forms, other routes, and frequencies that the numbers promise.
Units of one class in a study: what is put together, and what is not."""

import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import integrate, stats

import imubayes as ib
from imubayes.algebra.factor import Factor, factor_of, posterior
from imubayes.campaign import Sampling, SensorSpec, Study
from imubayes.errors import StudyError
from imubayes.population.levels import Likelihoods, between_sd
from imubayes.population.sessions import (
    Repeatability,
    SessionVerdict,
    in_common,
    pooled_by_kind,
    repeatability,
    without_prior,
)
from imubayes.rig.recordings import RunSpec
from imubayes.sensors.noise import Noise, NoiseRule
from imubayes.study import method

PRIOR = 0.4


def told(unit, session, component, name, mean, sd, prior_sd, pulls=None) -> SessionVerdict:
    """What a session says of a term, and how it leans on other columns."""
    posterior = {"full_mean": mean, "full_sd": sd, "prior_sd": prior_sd, "verdict": "needed"}
    term = SimpleNamespace(name=name, unit="m/s^2", printed="mg", **posterior)
    return SessionVerdict(unit, session, component, term, pulls or {})


def alone(value, error) -> Likelihoods:
    """Likelihoods of a coefficient that the tests see by itself."""
    return Likelihoods(value, error, np.zeros((*value.shape, 0)))


def compared(value, error, prior_sd=PRIOR) -> Repeatability:
    """Compare likelihoods: what their posteriors under the prior give."""
    precision = 1.0 / error**2 + 1.0 / prior_sd**2
    mean, sd = value / error**2 / precision, 1.0 / np.sqrt(precision)
    (found,) = repeatability(
        told(str(u), str(s), "", "b0", mean[u, s], sd[u, s], prior_sd)
        for s, u in np.ndindex(value.T.shape)
        if np.isfinite(value[u, s])
    )
    return found


def drawn(rng, tau, *, units=8, sessions=3):
    """Likelihoods of units with unlike means, errors that differ, and a scatter of tau between sessions."""
    error = rng.uniform(0.5e-3, 2e-3, (units, sessions))
    value = 0.3 * rng.normal(size=(units, 1)) + tau * rng.normal(size=error.shape)
    return value + error * rng.normal(size=error.shape), error


def test_prior_is_divided_out_of_a_marginal_posterior():
    """Second route: the posterior of the same rows with that coefficient's prior a million times wider."""
    rng = np.random.default_rng(1)
    X = rng.normal(size=(12, 3)) @ np.array([[1.0, 0.6, 0.0], [0.0, 1.0, 0.3], [0.0, 0.0, 1.0]])
    data: Factor = factor_of(X, X @ np.array([0.5, -0.3, 0.2]) + rng.normal(size=12), ("a", "b", "c"))
    prior, wide = np.array([0.3, 0.2, 0.4]), np.array([0.3e6, 0.2, 0.4])
    mean, sd = posterior(data, prior)
    value, error = without_prior(mean, sd, prior)
    free_mean, free_sd = posterior(data, wide)
    assert value[0] == pytest.approx(free_mean[0], rel=1e-9)
    assert error[0] == pytest.approx(free_sd[0], rel=1e-9)


def test_shrunk_posteriors_of_different_sharpness_do_not_pull():
    """One value seen with different errors: its posteriors differ by what the prior shrinks them."""
    found = compared(np.array([[0.5, 0.5, 0.5]]), np.array([[0.02, 0.2, 0.4]]))
    assert np.ptp(found.mean) > 0.2
    np.testing.assert_allclose(found.pulls, 0.0, atol=1e-12)
    assert found.p_value == pytest.approx(1.0, abs=1e-12)


def test_two_sessions_of_one_unit_have_a_closed_form():
    value, error = np.array([[0.010, 0.016]]), np.array([[0.002, 0.003]])
    found = compared(value, error)
    pull = 0.006 / math.hypot(0.002, 0.003)
    assert found.pulls[0, 1, 0] == pytest.approx(pull, rel=1e-9)
    assert found.p_value == pytest.approx(math.erfc(pull / math.sqrt(2.0)), rel=1e-9)

    def density(tau):
        spread = math.sqrt(0.002**2 + 0.003**2 + 2.0 * tau**2)
        return stats.norm.pdf(0.006, 0.0, spread) / (1.0 + (tau / PRIOR) ** 2)

    edges = [0.0, 1e-3, 1e-2, 0.1, 1.0, 10.0, np.inf]

    def integral(f):
        return sum(integrate.quad(f, a, b, epsabs=0.0, epsrel=1e-9)[0] for a, b in pairwise(edges))

    whole = integral(density)
    assert found.between[0] == pytest.approx(integral(lambda tau: tau * density(tau)) / whole, rel=1e-4)
    for point, share in zip(found.between[1:], (0.05, 0.95), strict=True):
        below = integral(lambda tau, point=point: density(tau) * (tau < point)) / whole
        assert below == pytest.approx(share, abs=1e-3)


def test_exact_sessions_leave_the_inverse_chi_law():
    """Without errors tau^2 is S / chi2 with one degree of freedom less, for tau comes in flat."""
    rng = np.random.default_rng(2)
    value = rng.normal(size=(8, 3))
    S = float(((value - value.mean(axis=1, keepdims=True)) ** 2).sum())
    mean, q05, q95 = between_sd(alone(value, np.full(value.shape, 1e-6)), 1e4)
    freedom = 8 * 2 - 1
    # the grid's step of 0.01 in ln tau squared, times the slope of the density (about 10), over 8
    assert q05 == pytest.approx(math.sqrt(S / stats.chi2.ppf(0.95, freedom)), rel=1e-3)
    assert q95 == pytest.approx(math.sqrt(S / stats.chi2.ppf(0.05, freedom)), rel=1e-3)
    # E[chi^-1] in closed form
    ratio = math.exp(math.lgamma(0.5 * (freedom - 1)) - math.lgamma(0.5 * freedom)) / math.sqrt(2.0)
    assert mean == pytest.approx(math.sqrt(S) * ratio, rel=1e-4)


def test_unit_of_the_numbers_changes_nothing_but_the_unit():
    factor = 1.0 / 9.80665e-6
    value, error = drawn(np.random.default_rng(3), 2e-3)
    one, other = compared(value, error), compared(factor * value, factor * error, factor * PRIOR)
    np.testing.assert_allclose(other.pulls, one.pulls, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(np.array(other.between) / factor, one.between, rtol=1e-6)
    assert other.p_value == pytest.approx(one.p_value, rel=1e-8)
    assert other.shared == pytest.approx(one.shared, rel=1e-9)


def test_probability_of_the_scatter_is_uniform_where_sessions_repeat():
    rng = np.random.default_rng(6)
    p = [compared(*drawn(rng, 0.0)).p_value for _ in range(200)]
    assert stats.kstest(p, "uniform").pvalue > 0.01


def test_a_term_that_is_seen_only_beside_another_is_compared_as_sharply_as_their_sum():
    """Each session sees ``b0 + 2 b2`` to 0.01, by which b0 is known to 0.33: a unit keeps both."""
    rng, prior = np.random.default_rng(8), np.array([PRIOR, 0.3])

    def found(shift):
        unit, rows = prior * rng.normal(size=2), []
        for s in range(4):
            seen = unit @ (1.0, 2.0) + shift * (s == 3) + 0.01 * rng.normal()
            # the dense posterior of one row
            gain = prior**2 * (1.0, 2.0) / (prior**2 @ (1.0, 4.0) + 1e-4)
            cov = np.diag(prior**2) - np.outer(gain, prior**2 * (1.0, 2.0))
            sd, pulls = math.sqrt(cov[0, 0]), {"b2": cov[0, 1] / prior[1]}
            rows.append(told("A", str(s), "", "b0", gain[0] * seen, sd, PRIOR, pulls))
        (one,) = repeatability(rows)
        assert one.sd.min() > 0.3
        return one

    p = [found(0.0).p_value for _ in range(200)]
    assert stats.kstest(p, "uniform").pvalue > 0.01
    changed = found(0.1)
    assert changed.p_value < 1e-6
    assert changed.between[1] < 0.05 < changed.between[2]
    assert np.abs(changed.pulls[0, 3, :3]).min() > 3.0


def test_interval_of_the_sd_between_sessions_covers_as_often_as_it_says():
    """Truths from the prior: 90 % intervals then cover in 86 to 94 % of 200 sets, two standard errors."""
    rng, scale = np.random.default_rng(7), 2e-3
    hits = 0
    for _ in range(200):
        tau = scale * abs(rng.standard_cauchy())
        value, error = drawn(rng, tau)
        _, low, high = between_sd(alone(value, error), scale)
        hits += low < tau < high
    assert 0.86 <= hits / 200 <= 0.94


def test_missing_session_is_left_out_and_nothing_else():
    value, error = drawn(np.random.default_rng(9), 2e-3)
    value[0, 1] = np.nan
    whole = compared(value, error)
    without = compared(value[1:], error[1:])
    alone = compared(value[:1, [0, 2]], error[:1, [0, 2]])
    assert np.isnan(whole.pulls[0, 1]).all()
    assert whole.pulls[0, 2, 0] == pytest.approx(alone.pulls[0, 1, 0], rel=1e-12)
    chi2 = stats.chi2.isf(without.p_value, 14) + stats.chi2.isf(alone.p_value, 1)
    assert whole.p_value == pytest.approx(stats.chi2.sf(chi2, 15), rel=1e-6)


def test_common_shift_is_shared_and_independent_ones_are_not():
    rng = np.random.default_rng(10)
    error = np.full((40, 3), 1e-6)
    alike = compared(rng.normal(size=(40, 1)) + np.array([0.0, 1.0, 3.0]), error, 1e3)
    own = compared(rng.normal(size=(40, 3)), error, 1e3)
    assert alike.shared == pytest.approx(1.0, abs=1e-9)
    # by chance 1/u of the scatter, chi-square with 2 of 80 degrees of freedom: below 0.13 in 99.5 %
    assert own.shared < 0.13


def estimates(components=("ax", "ay"), sessions=("1", "2", "3"), seed=11):
    rng = np.random.default_rng(seed)
    return [
        told(unit, session, component, term, rng.normal(0.0, 1e-3), sd, PRIOR)
        for unit in ("A", "B")
        for session in sessions
        for component in components
        for term, sd in (("b0", 1e-3), ("b2", 0.98 * PRIOR), ("S_ij", PRIOR))
    ]


def test_axes_of_a_triad_are_compared_together_and_one_by_one():
    every = estimates()
    found = {one.parameter: one for one in repeatability(every)}
    assert list(found) == ["b0", "ax.b0", "ay.b0", "b2", "ax.b2", "ay.b2"]
    assert found["b0"].units == ("A.ax", "A.ay", "B.ax", "B.ay")
    chi2 = sum(stats.chi2.isf(found[f"{axis}.b0"].p_value, 4) for axis in ("ax", "ay"))
    assert found["b0"].p_value == pytest.approx(stats.chi2.sf(chi2, 8), rel=1e-9)
    assert found["ay.b0"].mean[1, 2] == next(
        e.term.full_mean
        for e in every
        if (e.unit, e.session, e.component, e.term.name) == ("B", "3", "ay", "b0")
    )


def test_axes_together_have_in_common_what_their_own_units_have():
    """A cause that moves x one way and z the other moves all units alike."""
    moved = {"ax": (0.0, 1.0, 2.0), "az": (3.0, 1.0, -4.0)}
    every = [
        told(unit, f"{k}", axis, "b0", shift, 1e-3, 1e3)
        for unit in ("A", "B", "C")
        for axis, shifts in moved.items()
        for k, shift in enumerate(shifts)
    ]
    found = {one.parameter: one.shared for one in repeatability(every)}
    assert list(found.values()) == pytest.approx([1.0, 1.0, 1.0], abs=1e-9)


def test_parameter_that_the_data_hardly_touch_cannot_be_told():
    found = {one.parameter: one for one in repeatability(estimates())}
    assert math.isfinite(found["b0"].p_value) and math.isnan(found["b2"].p_value)
    assert not found["b2"].exceeds and np.isnan(found["b2"].between).all()


def test_one_study_in_a_hundred_finds_a_change_where_sessions_differ_by_their_errors_alone():
    rng, studies, names = np.random.default_rng(4), 60, [f"c{k}" for k in range(12)]
    alarms = 0
    for _ in range(studies):
        found = repeatability(
            told("A", session, "", name, rng.normal(0.0, 1e-3), 1e-3, 1e3)
            for session in ("1", "2")
            for name in names
        )
        assert {one.level for one in found} == {0.01 / 12}
        alarms += any(one.exceeds for one in found)
    assert alarms <= stats.binom.isf(1e-4, studies, 0.01)


def test_session_that_is_there_twice_is_refused():
    every = estimates()
    with pytest.raises(StudyError, match="session '2' of unit 'A' is there twice"):
        repeatability([*every, replace(every[0], session="2")])


TUMBLE = {"profile": "tumble", "angles": 6, "planes": 2, "dwell": 5.0, "rate": 1.0}
NOISE = Noise(6e-4, 3e-4, 0.0)
UNITS, SESSIONS = ("A", "B", "C", "D"), ("1", "2")


def specs():
    """Four tactical accelerometers in two sessions, of which the second moves the bias of all of them."""
    rng = np.random.default_rng(1)
    usual = SensorSpec(
        id="",
        kind="accelerometer",
        sensor_class=ib.sensor("mems_tactical", kind="accelerometer"),
        library=ib.library("accelerometer", powers=1, asymmetry=-1),
        runs=(RunSpec("tumble", "tumble", simulate=TUMBLE, noise=NoiseRule("fixed", NOISE)),),
        truth={},
    )
    for unit in UNITS:
        b0, b1, m_j = rng.normal(0.0, (0.03, 6e-4, 5e-4))
        for session in SESSIONS:
            bias = b0 + 0.02 * (session == "2") + rng.normal(0.0, 1e-3)
            truth = {"b0": float(bias), "b1": float(b1), "m_j": float(m_j)}
            yield replace(usual, id=unit + session, unit=unit, session=session, truth=truth)


@pytest.fixture(scope="module")
def sensors():
    return tuple(specs())


@pytest.fixture(scope="module")
def result(sensors):
    how = Sampling(method="exact")
    return method.run(Study("four units", 1, sensors, Path("four.toml"), "", how, compare=False))


def terms(found):
    return {term.name: term for term in found.terms}


def paired(sensors, result):
    return [(spec, [one]) for spec, one in zip(sensors, result.sensors, strict=True)]


def test_tests_between_sessions_share_one_level_in_a_class(result):
    found = result.classes[0]
    tested = [term.spreads for term in found.terms if not math.isnan(term.spreads.p_value)]
    assert len(tested) > 1
    assert sum(one.level for one in tested) == pytest.approx(0.01)


def test_sessions_of_a_unit_are_compared(result):
    found = {one.parameter: one for one in result.sessions}
    assert found["b0"].units == UNITS and found["b0"].sessions == SESSIONS
    assert found["b0"].exceeds and not found["b1"].exceeds


def test_class_needs_what_its_units_need_and_tells_what_the_test_cannot(result):
    found = terms(result.classes[0])
    assert (found["b0"].need.verdict, found["b1"].need.verdict) == ("needed", "needed")
    # two sessions may be all that the bias is: only the rest is surely of the units
    assert found["b0"].need.pooled.inclusion < 0.95 < found["b1"].need.pooled.inclusion
    assert found["S_ij"].need.verdict == "cannot tell" and not found["S_ij"].told
    assert found["S_ij"].need.pooled is None


def test_sensors_without_a_unit_are_units_of_their_own(sensors, result):
    alone = [(replace(spec, unit="", session=""), found) for spec, found in paired(sensors, result)]
    (found,) = in_common(alone)
    assert found.units == tuple(spec.id for spec in sensors) and found.sessions == ("",)
    assert math.isnan(terms(found)["b0"].spreads.turn_on.value)


def test_three_units_or_units_without_a_class_have_no_population(sensors, result):
    every = paired(sensors, result)
    assert not tuple(in_common(every[:6]))
    assert not tuple(in_common([(spec, [replace(one, class_id="")]) for spec, (one,) in every]))


def test_weak_hints_of_three_components_add_up(sensors, result):
    """A term 2.5 standard errors from zero in each is of all of them, though none alone shows it."""
    selection = result.sensors[0].selection
    terms = tuple(
        replace(term, full_mean=2.5 * 0.3 * 0.954 * term.prior_sd, full_sd=0.287 * term.prior_sd)
        if term.name == "b1"
        else replace(term, full_sd=term.prior_sd)
        for term in selection.terms
    )
    one = replace(selection, terms=terms)
    few = replace(selection, terms=terms[:1])
    spec = sensors[0]
    alone = pooled_by_kind(spec, ["accelerometer"], [one])["accelerometer"]
    three = pooled_by_kind(spec, ["accelerometer"] * 3, [one] * 3)["accelerometer"]
    assert alone["b1"] < 0.95 < three["b1"] and three["b0"] == 0.5
    assert set(pooled_by_kind(spec, ["accelerometer"] * 2, [one, few])["accelerometer"]) == {terms[0].name}
