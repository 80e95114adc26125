"""The first pass over a long run: checks, block averages, extremes, and a stretch at full rate."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

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
)
from imubayes.rig.inputs import GAP, Inputs, Part, Run, Stream, between_gaps, joined_parts
from imubayes.rig.recordings import RunSpec, assumed, frozen, source_of
from imubayes.rig.streams import Clock, Reader, RunFile, first_interval
from imubayes.rig.thermal import temperature_rate
from imubayes.sensors.terms import Kind, Library, columns

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


def read_long_run(spec: RunSpec, file: RunFile, kind: Kind, lib: Library, *, sha256: str) -> Run:
    """Read a run a part at a time, and keep what fits: columns of `lib` are averaged over the blocks.

    Raises
    ------
    DataError : as `imubayes.rig.runs.read_run` does.
    """
    interval = first_interval(file)
    found = _surveyed(Reader(file, interval), lib)
    usual, rate = float(np.median([seen.interval for seen in found.seen])), None
    if len(found.levels.distinct) == 1:
        check_output(file.shown, file.columns["output"], found.levels.distinct)
    elif lib.own in file.columns:
        refuse_stuck(file.shown, file.columns["output"], found.levels.distinct, found.extremes[lib.own])
    if "T" in file.columns and "dT" not in file.columns:
        rate = found.mean("t"), temperature_rate(found.mean("t"), found.mean("T"))
    if rate is not None or abs(usual - interval) > STEADY * interval:
        interval = usual
        found = _surveyed(Reader(file, interval, rate), lib)
    if rails := found.levels.rails():
        found = _without(Reader(file, interval, rate, rails), found)
    return _run(spec, kind, found, sha256)


def _without(reader: Reader, found: _Survey) -> _Survey:
    """Pass over a run again, without the samples at the ends of the output's range."""
    column, of, lost = reader.file.columns["output"], found.levels.samples, []
    again = _surveyed(reader, found.lib, lost)
    note = saturation_note(column, reader.rails, np.concatenate(lost), of)
    check_left(reader.file.shown, of - again.levels.samples, of, [note])
    again.seen, again.saturated = found.seen, note
    return again


@dataclass(frozen=True, slots=True)
class _Seen:
    """What a part was like: median step, gaps, the longest step and when, in s."""

    t: float
    interval: float
    gaps: int
    longest: float
    at: float


@dataclass(slots=True, eq=False)
class _Survey:
    """What a pass over a run gathers. Sums (m, q) and extremes are of the quantities `names` (q)."""

    lib: Library
    names: tuple[str, ...]
    reader: Reader
    longest: int
    clock: Clock
    sums: list[FloatArray] = field(default_factory=list)
    counts: list[int] = field(default_factory=list)
    mounts: list[int] = field(default_factory=list)
    outermost: list[FloatArray] = field(default_factory=list)
    seen: list[_Seen] = field(default_factory=list)
    kept: list[Part] = field(default_factory=list)
    reach: FloatArray = field(default_factory=lambda: np.zeros(0))
    swing: float = 0.0
    levels: Levels = field(default_factory=Levels)
    saturated: str = ""

    def mean(self, name: str) -> FloatArray:
        """Averages (m,) of a quantity over the blocks; the duration of the blocks is a sum."""
        return np.array([row[self.names.index(name)] for row in self.sums]) / np.array(self.counts)

    @property
    def extremes(self) -> dict[str, FloatArray]:
        """Rows (r,) that hold the extremes of each channel and of the output, by their names."""
        held = self.names[2 : self.names.index("output") + 1]
        return dict(zip(held, np.concatenate(self.outermost).T, strict=True))


def _surveyed(reader: Reader, lib: Library, lost: list[Stretches] | None = None) -> _Survey:
    """Pass over a run; `lost` gets the rows that the reader leaves out."""
    found: _Survey | None = None
    clock = Clock()
    for part in reader("reading", lost, clock):
        names = ("t", "duration", *part.channels, "output", *lib.names)
        if found is None:
            longest = max(1, math.ceil(reader.file.rows / BLOCKS))
            found = _Survey(lib, names, reader, longest, clock, reach=np.zeros(len(lib.names)))
        if sum(len(one) for one in found.kept) < STRETCH:
            found.kept.append(part)
        _average(found, part)
        found.outermost = [_outermost(np.concatenate([*found.outermost, _held(part)]), tuple(part.channels))]
        found.seen.append(_look(part, reader.interval))
        found.levels.add(part.output)
        own = part.channels.get(lib.own, 0.0)
        found.swing = max(found.swing, float(np.max(np.abs(part.output - own))))
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
    table = _quantities(part, found.lib)
    found.reach = np.maximum(found.reach, np.abs(table[:, -len(found.reach) :]).max(axis=0))
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


