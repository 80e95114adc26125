"""The rows of a file as those of a run, in SI: a bounded part at a time, of which a short file has one.

Of a long file what is held is what fits: averages over blocks, a stretch at full rate, and the rows with the
largest and smallest of every input. The rows themselves are read again by whoever needs them all.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import BoolArray, FloatArray
from imubayes.errors import DataError
from imubayes.rig.checks import NEAR, Stretches, beyond, check_time, check_values, stretches_of
from imubayes.rig.columns import Column, between_set_backs, resolve, spread, unwrapped
from imubayes.rig.formats import FileTable, read_table, rows_in, tables_of
from imubayes.rig.inputs import (
    MOUNT,
    Inputs,
    Part,
    Source,
    durations,
    frozen,
    joined_parts,
    sampling_interval,
    thinned,
)
from imubayes.rig.recordings import SECOND, RunSpec
from imubayes.rig.texts import Wanted
from imubayes.units import counted
from imubayes.work import Progress, silent

STREAMED = 1_000_000
"""Rows from which a file is read a part at a time: a study of so many in memory, with twenty terms, peaks at
0.9 GB; of five times as many at 2.3 GB."""

SAME_TIME = 0.01
"""Share of the interval by which time stamps of two files of one run may differ."""

SAID_EVERY = 0.5
"""s between two messages of progress."""

LATE_EPOCH = 1e6
"""s: a clock that starts later than this counts from an epoch; differences are then taken before scaling."""

_MOST_MOUNTS = 2**31
"""A number of a mount beyond this is something else."""


@dataclass(frozen=True, slots=True, eq=False)
class RunFile:
    """A file as rows of a run: where it is, and which of its columns are what.

    Messages call it `shown`. The `columns`, by channel, are of the first table: names, units, scales;
    `outputs` are the channels of what was measured, one or those of the components of a case. It has about so
    many `rows`, 0 where the format does not say. Those of a short file are `held` as its one part; where they
    are those of two files side by side, these are `beside`. `tell` is told of progress, and `notes` are what
    is to be said of the clock.
    """

    path: Path
    shown: str
    columns: Mapping[str, Column]
    rows: int
    outputs: tuple[str, ...]
    tell: Progress = silent
    held: Part | None = None
    notes: tuple[str, ...] = ()
    beside: tuple[RunFile, ...] = ()

    def values(self, clock: Clock) -> Iterator[Part]:
        """Rows a part at a time, without durations; the `clock` starts with the first."""
        if self.held is not None:
            yield self.held
        elif self.beside:
            clock.other = Clock()
            first, second = self.beside
            yield from _abreast(self.shown, first.values(clock), second.values(clock.other))
        else:
            names = [{name.partition("[:")[0].strip() for name in one.names} for one in self.columns.values()]
            wanted = Wanted(set().union(*names), names[[*self.columns].index("t")])
            for table in tables_of(self.path, self.shown, wanted):
                columns = {name: column.read(table) for name, column in self.columns.items()}
                yield _rows_of(table, columns, self.outputs, clock)

    def whole(self) -> tuple[Part, tuple[str, ...]]:
        """All rows as one part, and what is to be said of the clock."""
        clock = Clock()
        return joined_parts(list(self.values(clock))), (*self.notes, *clock.notes)

    def source(self, notes: tuple[str, ...]) -> Source:
        """Where the rows came from, the columns that were used by channel, and notes."""
        if self.beside:
            source, other = (file.source(notes) for file in self.beside)
            columns = tuple(dict.fromkeys((*source.columns, *other.columns)))
            return Source(self.shown, f"{source.sha256}, {other.sha256}", columns, notes)
        used = tuple((column.address, channel, column.unit) for channel, column in self.columns.items())
        with self.path.open("rb") as stream:
            sha256 = hashlib.file_digest(stream, "sha256").hexdigest()
        return Source(self.shown, sha256, used, notes)


def opened(
    path: Path,
    spec: RunSpec,
    required: tuple[str, ...],
    optional: tuple[str, ...] = (),
    *,
    unit: str = "",
    tell: Progress = silent,
    check: Callable[[FileTable], None] | None = None,
) -> RunFile:
    """Find the channels of a run in a file, as `imubayes.rig.columns.resolve` does, after a `check`.

    A short file whose clock is set back is cut there, unless sections count its rows; a table of means whose
    dwells are its clock is held whole. It is a `DataError` if the file cannot be read, or lacks a channel.
    """
    shown = spec.shown or str(path)
    rows = rows_in(path)
    long = rows > STREAMED
    table = next(tables_of(path, shown, Wanted())) if long else read_table(path, shown)
    if check:
        check(table)
    given = {"output_unit": unit, "ignore": spec.ignore, "dwell": spec.dwell}
    columns = resolve(table, spec.columns, required=required, optional=optional, **given)
    if long and columns["t"].made:  # a clock that adds up the times of all rows before
        long, table = False, read_table(path, shown)
        columns = resolve(table, spec.columns, required=required, optional=optional, **given)
    file = RunFile(path, shown, columns, rows, tuple(name for name in required if name != "t"), tell)
    if long:
        return file
    check_values(table, columns["t"])
    part, notes = between_set_backs(table, columns["t"]) if not spec.sections else (slice(None), ())
    columns = {name: replace(column, raw=column.raw[part]) for name, column in columns.items()}
    columns["t"], more = spread(columns["t"])
    clock = Clock()
    held = _rows_of(table.rows(part), columns, file.outputs, clock)
    known = {name: replace(column, raw=np.zeros(0)) for name, column in columns.items()}
    return replace(file, columns=known, held=held, notes=(*notes, *more, *clock.notes))


def _rows_of(table: FileTable, columns: Mapping[str, Column], outputs: Collection[str], clock: Clock) -> Part:
    """Rows of the next table of a file, in SI, whose interval is not known yet."""
    t = clock.read(table, columns["t"])
    values: dict[str, FloatArray] = {}
    for name, column in ((name, column) for name, column in columns.items() if name != "t"):
        if len(column.raw) != len(t):
            raise DataError(
                f"{table.file}: column '{column.address}' has {len(column.raw)} rows where the time has"
                f" {len(t)}: expected columns of equal length"
            )
        check_values(table, column)
        values[name] = frozen(column.si())
    mount = None
    if MOUNT in values:
        numbers = values.pop(MOUNT)
        wrong = (np.rint(numbers) != numbers) | (np.abs(numbers) > _MOST_MOUNTS)
        if wrong.any():
            row = int(np.argmax(wrong))
            raise DataError(
                f"{table.file}, {table.place(row)}: column '{columns[MOUNT].address}' holds"
                f" {float(numbers[row]):g}: expected a whole number, the same in all rows between which the"
                " case stayed in its fixture"
            )
        mount = frozen(numbers.astype(np.int64))
    said = np.reshape([values.pop(name) for name in outputs], (-1, len(t))).T
    output = said[:, 0] if len(outputs) == 1 else np.ascontiguousarray(said)
    return Part(Inputs(frozen(t), values, np.nan, mount), output, table.first)


def abreast(file: RunFile, other: RunFile) -> RunFile:
    """Two files of one run on one clock, as one: both are held, or read a part at a time."""
    both = replace(
        file,
        shown=f"{file.shown}, {other.shown}",
        columns={**other.columns, **file.columns},
        rows=max(file.rows, other.rows),
        held=None,
        notes=tuple(dict.fromkeys((*file.notes, *other.notes))),
        outputs=(*file.outputs, *other.outputs),
        beside=(file, other),
    )
    if file.held is None or other.held is None:
        return both
    return replace(both, held=both.whole()[0], beside=tuple(replace(one, held=None) for one in both.beside))


def _abreast(shown: str, parts: Iterator[Part], other: Iterator[Part]) -> Iterator[Part]:
    """Rows of two files, as many at a time as were read of both.

    It is a `DataError` if they do not have the same time stamps.
    """
    a, b = next(parts, None), next(other, None)
    while a is not None and b is not None:
        k = min(len(a.t), len(b.t))
        if np.max(np.abs(a.t[:k] - b.t[:k])) > SAME_TIME * sampling_interval(a.t[:k]):
            break
        first, second = (rows.some(slice(0, k)) for rows in (a, b))
        inputs = replace(first.inputs, channels={**first.inputs.channels, **second.inputs.channels})
        yield replace(first, inputs=inputs, output=np.column_stack((first.output, second.output)))
        a, b = (
            rows.some(slice(k, None)) if k < len(rows) else next(more, None)
            for rows, more in ((a, parts), (b, other))
        )
    if a is not None or b is not None:
        ends = [
            sum((len(rows.t) for rows in rest), 0 if left is None else left.first + len(left.t))
            for left, rest in ((a, parts), (b, other))
        ]
        raise DataError(
            f"{shown.replace(', ', ' and ')}: expected the same time stamps in both, for accelerometers and"
            f" gyroscopes of one run; came {ends[0]} and {ends[1]} rows"
        )


@dataclass(slots=True, eq=False)
class Clock:
    """Time of the rows of a file, from table to table; checked across their borders.

    A clock that wraps around counts on, and one that counts from an epoch is referred to its first reading
    before it is scaled.
    """

    last: NDArray[np.generic] | None = None
    turns: int = 0
    origin: float | None = None
    late: bool = False
    other: Clock | None = None

    @property
    def notes(self) -> tuple[str, ...]:
        """What is to be said of the clock, and of that of the file beside."""
        turned = (f"the clock wrapped around {counted(self.turns, 'time')}",) if self.turns else ()
        own = (*turned, "time is counted from the first sample") if self.late else turned
        return own if self.other is None else tuple(dict.fromkeys((*own, *self.other.notes)))

    def read(self, table: FileTable, column: Column) -> FloatArray:
        """Time in s of the rows of the next table."""
        check_values(table, column)
        placed = table
        if self.last is not None:
            # the row before comes along, so that the step across the border is seen
            column = replace(column, raw=np.concatenate((self.last, column.raw)))
            placed = replace(table, first=table.first - 1)
        running, more = unwrapped(placed, column)
        clock = running.raw.astype(np.int64 if running.raw.dtype.kind in "iu" else np.float64)
        clock += np.asarray(self.turns * (column.wraps or 0.0)).astype(clock.dtype)
        origin = clock[0].item() if self.origin is None else self.origin
        self.origin, self.last, self.turns = origin, column.raw[-1:], self.turns + more
        self.late = abs((float(origin) - column.offset) * column.scale + column.zero) > LATE_EPOCH
        since = np.subtract(clock, origin).astype(np.float64) * column.scale
        t = since if self.late else replace(running, raw=clock).si()
        check_time(placed, column, t)
        return t if placed is table else t[1:]


Lost = tuple[Stretches, FloatArray]
"""Stretches of rows that are left out of a part, and when they begin, s."""


@dataclass(frozen=True, slots=True, eq=False)
class Reader:
    """Reads the rows of a run, a part at a time, as often as it is called.

    One sample is averaged over an `interval`, s. ``dT`` is interpolated between `rate`, times in s and rates
    of temperature in K/s; None leaves it out where the file has none. Samples at the `rails`, ends of each
    output's range, SI, are left out.
    """

    file: RunFile
    interval: float
    rate: tuple[FloatArray, FloatArray] | None = None
    rails: tuple[tuple[float, ...], ...] = ()

    def __call__(
        self, purpose: str, lost: list[list[Lost]] | None = None, clock: Clock | None = None
    ) -> Iterator[Part]:
        """Read the rows from the first on; `purpose` is told with the progress, `lost` what is left out."""
        parts = self._parts(self.file.values(clock or Clock()))
        kept = lost or [[] for _ in self.rails]
        within = thinned(_within(parts, self.rails, kept)) if self.rails else parts
        return _told(self.file, purpose, _prefetched(within))

    def __reduce__(self) -> tuple[type[Reader], tuple[object, ...]]:
        """Another process reads the same rows; whoever is told of progress stays in this one."""
        return Reader, (replace(self.file, tell=silent), self.interval, self.rate, self.rails)

    def _parts(self, tables: Iterator[Part]) -> Iterator[Part]:
        """Parts; each waits for the next, whose first row says how long its last one lasts."""
        held, before = next(tables, None), np.zeros(0)
        while held is not None:
            ahead = next(tables, None)
            yield self._part(held, before, held.t[:0] if ahead is None else ahead.t[:1])
            held, before = ahead, held.t[-1:]

    def _part(self, rows: Part, before: FloatArray, after: FloatArray) -> Part:
        """Rows, with how long they last, between the times of the row before and of the one after."""
        inputs, channels = rows.inputs, dict(rows.inputs.channels)
        if inputs.averaged is None:
            around = durations(np.concatenate((before, rows.t, after)), self.interval)
            lasting = frozen(around[len(before) : len(before) + len(rows)])
            inputs = replace(inputs, interval=self.interval, averaged=lasting)
        if (second := channels.pop(SECOND, None)) is not None:
            if "T" not in channels:
                raise DataError(
                    f"{self.file.shown}: has a second thermometer '{SECOND}' and no first: name its column T"
                )
            channels["gT"] = frozen(second - channels["T"])
        if self.rate is not None and "dT" not in channels:
            channels["dT"] = frozen(np.interp(rows.t, *self.rate))
        return replace(rows, inputs=replace(inputs, channels=channels))


def _within(
    parts: Iterator[Part], rails: tuple[tuple[float, ...], ...], lost: list[list[Lost]]
) -> Iterator[tuple[Part, BoolArray]]:
    """Parts, and which samples are not at the ends of a range; a few rows on both sides tell."""
    ahead = next(parts, None)
    held: FloatArray | None = None
    while (part := ahead) is not None:
        ahead = next(parts, None)
        before = part.output[:0] if held is None else held
        after = part.output[:0] if ahead is None else ahead.output[:NEAR]
        around, kept = np.concatenate((before, part.output, after)), np.ones(len(part), dtype=bool)
        for output, ends, out in zip(np.atleast_2d(around.T), rails, lost, strict=True):
            own = beyond(output, ends)[len(before) : len(before) + len(part)]
            rows = stretches_of(own)
            out.append((part.first + rows, part.t[rows[:, 0]]))
            kept &= ~own
        held = part.output[-NEAR:]
        yield part, kept


def _prefetched(parts: Iterator[Part]) -> Iterator[Part]:
    """Read the next part while this one is worked on."""
    from concurrent.futures import ThreadPoolExecutor

    with ThreadPoolExecutor(1) as reader:
        ahead = reader.submit(next, parts, None)
        while (part := ahead.result()) is not None:
            ahead = reader.submit(next, parts, None)
            yield part


def _told(file: RunFile, purpose: str, parts: Iterator[Part]) -> Iterator[Part]:
    """Say from time to time how far it is, and how fast."""
    start = said = time.perf_counter()
    for part in parts:
        yield part
        now, done = time.perf_counter(), part.first + len(part)
        if now - said > SAID_EVERY:
            said = now
            file.tell(
                f"{purpose}: {done:,} of about {max(file.rows, done):,} rows,"
                f" {done / (now - start):,.0f} rows/s",
                done / max(file.rows, done),
            )
