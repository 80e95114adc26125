"""The models that a posterior is over, sums over all 2^p of them, and the threads that share this work.

A space is all subsets of the candidates, numbered by masks (bit j is set where candidate j is in the model),
or a list of those that carry the posterior.

Work on all of them is cut in pieces that do not depend on the threads, and what the pieces give comes back in
their order: the same numbers whatever the threads. Plain threads carry it, since compiled code releases the
interpreter's lock: numba's own threading layers may not be entered from two threads at once, nor after a
fork.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from multiprocessing import parent_process
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra.arrays import BoolArray, FloatArray, IntArray


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


def admissible(space: Space, needs: Sequence[tuple[int, int]]) -> BoolArray:
    """Which models (m,) of a space hold the parent of every child that they hold, both by number."""
    allowed = np.ones(len(space), dtype=bool)
    for child, parent in needs:
        allowed &= ~space.having([child]) | space.having([parent])
    return allowed


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


BLOCK_BITS = 16
"""A block of 2^16 weights stays in the second cache while it is added up."""


class Totals(NamedTuple):
    """Sums of the weights of models: of those with each candidate (p,), of all, and of each size (p + 1,)."""

    having: FloatArray
    total: float
    by_size: FloatArray


def fold(weight: FloatArray, p: int) -> tuple[FloatArray, float]:
    """Sum of the weights (2^p,) of the masks that contain each bit, and of all: 2^(p+1) additions in all.

    Examples
    --------
    >>> fold(np.array([1.0, 2.0, 3.0, 4.0]), 2)
    (array([6., 7.]), 10.0)
    """
    sums = np.zeros(p)
    for j in range(p - 1, -1, -1):
        half = len(weight) // 2
        sums[j] = weight[half:].sum()
        weight = weight[:half] + weight[half:]
    return sums, float(weight[0])


def tally(weight: FloatArray, p: int) -> Totals:
    """Sum weights (2^p,) by candidate, by size and in all; threads share blocks, and so get the same sums.

    Examples
    --------
    >>> tally(np.array([1.0, 2.0, 3.0, 4.0]), 2)
    Totals(having=array([6., 7.]), total=10.0, by_size=array([1., 5., 4.]))
    """
    from imubayes.selection.kernels import block_sums

    bits = min(BLOCK_BITS, p)
    told = pieces(lambda k: block_sums(weight, k, bits), 1 << (p - bits))
    low = np.sum([having for having, _ in told], axis=0)
    sizes_of = np.array([by_size for _, by_size in told])
    high, total = fold(sizes_of.sum(axis=1), p - bits)
    by_size = np.zeros(p + 1)
    for ones in range(p - bits + 1):
        by_size[ones : ones + bits + 1] += sizes_of[sizes(p - bits) == ones].sum(axis=0)
    return Totals(np.concatenate((low, high)), total, by_size)


def heaviest(weight: FloatArray, count: int) -> IntArray:
    """Numbers of the largest of the weights (m,), largest first.

    They lie in as many blocks, those whose own largest are the largest.

    Examples
    --------
    >>> heaviest(np.array([0.1, 0.4, 0.2, 0.3]), 2).tolist()
    [1, 3]
    """
    block = 1 << BLOCK_BITS
    blocks = weight.reshape(-1, len(weight) if len(weight) % block else block)
    near = np.argsort(-blocks.max(axis=1), kind="stable")[:count]
    chosen = np.sort(near)[:, None] * blocks.shape[1] + np.arange(blocks.shape[1])
    count = min(count, chosen.size)
    flat = chosen.ravel()
    top = flat[np.argpartition(-weight[flat], count - 1)[:count]]
    return top[np.lexsort((top, -weight[top]))]


def standing_for(weight: FloatArray, count: int) -> tuple[IntArray, FloatArray]:
    """Models that stand for all: numbers (m,), in order, and their weights (m,), which sum to the same.

    The models that are heavier than a `count`-th of all have their own weight, and so have the ten heaviest;
    the others are drawn systematically, in proportion to their weight, and share what these have together:
    sums over them are right on average, whatever is summed.

    Parameters
    ----------
    weight : of all models.
    count : models, about.
    """
    from imubayes.selection.kernels import drawn

    if len(weight) <= count:
        return np.arange(len(weight)), weight
    top = heaviest(weight, 10)
    limit = min(float(weight.sum()) / count, float(weight[top[-1]]))
    heavy, ticks, rest = drawn(weight, limit, count)
    light, repeats = np.unique(ticks, return_counts=True)
    each = rest / max(len(ticks), 1)
    every = np.concatenate((heavy, light))
    order = np.argsort(every, kind="stable")
    share = np.concatenate((weight[heavy], each * repeats.astype(np.float64)))
    return every[order], share[order]


def sizes(p: int) -> NDArray[np.int64]:
    """Return the number of included columns of each mask: (2^p,)."""
    return subset_sums(np.ones(p, dtype=np.int64))


def subset_sums(values: NDArray[np.generic]) -> NDArray[Any]:
    """Sum of what is included of values (p,), by mask: (2^p,).

    Examples
    --------
    >>> subset_sums(np.array([1.0, 2.0])).tolist()
    [0.0, 1.0, 2.0, 3.0]
    """
    sums = np.zeros(1, dtype=values.dtype)
    for value in values:
        sums = np.concatenate((sums, sums + value))
    return sums


Found = TypeVar("Found")


def threads() -> int:
    """Threads that work may be shared by: ``NUMBA_NUM_THREADS``, by default one a core.

    One in a process that another Python started: such processes share the cores already.
    """
    from numba.core import config

    return 1 if parent_process() is not None else int(config.NUMBA_NUM_THREADS)  # pyright: ignore[reportAttributeAccessIssue]


def pieces(work: Callable[[int], Found], count: int) -> list[Found]:
    """Do the pieces 0 ... count - 1 of a work.

    Parameters
    ----------
    work : of the number of a piece; compiled, and without the interpreter's lock where it takes time.
    count : of the pieces.

    Returns
    -------
    what `work` gives for each, in the order of their numbers.

    Examples
    --------
    >>> pieces(lambda k: k * k, 3)
    [0, 1, 4]
    """
    available = min(threads(), count)
    if available < 2:
        return [work(k) for k in range(count)]

    def every(first: int) -> list[Found]:
        return [work(k) for k in range(first, count, available)]

    with ThreadPoolExecutor(available) as pool:
        found = list(pool.map(every, range(available)))
    return [found[k % available][k // available] for k in range(count)]


STEPS = 60
"""Most steps on the way to a score's best subset."""


