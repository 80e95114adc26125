"""Weights of the tree against each model's own, whatever shares the work; the tree against brute force.
Coefficients of submodels and integrals over g, each by a second route."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba.core import config
from scipy.integrate import quad

from imubayes.algebra.factor import factor_of, with_prior_rows
from imubayes.inference.prior import GPrior, HyperG, ZellnerSiow, g_nodes
from imubayes.selection import lanes
from imubayes.selection.kernels import g_integrals, solutions
from imubayes.selection.lanes import residuals, walk
from imubayes.selection.model_sets import Space, admissible, sizes

seeds = st.integers(0, 2**32 - 1)
REL = 1e-12
"""Of a weight: a few roundings a column, 26 columns at most, and the exponent's own of 1e-16 x |exponent|."""


def _problem(seed: int, p: int) -> tuple[np.ndarray, np.ndarray]:
    """Factor with prior rows in units of the noise, and the rows: 1/sd of each column."""
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(2 * p, p)) * 10.0 ** rng.uniform(-3, 3, p)
    y = X @ (rng.normal(size=p) / np.linalg.norm(X, axis=0)) + rng.normal(size=len(X))
    width = 10.0 ** rng.uniform(-3, 3, p)
    return with_prior_rows(factor_of(X, y, [f"x{j}" for j in range(p)]).R, width), width


def _weights(R: np.ndarray, width: np.ndarray, by_size: np.ndarray, **options) -> np.ndarray:
    weight = np.zeros(1 << len(width))
    largest = lanes.add_weights(weight, *lanes.ready(R, width), by_size, **options)
    assert largest == weight.max()
    return weight


@settings(deadline=None, max_examples=20)
@given(seeds, st.sampled_from([0, 1, 3, 7, 8, 9, 12, 13]))
def test_weights_are_those_of_each_model_by_itself(seed, p):
    R, width = _problem(seed, p)
    by_size = np.random.default_rng(seed).normal(size=p + 1)
    inside = Space(p).members(np.arange(1 << p))
    *_, rss, log_det = solutions(R, inside)
    logs = 0.3 + by_size[sizes(p)] - 0.5 * (rss - R[-1, -1] ** 2) - log_det + inside @ np.log(width)
    expected = np.exp(logs)
    found = _weights(R, width, by_size, log_factor=0.3)
    shift = REL + 1e-14 * np.max(np.abs(logs))
    np.testing.assert_allclose(found, expected, rtol=shift, atol=1e-290)


def test_a_model_with_a_child_and_without_its_parent_has_no_weight():
    R, width = _problem(5, 14)
    needs = [(0, 13), (12, 3), (1, 2), (11, 9)]
    by_size = np.zeros(15)
    free = _weights(R, width, by_size, log_factor=0.0)
    bound = _weights(R, width, by_size, log_factor=0.0, needs=needs)
    np.testing.assert_array_equal(bound, np.where(admissible(Space(14), needs), free, 0.0))


@pytest.mark.parametrize("p", [17, 19])
def test_numbers_are_the_same_to_the_last_digit_whatever_the_threads(p, monkeypatch):
    R, width = _problem(6, p)
    found = []
    for threads in (1, 2, 3):
        monkeypatch.setattr(config, "NUMBA_NUM_THREADS", threads)
        found.append(_weights(R, width, np.zeros(p + 1), log_factor=0.0))
    np.testing.assert_array_equal(found[0], found[1])
    np.testing.assert_array_equal(found[0], found[2])


def test_columns_that_vanish_beside_others_leave_every_number_finite():
    """Two equal columns: without the first, the second takes its place."""
    rng = np.random.default_rng(7)
    X = rng.normal(size=(20, 9))
    X[:, 4] = X[:, 2]
    R = np.triu(np.linalg.qr(np.column_stack((X, rng.normal(size=20))), mode="r"))
    rss = lanes.residuals(R)
    assert np.isfinite(rss).all()
    swapped = [mask ^ (0b10100 if (mask >> 2 & 1) != (mask >> 4 & 1) else 0) for mask in range(1 << 9)]
    np.testing.assert_allclose(rss, rss[swapped], rtol=1e-9)


def test_what_products_cannot_hold_is_not_called_storable():
    R, width = _problem(8, 9)
    assert lanes.storable(R, width)
    assert not lanes.storable(R, width * math.exp(-90.0))
    R[2, 5] = np.inf
    assert not lanes.storable(R, width)


@pytest.mark.parametrize("p", [2, 9])
def test_a_model_too_improbable_for_a_number_has_no_weight(p):
    """Without its strong column a model lies 5,000 nats below: no number holds that, and none is made up."""
    R = np.diag(np.full(p + 1, 10.0))
    R[0, -1] = 100.0
    weight = _weights(R, np.ones(p), np.zeros(p + 1), log_factor=0.0)
    np.testing.assert_array_equal(weight > 0.0, np.arange(1 << p) & 1 == 1)


def _rows(seed: int, p: int, n: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(n, p)) * 10.0 ** rng.uniform(-3, 3, p)
    return X, X @ (rng.normal(size=p) / (np.linalg.norm(X, axis=0) + 1.0)) + rng.normal(size=n)


def _included(mask: int, p: int) -> list[int]:
    return [j for j in range(p) if mask >> j & 1]


