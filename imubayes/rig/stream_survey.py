"""The first pass over a long run: checks, block averages, extremes, and a stretch at full rate."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.rig.checks import (
    JUMP,
    Levels,
    Stretches,
    check_left,
    check_output,
    earth_left_out,
    gap_note,
    jump_note,
    refuse_stuck,
    saturation_note,
    united,
)
from imubayes.rig.inputs import GAP, Inputs, Part, Run, Stream, between_gaps, joined_parts
from imubayes.rig.recordings import CASES, RunSpec, assumed, frozen
from imubayes.rig.streams import Clock, Reader, RunFile, first_interval
from imubayes.rig.thermal import temperature_rate
from imubayes.sensors.terms import QUANTITY, Kind, Library, columns

BLOCKS = 1500
"""Blocks that a run is averaged to, about: as many as the noise of a run in memory is judged by."""

STRETCH = 65_536
"""Rows at full rate that are kept: the noise within a block is judged by them."""

APART = 0.1
"""Share of a block that a gap lasts at least to end it: averages may reach across a few lost samples."""

STEADY = 0.01
"""Relative error of the first table's sampling interval that asks for a second look at the run."""

TILE = 8192
"""Rows whose columns are made at a time: they fit the cache."""


def read_long_run(spec: RunSpec, file: RunFile, kind: Kind | None) -> tuple[Run, Stretches]:
    """Read a run of a component of a kind, or of a case, a part at a time, and keep what fits.

    Returns
    -------
    the run, and the stretches of rows that are left out of the file's.

    Raises
    ------
    DataError : as `imubayes.rig.runs.read_run` does.
    """
    interval = first_interval(file)
    found = _surveyed(Reader(file, interval))
    usual, rate = float(np.median([seen.interval for seen in found.seen])), None
    for name, levels in zip(file.outputs, found.levels, strict=True):
        if len(levels.distinct) == 1:
            check_output(file.shown, file.columns[name], levels.distinct)
    if kind and (own := f"{QUANTITY[kind]}_i") in file.columns:
        refuse_stuck(file.shown, file.columns["output"], found.levels[0].distinct, found.extremes[own])
    if "T" in file.columns and "dT" not in file.columns:
        rate = found.mean("t"), temperature_rate(found.mean("t"), found.mean("T"))
    if rate is not None or abs(usual - interval) > STEADY * interval:
        interval = usual
        found = _surveyed(Reader(file, interval, rate))
    if any(rails := tuple(levels.rails() for levels in found.levels)):
        found = _without(Reader(file, interval, rate, rails), found)
    return _run(spec, kind, found), found.lost


def _without(reader: Reader, found: _Survey) -> _Survey:
    """Pass over a run again, without the samples at the ends of an output's range."""
    file, of = reader.file, found.levels[0].samples
    lost: list[list[Stretches]] = [[] for _ in file.outputs]
    again = _surveyed(reader, lost)
    again.saturated = tuple(
        saturation_note(file.columns[name], rails, np.concatenate(stretches), of)
        for name, rails, stretches in zip(file.outputs, reader.rails, lost, strict=True)
        if rails
    )
    check_left(file.shown, of - again.levels[0].samples, of, again.saturated)
    again.seen, again.lost = found.seen, united(np.concatenate([part for parts in lost for part in parts]))
    return again


class _Seen(NamedTuple):
    """What a part was like: median step, gaps, the longest step and when, in s."""

    t: float
    interval: float
    gaps: int
    longest: float
    at: float


@dataclass(slots=True, eq=False)
class _Survey:
    """What a pass over a run gathers. Sums (m, q) are of time, duration, channels `names`, and outputs."""

    names: tuple[str, ...]
    reader: Reader
    longest: int
    clock: Clock
    levels: tuple[Levels, ...]
    sums: list[FloatArray] = field(default_factory=list)
    counts: list[int] = field(default_factory=list)
    mounts: list[int] = field(default_factory=list)
    outermost: list[FloatArray] = field(default_factory=list)
    seen: list[_Seen] = field(default_factory=list)
    kept: list[Part] = field(default_factory=list)
    saturated: tuple[str, ...] = ()
    lost: Stretches = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))

    def mean(self, name: str) -> FloatArray:
        """Averages (m,) of time or of a channel over the blocks."""
        return np.array([row[("t", "duration", *self.names).index(name)] for row in self.sums]) / self.counts

    @property
    def output(self) -> FloatArray:
        """Averages (m,) or (m, c) of the outputs."""
        means = np.array([row[2 + len(self.names) :] for row in self.sums]) / np.array(self.counts)[:, None]
        return _as_output(means)

    @property
    def extremes(self) -> dict[str, FloatArray]:
        """Rows (r,) that hold the extremes of each channel and of the output, by their names."""
        return _named(self.names, self.outermost[0])


