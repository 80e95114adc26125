"""Rows and factors that know only some columns of a larger model, among all of its columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import Factor, triangular
from imubayes.inference.linear import Linear


def widened(rows: Linear, names: Sequence[str]) -> Linear:
    """Rows with zeros in the columns of `names` that they do not have."""
    where = [list(names).index(name) for name in rows.names]

    def columns(start: int, stop: int) -> FloatArray:
        part = rows.columns(start, stop)
        whole = np.zeros((len(part), len(names)))
        whole[:, where] = part
        return whole

    return replace(rows, names=tuple(names), columns=columns)


def narrowed(rows: Linear, where: Sequence[int]) -> Linear:
    """Rows with some of their columns alone, by their numbers."""
    kept = list(where)
    return replace(
        rows,
        names=tuple(rows.names[k] for k in kept),
        columns=lambda start, stop: rows.columns(start, stop)[:, kept],
    )


def widened_factor(f: Factor, names: Sequence[str]) -> Factor:
    """Factor of the same rows among the columns `names`: those that it does not have are zero.

    Examples
    --------
    >>> f = Factor(("b",), np.array([[2.0, 6.0], [0.0, 1.0]]), 5)
    >>> R = widened_factor(f, ("a", "b")).R
    >>> (R.T @ R).tolist()
    [[0.0, 0.0, 0.0], [0.0, 4.0, 12.0], [0.0, 12.0, 37.0]]
    """
    where = [list(names).index(name) for name in f.names]
    rows = np.zeros((f.p + 1, len(names) + 1))
    rows[:, [*where, len(names)]] = f.R
    R = triangular((rows,), len(names) + 1)
    return Factor(tuple(names), R, f.n, f.log_det)
