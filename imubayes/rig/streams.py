"""A run of any length: its file's rows, a bounded part at a time, in SI.

What is held of it is what fits: averages over blocks, a stretch at full rate, and the rows with the largest
and smallest of every input. The rows themselves are read again by whoever needs them all.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.errors import DataError
from imubayes.rig.checks import check_time, check_values
from imubayes.rig.columns import Column, resolve, unwrapped
from imubayes.rig.formats import Table
from imubayes.rig.inputs import Part, durations, sampling_interval
from imubayes.rig.recordings import INPUTS, LATE_EPOCH, OUTPUT_UNIT, RunSpec, values_of
from imubayes.rig.saturation import NEAR, Stretches, beyond, stretches_of
from imubayes.rig.stream_files import Wanted, rows_in, tables_of
from imubayes.sensors.terms import Kind

Tell = Callable[[str], None]

STREAMED = 1_000_000
"""Rows from which a file is read a part at a time: a study of so many in memory, with twenty terms, peaks at
0.9 GB; of five times as many at 2.3 GB."""

MOST_WHOLE = 30_000_000
"""Rows of a file that is read as a whole because something needs all of them at once: some 15 GB."""

SAID_EVERY = 0.5
"""s between two messages of progress."""


def is_long(path: Path) -> bool:
    """Tell whether a file has so many rows that it is read a part at a time."""
    return rows_in(path) > STREAMED


def refuse_whole(path: Path, shown: str) -> None:
    """Refuse a file that is to be read as a whole, and has too many rows for that.

    Raises
    ------
    DataError : with what the user can do.
    """
    rows = rows_in(path)
    if rows > MOST_WHOLE:
        raise DataError(
            f"{shown}: has about {rows:,} rows: with errors of the test bench (reference) or robust dwells"
            f" a run is read as a whole, and has at most {MOST_WHOLE:,}; leave these out of the study, or"
            " average the file"
        )


@dataclass(frozen=True, slots=True, eq=False)
class RunFile:
    """A file as rows of a run: where it is, and which of its columns are what.

    Attributes
    ----------
    path, shown : the file, and what messages call it.
    columns : of the first table, by channel: names, units, scales.
    rows : about so many.
    tell : is told of progress.
    """

    path: Path
    shown: str
    columns: Mapping[str, Column]
    rows: int
    tell: Tell

    def tables(self) -> Iterator[Table]:
        """Read the columns that the run uses."""
        names = {column.address.partition("[:")[0].strip() for column in self.columns.values()}
        clock = self.columns["t"].address
        return tables_of(self.path, self.shown, Wanted(names, clock))

    def found(self, table: Table, channel: str) -> Column:
        """Find a channel in a table."""
        column = self.columns[channel]
        return replace(column, raw=table.locate(column.address, channel)[1])


def opened(spec: RunSpec, path: Path, kind: Kind, tell: Tell) -> RunFile:
    """Find the channels of a run in a long file.

    Raises
    ------
    DataError : as `imubayes.rig.runs.read_run` does.
    """
    shown = spec.shown or str(path)
    table = next(tables_of(path, shown, Wanted()))
    columns = resolve(
        table,
        spec.columns,
        required=("t", "output"),
        optional=INPUTS,
        output_unit=OUTPUT_UNIT[kind],
        ignore=spec.ignore,
    )
    return RunFile(path, shown, columns, rows_in(path), tell)


def first_interval(file: RunFile) -> float:
    """Sampling interval by the first table, s."""
    return sampling_interval(next(_timed(file))[1])


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

    def __call__(self, purpose: str, lost: list[Stretches] | None = None) -> Iterator[Part]:
        """Read the rows from the first on; `purpose` is told with the progress, `lost` what is left out."""
        parts = _parts(self.file, self.interval, self.rate)
        within = _within(parts, self.rails, [] if lost is None else lost) if self.rails else parts
        return _told(self.file, purpose, _prefetched(within))

    def __reduce__(self) -> tuple[type[Reader], tuple[object, ...]]:
        """Another process reads the same rows; whoever is told of progress stays in this one."""
        return Reader, (replace(self.file, tell=_silent), self.interval, self.rate, self.rails)


def _silent(message: str) -> None:
    """Tell nobody."""


def _parts(file: RunFile, interval: float, rate: tuple[FloatArray, FloatArray] | None) -> Iterator[Part]:
    """Parts; each waits for the next, whose first row says how long its last one lasts."""
    held: tuple[Table, FloatArray, float] | None = None
    for table, t, before in _timed(file):
        if held is not None:
            yield _part(file, held, float(t[0]), interval, rate)
        held = table, t, before
    if held is not None:
        yield _part(file, held, np.nan, interval, rate)


def _within(parts: Iterator[Part], rails: tuple[float, ...], lost: list[Stretches]) -> Iterator[Part]:
    """Parts without the samples at the ends of the range; a few rows on both sides tell which these are."""
    ahead = next(parts, None)
    held, first, before = np.zeros(0), 0, np.nan
    while (part := ahead) is not None:
        ahead = next(parts, None)
        after = np.zeros(0) if ahead is None else ahead.output[:NEAR]
        around = np.concatenate((held, part.output, after))
        kept = ~beyond(around, rails)[len(held) : len(held) + len(part)]
        held = part.output[-NEAR:]
        lost.append(part.first + stretches_of(~kept))
        if kept.any():
            channels = {name: values[kept] for name, values in part.channels.items()}
            yield Part(first, before, part.t[kept], part.duration[kept], channels, part.output[kept])
            first, before = first + int(kept.sum()), float(part.t[kept][-1])


def _part(
    file: RunFile,
    held: tuple[Table, FloatArray, float],
    after: float,
    interval: float,
    rate: tuple[FloatArray, FloatArray] | None,
) -> Part:
    table, t, before = held
    around = np.concatenate(([before], t, [after]))
    known = np.isfinite(around)
    lasting = durations(around[known], interval)[int(known[0]) : int(known[0]) + len(t)]
    values = {name: values_of(table, file.found(table, name), len(t)) for name in file.columns if name != "t"}
    output = values.pop("output")
    if rate is not None and "dT" not in values:
        values["dT"] = np.interp(t, *rate)
    return Part(table.first, before, t, lasting, values, output)


def _timed(file: RunFile) -> Iterator[tuple[Table, FloatArray, float]]:
    """Tables with their time in s, and that of the row before; checked across their borders.

    A clock that wraps around counts on, and one that counts from an epoch is referred to its first reading
    before it is scaled, as in a run that is read as a whole.
    """
    last, turns, origin = None, 0, None
    for table in file.tables():
        column, placed = file.found(table, "t"), table
        check_values(table, column)
        if last is not None:
            # the row before comes along, so that the step across the border is seen
            column = replace(column, raw=np.concatenate((last, column.raw)))
            placed = replace(table, first=table.first - 1)
        running, more = unwrapped(placed, column)
        clock = running.raw.astype(np.int64 if running.raw.dtype.kind in "iu" else np.float64)
        clock += np.asarray(turns * (column.wraps or 0.0)).astype(clock.dtype)
        origin = clock[0].item() if origin is None else origin
        last, turns = column.raw[-1:], turns + more
        t = _seconds(replace(running, raw=clock), origin)
        if len(t) > 1:
            check_time(placed, column, t)
        yield (table, t, np.nan) if placed is table else (table, t[1:], float(t[0]))


def _seconds(clock: Column, origin: float) -> FloatArray:
    """Time in s of a clock whose first reading in the run was `origin`."""
    first = (float(origin) - clock.offset) * clock.scale + clock.zero
    since = np.subtract(clock.raw, origin)
    return since.astype(np.float64) * clock.scale if abs(first) > LATE_EPOCH else clock.si()


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
