"""Weights of the tree against each model's own, whatever shares the work; the tree against brute force.
Coefficients of submodels by a second route."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba.core import config

from imubayes.algebra.factor import factor_of, with_prior_rows
from imubayes.inference.prior import HyperG, g_nodes
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
    added = lanes.add_weights(weight, *lanes.ready(R, width), by_size, **options)
    assert added == pytest.approx(weight.sum(), rel=REL)
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


def test_numbers_are_the_same_to_the_last_digit_whatever_the_threads(monkeypatch):
    p = 17
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


@given(seeds, st.integers(0, 8), st.integers(1, 8), st.booleans())
def test_every_submodel_of_the_tree_is_its_own_qr(seed, p, n, prior):
    """Stacked under the factor of all columns, prior rows act in a submodel as the rows of its own prior."""
    X, y = _rows(seed, p, n if prior else p + n)
    weight = prior * 10.0 ** np.random.default_rng(seed).uniform(-2, 2, p)
    R = with_prior_rows(factor_of(X, y, "abcdefgh"[:p]).R, weight)
    rss, log_det = walk(R)
    np.testing.assert_array_equal(residuals(R), rss)
    every = Space(p).members(np.arange(1 << p))
    mean, variance, own_rss, own_log_det = solutions(R, every)
    for mask, inside in enumerate(every):
        Q, own = np.linalg.qr(np.vstack((X[:, inside], np.diag(weight[inside]))))
        response = np.append(y, np.zeros(len(own)))
        left = np.sum((response - Q @ (Q.T @ response)) ** 2)
        for found in (rss, own_rss):
            assert found[mask] == pytest.approx(left, rel=1e-10, abs=1e-13 * (y @ y))
        for found in (log_det, own_log_det):
            direct = np.sum(np.log(np.abs(np.diag(own))))
            assert found[mask] == pytest.approx(direct, rel=1e-10, abs=1e-10)
        assert not mean[mask, ~inside].any() and not variance[mask, ~inside].any()
        theta, sd = np.linalg.solve(own, Q.T @ response), np.linalg.norm(np.linalg.inv(own), axis=1)
        np.testing.assert_allclose(variance[mask, inside], sd**2, rtol=1e-8)
        assert np.all(np.abs(mean[mask, inside] - theta) < 1e-8 * sd * np.linalg.norm(y))


def test_the_variance_of_the_shrinkage_keeps_its_digits_beside_a_strong_signal():
    """For u -> 0 and large g, ``1/g`` is about gamma of shape s = (k + a)/2 - 1 and rate dof u^-1/2."""
    u, k, dof = 1e-14, 2, 1e6
    found = g_integrals(np.array([u]), np.array([k]), dof, *g_nodes(HyperG(3.0), 10))[0]
    shape, rate = 0.5 * (k + 3.0) - 1.0, 0.5 * dof / u
    assert found[2] == pytest.approx(shape / rate**2, rel=1e-4)
