"""Checks of a recorded run: what stops it, what the report must mention, and what is left out as saturated.

Samples at the end of a sensor's range are found by how often the output has exactly its extreme value.

Noise makes the extreme values of an output rare: each is less frequent than those beside it. Where the range
ends, all that lies beyond falls on one value. A healthy output does the same where it is so coarse that it
repeats itself everywhere; of such a one nothing is said.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import BoolArray, FloatArray
from imubayes.errors import DataError
from imubayes.rig.columns import Column
from imubayes.rig.formats import FileTable
from imubayes.rig.inputs import GAP, Inputs, Source
from imubayes.rig.plans import EARTH_RATE
from imubayes.units import counted

LARGEST = 1e100
"""In the file's own unit: beyond it a number is a placeholder, and its square leaves double precision."""

NOTICED = 0.05
"""Share of the Earth's rate across the axis of a table that is more than rounding: it is 1 at the equator."""

JUMP = 0.2
"""Relative change of the sampling interval, over a block of `BLOCK` steps, that is worth a note."""
BLOCK = 64


def check_values(table: FileTable, column: Column) -> None:
    """Refuse a column with an entry that is not a finite number below `LARGEST`: a `DataError` names it."""
    raw = column.raw
    if raw.dtype.kind in "iu":
        return
    bad = ~(np.abs(raw) <= LARGEST)  # true for NaN too
    if bad.any():
        row = int(np.argmax(bad))
        raise DataError(
            f"{table.file}, {table.place(row)}: column '{column.address}' holds {float(raw[row]):g}: "
            f"expected a finite number below {LARGEST:g}; correct the entry or leave the row out"
        )


def check_time(table: FileTable, column: Column, t: FloatArray) -> None:
    """Refuse a time that does not increase: a `DataError` names the first row not later than the last."""
    if len(t) < 2:
        raise DataError(
            f"{table.file}: has only {len(t)} row of numbers: expected a run of at least 2 samples"
        )
    late = np.diff(t) > 0.0
    if not late.all():
        row = int(np.argmin(late)) + 1
        before, now = float(column.raw[row - 1]), float(column.raw[row])
        what = "stands still" if now == before else "goes back"
        raise DataError(
            f"{table.file}, {table.place(row)}: time {what}, "
            f"'{column.address}' is {now:.15g} after {before:.15g}; "
            "expected strictly increasing times; sort the rows, and keep one of those with equal times"
        )


def check_output(file: str, column: Column, distinct: FloatArray) -> None:
    """Refuse an output that has a single value, SI, of which all samples are: a `DataError`."""
    if len(distinct) == 1:
        raise DataError(
            f"{file}: column '{column.address}' is {column.in_file(float(distinct[0])):g} in every row: "
            "expected a live output; check the wiring, or name another column in the study"
        )


class Timing(NamedTuple):
    """How some consecutive rows follow each other, in s.

    Median step; gaps, the longest step and when; median of a block of steps that differs, and when; NaN.
    """

    interval: float
    gaps: int
    longest: float
    at: float
    jump: float
    jump_at: float


def pace_of(t: FloatArray, interval: float) -> Timing:
    """Look for gaps and other intervals among times (n,), s, that are to be an interval apart."""
    steps = np.diff(t)
    worst, blocks = int(np.argmax(steps)), len(steps) // BLOCK
    jump = jump_at = np.nan
    if blocks > 1:
        medians = np.median(steps[: blocks * BLOCK].reshape(blocks, BLOCK), axis=1)
        away = np.flatnonzero(np.abs(medians - interval) > JUMP * interval)
        if len(away):
            jump, jump_at = medians[away[0]], t[away[0] * BLOCK]
    return Timing(
        interval=float(np.median(steps)),
        gaps=int(np.count_nonzero(steps > GAP * interval)),
        longest=float(steps[worst]),
        at=float(t[worst]),
        jump=float(jump),
        jump_at=float(jump_at),
    )


def pace_notes(parts: Sequence[Timing], usual: float) -> tuple[str, ...]:
    """Say how many gaps the parts of a record have, and where its sampling interval is not the usual one."""
    notes: list[str] = []
    if count := sum(part.gaps for part in parts):
        worst = max(parts, key=lambda part: part.longest)
        plural = "s" if count > 1 else ""
        notes.append(
            f"{count} gap{plural} in time, the longest {worst.longest:.4g} s at t = {worst.at:.6g} s"
        )
    if jump := next((part for part in parts if part.jump > 0.0), None):
        notes.append(
            f"the sampling interval is {jump.jump:.4g} s around t = {jump.jump_at:.6g} s "
            f"where it is {usual:.4g} s over most of the run"
        )
    return tuple(notes)


