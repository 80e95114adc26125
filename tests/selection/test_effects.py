"""Detectable effects, and the evidence of a support. pysindy's optimizers on a triangular factor, and their
whole paths at once."""

from __future__ import annotations

import warnings

import numpy as np
import pysindy as ps
import pytest
from scipy.stats import multivariate_normal

from imubayes.algebra.factor import factor_of
from imubayes.selection.sindy import PATHS, best_of, effects_of, log_evidence, refitted

NAMES = ("bias", "a", "b", "c", "d")
SD = np.array([3.0, 2.0, 0.5, 40.0, 1.0])
SCALE = 0.7
CANDIDATES = ("c", "a", "d", "b")  # another order than the factor's; "bias" is in every model


@pytest.fixture(scope="module")
def rows():
    rng = np.random.default_rng(5)
    X = rng.normal(size=(30, 5)) * np.array([1.0, 1.0, 5.0, 0.01, 0.3])
    X[:, 0] = 1.0
    X[:, 2] += 4.0 * X[:, 1]
    theta = np.array([2.0, 1.0, 0.0, 30.0, 0.0])
    return X, X @ theta + SCALE * rng.normal(size=30)


@pytest.fixture(scope="module")
def effects(rows):
    return effects_of(factor_of(*rows, NAMES), SD, CANDIDATES, SCALE)


def every_support(p):
    return (np.arange(1 << p)[:, None] >> np.arange(p) & 1).astype(bool)


def columns_of(support):
    return [0, *(NAMES.index(name) for name, inside in zip(CANDIDATES, support, strict=True) if inside)]


def test_evidence_is_the_density_of_the_rows(rows, effects):
    """The other columns integrated out with their prior: a normal density in as many dimensions as rows."""
    X, y = rows
    direct = []
    for support in every_support(4):
        A = X[:, columns_of(support)] * SD[columns_of(support)]
        direct.append(multivariate_normal(cov=SCALE**2 * np.eye(30) + A @ A.T).logpdf(y))
    found = log_evidence(effects, every_support(4))
    assert found - found[0] == pytest.approx(np.array(direct) - direct[0], abs=1e-8)


def test_refit_is_the_posterior_mean_in_effects(rows, effects):
    X, y = rows
    for support, theta in zip(every_support(4), refitted(effects, every_support(4)), strict=True):
        inside = columns_of(support)
        A = np.vstack((X[:, inside], np.diag(SCALE / SD[inside])))
        direct = np.linalg.lstsq(A, np.concatenate((y, np.zeros(len(inside)))))[0][1:]
        assert theta[support] * effects.unit[support] == pytest.approx(direct, rel=1e-9)
        assert not theta[~support].any()


def test_effect_is_the_posterior_sd_of_the_full_library(rows, effects):
    X, _ = rows
    covariance = np.linalg.inv(X.T @ X / SCALE**2 + np.diag(SD**-2.0))
    sd = np.sqrt(np.diag(covariance))
    assert effects.unit == pytest.approx([sd[NAMES.index(name)] for name in CANDIDATES], rel=1e-10)
    inverse = np.linalg.inv(effects.R[:-1, :-1])
    assert np.linalg.norm(inverse, axis=1) == pytest.approx(np.ones(4), rel=1e-12)


def test_null_direction_has_the_effect_that_the_prior_leaves():
    """Of two equal columns only the sum is seen: each is as unknown as their difference, sd/sqrt(2)."""
    x = np.linspace(1.0, 2.0, 50)
    twins = effects_of(factor_of(np.column_stack((x, x)), x, ("a", "b")), np.full(2, 5.0), ("a", "b"), 1e-6)
    assert twins.unit == pytest.approx([5.0 / np.sqrt(2.0)] * 2, rel=1e-6)


