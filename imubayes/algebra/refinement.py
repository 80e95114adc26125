"""Refinement of the triangular factor of many rows whose columns are nearly dependent.

A sweep over the rows rounds every column by a share eps of its norm, and least squares grows that, beside a
residual, by the square of the condition number. Here the rows A are multiplied by ``S = R^-1`` in twice the
digits of a double, which makes their columns orthonormal up to ``cond eps``; ``A S = Q C`` is then factored
without loss, and ``R = C S^-1``. What is left of the error is a rotation of Q by eps, whatever the condition
number (Yamamoto, Nakatsukasa, Yanagisawa and Fukaya, Electron. Trans. Numer. Anal. 44, 2015, with the
triangular product taken exactly).
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from imubayes.algebra import BoolArray, Extended, FloatArray, back_substitute, powers_of_two
from imubayes.algebra.compiled import strict
from imubayes.algebra.digits import norms

WORTH = 1e5
"""Condition number of columns and response, each of unit norm, below which double keeps eight digits."""

LOST = 1e-13
"""Share of a column's norm that is left beside those before it when it depends on them to rounding."""

SPLITTER = 134217729.0
"""2^27 + 1: parts a double into halves whose products are exact (Veltkamp)."""


def worth_refining(R: FloatArray) -> bool:
    """Whether columns behind a factor (w, w) are so nearly dependent that its rounding matters.

    Columns that are zero, or depend on others to rounding, are not looked at: no digit of theirs can be kept.
    """
    size, kept = norms(R), _kept(R)
    if not kept.any():
        return False
    spread = np.linalg.svd(R[:, kept] / size[kept], compute_uv=False)
    return bool(spread[0] > WORTH * spread[-1])


def refined(R: FloatArray, blocks: Iterable[FloatArray]) -> Extended | None:
    """Triangular factor (w, w) from rows (k, w) at a time once more; None where they do not bear out R.

    R (w, w) is their factor to the rounding of a double.
    """
    unit, kept = powers_of_two(norms(R)), _kept(R)
    first = R / unit
    S = np.triu(np.linalg.inv(np.linalg.qr(first[:, kept], mode="r")))
    shifted = SPLITTER * S
    high = shifted - (shifted - S)
    gram, cross = np.zeros_like(S), np.zeros((len(S), int(np.sum(~kept))))
    for rows in blocks:
        scaled, Y = rows / unit, np.empty((len(rows), len(S)))
        _times(np.ascontiguousarray(scaled[:, kept]), S, high, S - high, Y)
        gram += Y.T @ Y
        cross += Y.T @ scaled[:, ~kept]
    try:
        C = np.linalg.cholesky(gram).T
    except np.linalg.LinAlgError:
        return None
    whole = np.diag(np.where(kept, 0.0, np.diag(first))).astype(np.longdouble)
    whole[np.ix_(kept, kept)] = C.astype(np.longdouble) @ back_substitute(
        S.astype(np.longdouble), np.eye(len(S), dtype=np.longdouble)
    )
    whole[np.ix_(kept, ~kept)] = np.linalg.solve(C.T, cross)
    return np.triu(whole) * unit


def _kept(R: FloatArray) -> BoolArray:
    """Which columns (w,) are not lost beside those before them."""
    return np.abs(np.diag(R)) > LOST * norms(R)


@strict
def _times(rows, S, high, low, out):
    """Rows (n, w) times an upper triangle, sums and products in twice the digits."""
    n, w = rows.shape
    total, rest = np.empty(w), np.empty(w)
    for i in range(n):
        total[:] = 0.0
        rest[:] = 0.0
        for k in range(w):
            a = rows[i, k]
            shifted = SPLITTER * a
            a_high = shifted - (shifted - a)
            a_low = a - a_high
            for j in range(k, w):
                product = a * S[k, j]
                lost = ((a_high * high[k, j] - product) + a_high * low[k, j] + a_low * high[k, j]) + (
                    a_low * low[k, j]
                )
                added = total[j] + product
                back = added - total[j]
                rest[j] += lost + ((total[j] - (added - back)) + (product - back))
                total[j] = added
        for j in range(w):
            out[i, j] = total[j] + rest[j]
