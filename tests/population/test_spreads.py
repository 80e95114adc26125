"""Populations of units, recorded and drawn: dense algebra, mixed models, truths held."""

import math
from statistics import NormalDist

import numpy as np
import pytest
from scipy.integrate import dblquad
from scipy.stats import multivariate_normal

from imubayes.algebra.factor import factor_of, posterior
from imubayes.inference import frequency
from imubayes.inference.summary import pulls
from imubayes.population.levels import (
    Likelihoods,
    Version,
    between_sd,
    block_of,
    likelihoods,
    of_versions,
    over_sessions,
)
from imubayes.population.spreads import spread, spreads
from imubayes.sensors.catalogue import classes
from imubayes.sensors.lots import draw_lot, lot_sizes
from imubayes.sensors.terms import library

SIZE = 1.0


def drawn(rng, sds, *, units=8, sessions=3, aliases=2, mean=0.3):
    """A lot of units: (own, unit, common) sds, errors of unlike size, and what their tests book alike."""
    own, unit, common = sds
    shape = (units, sessions)
    noise = rng.uniform(0.02, 0.06, shape)
    alias = rng.uniform(0.0, 0.05, (*shape, aliases))
    value = mean + unit * rng.normal(size=(units, 1)) + common * rng.normal(size=sessions)
    value = value + own * rng.normal(size=shape) + noise * rng.normal(size=shape)
    booked = np.einsum("usk,uk->us", alias, rng.normal(size=(units, aliases)))
    return Likelihoods(value + booked, noise, alias)


def dense(one, own, unit, common):
    """Restricted log likelihood from the covariance of all sessions of all units; sds of any one shape."""
    u, s = np.nonzero(np.isfinite(one.value))
    own, unit, common = (np.asarray(sd)[..., None, None] for sd in (own, unit, common))
    y, alias, n = one.value[u, s], one.alias[u, s], len(u)
    V = np.diag(one.noise[u, s] ** 2) + own**2 * np.eye(n) + common**2 * (s[:, None] == s)
    V = V + (u[:, None] == u) * (unit**2 + alias @ alias.T)
    inverse = np.linalg.inv(V)
    a, b = inverse.sum(axis=(-1, -2)), inverse.sum(axis=-1) @ y
    return -0.5 * (np.linalg.slogdet(V)[1] + np.log(a) + inverse @ y @ y - b**2 / a)


def test_likelihood_of_the_three_spreads_is_that_of_the_dense_covariance():
    one = drawn(np.random.default_rng(1), (0.1, 0.5, 0.2))
    one.value[0, 1] = one.value[3, 0] = np.nan
    sds = np.array([1e-9, 0.03, 0.4])
    found = over_sessions(block_of(one, sds, sds), sds)[0]
    expected = dense(one, *np.meshgrid(sds, sds, sds, indexing="ij"))
    away = found - expected
    assert np.ptp(away) < 1e-9 * np.ptp(expected)


def test_posterior_is_the_integral_over_the_spreads():
    """Second route: the dense likelihood, summed over cells of what the priors are uniform in."""
    one = drawn(np.random.default_rng(2), (0.15, 0.6, 0.3), units=4, sessions=3)
    found = spreads([one], SIZE)
    edges = np.linspace(0.0, 1.0, 37) ** 2  # finer where the sds are small
    angles = np.linspace(0.0, 1.0, 31)
    shares = np.sin(0.5 * math.pi * angles) ** 2
    of_sd, of_angle = (0.5 * (x[1:] + x[:-1]) for x in (edges, angles))
    of_share = np.sin(0.5 * math.pi * of_angle) ** 2
    sds = SIZE * np.tan(0.5 * math.pi * of_sd)
    turn_on, share, unit = np.meshgrid(sds, of_share, sds, indexing="ij")
    log = dense(one, turn_on * np.sqrt(1.0 - share), unit, turn_on * np.sqrt(share))
    weight = np.exp(log - log.max()) * np.diff(edges)
    weight *= np.diff(edges)[:, None, None]
    three = found.turn_on, found.common_share, found.unit_to_unit
    for axis, (one_of, ends) in enumerate(zip(three, (edges, shares, edges), strict=True)):
        marginal = weight.sum(axis=tuple(k for k in range(3) if k != axis))
        reached = np.append(0.0, np.cumsum(marginal)) / marginal.sum()
        # a cell holds up to a tenth of the posterior; within it the density is taken as flat
        for point, level in ((one_of.low, 0.05), (one_of.value, 0.5), (one_of.high, 0.95)):
            place = point if axis == 1 else math.atan(point / SIZE) / (0.5 * math.pi)
            assert np.interp(place, ends, reached) == pytest.approx(level, abs=0.01), axis