def _as_output(values: FloatArray) -> FloatArray:
    """Outputs (n, c) as a run has them: (n,) of a single component."""
    return values[:, 0] if values.shape[1] == 1 else values


def _named(names: Sequence[str], rows: FloatArray) -> dict[str, FloatArray]:
    """Rows (r, q) of channels and, after them, outputs."""
    return dict(zip(names, rows.T, strict=False)) | {"output": _as_output(rows[:, len(names) :])}


def _surveyed(reader: Reader, lost: list[list[Stretches]] | None = None) -> _Survey:
    """Pass over a run; `lost` gets the rows of each output that the reader leaves out."""
    found: _Survey | None = None
    clock = Clock()
    for part in reader("reading", lost, clock):
        if found is None:
            longest = max(1, math.ceil(reader.file.rows / BLOCKS))
            levels = tuple(Levels() for _ in reader.file.outputs)
            found = _Survey(tuple(part.channels), reader, longest, clock, levels)
        if sum(len(one) for one in found.kept) < STRETCH:
            found.kept.append(part)
        _average(found, part)
        found.outermost = [_outermost(np.concatenate([*found.outermost, _held(part)]), found.names)]
        found.seen.append(_look(part, reader.interval))
        for levels, output in zip(found.levels, np.atleast_2d(part.output.T), strict=True):
            levels.add(output)
    if found is None:
        raise ValueError("a run without rows is refused when it is opened")
    return found


def _average(found: _Survey, part: Part) -> None:
    """Add the rows of a part to the averages over the blocks."""
    count = found.counts[-1] if found.counts else 0
    mounts = None if part.mount is None else np.append(found.mounts[-1:], part.mount)
    fresh: list[int] = []
    if mounts is not None:
        fresh = (np.flatnonzero(np.diff(mounts)) + len(part) + 1 - len(mounts)).tolist()
    starts = block_starts(part, count, found.longest, found.reader.interval, fresh)
    table = np.column_stack((part.t, part.duration, _held(part)))
    opening = bool(starts) and starts[0] == 0
    first = starts if opening else [0, *starts]
    sums = np.add.reduceat(table, first, axis=0)
    counts = np.diff([*first, len(part)]).tolist()
    if not opening:
        found.sums[-1] = found.sums[-1] + sums[0]
        found.counts[-1] += counts[0]
    found.sums += list(sums if opening else sums[1:])
    found.counts += counts if opening else counts[1:]
    if part.mount is not None:
        found.mounts += part.mount[starts].tolist()


def block_starts(part: Part, count: int, longest: int, interval: float, fresh: list[int]) -> list[int]:
    """First rows of the blocks that begin in a part.

    Parameters
    ----------
    part : rows of a run.
    count : rows of the block that is open; 0 before the first.
    longest : rows of a block.
    interval : averaging time of a sample, s.
    fresh : rows that a mount begins with.
    """
    steps = np.diff(part.t, prepend=part.before)
    breaks = np.flatnonzero(~(steps <= max(APART * longest, GAP) * interval)).tolist() + fresh
    starts: list[int] = []
    for a, b in pairwise(sorted({0, *breaks, len(part)})):
        if a in breaks:
            starts.append(a)
            count = 0
        more = list(range(a + longest - count, b, longest))
        starts += more
        count = b - more[-1] if more else count + b - a
    return starts


def fill(lib: Library, part: Part, inside: slice, table: FloatArray) -> None:
    """Write columns of a library and, beside them, the response of some rows of a part into a table."""
    p = len(lib.names)
    channels = {name: values[inside] for name, values in part.channels.items()}
    columns(lib, channels, len(table), out=table[:, :p])
    table[:, p] = part.output[inside] - channels.get(lib.own, 0.0)


