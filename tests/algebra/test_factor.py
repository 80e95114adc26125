"""The algebra of the triangular factor, as laws; least squares against published numbers."""

from __future__ import annotations

import json
import math
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imubayes.algebra import factor as algebra
from imubayes.algebra.factor import EXTENDED_ROWS, Factor, add, factor_of, least_squares, reorder
from imubayes.errors import UnobservableError
from imubayes.inference.dwells import always, stacked
from imubayes.inference.summary import Summary
from studies.extremes import exact

IDENTITY = 1e-10

seeds = st.integers(0, 2**32 - 1)
widths = st.integers(1, 7)


def _rows(seed: int, p: int, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Regular rows: normal columns, each with a size of its own."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=(n, p)) * 10.0 ** rng.uniform(-6, 6, p), rng.normal(size=n)


def _names(p: int) -> tuple[str, ...]:
    return tuple("abcdefgh"[:p])


def _factor(seed: int, p: int, n: int, *, log_det: float = 0.0) -> Factor:
    return factor_of(*_rows(seed, p, n), _names(p), log_det=log_det)


def _signed(R: np.ndarray) -> np.ndarray:
    """The one factor with a positive diagonal: a row's sign is free."""
    return R * np.where(np.diag(R) < 0.0, -1.0, 1.0)[:, None]


def _same(a: Factor, b: Factor) -> None:
    size = np.linalg.norm(b.R, axis=0)
    np.testing.assert_allclose(_signed(a.R) / size, _signed(b.R) / size, rtol=0.0, atol=IDENTITY)
    assert (a.names, a.n) == (b.names, b.n)
    assert a.log_det == pytest.approx(b.log_det, rel=1e-14)


@given(seed=seeds, p=widths, more=st.integers(0, 12))
def test_factor_of_three_runs_is_factor_of_their_stack(seed, p, more):
    X, y = _rows(seed, p, 3 * p + 6 + more)
    cuts = (0, p + 2, 2 * p + 4, len(y))
    parts = [factor_of(X[a:b], y[a:b], _names(p)) for a, b in pairwise(cuts)]
    _same(add(*parts), factor_of(X, y, _names(p)))
    _same(stacked([always(f) for f in parts]), factor_of(X, y, _names(p)))


@given(st.lists(st.lists(st.integers(-3, 3), min_size=4, max_size=4), min_size=1, max_size=9))
def test_factor_keeps_every_inner_product_whatever_the_rank(rows):
    whole = np.array(rows, dtype=float)
    R = factor_of(whole[:, :3], whole[:, 3], _names(3)).R
    assert np.array_equal(R, np.triu(R))
    size = np.linalg.norm(whole, axis=0)
    np.testing.assert_allclose(R.T @ R, whole.T @ whole, rtol=0.0, atol=1e-14 * (size.max() ** 2 or 1.0))


@given(seeds, st.permutations(range(5)), st.integers(1, 5))
def test_reorder_is_the_factor_of_the_columns_named(seed, order, kept):
    X, y = _rows(seed, 5, 12)
    names = tuple(_names(5)[j] for j in order[:kept])
    _same(reorder(factor_of(X, y, _names(5)), names), factor_of(X[:, order[:kept]], y, names))


@pytest.mark.parametrize("n", [20, EXTENDED_ROWS + 10])
@given(seed=seeds, exponents=st.lists(st.integers(-490, 490), min_size=4, max_size=4))
def test_scaling_a_column_by_a_power_of_two_changes_no_digit(n, seed, exponents):
    rng = np.random.default_rng(seed)
    X, y = rng.normal(size=(n, 3)), rng.normal(size=n)
    unit = np.exp2(exponents)
    scaled, plain = factor_of(X * unit[:3], y * unit[3], _names(3)), factor_of(X, y, _names(3))
    np.testing.assert_array_equal(scaled.R, plain.R * unit)


@pytest.mark.parametrize(
    "n", [EXTENDED_ROWS - 1, EXTENDED_ROWS, EXTENDED_ROWS + 1, 3 * algebra.ROWS_AT_ONCE + 1]
)
def test_factor_does_not_depend_on_how_the_rows_are_blocked(n):
    X, y = _rows(7, 4, n)
    whole = np.column_stack((X, y))
    direct = Factor(_names(4), np.linalg.qr(whole / np.abs(whole).max(axis=0), mode="r"), n)
    scaled = factor_of(X / np.abs(X).max(axis=0), y / np.abs(y).max(), _names(4))
    _same(scaled, direct)


@given(seeds, st.integers(1, 5), st.integers(0, 4))
def test_least_squares_leaves_residuals_orthogonal_to_every_column(seed, p, spare):
    X, y = _rows(seed, p, p + 1 + spare)
    found = least_squares(factor_of(X, y, _names(p)))
    residual = y - X @ found.mean
    reach = np.linalg.norm(X, axis=0) * np.linalg.norm(np.abs(y) + np.abs(X) @ np.abs(found.mean))
    assert np.max(np.abs(X.T @ residual) / reach) < 1e-13
    assert found.rss == pytest.approx(residual @ residual, rel=1e-9, abs=1e-13 * (y @ y))
    assert found.dof == 1 + spare


@pytest.mark.parametrize("n", [30, 2 * EXTENDED_ROWS + 1])
@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_a_dependent_column_is_named_and_not_solved_for(n, scale):
    X = np.random.default_rng(3).normal(size=(n, 4))
    X[:, 2] = (X[:, 0] - 2.0 * X[:, 1]) * scale
    with pytest.raises(UnobservableError, match=r"do not tell c from the others") as caught:
        least_squares(factor_of(X, X[:, 3] + 1.0, _names(4)))
    assert caught.value.terms == ("c",)


def test_fewer_rows_than_columns_are_unobservable():
    with pytest.raises(UnobservableError, match="2 rows"):
        least_squares(_factor(1, 3, 2))


def test_factors_of_different_columns_do_not_add():
    a = _factor(1, 2, 5)
    with pytest.raises(ValueError, match="different columns"):
        add(a, reorder(a, ("b", "a")))


PLAIN_QR = {
    "Norris": 13.3, "Pontius": 12.4, "NoInt1": 15.0, "NoInt2": 15.0, "Filip": 7.3, "Longley": 10.9,
    "Wampler1": 9.6, "Wampler2": 13.2, "Wampler3": 9.1, "Wampler4": 7.7, "Wampler5": 5.7,
}  # fmt: skip
"""Correct digits (worst coefficient) of Householder QR in double precision, on raw columns or on scaled ones
with one refinement, whichever has fewer; the sets without a published number are exact to rounding."""

ROUNDED = 0.05
"""The numbers of `PLAIN_QR` are printed to a tenth."""


def _digits(found: np.ndarray, exact: list[str]) -> float:
    """Log relative error of the worst coefficient (absolute where the exact one is zero), at most 16."""
    errors = []
    for value, text in zip(found.tolist(), exact, strict=True):
        truth = Fraction(text)
        errors.append(float(abs(Fraction(value) - truth) / (abs(truth) or 1)))
    return -math.log10(max([*errors, 1e-16]))


def _read(references, name: str) -> tuple[np.ndarray, np.ndarray, dict]:
    """Columns, response and exact numbers of a set of the NIST StRD."""
    record = json.loads((references / "nist/certified.json").read_text())[name]
    rows = np.loadtxt(references / f"nist/csv/{name}.csv", delimiter=",", skiprows=1)
    y, x = rows[:, 0], rows[:, 1:]
    if name.startswith("NoInt"):
        return x, y, record
    if x.shape[1] == 1:
        return x ** np.arange(record["p"]), y, record
    return np.column_stack((np.ones(len(y)), x)), y, record


@pytest.mark.parametrize("name", PLAIN_QR)
def test_least_squares_has_the_digits_of_householder_qr_on_nist_strd(references, name, measured):
    """Correct digits against exact arithmetic on the printed data, measured with an 80-bit longdouble.

    ========= ============ ===== ========= ========================================
    set       coefficients sds   plain QR  what limits the coefficients
    ========= ============ ===== ========= ========================================
    Norris    14.0         14.0  13.3      data rounded to double
    Pontius   13.5         13.8  12.4      data rounded to double
    NoInt1    16.0         16.0  -         the printed double
    NoInt2    16.0         16.0  -         the printed double
    Filip     7.6          7.6   7.3       powers rounded to double (10.6 without)
    Longley   14.7         15.1  10.9      data rounded to double
    Wampler1  12.7         13.2  9.6       64 bits of mantissa
    Wampler2  13.2         15.2  13.2      data rounded to double
    Wampler3  12.8         15.8  9.1       64 bits of mantissa
    Wampler4  11.3         15.7  7.7       64 bits of mantissa
    Wampler5  9.3          15.7  5.7       64 bits of mantissa
    ========= ============ ===== ========= ========================================
    """
    X, y, record = _read(references, name)
    found = Summary.from_arrays(X, y, [f"B{j}" for j in range(X.shape[1])]).least_squares()
    digits = {"coefficients": _digits(found.mean, record["exact_beta_30"])}
    # where the fit is perfect the exact sds are zero, and what is left is rounding of y
    digits["sds"] = _digits(found.sd, record["exact_sd_30"])
    for what, value in digits.items():
        measured(f"{name}, digits of {what}", round(value, 1))
        assert value > PLAIN_QR[name] - ROUNDED, what
    assert found.dof == record["n"] - record["p"]


@pytest.mark.skipif(np.finfo(np.longdouble).nmant < 63, reason="longdouble is no wider than double here")
@pytest.mark.parametrize("name", PLAIN_QR)
def test_least_squares_loses_no_more_than_the_condition_number_of_the_doubles_given(references, name):
    """Against exact arithmetic on the very same doubles: what is lost is the algorithm's own."""
    X, y, record = _read(references, name)
    p, condition = X.shape[1], record["cond_colscaled"]
    found = Summary.from_arrays(X, y, [f"B{j}" for j in range(p)]).least_squares()
    error = np.abs(found.mean - exact.least_squares(exact.products(X, y)).mean)
    # Higham, Accuracy and Stability, theorem 20.1, for scaled columns at the unit roundoff of 64 bits
    backward = p * 2.0**-64 * (condition * np.linalg.norm(y) + condition**2 * math.sqrt(found.rss))
    rounding = 2.0**-52 * np.abs(found.mean)  # of both to double
    assert np.all(error <= rounding + backward / np.linalg.norm(X, axis=0))


@pytest.mark.parametrize(("follow", "rounded"), [(0.0, 0.0), (1.0, 0.0), (1.0, 1e-9)])
def test_columns_that_do_nothing_new_leave_the_noise_scale_alone_whatever_the_blocks(follow, rounded):
    rng = np.random.default_rng(6)
    X, y = rng.normal(size=(60, 15)), rng.normal(size=60)
    X[:, 2:12] = follow * X[:, :2] @ rng.normal(size=(2, 10)) + rounded * rng.normal(size=(60, 10))
    names = tuple(f"x{k}" for k in range(15))
    whole = factor_of(X, y, names)
    halves = add(factor_of(X[:23], y[:23], names), factor_of(X[23:], y[23:], names))
    left = y - X @ np.linalg.lstsq(X, y, rcond=1e-7)[0]
    expected = np.sqrt(left @ left / (60 - 5))
    for one in (whole, halves):
        assert algebra.noise_scale(one, np.ones(15)) == pytest.approx(
            expected, rel=max(1e-10, 10.0 * rounded)
        )