def by_differences(value, noise):
    """5 % and 95 % points of the sd between sessions, from the density of the differences within units."""
    step, tau = np.diff(np.eye(value.shape[1]), axis=0), np.geomspace(1e-3, 1e3, 1500)
    log = np.log(tau) - np.log1p((tau / SIZE) ** 2)
    for y, e in zip(value, noise, strict=True):
        cov = step @ (np.eye(len(e)) * (e**2 + tau[:, None, None] ** 2)) @ step.T
        log += [multivariate_normal(cov=one).logpdf(step @ y) for one in cov]
    reached = np.cumsum(np.exp(log - log.max()))
    return np.interp((0.05, 0.95), reached / reached[-1], tau)


def test_units_that_share_no_session_have_the_turn_on_of_their_sessions_alone():
    rng = np.random.default_rng(5)
    value = 30.0 * rng.normal(size=(6, 1)) + 0.3 * rng.normal(size=(6, 3))
    noise = rng.uniform(0.05, 0.2, value.shape)
    apart = np.full((6, 18), np.nan)
    errors = np.full((6, 18), np.nan)
    for k in range(6):
        apart[k, 3 * k : 3 * k + 3], errors[k, 3 * k : 3 * k + 3] = value[k], noise[k]
    found = spreads([Likelihoods(apart, errors, np.zeros((6, 18, 0)))], SIZE)
    assert math.isnan(found.turn_on_common.value)
    expected = by_differences(value, noise)
    assert (found.turn_on.low, found.turn_on.high) == pytest.approx(expected, rel=0.02)
    alone = Likelihoods(value, noise, np.zeros((6, 3, 0)))
    assert between_sd(alone, SIZE)[1:] == pytest.approx(expected, rel=0.02)


def test_what_a_test_books_to_a_coefficient_is_no_change_between_sessions():
    """The split of a session's error: the covariance of repeated noise, from the normal equations."""
    rng = np.random.default_rng(6)
    X = rng.normal(size=(9, 4)) @ np.diag([1.0, 1.0, 1e-2, 1.0])
    X[:, 1] += 0.99 * X[:, 0]
    prior = np.array([0.5, 0.3, 0.4, 2.0])
    data = factor_of(X, rng.normal(size=9), tuple("abcd"))
    scale = 1.0
    mean, sd = posterior(data, prior, scale)
    cov = np.linalg.inv(X.T @ X + np.diag(prior**-2.0))
    pull = np.array([[[cov[0, k] / prior[k] for k in (1, 2, 3)]]])
    found = likelihoods(mean[:1, None], sd[:1, None], prior[:1, None], pull)
    share = 1.0 - cov[0, 0] / prior[0] ** 2
    noise = (cov @ X.T @ X @ cov)[0, 0] / share**2
    assert found.noise[0, 0] ** 2 == pytest.approx(noise, rel=1e-8)
    others = cov @ np.diag(prior**-2.0)
    booked = np.array([others[0, k] * prior[k] / share for k in (1, 2, 3)])
    np.testing.assert_allclose(found.alias[0, 0], booked, rtol=1e-8)


def test_pulls_are_covariances_over_the_priors_sds():
    rng = np.random.default_rng(7)
    X, y, prior = rng.normal(size=(40, 3)), rng.normal(size=40), np.array([0.2, 0.5, 3.0])
    scale2 = np.linalg.lstsq(X, y)[1][0] / 37.0
    cov = np.linalg.inv(X.T @ X / scale2 + np.diag(prior**-2.0))
    found = pulls(factor_of(X, y, ("a", "b", "c")), prior, ("c", "a"))
    for k, name in enumerate("abc"):
        np.testing.assert_allclose(found[name], cov[[2, 0], k] / prior[k], rtol=1e-9)


def test_one_session_leaves_turn_on_in_the_spread_of_the_units():
    rng = np.random.default_rng(11)
    one = drawn(rng, (0.3, 0.4, 0.0), units=200, sessions=1)
    found = spreads([one], SIZE)
    assert math.isnan(found.turn_on.value) and math.isnan(found.common_share.value)
    # 200 units: 5 % of the spread is one sd
    assert found.unit_to_unit.value == pytest.approx(0.5, rel=0.2)


def test_shifts_of_sessions_are_their_distances_from_the_mean_of_all():
    rng = np.random.default_rng(12)
    shift = np.array([-0.5, 0.1, 0.4])
    value = rng.normal(size=(40, 1)) + shift + 0.05 * rng.normal(size=(40, 3))
    found = spreads([Likelihoods(value, np.full(value.shape, 0.01), np.zeros((40, 3, 0)))], SIZE)
    assert found.shift.sum() == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(found.shift, shift, atol=4.0 * 0.05 / math.sqrt(40.0))
    np.testing.assert_allclose(found.shift_sd, 0.05 * math.sqrt(2.0 / 3.0 / 40.0), rtol=0.3)
    assert found.common_share.low > 0.5


