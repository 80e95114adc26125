"""The time of a file's rows: clocks that wrap around, that are set back, or that are read in coarse steps."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra.arrays import FloatArray
from imubayes.errors import DataError
from imubayes.rig.columns import Column
from imubayes.rig.formats import Table
from imubayes.rig.inputs import GAP

CAUGHT_UP = 10
"""Rows within which a time that went back is past its old value where rows are out of order."""

SET_BACK = 3
"""Times that a clock may be set back in a file; beyond it the rows are not in the order of time."""

REPEATED = 0.02
"""Share of rows with the time of the row before, from which on the clock is coarse, not a row doubled."""

RAGGED = 0.05
"""Resolution of a clock over the sampling interval, from which on its steps are uneven by it."""

ENOUGH = 100
"""Rows that show how a clock steps."""


def _plain(raw: NDArray[Any]) -> NDArray[Any]:
    return raw.astype(np.int64 if raw.dtype.kind in "iu" else np.float64)


def unwrapped(table: Table, column: Column) -> tuple[Column, int]:
    """Let a clock that wraps around count on, each step modulo the wrap, and say how often it wrapped.

    It is of finite numbers; integers stay integers, so that no step is rounded. It is a `DataError` if it
    goes further than its wrap allows, or counts integers to a wrap that is none.
    """
    if column.wraps is None or len(column.raw) < 2:
        return column, 0
    clock = _plain(column.raw)
    whole = clock.dtype.kind == "i"
    wraps = int(column.wraps) if whole else column.wraps
    low, high = clock.min().item(), clock.max().item()
    if wraps != column.wraps or high - low >= wraps:
        raise DataError(
            f"{table.file}: clock '{column.address}' runs from {low:.15g} to {high:.15g}"
            f"{' in integers' if whole else ''}, so that it cannot wrap around at {column.wraps:.15g}: "
            "correct 'wraps' in the study"
        )
    # a sum of whole wraps on top of the file's own numbers, which keeps these as they are
    turns = np.concatenate(([0], np.cumsum(np.diff(clock) < 0)))
    return replace(column, raw=clock + turns * wraps), int(turns[-1])


def between_set_backs(table: Table, column: Column) -> tuple[slice, tuple[str, ...]]:
    """Rows of the longest part of a file in which its clock runs on, and what is left out, in words.

    All rows where the clock never goes back, wraps around, or goes back because rows are out of order.
    """
    whole, clock = slice(None), _plain(column.raw)
    back = np.flatnonzero(np.diff(clock) < 0) + 1
    if column.wraps is not None or not 0 < len(back) <= SET_BACK:
        return whole, ()
    if any((clock[row : row + CAUGHT_UP] > clock[row - 1]).any() for row in back):
        return whole, ()
    start, stop = max(pairwise((0, *back.tolist(), len(clock))), key=lambda part: part[1] - part[0])
    if stop - start < CAUGHT_UP:
        return whole, ()
    row = int(back[0])
    note = (
        f"the clock is set back at {table.place(row)} ('{column.address}' is {clock[row].item():.15g} after"
        f" {clock[row - 1].item():.15g}): the file is cut there, and its longest part used, rows {start:,} to"
        f" {stop - 1:,} of {len(clock):,} counted from 0"
    )
    return slice(start, stop), (note,)


def spread(column: Column) -> tuple[Column, tuple[str, ...]]:
    """Spread the rows of a coarse clock evenly between its steps, and say so; any other clock stays as it is.

    A clock is coarse where many rows have the time of the row before, or where its steps are one or the
    other of two that differ by its resolution. The new one is in the file's unit, from the first sample on.
    """
    clock = _plain(column.raw)
    t = (clock - clock[:1]).astype(np.float64)
    steps = np.diff(t)
    if column.wraps is not None or len(t) < ENOUGH or not (t[-1] > 0.0 and (steps >= 0.0).all()):
        return column, ()
    resolution = _resolution(steps)
    if resolution == 0.0:
        return column, ()
    first = np.concatenate(([0], np.flatnonzero(steps > 0.0) + 1))
    counts = np.diff(np.append(first, len(t)))
    lasting = np.diff(t[first])
    usual = lasting <= GAP * np.median(lasting)
    interval = float(lasting[usual].sum() / counts[:-1][usual].sum())
    # within a group of equal stamps rows follow evenly, up to the next stamp unless a gap is in between
    lasting = np.minimum(np.append(lasting, np.inf), np.maximum(counts * interval, resolution))
    even = np.concatenate(
        [t[k] + step * np.arange(n) / n for k, n, step in zip(first, counts, lasting, strict=True)]
    )
    broken = (np.flatnonzero(steps > GAP * max(interval, resolution) + resolution) + 1).tolist()
    for start, stop in pairwise((0, *broken, len(t))):
        line = _line(t[start:stop])
        if np.abs(line - t[start:stop]).max() <= (1.0 + ROUNDING) * resolution:
            even[start:stop] = line
    note = (
        f"time stamps come in steps of {resolution * column.scale:.3g} s where rows follow each other every"
        f" {interval * column.scale:.6g} s: rows are spread evenly between them, and time is counted from the"
        " first sample"
    )
    return replace(column, raw=even, offset=0.0, zero=0.0), (note,)


ROUNDING = 1e-3
"""Relative difference by which two steps of a clock are the same."""


def _resolution(steps: FloatArray) -> float:
    """Resolution of a coarse clock by its steps (n,); 0 of one that is not coarse."""
    if np.mean(steps == 0.0) >= REPEATED:
        return float(steps[steps > 0.0].min())
    usual = steps[steps <= GAP * np.median(steps)]
    low, high = float(usual.min()), float(usual.max())
    ends = np.minimum(usual - low, high - usual)
    ragged = RAGGED * high <= high - low <= high / 2.0 and (ends <= ROUNDING * high).all()
    return high - low if ragged else 0.0


def _line(t: FloatArray) -> FloatArray:
    """Even times closest to those of consecutive rows (n,)."""
    if len(t) < 2:
        return t
    k = np.arange(len(t)) - 0.5 * (len(t) - 1)
    return t.mean() + k * float(k @ (t - t.mean()) / (k @ k))