def earth_left_out(procedure: str, inputs: Inputs, axes: str = "ijk") -> tuple[str, ...]:
    """Say that the rates of a recorded rate table lack the Earth's across its axis; empty if they have it.

    With it, w is along more than one line in the case while a mount turns. The Earth's vertical part is not
    asked for: it may be in the table's rate.

    Examples
    --------
    >>> earth_left_out("rate-table", Inputs(np.zeros(2), {"w_i": np.array([1.0, -2.0])}, 1.0))
    ("the Earth's rate across the table's axis (15 deg/h x cos latitude) is not in w",)
    """
    if procedure != "rate-table":
        return ()
    w = np.stack([inputs.channels.get(f"w_{axis}", np.zeros(len(inputs))) for axis in axes], axis=1)
    for number in np.unique(inputs.mounts):
        here = w[inputs.mounts == number]
        fastest = here[np.argmax(np.linalg.norm(here, axis=1))]
        across = np.linalg.norm(np.cross(here, fastest), axis=1).max()
        if across > NOTICED * EARTH_RATE * np.linalg.norm(fastest):
            return ()
    note = "the Earth's rate across the table's axis (15 deg/h x cos latitude) is not in w"
    return (note,) if w.any() else ()


Stretches = NDArray[np.int64]

LEVELS = 32
"""With fewer distinct values than this the output is too coarse to tell the end of a range from rest."""

BESIDE = 3
"""Values next to the extreme one that it is held against."""

PILED = 3.0
"""Samples at the extreme value over those at the `BESIDE` next to it, at the end of a range. A sine has 1."""

STUCK = 3.0
"""Input's span over that of an output of few values, from which on the output does not follow."""

REPEATED = 1.0 / 3.0
"""Share of samples that repeat the one before, away from the extremes, above which an output is coarse: white
noise of 0.8 steps."""

NEAR = 10
"""Samples between two at the end of the range, from which on they are kept: fewer are what noise brought back
from beyond, and their mean is not that of the output."""

LEAST = 0.1
"""Share of the samples that must be left: a run nearly all of which is beyond the range tests little."""

LISTED = 3
"""Stretches of rows that are listed."""


@dataclass(slots=True, eq=False)
class OutputLevels:
    """How often an output has which value, gathered a part at a time.

    Of the `samples`, `repeats` have the value of the one before. The `ends` are (value, samples, repeats) of
    the smallest and the largest `BESIDE` + 1 values, in order; `distinct` are up to `LEVELS` of the values.
    """

    samples: int = 0
    repeats: int = 0
    ends: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    distinct: FloatArray = field(default_factory=lambda: np.zeros(0))

    def add(self, output: FloatArray) -> OutputLevels:
        """Add consecutive samples (n,), and give what has been gathered.

        Examples
        --------
        >>> noise = np.random.default_rng(1).standard_normal(1000)
        >>> outputs = np.minimum(noise, 1.5), noise, np.round(3.0 * noise)
        >>> [OutputLevels().add(one).rails() for one in outputs]
        [(1.5,), (), ()]
        """
        values, counts = np.unique(output, return_counts=True)
        again, times = np.unique(output[1:][output[1:] == output[:-1]], return_counts=True)
        rows = np.column_stack((values, counts.astype(float), np.zeros(len(values))))
        rows[np.searchsorted(values, again), 2] = times
        self.samples += len(output)
        self.repeats += int(times.sum())
        self.distinct = np.unique(np.concatenate((self.distinct, values[:LEVELS])))[:LEVELS]
        # of the outermost values, those of one value are added
        rows = np.concatenate((self.ends, rows[_both_ends(len(rows))]))
        every, which = np.unique(rows[:, 0], return_inverse=True)
        sums = np.zeros((len(every), 3))
        np.add.at(sums, which, rows)
        sums[:, 0] = every
        self.ends = sums[_both_ends(len(every))]
        return self

    def rails(self) -> tuple[float, ...]:
        """Ends of the range: the smallest value, the largest, both or none."""
        low, high = self.ends[0], self.ends[-1]
        samples, repeats = self.samples - low[1] - high[1], self.repeats - low[2] - high[2]
        if len(self.distinct) < LEVELS or repeats > REPEATED * samples:
            return ()
        sides = (self.ends[: BESIDE + 1], self.ends[: -BESIDE - 2 : -1])
        return tuple(float(side[0, 0]) for side in sides if side[0, 1] >= PILED * side[1:, 1].sum())


def _both_ends(n: int) -> NDArray[np.int64]:
    """Places of the first and the last `BESIDE` + 1 of n values in order."""
    return np.unique(np.r_[: min(BESIDE + 1, n), max(n - BESIDE - 1, 0) : n])


