"""Digits that are stated before any reference is known, against exact arithmetic."""

from __future__ import annotations

import numpy as np
import pytest

from imubayes.algebra import factor as algebra
from imubayes.algebra.digits import HALF_UNIT, bounds
from imubayes.algebra.factor import factor_of, least_squares
from imubayes.errors import UnobservableError
from studies.extremes import exact
from studies.extremes.digits import of_coefficients


def _alike(seed: int, apart: float, n: int = 30) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(n, 3))
    X[:, 2] = X[:, 0] + apart * X[:, 2]
    return X, X @ [1.0, 2.0, -1.0] + 10.0 ** rng.uniform(-6.0, 1.0) * rng.normal(size=n)


@pytest.mark.parametrize("apart", [1.0, 1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("seed", range(3))
def test_stated_digits_of_least_squares_never_exceed_the_true_ones(seed, apart):
    X, y = _alike(seed, apart)
    extended = factor_of(X, y, ("a", "b", "c"))
    plain = algebra.Factor(extended.names, algebra.triangular((np.column_stack((X, y)),), 4), len(y))
    truth = exact.least_squares(exact.products(X, y)).mean
    for f in (extended, plain):
        found = least_squares(f)
        assert of_coefficients(found.mean, truth, found.sd) >= found.digits.coefficients


@pytest.mark.skipif(np.finfo(np.longdouble).nmant < 63, reason="longdouble is no wider than double here")
def test_extended_precision_states_the_digits_that_its_longer_mantissa_adds():
    X, y = _alike(1, 1e-6)
    extended = factor_of(X, y, ("a", "b", "c"))
    plain = algebra.Factor(extended.names, extended.R, len(y))
    gained = least_squares(extended).digits.coefficients - least_squares(plain).digits.coefficients
    assert gained in (2, 3, 4)  # 2^11 and half a digit of it is the longdouble's own epsilon


def test_bounds_cover_what_a_change_of_every_entry_by_one_rounding_does():
    X, y = _alike(3, 1e-5)
    rng = np.random.default_rng(4)
    before, found = least_squares(factor_of(X, y, "abc")), bounds(factor_of(X, y, "abc").R, HALF_UNIT)
    size = np.linalg.norm(np.column_stack((X, y)), axis=0) / np.sqrt(len(y))
    for _ in range(50):
        off = rng.uniform(-1.0, 1.0, size=(len(y), 4)) * HALF_UNIT * size
        # a thousand times the rounding, so that it stands out from that of the computation
        after = least_squares(factor_of(X + 1e3 * off[:, :3], y + 1e3 * off[:, 3], "abc"))
        assert np.all(np.abs(after.mean - before.mean) <= 1e3 * found.coefficients)
        assert np.all(np.abs(after.sd / before.sd - 1.0) <= 1e3 * found.sd)


def test_nothing_is_claimed_where_the_first_order_says_nothing():
    R = np.array([[1.0, 1.0, 1.0], [0.0, 1e-15, 1.0], [0.0, 0.0, 1.0]])
    assert np.all(np.isinf(bounds(R, HALF_UNIT).coefficients))


def test_coefficients_beyond_the_doubles_are_refused():
    X, y = _alike(5, 1.0)
    with pytest.raises(UnobservableError, match="range of doubles"):
        least_squares(factor_of(X * 1e-300, y * 1e300, ("a", "b", "c")))


def test_as_many_rows_as_columns_leave_the_sds_without_bound():
    X, y = _alike(6, 1.0, n=3)
    found = least_squares(factor_of(X, y, ("a", "b", "c")))
    np.testing.assert_allclose(found.mean, np.linalg.solve(X, y), rtol=1e-12)
    assert np.all(np.isinf(found.sd))
    assert found.digits.sd == 0
