"""How many digits of a result its arithmetic can be trusted for.

Householder and Givens transformations give the exact factor of columns that differ from the given ones by a
few units of rounding of each column's norm. What such differences do to the results follows to first order
(Björck, Numerical Methods for Least Squares Problems, 1996, section 1.4; Higham, Accuracy and Stability of
Numerical Algorithms, 2002, section 20.1), with ``W = R^-1`` for columns of unit norm, eta_k the rounding of
column k and eta_y that of the response::

    |d theta_j| <= |W_j| e + rho sum_k |WW'|_jk eta_k,    e = eta_y |y| + sum_k eta_k |theta_k|
    |d sd_j| / sd_j <= sum_k |WW'|_jk eta_k / |W_j| + e / rho,    |d ln det R| <= sum_k |W_k| eta_k

So an error counted in sds depends on the condition number only through the residual: the digits are known
before any reference is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from imubayes.algebra import FloatArray, powers_of_two

HALF_UNIT = 2.0**-53
"""Rounding of a double."""

MOST = 15
"""Digits of a double."""

FIRST_ORDER = 0.1
"""Relative change of a column's own part beyond which the first order says nothing: no digit is claimed."""

ROWS_A_BLOCK = 4096
"""Rows between two sweeps, whose roundings add like a random walk."""

SWEEP = 4.0
"""Roundings of one sweep over p columns are below ``SWEEP sqrt(p + 1)`` units: measured, they are below one
unit ``sqrt(p + 1)``; the rigorous bound grows with rows times columns and is thousands of times too large."""


@dataclass(frozen=True, slots=True)
class Digits:
    """Decimal digits that can be trusted, whole numbers from 0 to 15.

    Those of coefficients count against the larger of size and sd, those of a log evidence behind the point
    where its size is below one, those of an inclusion behind the point.
    """

    coefficients: int
    sd: int
    log_evidence: int
    inclusion: int


@dataclass(frozen=True, slots=True, eq=False)
class Bounds:
    """First-order bounds on what rounding does to least squares.

    `coefficients` (p,) are in their units, `sd` (p,) relative; `response` is of what the columns leave of it,
    in its units, and `log_det` of ``ln |det R|``.
    """

    coefficients: FloatArray
    sd: FloatArray
    response: float
    log_det: float


def rounding_of(rows: int, columns: int, unit: float = HALF_UNIT) -> float:
    """Relative rounding of a column's norm after a sweep over so many rows.

    Examples
    --------
    >>> f"{rounding_of(1000, 3):.1e}"
    '9.9e-16'
    """
    return SWEEP * unit * math.sqrt(columns + 1) * math.sqrt(1.0 + rows / ROWS_A_BLOCK)


def bounds(R: FloatArray, rounding: FloatArray | float) -> Bounds:
    """Bounds on the errors of least squares from a factor R (p + 1, p + 1), with no zero on X's diagonal.

    `rounding` is relative, of each column and of the response: (p + 1,), or one for all.
    """
    p = len(R) - 1
    eta = np.broadcast_to(rounding, p + 1)
    size = norms(R)
    unit = np.where(size > 0.0, size, 1.0)
    A = R / unit
    W = np.linalg.solve(A[:-1, :-1], np.eye(p)) if p else np.empty((0, 0))
    reach, theta = np.linalg.norm(W, axis=1), W @ A[:-1, -1]
    shared = np.abs(W @ W.T) @ eta[:-1]
    if p and np.max(reach * eta[:-1]) > FIRST_ORDER:
        return Bounds(np.full(p, np.inf), np.full(p, np.inf), math.inf, math.inf)
    left = abs(float(A[-1, -1]))
    response = float(eta[-1] + np.abs(theta) @ eta[:-1])
    with np.errstate(over="ignore", divide="ignore"):
        coefficients = (reach * response + left * shared) * (unit[-1] / unit[:-1])
        sd = shared / reach + (response / left if left > 0.0 else math.inf)
    return Bounds(coefficients, sd, response * float(unit[-1]), float(reach @ eta[:-1]))


def norms(R: FloatArray) -> FloatArray:
    """Norms (p,) of columns whose squares may leave the range of doubles."""
    unit = powers_of_two(np.abs(R).max(axis=0, initial=0.0))
    return unit * np.linalg.norm(R / unit, axis=0)


def digits_within(error: float) -> int:
    """Whole digits that an error of this share of a quantity leaves.

    Examples
    --------
    >>> digits_within(2e-6), digits_within(0.5), digits_within(0.0)
    (5, 0, 15)
    """
    if not error < 1.0:
        return 0
    return MOST if error <= 10.0**-MOST else int(-math.log10(error))