def refuse_stuck(file: str, column: Column, output: FloatArray, own: FloatArray) -> None:
    """Refuse a coarse output that its own input moves far past: all of the run is beyond the range.

    Of either, (n,) samples, all values and extremes are enough. It is a `DataError` if the output has less
    than `LEVELS` values, `STUCK` times closer together than the input's.
    """
    moved, told = float(np.ptp(own)), float(np.ptp(output))
    if STUCK * told < moved and (values := len(np.unique(output))) < LEVELS:
        told, moved = (span / abs(column.scale) for span in (told, moved))
        raise DataError(
            f"{file}: column '{column.address}' has only {counted(values, 'value')}, within"
            f" {told:.3g} {column.unit}, while its input moves by {moved:.3g} {column.unit}:"
            " expected an output that follows its input; test the sensor within its range, or"
            " correct the column's unit, its scale or the axis of the input"
        )


def beyond(output: FloatArray, rails: Iterable[float]) -> BoolArray:
    """Samples (n,) at one of the ends of the range, or among such that are fewer than `NEAR` apart."""
    out = np.zeros(len(output), dtype=bool)
    for rail in rails:
        at = np.flatnonzero(output == rail)
        close = np.diff(at) <= NEAR
        opened = np.zeros(len(output) + 1, dtype=np.int64)
        opened[at] += 1
        opened[at + 1] -= 1
        opened[at[:-1][close] + 1] += 1
        opened[at[1:][close]] -= 1
        out |= np.cumsum(opened[:-1]) > 0
    return out


SATURATED, RESTLESS, STEPS = "is saturated", "is restless", "steps by"
GAPS, JUMPS, SET_BACK, COARSE = "in time, the longest", "interval is", "clock is set back", "in steps of"
FAULTS = (SATURATED, RESTLESS, STEPS, JUMPS, SET_BACK, COARSE)
"""Words by which notes are known of what is wrong with a record."""

WITHOUT_GAPS = ("static", "thermal", "oscillation", "free-tumble", "ferraris")
"""Procedures that are one record; others have gaps between their positions."""


def faults(runs: Iterable[tuple[str, str, Source]]) -> tuple[str, ...]:
    """Say what is wrong with the records of runs, given by name, procedure and source."""
    notes = (
        f"{name.partition(' (')[0]}: {note}"
        for name, procedure, source in runs
        for note in source.notes
        if any(word in note for word in FAULTS) or (GAPS in note and procedure in WITHOUT_GAPS)
    )
    return tuple(dict.fromkeys(notes))


def saturation_note(column: Column, rails: tuple[float, ...], rows: Stretches, of: int, first: float) -> str:
    """Say which channel is at the end of its range, where and when, and which of so many samples go."""
    ends = " and ".join(f"{column.in_file(rail):.6g} {column.unit}".strip() for rail in rails)
    count = int(np.sum(rows[:, 1] - rows[:, 0]))
    texts = [f"{a:,}" if b == a + 1 else f"{a:,} to {b - 1:,}" for a, b in rows[:LISTED].tolist()]
    if more := len(rows) - len(texts):
        texts.append(f"{counted(more, 'more stretch')} up to {int(rows[-1, 1]) - 1:,}")
    listed = ", ".join(texts[:-1]) + (" and " if len(texts) > 1 else "") + texts[-1]
    return (
        f"{column.channel} {SATURATED} at {ends}: {count:,} of {of:,} samples are left out,"
        f" rows {listed} counted from 0, first at t = {first:.6g} s"
    )


def check_left(file: str, out: int, of: int, notes: Iterable[str]) -> None:
    """Refuse a run of which less than a tenth is within the range: a `DataError` with the notes."""
    if of - out < LEAST * of:
        raise DataError(
            f"{file}: {'; '.join(notes)}: expected a tenth of the samples or more within the range of the"
            " sensor; test it over a smaller range, or correct the column's scale"
        )


def stretches_of(out: BoolArray) -> Stretches:
    """First row of each stretch that is out, and the one after its last: (k, 2).

    Examples
    --------
    >>> stretches_of(np.array([False, True, True, False, True])).tolist()
    [[1, 3], [4, 5]]
    """
    edges = np.diff(np.concatenate(([False], out, [False])).astype(np.int8))
    return np.column_stack((np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)))


def united(rows: Stretches) -> Stretches:
    """Stretches of rows that are in any of some stretches.

    Examples
    --------
    >>> united(np.array([[5, 7], [1, 3], [2, 4], [6, 8]])).tolist()
    [[1, 4], [5, 8]]
    """
    rows = rows[np.argsort(rows[:, 0])]
    ends = np.maximum.accumulate(rows[:, 1])
    fresh = np.concatenate(([True], rows[1:, 0] > ends[:-1]))[: len(rows)]
    last = np.append(np.flatnonzero(fresh)[1:], len(rows)) - 1
    return np.column_stack((rows[fresh, 0], ends[last[: np.count_nonzero(fresh)]]))
