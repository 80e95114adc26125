"""The references themselves, by other routes."""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np
import pytest
from mpmath import mp
from scipy.linalg import solve_triangular

from imubayes.inference.linear import Rows
from imubayes.inference.whiten import Processes
from imubayes.sensors.noise import Noise
from studies.extremes import exact
from studies.extremes.cases import Stamps

RNG = np.random.default_rng(3)
X = RNG.normal(size=(12, 2))
Y = X @ [0.4, 0.0] + RNG.normal(size=12)
SD = np.array([0.7, 2.0])


def _log_marginal(columns: tuple[int, ...], sigma: float) -> float:
    """Dense normal density of the response with the coefficients integrated out."""
    V = sigma**2 * np.eye(len(Y)) + (X[:, columns] * SD[list(columns)] ** 2) @ X[:, columns].T
    return float(-0.5 * (Y @ np.linalg.solve(V, Y) + np.linalg.slogdet(2.0 * math.pi * V)[1]))


def test_posterior_is_the_integral_of_dense_densities_over_the_noise_scale():
    models = [c for k in range(3) for c in combinations(range(2), k)]
    prior = {k: 1.0 / (3.0 * math.comb(2, k)) for k in range(3)}

    def integral(chosen):
        with mp.workdps(20):
            return float(
                mp.quad(
                    lambda s: sum(
                        prior[len(m)] * mp.exp(_log_marginal(m, math.exp(float(s)))) for m in chosen
                    ),
                    mp.linspace(-4, 6, 21),
                )
            )

    found = exact.posterior(exact.products(X, Y), SD)
    total = integral(models)
    # the dense densities are doubles: the rule itself is exact to far more
    assert found.log_evidence == pytest.approx(math.log(total), abs=1e-9)
    share = [integral([m for m in models if j in m]) / total for j in range(2)]
    np.testing.assert_allclose(found.inclusion, share, rtol=1e-9)


def test_dependent_columns_have_no_least_squares():
    assert exact.least_squares(exact.products(X[:, [0, 0]], Y)) is None


def test_whitened_products_are_those_of_the_dense_covariance():
    t, T, K, N = 0.5 * np.arange(1, 13), np.full(12, 0.5), 0.3, 0.2
    stamps = Stamps(Rows(t, T), Noise(N, 0.0, K), Processes(np.empty(0), np.empty(0)))
    start = t[0] - 0.25
    C = K**2 * (np.minimum.outer(t, t) - start)
    C[np.diag_indices(12)] += N**2 / T - K**2 * T / 6.0
    L = np.linalg.cholesky(C)
    W, z = solve_triangular(L, X, lower=True), solve_triangular(L, Y, lower=True)
    found = exact.least_squares(exact.whitened_products(X, Y, stamps))
    np.testing.assert_allclose(found.mean, np.linalg.lstsq(W, z)[0], rtol=1e-11)
