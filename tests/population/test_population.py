import math
from statistics import NormalDist

import numpy as np
import pytest
from scipy.integrate import dblquad
from scipy.stats import beta, chi2

from imubayes.inference.intervals import frequency
from imubayes.population.spreads import lot_sizes, spread
from imubayes.sensors.catalogue import classes
from imubayes.sensors.lots import draw_lot
from imubayes.sensors.terms import library


def test_posterior_agrees_with_direct_integration_over_mean_and_spread():
    estimate, variance, ends = np.array([0.3, 1.1, -0.4]), np.array([0.04, 0.25, 0.09]), (0.1, 5.0)

    def density(mu, log_tau):
        tau = math.exp(log_tau)
        spreads = np.sqrt(tau**2 + variance)
        units = np.prod([NormalDist(mu, s).pdf(t) for t, s in zip(estimate, spreads, strict=True)])
        return NormalDist(0.0, tau).pdf(mu) * float(units)

    def mass(log_low, log_high, low=-30.0, high=30.0):
        return dblquad(density, log_low, log_high, low, high, epsabs=1e-9, epsrel=1e-6)[0]

    mu, tau = spread(estimate, variance, ends)
    bottom, top = (math.log(end) for end in ends)
    whole = mass(bottom, top, -6.0, 6.0)
    # a cell of the grid is 1 % of the spread, and holds less than 1 % of the posterior
    assert mass(bottom, math.log(tau.low), -6.0, 6.0) / whole == pytest.approx(0.05, abs=0.005)
    assert mass(bottom, math.log(tau.value), -6.0, 6.0) / whole == pytest.approx(0.5, abs=0.005)
    assert mass(bottom, top, -6.0, mu.high) / whole == pytest.approx(0.95, abs=0.005)


def test_spread_of_exact_estimates_is_that_of_many_normal_draws():
    n = 400
    theta = 2.0 + 3.0 * np.random.default_rng(1).standard_normal(n)
    mu, tau = spread(theta, np.zeros(n), (1e-3, 1e3))
    s2 = float(np.var(theta, ddof=1)) * (n - 1)
    low, high = np.sqrt(s2 / chi2(n - 1).ppf([0.95, 0.05]))
    # the prior of the mean, N(0, spread^2), counts as one unit of 400; a cell of this wide grid is 3.5 %
    assert tau.low == pytest.approx(low, rel=0.01)
    assert tau.high == pytest.approx(high, rel=0.01)
    assert mu.value == pytest.approx(theta.mean() * n / (n + 1), rel=1e-3)


def test_scatter_of_the_measurements_is_not_taken_for_the_populations():
    rng = np.random.default_rng(2)
    estimate = 1.0 + rng.standard_normal(10)
    assert spread(estimate, np.full(10, 1.0), (1e-3, 1e3))[1].low < 0.1
    assert spread(estimate, np.full(10, 1e-6), (1e-3, 1e3))[1].low > 0.5


def test_a_badly_measured_unit_counts_for_nothing():
    estimate, variance = np.array([1.0, 1.2, 0.8, 50.0]), np.array([1e-4, 1e-4, 1e-4, 1e12])
    with_it, without = (spread(estimate[:n], variance[:n], (1e-2, 1e2)) for n in (4, 3))
    assert with_it[0].value == pytest.approx(without[0].value, rel=1e-6)
    assert with_it[1].high == pytest.approx(without[1].high, rel=1e-6)


def test_unit_of_measure_scales_mean_and_spread():
    estimate, variance = np.array([1.0, 2.0, 4.0]), np.array([0.1, 0.2, 0.1])
    mu, tau = spread(estimate, variance, (1e-2, 1e2))
    small = spread(1e-6 * estimate, 1e-12 * variance, (1e-8, 1e-4))
    assert small[1].value == pytest.approx(1e-6 * tau.value, rel=1e-9)
    assert small[0].low == pytest.approx(1e-6 * mu.low, rel=1e-9)


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
                mu, tau = spread(seen[:, j], sd[:, j] ** 2, (low[j] / math.sqrt(2.0), high[j]))
                held.append(mu.low <= lot.mean[j] <= mu.high)
                held.append(tau.low <= lot.sd[j] <= tau.high)
    # figures that terms of a class have in common make about a third of the cases independent
    error = math.sqrt(0.9 * 0.1 / (len(held) / 3.0))
    assert 0.86 - error < np.mean(held) < 0.94 + error


def test_lots_lie_within_the_sizes_of_their_class():
    rng = np.random.default_rng(4)
    for kind in ("accelerometer", "gyroscope"):
        lib = library(kind, set="extended")
        for entry in classes(kind):
            low, high = lot_sizes(entry, lib)
            for _ in range(5):
                sd = draw_lot(entry, lib, 1, rng).sd
                # spread of a lot is sqrt(1 - r) of its size, with a share r of 0.1 or 0.5
                assert np.all(sd >= math.sqrt(0.5) * low * (1.0 - 1e-9)), entry.id
                assert np.all(sd <= math.sqrt(0.9) * high * (1.0 + 1e-9)), entry.id


@pytest.mark.parametrize(("count", "n"), [(3, 10), (1, 6), (7, 8)])
def test_share_has_the_interval_of_jeffreys_beta_posterior(count, n):
    found = frequency(count, n)
    assert (found.low, found.high) == pytest.approx(beta(count + 0.5, n - count + 0.5).ppf([0.05, 0.95]))
    assert found.low < found.value < found.high


def test_a_share_that_was_always_or_never_met_is_inside_its_interval():
    assert frequency(0, 6).low == 0.0
    assert frequency(6, 6).high == 1.0
    assert 0.5 < frequency(6, 6).low < 1.0
    assert (frequency(0, 0).low, frequency(0, 0).high) == (0.0, 1.0)