@given(seeds, st.integers(0, 8), st.integers(1, 8), st.booleans())
def test_every_submodel_of_the_tree_is_its_own_qr(seed, p, n, prior):
    """Stacked under the factor of all columns, prior rows act in a submodel as the rows of its own prior."""
    X, y = _rows(seed, p, n if prior else p + n)
    weight = prior * 10.0 ** np.random.default_rng(seed).uniform(-2, 2, p)
    R = with_prior_rows(factor_of(X, y, "abcdefgh"[:p]).R, weight)
    rss, log_det = walk(R)
    np.testing.assert_array_equal(residuals(R), rss)
    for mask in range(1 << p):
        of = _included(mask, p)
        Q, own = np.linalg.qr(np.vstack((X[:, of], np.diag(weight[of]))))
        response = np.append(y, np.zeros(len(of)))
        left = np.sum((response - Q @ (Q.T @ response)) ** 2)
        assert rss[mask] == pytest.approx(left, rel=1e-10, abs=1e-13 * (y @ y))
        assert log_det[mask] == pytest.approx(np.sum(np.log(np.abs(np.diag(own)))), rel=1e-10, abs=1e-10)


def _small_problem(seed: int, p: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows, response and factor of a regular problem."""
    rng = np.random.default_rng(seed)
    X, y = rng.normal(size=(p + 6, p)), rng.normal(size=p + 6)
    return X, y, factor_of(X, y, "abcdef"[:p]).R


@given(seeds, st.integers(1, 5))
def test_solutions_are_least_squares_of_every_submodel(seed, p):
    X, y, R = _small_problem(seed, p)
    every = Space(p)
    mean, variance, rss, log_det = solutions(R, every.members(np.arange(len(every))))
    for mask in range(1 << p):
        columns = [j for j in range(p) if mask >> j & 1]
        outside = [j for j in range(p) if j not in columns]
        assert not mean[mask, outside].any()
        assert not variance[mask, outside].any()
        inverse = np.linalg.inv(X[:, columns].T @ X[:, columns])
        theta = inverse @ X[:, columns].T @ y
        np.testing.assert_allclose(mean[mask, columns], theta, rtol=1e-8, atol=1e-10)
        np.testing.assert_allclose(variance[mask, columns], np.diag(inverse), rtol=1e-8)
        assert rss[mask] == pytest.approx(np.sum((y - X[:, columns] @ theta) ** 2), rel=1e-9)
        assert log_det[mask] == pytest.approx(-0.5 * np.linalg.slogdet(inverse)[1], rel=1e-9, abs=1e-9)


def _density(prior, n):
    """Density of g, from the papers."""
    if isinstance(prior, HyperG):
        return lambda g: (prior.a / 2.0 - 1.0) * (1.0 + g) ** (-prior.a / 2.0)
    beta = n * prior.scale**2 / 2.0
    return lambda g: math.sqrt(beta / math.pi) * g**-1.5 * math.exp(-beta / g)


def _expectations(prior, n, dof, k, u):
    """Bayes factor and posterior means of s, s^2, s r, r by adaptive quadrature over x = ln g."""
    density = _density(prior, n)

    def factor(g):
        return math.exp(0.5 * (dof - k) * math.log1p(g) - 0.5 * dof * math.log1p(g * u))

    def mean_of(of):
        def integrand(x):
            g = math.exp(x)
            return density(g) * factor(g) * g * of(g / (1.0 + g), (1.0 + g * u) / (1.0 + g))

        return sum(
            quad(integrand, a, a + 5.0, epsabs=0.0, epsrel=1e-12, limit=200)[0] for a in range(-30, 55, 5)
        )

    total = mean_of(lambda s, r: 1.0)
    moments = [lambda s, r: s, lambda s, r: s * s, lambda s, r: s * r, lambda s, r: r]
    s, square, shrunk, left = (mean_of(of) / total for of in moments)
    return [math.log(total), s, square - s * s, shrunk, left]


@pytest.mark.parametrize("prior", [HyperG(3.0), HyperG(4.0), ZellnerSiow(1.0), ZellnerSiow(0.3)])
@pytest.mark.parametrize(("n", "k", "u"), [(8, 1, 0.9), (12, 3, 0.2), (40, 5, 0.5), (60, 2, 0.01)])
@pytest.mark.filterwarnings("ignore::scipy.integrate.IntegrationWarning")  # at the far ends, where all is 0
def test_integrals_over_g_are_those_of_adaptive_quadrature(prior, n, k, u):
    dof = n - 1.0
    found = g_integrals(np.array([u]), np.array([k]), dof, *g_nodes(prior, n))[0]
    np.testing.assert_allclose(found, _expectations(prior, n, dof, k, u), rtol=1e-8, atol=1e-8)


@given(st.floats(0.0, 1.0), st.integers(0, 9), st.floats(1e-3, 1e6))
def test_a_fixed_g_gives_the_closed_bayes_factor_and_shrinkage(u, k, g):
    found = g_integrals(np.array([u]), np.array([k]), 10.0, *g_nodes(GPrior(g), 11))[0]
    s, r = g / (1.0 + g), (1.0 + g * u) / (1.0 + g)
    log_factor = 0.5 * (10 - k) * math.log1p(g) - 5.0 * math.log1p(g * u)
    np.testing.assert_allclose(found, [log_factor, s, 0.0, s * r, r], rtol=1e-12, atol=1e-12)


def test_the_variance_of_the_shrinkage_keeps_its_digits_beside_a_strong_signal():
    """For u -> 0 and large g, ``1/g`` is about gamma of shape s = (k + a)/2 - 1 and rate dof u^-1/2."""
    u, k, dof = 1e-14, 2, 1e6
    found = g_integrals(np.array([u]), np.array([k]), dof, *g_nodes(HyperG(3.0), 10))[0]
    shape, rate = 0.5 * (k + 3.0) - 1.0, 0.5 * dof / u
    assert found[2] == pytest.approx(shape / rate**2, rel=1e-4)
