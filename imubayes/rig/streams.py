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
from imubayes.rig.checks import NEAR, Stretches, beyond, check_time, check_values, stretches_of
from imubayes.rig.clocks import between_set_backs, spread, unwrapped
from imubayes.rig.columns import Column, ColumnSpec, resolve
from imubayes.rig.formats import Table, read_table
from imubayes.rig.inputs import MOUNT, Part, durations, sampling_interval, thinned
from imubayes.rig.stream_files import Wanted, rows_in, tables_of
from imubayes.units import counted

Tell = Callable[[str], None]

STREAMED = 1_000_000
"""Rows from which a file is read a part at a time: a study of so many in memory, with twenty terms, peaks at
0.9 GB; of five times as many at 2.3 GB."""

MOST_WHOLE = 30_000_000
"""Rows of a run that is held as a whole because something needs all of them at once: some 15 GB."""

SAID_EVERY = 0.5
"""s between two messages of progress."""

LATE_EPOCH = 1e6
"""s: a clock that starts later than this counts from an epoch; differences are then taken before scaling."""

_MOST_MOUNTS = 2**31
"""A number of a mount beyond this is something else."""


def silent(message: str) -> None:
    """Tell nobody."""


@dataclass(frozen=True, slots=True, eq=False)
class RunFile:
    """A file as rows of a run: where it is, and which of its columns are what.

    Attributes
    ----------
    path, shown : the file, and what messages call it.
    columns : of the first table, by channel: names, units, scales.
    rows : about so many; 0 where the format does not say.
    held : all of a short file; None of one that is read a part at a time.
    tell : is told of progress.
    notes : what is to be said of its clock.
    """

    path: Path
    shown: str
    columns: Mapping[str, Column]
    rows: int
    held: Table | None = None
    tell: Tell = silent
    notes: tuple[str, ...] = ()

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

    def values(self, clock: Clock) -> Iterator[Rows]:
        """Values a table at a time, whose `clock` starts with the first."""
        for table in self.tables():
            t, before = clock.read(self, table)
            columns = {name: self.found(table, name) for name in self.columns if name != "t"}
            values = {name: _checked(table, column, len(t)) for name, column in columns.items()}
            mount = whole_numbers(table, columns[MOUNT], values.pop(MOUNT)) if MOUNT in values else None
            yield Rows(table.first, before, t, values, mount)

    def whole(self) -> tuple[Rows, tuple[str, ...]]:
        """All rows, and what is to be said of the clock."""
        clock = Clock()
        parts = list(self.values(clock))
        joined = parts[0] if len(parts) == 1 else _joined(parts)
        for one in (joined.t, *joined.values.values()):
            one.setflags(write=False)
        return joined, (*self.notes, *clock.notes)


def opened(
    path: Path,
    shown: str,
    specs: Mapping[str, ColumnSpec],
    *,
    required: tuple[str, ...],
    optional: tuple[str, ...],
    output_unit: str = "",
    ignore: Collection[str] = (),
    tell: Tell = silent,
    check: Callable[[Table], None] = lambda table: None,
    cut: bool = True,
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
        table, specs, required=required, optional=optional, output_unit=output_unit, ignore=ignore
    )
    if held is None:
        return RunFile(path, shown, columns, rows, held, tell)
    check_values(held, columns["t"])
    part, notes = between_set_backs(held, columns["t"]) if cut else (slice(None), ())
    columns = {name: replace(column, raw=column.raw[part]) for name, column in columns.items()}
    columns["t"], more = spread(columns["t"])
    return RunFile(path, shown, columns, rows, held.rows(part), tell, (*notes, *more))


def refuse_long(file: RunFile, what: str, instead: str) -> None:
    """Refuse a file with more rows than are held at a time."""
    if file.rows > MOST_WHOLE:
        raise DataError(
            f"{file.shown}: has about {file.rows:,} rows: {what} is read as a whole, and has at most"
            f" {MOST_WHOLE:,}; {instead}"
        )


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """Consecutive rows of a file: number of the first, time of the row before (NaN for the first), values.

    Time and values (k,) are in SI; `mount` has the numbers of the rows' mounts, None where the file has none.
    """

    first: int
    before: float
    t: FloatArray
    values: dict[str, FloatArray]
    mount: NDArray[np.int64] | None


def _joined(parts: list[Rows]) -> Rows:
    first, mounts = parts[0], [part.mount for part in parts if part.mount is not None]
    values = {name: np.concatenate([part.values[name] for part in parts]) for name in first.values}
    mount = np.concatenate(mounts) if mounts else None
    return Rows(0, first.before, np.concatenate([part.t for part in parts]), values, mount)


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

    @property
    def notes(self) -> tuple[str, ...]:
        """What is to be said of the clock."""
        turned = (f"the clock wrapped around {counted(self.turns, 'time')}",) if self.turns else ()
        return (*turned, "time is counted from the first sample") if self.late else turned

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
    rails : ends of the output's range, SI, at which samples are left out.
    """

    file: RunFile
    interval: float
    rate: tuple[FloatArray, FloatArray] | None = None
    rails: tuple[float, ...] = ()

    def __call__(
        self, purpose: str, lost: list[Stretches] | None = None, clock: Clock | None = None
    ) -> Iterator[Part]:
        """Read the rows from the first on; `purpose` is told with the progress, `lost` what is left out."""
        parts = _parts(self.file.values(clock or Clock()), self.interval, self.rate)
        within = thinned(_within(parts, self.rails, [] if lost is None else lost)) if self.rails else parts
        return _told(self.file, purpose, _prefetched(within))

    def __reduce__(self) -> tuple[type[Reader], tuple[object, ...]]:
        """Another process reads the same rows; whoever is told of progress stays in this one."""
        return Reader, (replace(self.file, tell=silent), self.interval, self.rate, self.rails)


def _parts(
    tables: Iterator[Rows], interval: float, rate: tuple[FloatArray, FloatArray] | None
) -> Iterator[Part]:
    """Parts; each waits for the next, whose first row says how long its last one lasts."""
    held: Rows | None = None
    for rows in tables:
        if held is not None:
            yield _part(held, float(rows.t[0]), interval, rate)
        held = rows
    if held is not None:
        yield _part(held, np.nan, interval, rate)


def _within(
    parts: Iterator[Part], rails: tuple[float, ...], lost: list[Stretches]
) -> Iterator[tuple[Part, BoolArray]]:
    """Parts, and which samples are not at the ends of the range; a few rows on both sides tell."""
    ahead = next(parts, None)
    held = np.zeros(0)
    while (part := ahead) is not None:
        ahead = next(parts, None)
        after = np.zeros(0) if ahead is None else ahead.output[:NEAR]
        around = np.concatenate((held, part.output, after))
        kept = ~beyond(around, rails)[len(held) : len(held) + len(part)]
        held = part.output[-NEAR:]
        lost.append(part.first + stretches_of(~kept))
        yield part, kept


def _part(rows: Rows, after: float, interval: float, rate: tuple[FloatArray, FloatArray] | None) -> Part:
    around = np.concatenate(([rows.before], rows.t, [after]))
    known = np.isfinite(around)
    lasting = durations(around[known], interval)[int(known[0]) : int(known[0]) + len(rows.t)]
    channels = dict(rows.values)
    output = channels.pop("output")
    if rate is not None and "dT" not in channels:
        channels["dT"] = np.interp(rows.t, *rate)
    return Part(rows.first, rows.before, rows.t, lasting, channels, output, rows.mount)


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
                f" {done / (now - start):,.0f} rows/s"
            )
