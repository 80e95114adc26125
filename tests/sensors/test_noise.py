"""The Allan variance of the modelled noise, by closed formulas."""

import math

import numpy as np
import pytest

from imubayes.sensors.noise import Noise, allan_variance, flicker

FLOOR = 2.0 * math.log(2.0) / math.pi
"""Allan variance of flicker noise over B^2 (IEEE 952 annex C)."""


def _gauss_markov_allan_variance(variance, tau_c, tau):
    """Allan variance of a first-order process of time constant `tau_c` at averaging time `tau`."""
    x = tau / tau_c
    closed = 1.0 - (3.0 - 4.0 * np.exp(-x) + np.exp(-2.0 * x)) / (2.0 * x)
    series = x**2 / 3.0 - x**3 / 4.0 + 7.0 * x**4 / 60.0  # where the closed form is a difference of ones
    return 2.0 * variance / x * np.where(x < 1e-2, series, closed)


def _sum_allan_variance(shortest, longest, ratio, tau):
    variance, tau_c = flicker(1.0, shortest, longest, ratio)
    return sum(_gauss_markov_allan_variance(v, t, tau) for v, t in zip(variance, tau_c, strict=True))


@pytest.mark.parametrize(("ratio", "flatness"), [(10.0, 0.01), (4.0, 0.001)])
def test_flicker_has_a_flat_allan_deviation_away_from_its_ends(ratio, flatness):
    tau = np.geomspace(1e2, 1e3, 61)
    margin = 1e4  # the missing processes beyond the ends would add a fraction of order 1 / margin
    allan = _sum_allan_variance(1e2 / margin, 1e3 * margin, ratio, tau)
    assert np.max(np.abs(np.sqrt(allan / FLOOR) - 1.0)) < flatness


def test_flicker_of_the_fitted_ratio_is_within_three_percent_up_to_its_ends():
    tau = np.geomspace(1.0, 1e4, 201)
    allan = _sum_allan_variance(1.0, 1e4, 10.0, tau)
    assert np.max(np.abs(np.sqrt(allan / FLOOR) - 1.0)) < 0.03


@pytest.mark.parametrize("longest", [0.5, 1.0, 1.1, 16.0, 17.0, 1e5])
def test_time_constants_enclose_the_range_by_one_step_in_a_geometric_row(longest):
    variance, tau = flicker(3.0, 1.0, longest, ratio=4.0)
    np.testing.assert_allclose(tau[1:] / tau[:-1], 4.0, rtol=1e-12)
    assert tau[0] == 0.25
    assert max(longest, 1.0) * 4.0 <= tau[-1] < max(longest, 1.0) * 16.0
    np.testing.assert_allclose(variance, 9.0 * math.log(4.0) / math.pi, rtol=1e-15)


def test_allan_variance_has_the_published_coefficient_of_each_process():
    tau = np.array([0.1, 1.0, 100.0])
    np.testing.assert_allclose(allan_variance(Noise(2.0, 0.0, 0.0), tau), 4.0 / tau, rtol=1e-15)
    np.testing.assert_allclose(allan_variance(Noise(0.0, 0.0, 2.0), tau), 4.0 * tau / 3.0, rtol=1e-15)
    # the bias instability is the floor of the Allan deviation over 0.664
    np.testing.assert_allclose(np.sqrt(allan_variance(Noise(0.0, 2.0, 0.0), tau)), 0.664 * 2.0, rtol=1e-3)
