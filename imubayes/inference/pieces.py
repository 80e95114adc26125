"""A run cut to its dwells: one small factor each, which can be left out, doubled, and added up again.

The rows are whitened as a whole, in their order, so that a dwell's rows are what it adds to the dwells before
it: the pieces are independent given the coefficients, and their factors stack to the factor of the run.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import factor as algebra
from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import Factor

ROUNDING = 1e-15
"""A direction of a dwell that is smaller, beside the columns of all dwells, is rounding."""


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """Factors of the q dwells of a run.

    Attributes
    ----------
    run : its name.
    names : the p columns.
    start, stop : (q,) s.
    rows : (q,) samples of each dwell.
    R : (q, p + 1, p + 1) triangular factor of the whitened ``[X y]`` of each dwell.
    log_det : (q,) log determinant of the noise covariance of each dwell, given those before it.
    kept : whether they are always there: never left out, and never drawn twice.
    """

    run: str
    names: tuple[str, ...]
    start: FloatArray
    stop: FloatArray
    rows: NDArray[np.int64]
    R: FloatArray
    log_det: FloatArray
    kept: bool = False

    def __len__(self) -> int:
        return len(self.rows)


def always(f: Factor) -> Pieces:
    """A factor from elsewhere as one piece that is always there."""
    nowhen = np.array([np.nan])
    return Pieces("", f.names, nowhen, nowhen, np.array([f.n]), f.R[None], np.array([f.log_det]), kept=True)


def few_rows(R: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Rows (q, w, w) that say what the factors R (q, w, w) of dwells do, and which (q, w) say something.

    A dwell at constant inputs moves the columns in a few directions only.
    """
    size = np.linalg.norm(R, axis=(0, 1))
    _, s, directions = np.linalg.svd(R / np.where(size > 0.0, size, 1.0), full_matrices=False)
    return s[:, :, None] * directions * size, s > ROUNDING


def stacked(pieces: Sequence[Pieces], counts: Sequence[NDArray[np.int64]] | None = None) -> Factor:
    """Factor of dwells, each taken as often as `counts` says; once without counts.

    Parameters
    ----------
    pieces : of one or more runs, over the same columns.
    counts : (q,) repetitions of each dwell, by run: 0 leaves it out, 2 doubles it.
    """
    times = [np.ones(len(p), dtype=np.int64) for p in pieces] if counts is None else list(counts)
    names = pieces[0].names
    kept = [np.sqrt(c[c > 0])[:, None, None] * p.R[c > 0] for p, c in zip(pieces, times, strict=True)]
    tall = np.concatenate([part.reshape(-1, len(names) + 1) for part in kept])
    return Factor(
        names=names,
        R=algebra.triangular([tall], len(names) + 1),
        n=int(sum(np.sum(c * p.rows) for p, c in zip(pieces, times, strict=True))),
        log_det=float(sum(np.sum(c * p.log_det) for p, c in zip(pieces, times, strict=True))),
    )