def _quantities(part: Part, lib: Library) -> FloatArray:
    """Time, duration, channels, output, columns of the library: (k, q)."""
    table = np.empty((len(part), 3 + len(part.channels) + len(lib.names)))
    table[:, : -len(lib.names)] = np.column_stack((part.t, part.duration, _held(part)))
    for a in range(0, len(part), TILE):
        inside = slice(a, min(a + TILE, len(part)))
        channels = {name: values[inside] for name, values in part.channels.items()}
        columns(lib, channels, inside.stop - a, out=table[inside, -len(lib.names) :])
    return table


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
    for part in stream.parts("averages"):
        for a in range(0, len(part), TILE):
            inside = slice(a, min(a + TILE, len(part)))
            table = np.empty((inside.stop - a, width))
            filled(part, inside, table)
            block = np.searchsorted(ends, part.first + np.arange(inside.start, inside.stop), "right")
            starts = np.flatnonzero(np.diff(block, prepend=-1))
            sums[block[starts]] += np.add.reduceat(table, starts, axis=0)
            reach = np.maximum(reach, np.abs(table).max(axis=0))
    return sums / stream.counts[:, None], reach


def renewed(run: Run) -> Run:
    """Run of which rows are left out, with reach, swing and extremes of those that remain: two passes."""
    if (stream := run.stream) is None:
        return run
    _, largest = averaged_parts(stream, stream.fill, len(stream.reach) + 1)
    outermost = np.zeros((0, 0))
    for part in stream.parts("extremes of what is left"):
        held = _held(part)
        outermost = _outermost(
            np.concatenate([outermost, held]) if len(outermost) else held, tuple(part.channels)
        )
    extremes = dict(zip(stream.extremes, outermost.T, strict=True))
    left = replace(stream, reach=largest[:-1], swing=float(largest[-1]), extremes=extremes)
    return replace(run, stream=left)


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


def _notes(found: _Survey, samples: int, stretch: Part) -> tuple[str, ...]:
    """What the checks found that does not stop the run."""
    seen, usual = found.seen, found.reader.interval
    worst = max(seen, key=lambda one: one.longest)
    away = [one for one in seen if abs(one.interval - usual) > JUMP * usual]
    notes = (
        *found.clock.notes,
        gap_note(sum(one.gaps for one in seen), worst.longest, worst.at),
        jump_note(away[0].interval, away[0].t, usual) if away else "",
        found.saturated,
        f"{samples:,} rows are read a part at a time: every row counts in the coefficients, while figures"
        f" and tests have averages over {len(found.counts):,} blocks, and {len(stretch):,} rows at"
        f" full rate from t = {stretch.t[0]:.6g} s on",
        "dT/dt is the smoothed derivative of the recorded temperature"
        if found.reader.rate is not None
        else "",
    )
    return tuple(note for note in notes if note)


def _stretch(found: _Survey) -> Part:
    """Longest part of the first rows that no gap interrupts."""
    rows = joined_parts(found.kept)
    a, b = max(between_gaps(rows.t, found.reader.interval), key=lambda part: part[1] - part[0])
    return rows.some(slice(a, b), a, np.nan)


def _run(spec: RunSpec, kind: Kind, found: _Survey, sha256: str) -> Run:
    names = found.names[2 : found.names.index("output")]
    counts, stretch = np.array(found.counts), _stretch(found)
    samples = int(counts.sum())
    duration = np.array([row[1] for row in found.sums])
    stream = Stream(
        parts=found.reader,
        samples=samples,
        interval=found.reader.interval,
        library=found.lib,
        counts=counts,
        duration=duration,
        X=np.array([row[-len(found.reach) :] for row in found.sums]) / counts[:, None],
        reach=found.reach,
        swing=found.swing,
        extremes=found.extremes,
        stretch=stretch,
        fill=partial(fill, found.lib),
    )
    channels = {name: frozen(found.mean(name)) for name in names}
    mount = np.array(found.mounts) if found.mounts else None
    inputs = Inputs(frozen(found.mean("t")), channels, float(np.median(duration)), mount)
    left_out = earth_left_out(spec.procedure, inputs) if kind == "gyroscope" else ()
    notes = (*_notes(found, samples, stretch), *left_out, *assumed(kind, channels))
    source = source_of(found.reader.file.shown, sha256, found.reader.file.columns, notes)
    return Run(spec.name, spec.procedure, inputs, frozen(found.mean("output")), source, stream)
