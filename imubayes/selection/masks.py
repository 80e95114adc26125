"""Sums over all 2^p models, which are numbered by masks: bit j is set where candidate j is in the model."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra.arrays import FloatArray, IntArray
from imubayes.selection.threads import pieces

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
    from imubayes.selection.passes import block_sums

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
    from imubayes.selection.passes import drawn

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
    count = np.zeros(1, dtype=np.int64)
    for _ in range(p):
        count = np.concatenate((count, count + 1))
    return count