def descended(
    among: BoolArray,
    scores: Callable[[Space], Mapping[str, FloatArray]],
    mended: Callable[[BoolArray], BoolArray],
) -> BoolArray:
    """Subsets of a list (m, p), and all that lie about the way down from the best of them under each score.

    Parameters
    ----------
    among : subsets to start from.
    scores : of subsets, by name: the smaller, the better.
    mended : makes subsets (m, p) admissible.

    Examples
    --------
    >>> empty = np.zeros((1, 3), dtype=bool)
    >>> found = descended(empty, lambda s: {"terms": -s.sizes() * 1.0}, lambda inside: inside)
    >>> bool(found.all(axis=1).any())
    True
    """
    first = mended(among)
    found = [first]
    for name, values in scores(Listed(first)).items():
        best, least = first[int(np.argmin(values))], float(values.min())
        for _ in range(STEPS):
            near = mended(_neighbours(best))
            found.append(near)
            around = scores(Listed(near))[name]
            if not around.min() < least:
                break
            best, least = near[int(np.argmin(around))], float(around.min())
    return np.unique(np.concatenate(found), axis=0)


def _neighbours(inside: BoolArray) -> BoolArray:
    """Subsets (m, p) with one term more, one less, or one exchanged for another."""
    flips = inside ^ np.eye(len(inside), dtype=bool)
    there, away = np.flatnonzero(inside), np.flatnonzero(~inside)
    swaps = np.tile(inside, (len(there) * len(away), 1))
    rows = np.arange(len(swaps))
    swaps[rows, np.repeat(there, len(away))] = False
    swaps[rows, np.tile(away, len(there))] = True
    return np.concatenate((flips, swaps))