def averaged_parts(
    stream: Stream, filled: Callable[[Part, slice, FloatArray], None], width: int
) -> tuple[FloatArray, FloatArray]:
    """Averages (m, width) over the blocks of a run of what is `filled` in, and the largest size (width,)."""
    ends = np.cumsum(stream.counts)
    sums, reach = np.zeros((len(ends), width)), np.zeros(width)
    for part in stream.read("averages"):
        for a in part.own[::TILE]:
            inside = slice(a, min(a + TILE, part.own.stop))
            table = np.empty((inside.stop - a, width))
            filled(part, inside, table)
            block = np.searchsorted(ends, part.first + np.arange(inside.start, inside.stop), "right")
            starts = np.flatnonzero(np.diff(block, prepend=-1))
            sums[block[starts]] += np.add.reduceat(table, starts, axis=0)
            reach = np.maximum(reach, np.abs(table).max(axis=0))
    return sums / stream.counts[:, None], reach


def renewed(run: Run) -> Run:
    """Run of which rows are left out, with the extremes of those that remain: one pass."""
    if (stream := run.stream) is None:
        return run
    names = [name for name in stream.extremes if name != "output"]
    outermost: list[FloatArray] = []
    for part in stream.parts("extremes of what is left"):
        outermost = [_outermost(np.concatenate([*outermost, _held(part)]), names)]
    return replace(run, stream=replace(stream, extremes=_named(names, outermost[0])))


def _held(part: Part) -> FloatArray:
    return np.column_stack((*part.channels.values(), part.output))


def _outermost(rows: FloatArray, names: Sequence[str]) -> FloatArray:
    """Rows that hold the smallest and largest of every quantity, and of the force."""
    force = [k for k, name in enumerate(names) if name.startswith("f_")]
    looked = np.column_stack((rows, np.linalg.norm(rows[:, force], axis=1)))
    return rows[np.unique(np.concatenate((looked.argmin(axis=0), looked.argmax(axis=0))))]


def _look(part: Part, interval: float) -> _Seen:
    steps = np.diff(part.t, prepend=part.before)
    steps = steps[np.isfinite(steps)]
    worst = int(np.argmax(steps))
    return _Seen(
        t=float(part.t[0]),
        interval=float(np.median(steps)),
        gaps=int(np.count_nonzero(steps > GAP * interval)),
        longest=float(steps[worst]),
        at=float(part.t[worst - len(steps)] - steps[worst]),
    )


def _notes(found: _Survey) -> tuple[str, ...]:
    """What the checks found that does not stop the run."""
    seen, usual = found.seen, found.reader.interval
    worst = max(seen, key=lambda one: one.longest)
    away = [one for one in seen if abs(one.interval - usual) > JUMP * usual]
    notes = (
        *found.clock.notes,
        gap_note(sum(one.gaps for one in seen), worst.longest, worst.at),
        jump_note(away[0].interval, away[0].t, usual) if away else "",
        *found.saturated,
        "dT/dt is the smoothed derivative of the recorded temperature"
        if found.reader.rate is not None
        else "",
    )
    return tuple(note for note in notes if note)


def _read_in_parts(stream: Stream) -> str:
    stretch = stream.stretch
    return (
        f"{stream.samples:,} rows are read a part at a time: every row counts in the coefficients, while"
        f" figures and tests have averages over {len(stream.counts):,} blocks, and {len(stretch):,} rows at"
        f" full rate from t = {stretch.t[0]:.6g} s on"
    )


def _run(spec: RunSpec, kind: Kind | None, found: _Survey) -> Run:
    counts, rows = np.array(found.counts), joined_parts(found.kept)
    # the longest part of the first rows that no gap interrupts
    a, b = max(between_gaps(rows.t, found.reader.interval), key=lambda part: part[1] - part[0])
    stretch = rows.some(slice(a, b), a, np.nan)
    axes = "ijk" if kind else "xyz"
    duration = np.array([row[1] for row in found.sums])
    stream = Stream(
        parts=found.reader,
        samples=int(counts.sum()),
        interval=found.reader.interval,
        counts=counts,
        duration=duration,
        extremes=found.extremes,
        stretch=stretch,
    )
    channels = {name: frozen(found.mean(name)) for name in found.names}
    mount = np.array(found.mounts) if found.mounts else None
    inputs = Inputs(frozen(found.mean("t")), channels, float(np.median(duration)), mount)
    notes = _notes(found)
    if spec.procedure not in CASES:
        left_out = earth_left_out(spec.procedure, inputs, axes) if kind != "accelerometer" else ()
        zeros = assumed(kind or "accelerometer", channels, axes)
        notes = (*notes, _read_in_parts(stream), *left_out, *zeros)
    source = found.reader.file.source(notes)
    return Run(spec.name, spec.procedure, inputs, frozen(found.output), source, stream)
