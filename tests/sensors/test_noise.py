"""The Allan variance of the modelled noise, by closed formulas. The noise processes' conventions: Allan
variances, densities, units and priors."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

from imubayes.inference.noise_fit import Spectrum, density
from imubayes.sensors.catalogue import sensor
from imubayes.sensors.noise import allan_variance, class_prior, flicker, gauss_markov_variance
from imubayes.units import factor

FLOOR = 2.0 * math.log(2.0) / math.pi
"""Allan variance of flicker noise over B^2 (IEEE 952 annex C)."""


def _sum_allan_variance(shortest, longest, ratio, tau):
    variance, tau_c = flicker(1.0, shortest, longest, ratio)
    return sum(gauss_markov_variance(np.sqrt(v), t, tau) for v, t in zip(variance, tau_c, strict=True))


@pytest.mark.parametrize(
    ("ratio", "margin", "flatness"), [(10.0, 1e4, 0.01), (4.0, 1e4, 0.001), (10.0, 1.0, 0.03)]
)
def test_flicker_has_a_flat_allan_deviation(ratio, margin, flatness):
    """Processes that are missing beyond the ends take a fraction of order 1 / margin away from them."""
    tau = np.geomspace(1.0, 1e4, 201)
    allan = _sum_allan_variance(1.0 / margin, 1e4 * margin, ratio, tau)
    assert np.max(np.abs(np.sqrt(allan / FLOOR) - 1.0)) < flatness


def test_allan_variance_has_the_published_coefficient_of_each_process():
    tau = np.array([0.1, 1.0, 100.0])
    np.testing.assert_allclose(allan_variance({"N": 2.0}, tau), 4.0 / tau, rtol=1e-15)
    np.testing.assert_allclose(allan_variance({"K": 2.0}, tau), 4.0 * tau / 3.0, rtol=1e-15)
    np.testing.assert_allclose(allan_variance({"Q": 2.0}, tau), 3.0 * 4.0 / tau**2, rtol=1e-14)
    np.testing.assert_allclose(allan_variance({"R": 2.0}, tau), 4.0 * tau**2 / 2.0, rtol=1e-14)
    # the bias instability is the floor of the Allan deviation over 0.664
    np.testing.assert_allclose(np.sqrt(allan_variance({"B": 2.0}, tau)), 0.664 * 2.0, rtol=1e-3)


NORMAL_95 = 1.6448536269514722


def transfer(S, tau, high):
    """Allan variance of a two-sided density S: 4 int S sin^4(pi f tau)/(pi f tau)^2 df over f > 0."""

    def integrand(log_f):
        x = math.pi * math.exp(log_f) * tau
        return 4.0 * S(math.exp(log_f)) * math.sin(x) ** 4 / x**2 * math.exp(log_f)

    edges = np.log(np.concatenate((np.geomspace(1e-6, 0.1, 12), np.arange(0.2, high * tau, 0.25))) / tau)
    return sum(quad(integrand, a, b, epsrel=1e-9)[0] for a, b in pairwise(edges))


def two_sided(noise, f):
    at = np.array([f])
    return float(density(noise, Spectrum(at, at, np.full(1, 1e-3)))[0])


@pytest.mark.parametrize(
    ("noise", "tail"),
    [
        # beyond f tau = 40 a density that falls as f^-a leaves below (40)^-(1+a) of the variance
        ({"N": 0.7}, 0.02),
        ({"B": 0.7}, 2e-3),
        ({"K": 0.7}, 1e-4),
        ({"G": 0.7, "tau": 2.0}, 1e-4),
    ],
    ids=["N", "B", "K", "G"],
)
def test_allan_variance_is_the_integral_of_the_two_sided_density(noise, tail):
    expected = allan_variance(noise, np.array([3.0]))[0]
    assert transfer(lambda f: two_sided(noise, f), 3.0, 40.0) == pytest.approx(expected, rel=tail)


def test_gauss_markov_deviation_peaks_at_0_617_sd_and_1_893_time_constants():
    x = np.linspace(1.0, 3.0, 20_001)
    deviation = np.sqrt(gauss_markov_variance(1.0, 1.0, x))
    assert deviation.max() == pytest.approx(0.617, abs=5e-4)
    assert x[deviation.argmax()] == pytest.approx(1.893, abs=5e-3)


def test_gauss_markov_variance_is_smooth_where_its_series_takes_over():
    low, high = gauss_markov_variance(1.0, 1.0, np.array([0.01 - 1e-9, 0.01 + 1e-9]))
    # the series lacks terms of x^4: 1e-8 of the first; the closed form loses 1e-16 / x^2
    assert low == pytest.approx(high, rel=1e-6)


def test_quantum_of_an_accelerometer_is_over_its_sampling_interval_and_of_a_gyroscope_an_angle():
    tactical = class_prior(sensor("mems_tactical", kind="accelerometer"), 0.01)["Q"]
    assert tactical[0] == pytest.approx(2e-6 * 9.80665 * 0.01)
    assert math.exp(2.0 * NORMAL_95 * tactical[1]) == pytest.approx(30.0 / 0.3)
    ring = sensor("rlg_navigation", kind="gyroscope")
    laser = [class_prior(ring, interval)["Q"] for interval in (0.01, 1.0)]
    assert laser[0] == laser[1] == pytest.approx((0.32 * factor("arcsec"), laser[0][1]))
