"""Many rows of nearly dependent columns keep their digits, through every path that rows take."""

from __future__ import annotations

import made
import numpy as np
import pytest

from imubayes.algebra import factor as algebra
from imubayes.algebra.refinement import refined, worth_refining
from imubayes.inference.dwells import whitened_factor
from imubayes.inference.whiten import Processes
from imubayes.sensors.noise import Noise
from studies.extremes import exact
from studies.extremes.digits import of_coefficients

NAMES = ("a", "b", "c")
CONDITION = 10.0
KEPT = 9.0
"""Digits, where a plain sweep over the rows leaves 4 to 7."""


def _rows(n: int = 9000, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    U, V = np.linalg.qr(rng.normal(size=(n, 3)))[0], np.linalg.qr(rng.normal(size=(3, 3)))[0]
    X = U * 10.0 ** -np.linspace(0.0, CONDITION, 3) @ V.T
    return X, X @ (np.array([30.0, 3.0, 0.0]) / np.sqrt(n) / np.abs(X).max(axis=0)) + rng.normal(size=n)


def _digits(f: algebra.Factor, X: np.ndarray, y: np.ndarray) -> float:
    fit = exact.least_squares(exact.products(X, y))
    assert fit is not None
    return of_coefficients(algebra.least_squares(f).mean, fit.mean, fit.sd)


def _whitened(X: np.ndarray, y: np.ndarray) -> algebra.Factor:
    none = Processes(np.empty(0), np.empty(0))
    return whitened_factor(made.rows_of(y, X), Noise(1.0, 0.0, 0.0), none, sharp=True)


@pytest.mark.parametrize("power", [-3.0, 0.0, 3.0])
def test_arrays_of_many_rows_keep_their_digits_at_a_condition_of_1e10_and_say_so(power):
    X, y = _rows()
    X *= 10.0**power
    found = algebra.factor_of(X, y, NAMES)
    assert _digits(found, X, y) >= max(KEPT, algebra.least_squares(found).digits.coefficients)


@pytest.mark.parametrize("n", [40, 9000])
def test_a_whitened_run_keeps_its_digits_at_a_condition_of_1e10(n):
    X, y = _rows(n)
    assert _digits(_whitened(X, y), X, y) >= KEPT


def test_adding_factors_of_runs_costs_no_more_than_their_rounding_to_doubles():
    """The condition number times 1e-16 of an sd; a sum in doubles costs sqrt(rows) times that."""
    X, y = _rows()
    two = algebra.add(_whitened(X[:4000], y[:4000]), _whitened(X[4000:], y[4000:]))
    assert _digits(two, X, y) >= 16.0 - CONDITION


def test_rows_of_other_scales_are_refined_to_the_same_numbers():
    X, y = _rows(5000)
    unit = np.array([2.0**900, 2.0**-900, 1.0])
    one, other = (algebra.factor_of(X * u, y, NAMES).R for u in (1.0, unit))
    np.testing.assert_array_equal(other[:, :3] / unit, one[:, :3])


def test_regular_and_dependent_columns_are_left_as_they_are():
    X = np.random.default_rng(3).normal(size=(5000, 3))
    y = X @ [1.0, 0.0, 0.0] + 1.0
    assert not worth_refining(algebra.factor_of(X, y, NAMES).R)
    X[:, 2] = X[:, 0] - X[:, 1]
    assert not worth_refining(algebra.triangular([np.column_stack((X, y))], 4))


def test_zero_and_dependent_columns_do_not_keep_the_others_from_their_digits():
    X, y = _rows()
    wide = np.column_stack((X[:, 0], 0.0 * y, X[:, 1], 2.0 * X[:, 0], X[:, 2]))
    made = algebra.factor_of(wide, y, ("a", "zero", "b", "twice", "c"))
    assert _digits(algebra.reorder(made, NAMES), X, y) >= KEPT
    gram = wide.T @ wide
    size = np.sqrt(np.diag(gram)) + (np.diag(gram) == 0.0)
    np.testing.assert_allclose(
        (made.R.T @ made.R)[:5, :5] / np.outer(size, size), gram / np.outer(size, size), atol=1e-13
    )


def test_rows_that_belie_the_factor_refine_nothing():
    assert refined(np.eye(2), [np.zeros((5, 2))]) is None
