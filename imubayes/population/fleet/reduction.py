"""Units add up: tallies of parts are merged as a tree whose shape depends on the number of parts only.

Part k is a leaf; nodes 2k and 2k + 1 of a level make node k of the next one, the left one first, as soon as
both are there. Whichever parts are done first, each number is computed from the same two others.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from imubayes.algebra.arrays import FloatArray, IntArray
from imubayes.population.fleet.units import Broken, PartFound

VERDICTS = ("needed", "not needed", "undecided", "inseparable", "unresolved", "untested")
"""Verdicts in the order in which they are counted."""


@dataclass(frozen=True, slots=True, eq=False)
class Tally:
    """What some of the units say together.

    Attributes
    ----------
    counts : (6, p) units with each verdict of each term, in the order of `VERDICTS`.
    names : of the n units that have a record.
    estimate, variance : (n, p) of their terms, SI and squared, without shrinkage.
    order : (n,) number of needed terms of each unit.
    noise : (n, 3) N, B, K of each unit, SI.
    samples : rows that were used.
    broken : units that have no record.
    """

    counts: IntArray
    names: tuple[str, ...]
    estimate: FloatArray
    variance: FloatArray
    order: IntArray
    noise: FloatArray
    samples: int
    broken: tuple[Broken, ...]


def tally(found: PartFound, p: int) -> Tally:
    """Tally of one part, whose library has p terms."""
    records = found.records
    verdicts = np.array([record.verdicts for record in records]).reshape(len(records), p)
    return Tally(
        counts=np.array([np.sum(verdicts == verdict, axis=0) for verdict in VERDICTS]),
        names=tuple(record.name for record in records),
        estimate=_rows([record.full_mean for record in records], p),
        variance=_rows([record.full_sd**2 for record in records], p),
        order=np.asarray(np.sum(verdicts == VERDICTS[0], axis=1), dtype=np.int64),
        noise=_rows([np.array(record.noise) for record in records], 3),
        samples=sum(record.samples for record in records),
        broken=found.broken,
    )


def _rows(arrays: Sequence[FloatArray], width: int) -> FloatArray:
    return np.array(arrays, dtype=np.float64).reshape(len(arrays), width)


def merge(a: Tally, b: Tally) -> Tally:
    """Tally of the units of both, those of `a` first."""
    return Tally(
        counts=a.counts + b.counts,
        names=a.names + b.names,
        estimate=np.concatenate((a.estimate, b.estimate)),
        variance=np.concatenate((a.variance, b.variance)),
        order=np.concatenate((a.order, b.order)),
        noise=np.concatenate((a.noise, b.noise)),
        samples=a.samples + b.samples,
        broken=a.broken + b.broken,
    )


def reduced(leaves: Iterable[tuple[int, Tally]], count: int) -> Tally:
    """Merge all leaves as they come.

    Parameters
    ----------
    leaves : each with its index, in any order, each index below `count` once.
    count : of the leaves, 1 or more.
    """
    waiting: dict[tuple[int, int], Tally] = {}
    for index, leaf in leaves:
        _grow(waiting, index, leaf, count)
    (root,) = waiting.values()
    return root


def _grow(waiting: dict[tuple[int, int], Tally], place: int, node: Tally, width: int) -> None:
    """Put a leaf in its place, and merge it upwards for as long as its sibling is there, or has no place."""
    level = 0
    while width > 1:
        sibling = (level, place ^ 1)
        if sibling[1] < width:
            if sibling not in waiting:
                break
            other = waiting.pop(sibling)
            node = merge(other, node) if place % 2 else merge(node, other)
        level, place, width = level + 1, place // 2, (width + 1) // 2
    waiting[level, place] = node