def test_term_that_was_not_excited_is_no_candidate(rows):
    X, y = rows
    without = np.where(np.arange(5) == 2, 0.0, X)
    assert effects_of(factor_of(without, y, NAMES), SD, CANDIDATES, SCALE).names == ("c", "a", "d")


def test_of_equal_scores_the_smallest_support_is_taken_in_the_middle_of_its_stretch():
    supports = np.array([[1, 1], [1, 0], [1, 0], [1, 0], [0, 0]], dtype=bool)
    assert best_of(supports, np.array([-1.0, -1.0, -1.0, -1.0, -9.0])) == 2
    assert best_of(supports, np.array([-0.5, -1.0, -1.0, -1.0, -9.0])) == 0


TRUTH = np.array([9.0, 0.0, -3.0, 0.4, 0.0, 1.5, 0.0, 0.0])


def regression_rows(seed=0, n=90):
    """White rows over columns of which the first three are alike."""
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(n, len(TRUTH)))
    X[:, 1:3] += 2.0 * X[:, :1]
    return X, X @ TRUTH + rng.normal(size=n)


def triangle(X, y):
    R = factor_of(X, y, tuple(f"x{j}" for j in range(X.shape[1]))).R
    return R[:-1, :-1], R[:-1, -1]


@pytest.mark.parametrize(("b", "reached"), [([2.0, 0, 0, 0, 0], 1), ([1.0, 0.0, 2.0, 0.0, 0.0], 2)])
def test_a_path_that_ends_where_nothing_is_left_keeps_its_largest_support(b, reached):
    """pysindy's FROLS goes on to nothing once the residual is zero."""
    A = np.triu(np.random.default_rng(1).normal(size=(5, 5))) + 3.0 * np.eye(5)
    supports = PATHS["frols"](A, A @ np.array(b), np.arange(6.0))
    assert supports.sum(axis=1).tolist() == [min(k, reached) for k in range(5)] + [5]
    assert (supports[reached] == (np.array(b) != 0.0)).all()


@pytest.mark.parametrize("name", ["stlsq", "sr3"])
def test_path_over_thresholds_is_a_fit_at_each_of_them(name):
    A, b = triangle(*regression_rows(1))
    thresholds = np.geomspace(0.1, 20.0, 15)
    one_by_one = {
        "stlsq": lambda t: ps.STLSQ(threshold=t, alpha=0.0, unbias=False),
        "sr3": lambda t: ps.SR3(ps.SR3.calculate_l0_weight(t, 1.0), "l0", 1.0, tol=1e-3, max_iter=500),
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        single = [one_by_one[name](float(t)).fit(A, b).coef_[0] != 0.0 for t in thresholds]
    path = PATHS[name](A, b, thresholds)
    assert len(np.unique(path, axis=0)) > 4
    assert np.array_equal(path, single)


def test_ssr_drops_the_smallest_coefficient_at_each_step():
    A, b = triangle(*regression_rows(2))
    inside, expected = np.ones(8, dtype=bool), []
    for _ in range(8):
        theta = np.zeros(8)
        theta[inside] = np.linalg.lstsq(A[:, inside], b)[0]
        inside = inside & (np.arange(8) != np.argmin(np.where(inside, np.abs(theta), np.inf)))
        expected.append(inside)
    assert np.array_equal(PATHS["ssr"](A, b, np.arange(9.0)), [*expected[::-1], np.ones(8, dtype=bool)])


def test_frols_adds_what_lowers_the_residual_most():
    A, b = triangle(*regression_rows(3))
    inside, expected = [], [[]]

    def residual(j):
        return float(np.linalg.lstsq(A[:, [*inside, j]], b)[1].sum())

    for _ in range(7):  # the last column leaves no residual to compare
        inside.append(min((j for j in range(8) if j not in inside), key=residual))
        expected.append(list(inside))
    path = PATHS["frols"](A, b, np.arange(8.0))
    assert [sorted(np.flatnonzero(s)) for s in path] == [sorted(s) for s in expected]
