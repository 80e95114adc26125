"""The rows of a file as those of a run, in SI: a bounded part at a time, of which a short file has one.

Of a long file what is held is what fits: averages over blocks, a stretch at full rate, and the rows with the
largest and smallest of every input. The rows themselves are read again by whoever needs them all.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra.arrays import BoolArray, FloatArray
from imubayes.errors import DataError
from imubayes.progress import Progress, silent
from imubayes.rig.checks import NEAR, Stretches, beyond, check_time, check_values, stretches_of
from imubayes.rig.clocks import between_set_backs, spread, unwrapped
from imubayes.rig.columns import Column, ColumnSpec, resolve
from imubayes.rig.formats import Table, read_table
from imubayes.rig.inputs import MOUNT, Part, Source, durations, joined_parts, sampling_interval, thinned
from imubayes.rig.recordings import sha256_of, with_gradient
from imubayes.rig.stream_files import Wanted, rows_in, tables_of
from imubayes.units import counted

STREAMED = 1_000_000
"""Rows from which a file is read a part at a time: a study of so many in memory, with twenty terms, peaks at
0.9 GB; of five times as many at 2.3 GB."""

SAME_TIME = 0.01
"""Share of the interval by which time stamps of two files of one run may differ."""

SAID_EVERY = 0.5
"""s between two messages of progress."""

LATE_EPOCH = 1e6
"""s: a clock that starts later than this counts from an epoch; differences are then taken before scaling."""

NOT_YET = np.zeros(0)
"""In place of the durations of rows whose last one waits for the row after it."""

_MOST_MOUNTS = 2**31
"""A number of a mount beyond this is something else."""


@dataclass(frozen=True, slots=True, eq=False)
class RunFile:
    """A file as rows of a run: where it is, and which of its columns are what.

    Attributes
    ----------
    path, shown : the file, and what messages call it.
    columns : of the first table, by channel: names, units, scales.
    rows : about so many; 0 where the format does not say.
    held : all of a short file; None of one that is read a part at a time.
    outputs : channels of what was measured, one or of the components of a case.
    beside : two files whose rows these are, side by side; none where they are those of one file.
    tell : is told of progress.
    notes : what is to be said of its clock.
    """

    path: Path
    shown: str
    columns: Mapping[str, Column]
    rows: int
    held: Table | None = None
    tell: Progress = silent
    notes: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ("output",)
    beside: tuple[RunFile, ...] = ()

    def tables(self) -> Iterator[Table]:
        """Read the columns that the run uses."""
        if self.held is not None:
            return iter([self.held])
        wanted = [*self.columns.values(), self.columns["t"]]
        *names, clock = ({name.partition("[:")[0].strip() for name in one.names} for one in wanted)
        return tables_of(self.path, self.shown, Wanted(set().union(*names), clock))

    def found(self, table: Table, channel: str) -> Column:
        """Find a channel in a table."""
        column = self.columns[channel]
        return column if table is self.held else column.read(table)

    def values(self, clock: Clock) -> Iterator[Part]:
        """Rows a table at a time, without durations; the `clock` starts with the first."""
        if self.beside:
            clock.other = Clock()
            first, second = self.beside
            yield from _abreast(self.shown, first.values(clock), second.values(clock.other))
            return
        for table in self.tables():
            t, before = clock.read(self, table)
            columns = {name: self.found(table, name) for name in self.columns if name != "t"}
            values = {name: _checked(table, column, len(t)) for name, column in columns.items()}
            mount = whole_numbers(table, columns[MOUNT], values.pop(MOUNT)) if MOUNT in values else None
            said = np.reshape([values.pop(name) for name in self.outputs], (-1, len(t))).T
            output = said[:, 0] if len(self.outputs) == 1 else np.ascontiguousarray(said)
            yield Part(table.first, before, t, NOT_YET, values, output, mount)

    def source(self, notes: tuple[str, ...]) -> Source:
        """Where the rows came from, the columns that were used by channel, and notes."""
        if self.beside:
            one, other = (file.source(notes) for file in self.beside)
            columns = tuple(dict.fromkeys((*one.columns, *other.columns)))
            return Source(self.shown, f"{one.sha256}, {other.sha256}", columns, notes)
        used = tuple((column.address, channel, column.unit) for channel, column in self.columns.items())
        return Source(self.shown, sha256_of(self.path), used, notes)

    def whole(self) -> tuple[Part, tuple[str, ...]]:
        """All rows, without durations, and what is to be said of the clock."""
        clock = Clock()
        parts = list(self.values(clock))
        joined = parts[0] if len(parts) == 1 else joined_parts(parts)
        for one in (joined.t, joined.output, *joined.channels.values()):
            one.setflags(write=False)
        return joined, (*self.notes, *clock.notes)


def any_table(table: Table) -> None:
    """Take a file as it is."""


def opened(
    path: Path,
    shown: str,
    specs: Mapping[str, ColumnSpec],
    *,
    required: tuple[str, ...],
    optional: tuple[str, ...],
    output_unit: str = "",
    ignore: Collection[str] = (),
    tell: Progress = silent,
    check: Callable[[Table], None] = any_table,
    cut: bool = True,
    dwell: float = 0.0,
) -> RunFile:
    """Find the channels of a run in a file, as `imubayes.rig.columns.resolve` does, after a `check`.

    A short file whose clock is set back is cut there, unless `cut` forbids it.

    Raises
    ------
    DataError : if the file cannot be read, or lacks a channel.
    """
    rows = rows_in(path)
    held = None if rows > STREAMED else read_table(path, shown)
    table = next(tables_of(path, shown, Wanted())) if held is None else held
    check(table)
    columns = resolve(
        table,
        specs,
        required=required,
        optional=optional,
        output_unit=output_unit,
        ignore=ignore,
        dwell=dwell,
    )
    outputs = tuple(name for name in required if name != "t")
    if held is None:
        return RunFile(path, shown, columns, rows, held, tell, outputs=outputs)
    check_values(held, columns["t"])
    part, notes = between_set_backs(held, columns["t"]) if cut else (slice(None), ())
    columns = {name: replace(column, raw=column.raw[part]) for name, column in columns.items()}
    columns["t"], more = spread(columns["t"])
    return RunFile(path, shown, columns, rows, held.rows(part), tell, (*notes, *more), outputs)


def abreast(file: RunFile, other: RunFile) -> RunFile:
    """Two files of one run on one clock, as one: both are held, or read a part at a time."""
    return replace(
        file,
        shown=f"{file.shown}, {other.shown}",
        columns={**other.columns, **file.columns},
        rows=max(file.rows, other.rows),
        held=file.held if other.held is not None else None,
        notes=tuple(dict.fromkeys((*file.notes, *other.notes))),
        outputs=(*file.outputs, *other.outputs),
        beside=(file, other),
    )


def _abreast(shown: str, one: Iterator[Part], other: Iterator[Part]) -> Iterator[Part]:
    """Rows of two files, as many at a time as were read of both.

    Raises
    ------
    DataError : if they do not have the same time stamps.
    """
    a, b = next(one, None), next(other, None)
    while a is not None and b is not None:
        k = min(len(a.t), len(b.t))
        if np.max(np.abs(a.t[:k] - b.t[:k])) > SAME_TIME * sampling_interval(a.t[:k]):
            break
        first, second = (rows.some(slice(0, k), rows.first, rows.before) for rows in (a, b))
        channels = {**first.channels, **second.channels}
        yield replace(first, channels=channels, output=np.column_stack((first.output, second.output)))
        a, b = (
            rows.some(slice(k, None), rows.first + k, float(rows.t[k - 1]))
            if k < len(rows)
            else next(more, None)
            for rows, more in ((a, one), (b, other))
        )
    if a is not None or b is not None:
        ends = [
            sum((len(rows.t) for rows in rest), 0 if left is None else left.first + len(left.t))
            for left, rest in ((a, one), (b, other))
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

    def read(self, file: RunFile, table: Table) -> tuple[FloatArray, float]:
        """Time in s of the rows of the next table, and that of the row before."""
        column, placed = file.found(table, "t"), table
        check_values(table, column)
        if self.last is not None:
            # the row before comes along, so that the step across the border is seen
            column = replace(column, raw=np.concatenate((self.last, column.raw)))
            placed = replace(table, first=table.first - 1)
        running, more = unwrapped(placed, column)
        clock = running.raw.astype(np.int64 if running.raw.dtype.kind in "iu" else np.float64)
        clock += np.asarray(self.turns * (column.wraps or 0.0)).astype(clock.dtype)
        self.origin = clock[0].item() if self.origin is None else self.origin
        self.last, self.turns = column.raw[-1:], self.turns + more
        t = self._seconds(replace(running, raw=clock))
        if len(t) > 1 or table is file.held:
            check_time(placed, column, t)
        return (t, np.nan) if placed is table else (t[1:], float(t[0]))

    def _seconds(self, clock: Column) -> FloatArray:
        origin = self.origin or 0
        self.late = abs((float(origin) - clock.offset) * clock.scale + clock.zero) > LATE_EPOCH
        return np.subtract(clock.raw, origin).astype(np.float64) * clock.scale if self.late else clock.si()


def _checked(table: Table, column: Column, n: int) -> FloatArray:
    """Values (n,) of a column in SI.

    Raises
    ------
    DataError : if there are more or fewer of them, or one is not finite.
    """
    if len(column.raw) != n:
        raise DataError(
            f"{table.file}: column '{column.address}' has {len(column.raw)} rows where the time has {n}: "
            "expected columns of equal length"
        )
    check_values(table, column)
    return column.si()


def whole_numbers(table: Table, column: Column, values: FloatArray) -> NDArray[np.int64]:
    """Numbers of mounts, which are whole."""
    wrong = (np.rint(values) != values) | (np.abs(values) > _MOST_MOUNTS)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise DataError(
            f"{table.file}, {table.place(row)}: column '{column.address}' holds {float(values[row]):g}: "
            "expected a whole number, the same in all rows between which the case stayed in its fixture"
        )
    numbers = values.astype(np.int64)
    numbers.setflags(write=False)
    return numbers


def first_interval(file: RunFile) -> float:
    """Sampling interval by the first table, s."""
    return sampling_interval(next(file.values(Clock())).t)


@dataclass(frozen=True, slots=True, eq=False)
class Reader:
    """Reads the rows of a run, a part at a time, as often as it is called.

    Attributes
    ----------
    file : of the run.
    interval : averaging time of one sample, s.
    rate : times in s and rates of temperature in K/s, between which ``dT`` is interpolated; None leaves it
        out where the file has none.
    rails : ends of each output's range, SI, at which samples are left out.
    """

    file: RunFile
    interval: float
    rate: tuple[FloatArray, FloatArray] | None = None
    rails: tuple[tuple[float, ...], ...] = ()

    def __call__(
        self, purpose: str, lost: list[list[Stretches]] | None = None, clock: Clock | None = None
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
        held: Part | None = None
        for rows in tables:
            if held is not None:
                yield self._part(held, float(rows.t[0]))
            held = rows
        if held is not None:
            yield self._part(held, np.nan)

    def _part(self, rows: Part, after: float) -> Part:
        around = np.concatenate(([rows.before], rows.t, [after]))
        known = np.isfinite(around)
        lasting = durations(around[known], self.interval)[int(known[0]) : int(known[0]) + len(rows.t)]
        channels = with_gradient(rows.channels, self.file.shown)
        if self.rate is not None and "dT" not in channels:
            channels["dT"] = np.interp(rows.t, *self.rate)
        return replace(rows, duration=lasting, channels=channels)


def _within(
    parts: Iterator[Part], rails: tuple[tuple[float, ...], ...], lost: list[list[Stretches]]
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
            out.append(part.first + stretches_of(own))
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
