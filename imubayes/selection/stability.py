"""Resampled campaigns: dwells drawn with replacement, or split into halves, by run.

Dwells are whitened, so that they are independent given the coefficients; single rows of coloured noise are
not, and drawing them singly would take their common drift for something that many rows confirm. Each run
keeps its number of dwells: a campaign without its centrifuge would be another campaign.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import factor as algebra
from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import Factor
from imubayes.inference.dwells import Pieces, few_rows

Counts = NDArray[np.int64]

CUT = 0.9
"""Selection frequency over halves from which a term is stable: the upper end of what Meinshausen and Buhlmann
(2010) recommend (0.6 to 0.9), since strong terms reach 1."""


@dataclass(frozen=True, slots=True, eq=False)
class Dwelled:
    """Whitened rows of all dwells, as few as hold all that the dwells say.

    Attributes
    ----------
    names : the p columns.
    rows : (m, p + 1).
    dwell : (m,) the dwell that a row belongs to.
    sizes : dwells of each run.
    known : (k, p + 1) rows that every campaign has.
    """

    names: tuple[str, ...]
    rows: FloatArray
    dwell: NDArray[np.int64]
    sizes: tuple[int, ...]
    known: FloatArray


def dwelled(pieces: Sequence[Pieces], names: tuple[str, ...]) -> Dwelled:
    """Bring the dwells of all runs to the named columns."""
    known, R = (_columns([p for p in pieces if p.kept is kept], names) for kept in (True, False))
    rows, kept = few_rows(R)
    sizes = tuple(len(p) for p in pieces if not p.kept)
    return Dwelled(names, rows[kept], np.nonzero(kept)[0], sizes, known.reshape(-1, known.shape[2]))


def _columns(pieces: Sequence[Pieces], names: tuple[str, ...]) -> FloatArray:
    """Factors (q, w, p + 1) of pieces, over the named columns."""
    parts = [p.R[:, :, [*(p.names.index(name) for name in names), -1]] for p in pieces]
    return np.concatenate(parts) if parts else np.zeros((0, len(names) + 1, len(names) + 1))


def resampled(d: Dwelled, counts: Counts) -> Factor:
    """Factor of the dwells, each taken as often as `counts` says."""
    times = counts[d.dwell]
    taken = times > 0
    rows = np.concatenate((d.known, np.sqrt(times[taken])[:, None] * d.rows[taken]))
    width = len(d.names) + 1
    return Factor(d.names, algebra.triangular([rows] if len(rows) else [], width), len(rows))


def with_replacement(sizes: Sequence[int], draws: int, rng: np.random.Generator) -> Iterator[Counts]:
    """Counts of the dwells in campaigns that draw as many dwells of each run as it has.

    Examples
    --------
    >>> [int(c.sum()) for c in with_replacement((4, 3), 2, np.random.default_rng(1))]
    [7, 7]
    """
    for _ in range(draws):
        yield np.concatenate([rng.multinomial(q, np.full(q, 1.0 / q)) for q in sizes])


def halves(sizes: Sequence[int], pairs: int, rng: np.random.Generator) -> Iterator[Counts]:
    """Counts of the dwells in complementary halves, one after the other.

    Examples
    --------
    >>> a, b = halves((4, 3), 1, np.random.default_rng(1))
    >>> (a + b).tolist()
    [1, 1, 1, 1, 1, 1, 1]
    """
    for _ in range(pairs):
        first = np.concatenate([rng.permutation((np.arange(q) + rng.integers(2)) % 2) for q in sizes])
        yield first
        yield 1 - first


def false_bound(selected: float, p: int, cut: float = CUT) -> float:
    """Bound on the expected number of false terms among the stable ones, ``q^2 / ((2 cut - 1) p)``.

    Meinshausen and Buhlmann (2010), theorem 1. With complementary halves it holds without assumption for
    terms that a half selects no more often than q/p, a random pick (Shah and Samworth 2013, theorem 1).

    Parameters
    ----------
    selected : q, terms that a half selects on average.
    p : candidates.
    cut : selection frequency from which a term is stable.

    Examples
    --------
    >>> round(false_bound(2.0, 20), 3)
    0.25
    """
    return selected**2 / ((2.0 * cut - 1.0) * p)
