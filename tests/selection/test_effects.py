"""Detectable effects, and the evidence of a support."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from imubayes.algebra.factor import factor_of
from imubayes.selection.effects import best_of, effects_of, log_evidence, refitted

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


def test_problem_in_effects_knows_no_units(rows, effects):
    X, y = rows
    units = np.array([1.0, 1e6, 1e-4, 3.0, 1e-9])
    other = effects_of(factor_of(X * units, y, NAMES), SD / units, CANDIDATES, SCALE)
    turned = other.R * np.sign(np.diag(other.R) * np.diag(effects.R))[:, None]
    assert np.abs(turned[:-1] - effects.R[:-1]).max() < 1e-10 * np.abs(effects.R).max()


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