def test_intervals_hold_the_truth_of_lots_drawn_from_the_prior():
    """Exact for the spreads: 90 % of 60 lots, within 3 standard errors."""

    rng, held = np.random.default_rng(14), []
    for _ in range(60):
        turn_on, unit = SIZE * np.tan(0.5 * math.pi * rng.random(2))
        angle = 0.5 * math.pi * rng.random()
        own, common = turn_on * math.cos(angle), turn_on * math.sin(angle)
        mean = 0.3 * rng.normal()
        found = spreads([drawn(rng, (own, unit, common), mean=mean)], SIZE)
        further = mean + math.sqrt(own**2 + unit**2 + common**2) * rng.normal()
        sizes = found.turn_on_own, found.unit_to_unit, found.turn_on_common, found.turn_on
        truths = own, unit, common, turn_on, mean, further
        shares = zip((*sizes, found.mean, found.next_unit), truths, strict=True)
        held.append([share.low < truth < share.high for share, truth in shares])
    share = np.mean(held, axis=0)
    assert np.all(np.abs(share - 0.9) < 3.0 * math.sqrt(0.09 / 60)), share


@pytest.mark.parametrize("n", [2, 20, 100, 1000])
def test_versions_of_what_units_share_have_its_mean_and_sd_or_it_is_lost_in_the_units_mean(n):
    rng = np.random.default_rng(n)
    for common in (1e-3, 0.01, 0.05, 0.1, 0.3, 1.0, 5.0, 30.0):
        estimate = rng.normal(size=n) + 3.0 * common * rng.normal()
        weight, moved, variance = of_versions([Version(1.0, estimate, np.full(n, 0.5), common)])
        shift = (estimate - moved)[:, 0]
        assert weight.sum() == pytest.approx(1.0)
        assert np.all(variance == 0.5)
        if len(weight) == 1:
            assert common < 0.8 * math.sqrt(0.5 / n)
        else:
            assert weight @ shift == pytest.approx(0.0, abs=0.03 * common)
            assert math.sqrt(weight @ shift**2) == pytest.approx(common, rel=0.04)


@pytest.mark.parametrize("versions", [((1.0, 1.0, 0.0),), ((0.3, 1.0, 0.0), (0.7, 2.0, 0.4))])
def test_posterior_agrees_with_direct_integration_over_mean_and_spread(versions):
    """Of units whose errors are known, and of some that may share one of them."""
    estimate, variance, ends = np.array([0.3, 1.1, -0.4]), np.array([0.04, 0.25, 0.09]), (0.1, 5.0)
    told = [Version(weight, estimate, size * variance, common) for weight, size, common in versions]

    def density(mu, log_tau):
        tau, units = math.exp(log_tau), 0.0
        for weight, _, own, common in told:
            cov = np.diag(tau**2 + own) + common**2
            log = -0.5 * (estimate - mu) @ np.linalg.solve(cov, estimate - mu)
            units += weight * math.exp(log) / math.sqrt(np.linalg.det(cov))
        return NormalDist(0.0, tau).pdf(mu) * units

    def mass(log_low, log_high, low=-30.0, high=30.0):
        return dblquad(density, log_low, log_high, low, high, epsabs=1e-9, epsrel=1e-6)[0]

    mu, tau = spread(told, ends)
    bottom, top = (math.log(end) for end in ends)
    whole = mass(bottom, top, -6.0, 6.0)
    # a cell of the grid is 1 % of the spread, and holds less than 1 % of the posterior
    assert mass(bottom, math.log(tau.low), -6.0, 6.0) / whole == pytest.approx(0.05, abs=0.005)
    assert mass(bottom, math.log(tau.value), -6.0, 6.0) / whole == pytest.approx(0.5, abs=0.005)
    assert mass(bottom, top, -6.0, mu.high) / whole == pytest.approx(0.95, abs=0.005)


@pytest.mark.parametrize(
    "unknown", [pytest.param(1e-3, marks=pytest.mark.slow), 0.3, pytest.param(1.0, marks=pytest.mark.slow)]
)
def test_intervals_hold_mean_and_spread_of_lots_as_often_as_they_say(unknown):
    """Lots of 8 from every class; `unknown` is a unit's error over the typical size."""
    rng = np.random.default_rng(3)
    held = []
    for kind in ("accelerometer", "gyroscope"):
        lib = library(kind)
        for entry in classes(kind):
            low, high = lot_sizes(entry, lib)
            lot = draw_lot(entry, lib, 8, rng)
            sd = unknown * np.sqrt(low * high) * np.ones((8, 1))
            seen = lot.theta + sd * rng.standard_normal(lot.theta.shape)
            for j in range(len(low)):
                ends = low[j] / math.sqrt(2.0), high[j]
                mu, tau = spread([Version(1.0, seen[:, j], sd[:, j] ** 2, 0.0)], ends)
                held.append(mu.low <= lot.mean[j] <= mu.high)
                held.append(tau.low <= lot.sd[j] <= tau.high)
    # figures that terms of a class have in common make about a third of the cases independent
    error = math.sqrt(0.9 * 0.1 / (len(held) / 3.0))
    assert 0.86 - error < np.mean(held) < 0.94 + error


def test_a_share_that_was_always_or_never_met_is_inside_its_interval():
    assert frequency(0, 6).low == 0.0
    assert frequency(6, 6).high == 1.0
    assert 0.5 < frequency(6, 6).low < 1.0
    assert (frequency(0, 0).low, frequency(0, 0).high) == (0.0, 1.0)
