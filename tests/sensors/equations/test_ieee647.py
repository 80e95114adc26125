"""IEEE 647: lock-in, held against Adler's equation itself."""

import math

import numpy as np
import pytest

from imubayes.sensors.equations import ieee952
from imubayes.sensors.equations.ieee647 import (
    STANDARD,
    RingLaserGyro,
    indicated,
    locked,
    polynomial_of,
    random_walk,
    residual_lock_in,
    slowest_rate,
    to_general,
)
from imubayes.sensors.terms import library


def _step(rate, psi, t, h):
    """One Runge-Kutta step of ``dpsi/dt = rate(t, psi)``."""
    a = rate(t, psi)
    b = rate(t + h / 2.0, psi + h / 2.0 * a)
    c = rate(t + h / 2.0, psi + h / 2.0 * b)
    return psi + h / 6.0 * (a + 2.0 * b + 2.0 * c + rate(t + h, psi + h * c))


@pytest.mark.parametrize("w", [-1.2, 1.01, 3.0, 40.0])
def test_mean_rate_is_that_of_adlers_equation(w):
    """The time of a fringe is the integral of ``dpsi / (S (w - w_L sin psi))``, periodic: a sum is exact."""
    psi = 2.0 * np.pi * np.arange(4096) / 4096
    period = np.mean(2.0 * np.pi / (5.0 * (w - np.sin(psi))))
    assert locked(np.array([w]), 1.0)[0] == pytest.approx(2.0 * np.pi / (5.0 * period), rel=1e-12)


def test_trap_sign_and_dead_band():
    w = np.array([-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0])
    root = math.sqrt(3.0)
    np.testing.assert_allclose(locked(w, 1.0), [-root, 0.0, 0.0, 0.0, 0.0, 0.0, root], rtol=1e-15)


def test_dither_leaves_the_lock_in_of_the_bessel_function():
    """Adler's equation with sinusoidal dither, integrated: the beat at twice the residual lock-in rate.

    The neglected order is (w_L / peak dither rate)^2, here (0.6 / 50)^2, and (w_L/W)^2 with W = 10: 4e-3;
    a fringe at the ends of the record is worth one part in its number of beats, 40.
    """
    w_L, beta, W = 0.6, 5.0, 10.0
    w_R = residual_lock_in(w_L, 1.0, beta)
    w = np.array([0.5, -2.0, 4.0]) * w_R

    def rate(t, psi):
        return w + beta * W * math.cos(W * t) - w_L * np.sin(psi)

    steps, per_period, psi = 32, 2.0 * np.pi / 10.0, np.zeros(3)
    periods = 1500
    start = psi
    for n in range(periods * steps):
        psi = _step(rate, psi, n * per_period / steps, per_period / steps)
        if n + 1 == periods * steps // 5:
            start = psi
    mean = (psi - start) / (0.8 * periods * per_period)
    np.testing.assert_allclose(mean, locked(w, w_R), rtol=0.03, atol=1e-3 * w_R)


def test_randomised_dither_makes_the_random_walk_of_its_turns():
    """Adler's equation under dither of random amplitude: variance of the angle per time, 600 rings at once.

    10 periods of 600 rings are 6,000 draws: the variance is known to sqrt(2/6000) = 1.8 %, tolerance 4 of it.
    """
    rng, rings, periods, steps = np.random.default_rng(1), 600, 10, 1000
    w_L, h = 0.2, 2.0 * np.pi / 1000
    psi = start = rng.uniform(0.0, 2.0 * np.pi, rings)
    squares, expected = 0.0, 0.0
    for _ in range(periods):
        beta = rng.uniform(30.0, 50.0, rings)

        def rate(t, psi, beta=beta):
            return beta * math.cos(t) - w_L * np.sin(psi)

        for n in range(steps):
            psi = _step(rate, psi, n * h, h)
        squares += np.sum((psi - start) ** 2)
        expected += sum(random_walk(w_L, 1.0, peak) ** 2 * 2.0 * np.pi for peak in beta)
        start = psi
    assert squares / expected == pytest.approx(1.0, abs=4.0 * math.sqrt(2.0 / 6000))


def test_beyond_the_slowest_rate_lock_in_takes_less_than_the_error():
    w = slowest_rate(2e-3, 1e-6)
    assert w - locked(np.array([w]), 2e-3)[0] == pytest.approx(1e-6, rel=1e-9)
    assert slowest_rate(2e-3, 2e-3) == 0.0


def test_scale_and_dead_band_terms_fitted_to_lock_in_are_those_of_its_integrals():
    """Rates uniform to W: both moments of ``L(w) - w`` have closed forms, and give b1 and b0' by hand."""
    r, W, n = 1.0, 8.0, 400_000
    lib = library("gyroscope", powers=1, asymmetry=0)
    w = W * (2.0 * (np.arange(n) + 0.5) / n - 1.0)
    found = polynomial_of(lib, r, {"w_i": w}, n)
    root = math.sqrt(W * W - r * r)
    zeroth = ((W * root - r * r * math.acosh(W / r)) / 2.0 - W * W / 2.0) / W
    first = (root**3 / 3.0 - W**3 / 3.0) / W
    moments = np.array([[W * W / 3.0, W / 2.0], [W / 2.0, 1.0]])
    b1, b0p = np.linalg.solve(moments, [first, zeroth])
    # the corner of infinite slope costs the midpoint sum about (step)^1.5 = 3e-7
    np.testing.assert_allclose([found.coefficients["b1"], found.coefficients["b0p"]], [b1, b0p], rtol=1e-5)
    assert found.coefficients["b0"] == pytest.approx(0.0, abs=1e-12)
    assert b0p < 0.0 < b1


def test_dither_amplitude_enters_the_equation_by_the_residual_lock_in():
    w = np.array([0.5])
    dithered = RingLaserGyro(w_L=1.0, S=10.0, theta_D=0.5)
    assert indicated(RingLaserGyro(w_L=1.0), {"w_i": w}, 1)[0] == 0.0
    # J0(5) = -0.1775967713143383 (Abramowitz and Stegun, table 9.1)
    expected = math.sqrt(0.25 - 0.1775967713143383**2)
    assert indicated(dithered, {"w_i": w}, 1)[0] == pytest.approx(expected, rel=1e-14)


def test_without_lock_in_and_field_the_equation_is_that_of_ieee_952():
    rng = np.random.default_rng(2)
    common = {"eps_K": 1e-2, "a_X": 0.1, "D_F": 1e-3, "D_T": 1e-4, "eps_T": 1e-4}
    channels = {name: rng.normal(size=20) for name in ("w_i", "w_j", "w_k", "dT")}
    channels["T"] = rng.uniform(280.0, 320.0, 20)
    ring, fiber = RingLaserGyro(**common), ieee952.FiberOpticGyro(**common)
    np.testing.assert_allclose(
        indicated(ring, channels, 20), ieee952.indicated(fiber, channels, 20), rtol=1e-13
    )
    shared = ieee952.to_general(fiber)
    assert all(shared[name] == value for name, value in to_general(ring).items())


def test_magnetic_bias_and_lock_in_have_no_counterpart():
    lost = {"D_H,i", "D_H,j", "D_H,k", "Omega_L", "S", "theta_D"}
    assert lost < set(STANDARD.standard_only)
    p = RingLaserGyro(D_H_j=2.0)
    assert indicated(p, {"H_j": np.array([3.0])}, 1)[0] == 6.0
