"""Units add up: how many have each verdict, and what each says of every term."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra.arrays import FloatArray, IntArray
from imubayes.inference.intervals import Share
from imubayes.population.records import Broken, Record
from imubayes.selection.class_needs import CANNOT_TELL

VERDICTS = ("needed", "not needed", "undecided", "inseparable", "unresolved", "untested")
"""Verdicts in the order in which they are counted."""

OPEN = CANNOT_TELL | {"undecided"}
"""Verdicts of a unit that leave a term open."""

RANGE = (0.5, 0.05, 0.95)
"""Quantiles over units: median and 90 % range."""


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


def tally(records: Sequence[Record], p: int, broken: Sequence[Broken] = ()) -> Tally:
    """Tally of some units, whose library has p terms, and of those that have no record."""
    verdicts = np.array([record.verdicts for record in records]).reshape(len(records), p)
    return Tally(
        counts=np.array([np.sum(verdicts == verdict, axis=0) for verdict in VERDICTS]),
        names=tuple(record.name for record in records),
        estimate=_rows([record.full_mean for record in records], p),
        variance=_rows([record.full_sd**2 for record in records], p),
        order=np.asarray(np.sum(verdicts == VERDICTS[0], axis=1), dtype=np.int64),
        noise=_rows([np.array(record.noise) for record in records], 3),
        samples=sum(record.samples for record in records),
        broken=tuple(broken),
    )


def _rows(arrays: Sequence[FloatArray], width: int) -> FloatArray:
    return np.array(arrays, dtype=np.float64).reshape(len(arrays), width)


def together(tallies: Sequence[Tally]) -> Tally:
    """Tally of the units of all, in their order."""
    return Tally(
        counts=np.sum([one.counts for one in tallies], axis=0),
        names=tuple(name for one in tallies for name in one.names),
        estimate=np.concatenate([one.estimate for one in tallies]),
        variance=np.concatenate([one.variance for one in tallies]),
        order=np.concatenate([one.order for one in tallies]),
        noise=np.concatenate([one.noise for one in tallies]),
        samples=sum(one.samples for one in tallies),
        broken=tuple(broken for one in tallies for broken in one.broken),
    )


def over_units(values: Sequence[float] | NDArray[np.generic]) -> Share:
    """Median and 90 % range over units."""
    return Share(*np.quantile(np.asarray(values), RANGE).tolist())
