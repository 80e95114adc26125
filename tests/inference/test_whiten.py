"""Whitening, and what coloured rows count for, against dense covariances by formulas of their own."""

from __future__ import annotations

import made
import numpy as np
import pytest

from imubayes.inference.dwells import whitened_factor
from imubayes.inference.linear import Rows
from imubayes.inference.whiten import (
    Processes,
    effective_samples,
    marginal_variance,
    nbk,
    processes,
    samples_of,
    whiten,
    whiten_each,
)
from imubayes.rig.simulate import synthesise
from imubayes.sensors.noise import Noise

NOISES = {
    "white": Noise(2.0, 0.0, 0.0),
    "bias instability": Noise(0.3, 0.7, 0.0),
    "random walk": Noise(0.3, 0.0, 0.05),
    "all three": Noise(1.0, 0.7, 0.05),
    "no white part": Noise(0.0, 0.7, 0.05),
}


def equal_rows():
    return Rows(0.5 * np.arange(90.0) + 0.25, np.full(90, 0.5))


def rows_with_gaps():
    start = np.concatenate((np.arange(40.0), 100.0 + np.arange(30.0), 5e4 + 3.0 * np.arange(20.0)))
    return Rows(start + 0.4, np.full(90, 0.8))


def unequal_rows():
    rng = np.random.default_rng(3)
    duration = rng.uniform(0.5, 6.0, 90)
    start = np.cumsum(np.concatenate(([7.0], duration[:-1] + rng.exponential(2.0, 89))))
    return Rows(start + 0.5 * duration, duration)


def three_axes():
    rows = rows_with_gaps()
    return Rows(rows.t, rows.duration, np.random.default_rng(4).normal(size=(90, 3)))


def two_at_a_time():
    """Two rows at one time, as a turn has, that see components across each other, which do not covary."""
    rng, start = np.random.default_rng(5), np.cumsum(np.random.default_rng(6).uniform(8.0, 20.0, 45))
    axes = np.concatenate([np.linalg.qr(rng.normal(size=(3, 3)))[0][:2] for _ in start])
    return Rows(np.repeat(start, 2), np.repeat(rng.uniform(4.0, 6.0, 45), 2), axes)


ROWS = {
    "equal": equal_rows,
    "gaps": rows_with_gaps,
    "unequal": unequal_rows,
    "axes": three_axes,
    "two at a time": two_at_a_time,
}


@pytest.mark.parametrize("noise", NOISES.values(), ids=NOISES.keys())
@pytest.mark.parametrize("make", ROWS.values(), ids=ROWS.keys())
def test_factor_is_that_of_the_dense_covariance(make, noise):
    rows = make()
    parts = processes(rows) if noise.B else Processes(np.empty(0), np.empty(0))
    C = made.dense(noise, rows, parts)
    W, d = whiten(noise, rows, np.eye(len(rows.t)), parts)
    L, size = np.linalg.inv(W), np.sqrt(np.diag(C))
    np.testing.assert_allclose(L @ L.T / np.outer(size, size), C / np.outer(size, size), rtol=0.0, atol=1e-9)
    assert np.array_equal(W, np.tril(W))
    assert np.sum(np.log(d)) == pytest.approx(np.linalg.slogdet(C)[1], rel=1e-10, abs=1e-9)


