"""The models that a posterior is over: all subsets of the candidates, or a list of those that carry it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from imubayes.algebra.arrays import BoolArray, FloatArray, IntArray
from imubayes.selection.masks import fold, sizes


@dataclass(frozen=True, slots=True)
class Every:
    """All 2^p subsets of p candidates, numbered by masks: bit j is set where candidate j is in."""

    p: int

    def __len__(self) -> int:
        return 1 << self.p

    def sizes(self) -> IntArray:
        """Candidates in each model: (2^p,)."""
        return sizes(self.p)

    def sums(self, weight: FloatArray) -> tuple[FloatArray, float]:
        """Sum of the weights of the models with each candidate (p,), and of all."""
        return fold(weight, self.p)

    def having(self, bits: Iterable[int]) -> BoolArray:
        """Which models contain every one of the candidates `bits`: (2^p,)."""
        mask = sum(1 << bit for bit in bits)
        return (np.arange(len(self)) & mask) == mask

    def having_any(self, bits: Iterable[int]) -> BoolArray:
        """Which models contain at least one of the candidates `bits`: (2^p,)."""
        mask = sum(1 << bit for bit in bits)
        return (np.arange(len(self)) & mask) != 0

    def members(self, which: IntArray) -> BoolArray:
        """Which candidates are in the models numbered `which` (k,): (k, p)."""
        return ((which[:, None] >> np.arange(self.p)) & 1).astype(bool)

    @property
    def full(self) -> int:
        """Number of the model with every candidate."""
        return len(self) - 1


@dataclass(frozen=True, slots=True, eq=False)
class Listed:
    """Some subsets of the candidates: the rows of `inside` (m, p), the model with every candidate last."""

    inside: BoolArray

    def __len__(self) -> int:
        return len(self.inside)

    @property
    def p(self) -> int:
        """Number of candidates."""
        return self.inside.shape[1]

    def sizes(self) -> IntArray:
        """Candidates in each model: (m,)."""
        return self.inside.sum(axis=1)

    def sums(self, weight: FloatArray) -> tuple[FloatArray, float]:
        """Sum of the weights of the models with each candidate (p,), and of all."""
        return weight @ self.inside, float(weight.sum())

    def having(self, bits: Iterable[int]) -> BoolArray:
        """Which models contain every one of the candidates `bits`: (m,)."""
        return np.asarray(self.inside[:, list(bits)].all(axis=1))

    def having_any(self, bits: Iterable[int]) -> BoolArray:
        """Which models contain at least one of the candidates `bits`: (m,)."""
        return np.asarray(self.inside[:, list(bits)].any(axis=1))

    def members(self, which: IntArray) -> BoolArray:
        """Which candidates are in the models numbered `which` (k,): (k, p)."""
        return self.inside[which]

    @property
    def full(self) -> int:
        """Number of the model with every candidate."""
        return len(self) - 1


Space = Every | Listed


def listed(inside: BoolArray, weight: FloatArray) -> tuple[Listed, FloatArray]:
    """Models (m, p) and their weights (m,), with the model of every candidate last, if only at weight 0.

    Examples
    --------
    >>> space, weight = listed(np.array([[True, True], [False, True]]), np.array([0.3, 0.7]))
    >>> space.inside.tolist(), weight.tolist()
    ([[False, True], [True, True]], [0.7, 0.3])
    """
    whole = inside.all(axis=1)
    rows = np.vstack((inside[~whole], np.ones((1, inside.shape[1]), dtype=bool)))
    return Listed(rows), np.append(weight[~whole], weight[whole].sum())


def united(spaces: Sequence[Space], weights: Sequence[FloatArray]) -> tuple[Space, FloatArray]:
    """One space of several over the same candidates, and the sum of their weights there."""
    first = spaces[0]
    if isinstance(first, Every):
        return first, np.sum(weights, axis=0)
    inside = np.concatenate([s.members(np.arange(len(s))) for s in spaces])
    packed, which = np.unique(np.packbits(inside, axis=1), axis=0, return_inverse=True)
    summed = np.zeros(len(packed))
    np.add.at(summed, which.ravel(), np.concatenate(list(weights)))
    return listed(np.unpackbits(packed, axis=1, count=first.p).astype(bool), summed)
