"""Effective sample size of coloured noise, against the known formulas and dense covariances."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.linalg import inv, solve

from imubayes.inference.dwells import whitened_factor
from imubayes.inference.linear import Linear, Rows
from imubayes.inference.whiten import effective_samples, marginal_variance, samples_of, whiten
from imubayes.sensors.noise import Noise

NOISE = Noise(N=0.3, B=0.2, K=0.02)


def _constant_under(covariance: np.ndarray) -> float:
    """Effective samples of a constant in rows of a given covariance."""
    n = len(covariance)
    one = np.ones(n)
    return samples_of(
        np.array([one @ solve(covariance, one)]), np.array([np.sum(1.0 / np.diag(covariance))]), n
    )


def _rows(n: int, noise_columns: np.ndarray) -> Linear:
    t = np.arange(n) * 2.0
    columns = np.column_stack((np.ones(n), noise_columns))
    return Linear(
        "run", "other", ("b0", "b1"), t, np.full(n, 2.0), 2.0, np.zeros(n), lambda a, b: columns[a:b]
    )


@pytest.mark.parametrize("a", [0.0, 0.5, 0.98])
def test_a_constant_in_a_first_order_process_has_the_known_number_of_samples(a):
    n = 200
    lag = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    expected = (n * (1.0 - a) + 2.0 * a) / (1.0 + a)
    assert _constant_under(3.0 * a**lag) == pytest.approx(expected, rel=1e-10)


def test_white_rows_of_any_column_count_one_each():
    rng = np.random.default_rng(1)
    rows = _rows(300, rng.normal(size=300))
    white = Noise(0.4, 0.0, 0.0)
    found = effective_samples(whitened_factor(rows, white)[0], [rows], [white])
    assert found == pytest.approx(300.0, rel=1e-12)


def test_marginal_variance_is_the_diagonal_of_the_covariance_that_whitens():
    duration = np.array([1.0, 2.0, 3.0, 2.0, 5.0])
    t = np.cumsum(duration) - 0.5 * duration
    rows = Rows(t, duration)
    # whitening the identity gives the inverse of the covariance's root
    lower = inv(whiten(NOISE, rows, np.eye(5))[0])
    assert marginal_variance(NOISE, rows) == pytest.approx(np.sum(lower**2, axis=1), rel=1e-10)