@pytest.mark.parametrize("make", ROWS.values(), ids=ROWS.keys())
def test_columns_are_whitened_side_by_side_as_each_is_alone(make):
    rows, rng = make(), np.random.default_rng(7)
    parts, table = processes(rows), rng.normal(size=(len(rows.t), 40))
    noises = np.exp(rng.normal(size=(3, 40)))
    white = table.copy()
    d = whiten_each(nbk(parts, rows).sized(noises), rows, white)
    for k, noise in enumerate(noises.T.tolist()):
        alone, variance = whiten(Noise(*noise), rows, table[:, k : k + 1].copy(), parts)
        np.testing.assert_allclose(white[:, k], alone[:, 0], rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(d[:, k], variance, rtol=1e-9)


def test_synthesised_noise_is_white_once_whitened():
    rng, dt = np.random.default_rng(11), 0.1
    start = np.concatenate([100.0 * k + dt * np.arange(500) for k in range(40)])
    noise = Noise(0.05, 0.1, 0.002)
    rows = Rows(start, np.full(len(start), dt))
    white, _ = whiten(noise, rows, synthesise(noise, start, dt, rng)[:, None])
    blocks = white[:, 0].reshape(-1, 25).sum(axis=1) / 5.0  # 800 of them: what varies over 2.5 s and more
    # the fitted row of time constants is coarser than the simulated one, which costs 1 % of B^2
    assert white[:, 0].std() == pytest.approx(1.0, abs=4.0 / np.sqrt(2.0 * len(white)) + 0.01)
    assert blocks.std() == pytest.approx(1.0, abs=4.0 / np.sqrt(2.0 * len(blocks)) + 0.01)
    assert abs(np.mean(blocks[1:] * blocks[:-1])) < 4.0 / np.sqrt(len(blocks))


def test_processes_that_are_white_within_a_row_are_left_to_the_white_noise():
    rows = Rows(np.array([0.5, 600.5]), np.array([1.0, 1000.0]))
    assert processes(rows).tau.min() > 1000.0 / 20.0
    assert processes(equal_rows(), Noise(10.0, 1.0, 0.0)).tau.min() == pytest.approx(1.0)


def test_processes_that_are_over_within_a_row_are_white():
    """Rows of 100 s of a sensor whose fastest process lasts 0.02 s: no overflow, and the dense covariance."""
    T, t = 100.0, 50.0 + 100.0 * np.arange(40.0)
    rows, noise = Rows(t, np.full(40, T)), Noise(1e-3, 5e-4, 0.0)
    parts = Processes(np.full(6, 0.7329), 0.02 * 10.0 ** np.arange(6.0))
    _, d = whiten(noise, rows, np.zeros((40, 1)), parts)
    assert np.isfinite(d).all()
    lag = np.abs(t[:, None] - t) - T
    C = noise.N**2 / T * np.eye(40)
    for variance, tau in zip(noise.B**2 * parts.variance, parts.tau, strict=True):
        x = T / tau
        apart = variance * np.exp(-np.maximum(lag, 0.0) / tau) * ((1.0 - np.exp(-x)) / x) ** 2
        C += np.where(lag < 0.0, variance * 2.0 * (x - 1.0 + np.exp(-x)) / x**2, apart)
    # neighbours are correlated by 0.1 % at most through what is taken for white: r^2 of each row, twice
    assert np.sum(np.log(d)) == pytest.approx(np.linalg.slogdet(C)[1], abs=2.0 * 40 * 0.001**2)


def test_a_process_however_fast_is_nothing_from_row_to_row_where_times_are_rounded():
    """Where a row begins 1e-12 s before the one before it ends, by rounding, nothing grows."""
    rows = Rows(0.1 * np.arange(1e4, 1e4 + 300) + 0.05, np.full(300, 0.1))
    assert (np.diff(rows.t) - 0.1).min() < 0.0
    fast = Processes(np.array([0.7]), np.array([1e-18]))
    table, d = whiten(Noise(1.0, 1.0, 0.0), rows, np.ones((300, 1)), fast)
    np.testing.assert_allclose(table[:, 0], np.sqrt(0.1), rtol=1e-9)
    np.testing.assert_allclose(d, 10.0, rtol=1e-9)


@pytest.mark.parametrize("a", [0.0, 0.5, 0.98])
def test_a_constant_in_a_first_order_process_has_the_known_number_of_samples(a):
    n, one = 200, np.ones(200)
    covariance = 3.0 * a ** np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    told, alone = one @ np.linalg.solve(covariance, one), np.sum(1.0 / np.diag(covariance))
    expected = (n * (1.0 - a) + 2.0 * a) / (1.0 + a)
    assert samples_of(np.array([told]), np.array([alone]), n) == pytest.approx(expected, rel=1e-10)


def test_white_rows_of_any_column_count_one_each():
    X, white = np.random.default_rng(1).normal(size=(300, 2)), Noise(0.4, 0.0, 0.0)
    rows = made.rows_of(np.zeros(300), X, duration=2.0)
    found = effective_samples(whitened_factor(rows, white), [rows], [white])
    assert found == pytest.approx(300.0, rel=1e-12)


def test_marginal_variance_is_the_diagonal_of_the_covariance_that_whitens():
    rows, noise = unequal_rows(), NOISES["all three"]
    # whitening the identity gives the inverse of the covariance's root
    lower = np.linalg.inv(whiten(noise, rows, np.eye(90))[0])
    assert marginal_variance(noise, rows) == pytest.approx(np.sum(lower**2, axis=1), rel=1e-10)
