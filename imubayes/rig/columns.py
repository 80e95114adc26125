"""Columns of a file as channels of a run: which one, in which unit.

Of its clock too: one that wraps around, that is set back, or that is read in coarse steps.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imubayes import units
from imubayes.algebra import FloatArray
from imubayes.errors import DataError, UnitError
from imubayes.rig.formats import FileTable, bare, bracketed
from imubayes.rig.inputs import DWELL, GAP
from imubayes.sensors.imu import ACCELEROMETERS, GYROSCOPES
from imubayes.sensors.terms import CHANNEL_UNITS

NEARLY = 0.85
"""Likeness of two names (difflib's ratio) that are meant to be one."""

AXES = "ijkxyz"
"""Letters that name an axis."""

CALLED = {
    "f": ("f", "a", "acc", "accel", "force"),
    "w": ("w", "omega", "rate", "gyro"),
    "dw": ("dw", "domega", "wdot", "alpha"),
}
"""What people call the families of channels."""

_UNITS = {
    **CHANNEL_UNITS,
    "t": "s",
    DWELL: "s",
    "mount": "",
    **dict.fromkeys(ACCELEROMETERS, "m/s^2"),
    **dict.fromkeys(GYROSCOPES, "rad/s"),
    **dict.fromkeys(("roll", "pitch", "yaw"), "rad"),
    "q": "",
}
"""SI units of the channels that are no output of a single component; a count needs none."""

_CONVERTER = ("count", "LSB", "V", "mV", "uV", "A", "mA")
"""Units that an output may have only with a scale."""

SAME_SIZE = 1e-9
"""Relative difference by which the ratio of two units of time is whole."""

_CONVERTED = ("", "V", "A")
"""Units of what an analogue or a digital output gives."""


@dataclass(frozen=True, slots=True)
class ColumnSpec:
    """Where the study finds a channel, if not under the channel's own name and unit.

    Attributes
    ----------
    column : name in the file (``adc``, ``raw[:,0,3]``), or number from 0; None for the channel's name.
    unit : unit of the file's numbers; None for the one in the file's header.
    scale : SI per file unit; None for the factor of the unit.
    offset : in file units, subtracted before scaling; None for 0.
    wraps : in file units, where a clock starts again from its lowest value; None for one that does not.
    rate : of a clock that the file does not have, in rows a second; 0 for one that it has.
    parts : of a clock that is the sum of several columns, such as seconds and nanoseconds; else none.
    """

    column: str | int | None = None
    unit: str | None = None
    scale: float | None = None
    offset: float | None = None
    wraps: float | None = None
    rate: float = 0.0
    parts: tuple[ColumnSpec, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Column:
    """A column of a file as a channel of a run.

    Attributes
    ----------
    channel : ``t``, ``output``, ``f_i``, ...
    address : name in the file, or number, for messages.
    unit : of the file's numbers.
    raw : (n,) the file's numbers, in the file's own type.
    scale, offset, zero : SI value of a number x is ``(x - offset) * scale + zero``.
    wraps : in the file's unit, where a clock starts again; None for one that does not.
    parts : (name in the file, its size in `unit`) of each column of a sum; the size is 0 where only its rows
        count. None of a column by itself.
    made : whether it adds up the times of the rows before, so that no part of the file has it by itself.
    """

    channel: str
    address: str
    unit: str
    raw: NDArray[np.generic]
    scale: float
    offset: float
    zero: float
    wraps: float | None = None
    parts: tuple[tuple[str, float], ...] = ()
    made: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """Names in the file of what it is made of."""
        return tuple(name for name, _ in self.parts) or (self.address,)

    def read(self, table: FileTable) -> Column:
        """Read the same channel of another table of the file."""
        found = [_whole(table.locate(name, self.channel)[1]) for name in self.names]
        raw = found[0] if not self.parts else np.arange(table.first, table.first + len(found[0]))
        if self.parts and self.parts[0][1]:
            sizes = [int(size) if size == int(size) else size for _, size in self.parts]
            raw = np.sum([values * size for values, size in zip(found, sizes, strict=True)], axis=0)
        return replace(self, raw=raw)

    def si(self) -> FloatArray:
        """Return the column in SI, a fresh array."""
        return (self.raw.astype(np.float64) - self.offset) * self.scale + self.zero

    def in_file(self, value: float) -> float:
        """Return the file's number for a value in SI."""
        return (value - self.zero) / self.scale + self.offset


def channel_unit(channel: str, output_unit: str) -> str:
    """SI unit of a channel.

    Examples
    --------
    >>> channel_unit("dw_k", "m/s^2")
    'rad/s^2'
    """
    return _UNITS.get(channel.partition("_")[0], output_unit)


def resolve(
    table: FileTable,
    specs: Mapping[str, ColumnSpec],
    *,
    required: tuple[str, ...],
    optional: tuple[str, ...],
    output_unit: str,
    ignore: Collection[str] = (),
    dwell: float = 0.0,
) -> dict[str, Column]:
    """Find the channels of a run in a file.

    Parameters
    ----------
    specs : what the study says, by channel; other channels are found under their own name.
    required, optional : channels to look for; an optional one that is in neither is left out.
    ignore : names in the file, with or without unit, of columns that are no channel.
    dwell : s, time of a row of a table of means, whose rows follow each other where it has no clock, as they
        do where a column says it; 0 where the rows are samples.

    Raises
    ------
    DataError : for a channel that is required or listed and not there, that is there twice, or has no unit
        that measures what the channel holds; for a column whose name is nearly that of a missing channel.
    """
    columns: dict[str, Column] = {}
    clock, there = specs.get("t", ColumnSpec()), {bare(name) for name in table.columns}
    named = there | specs.keys()
    means = "t" not in named and (dwell or DWELL in named)
    made = bool(clock.rate or clock.parts or (means and "t" in required))
    for channel in (*required, *optional):
        wanted = channel in (*required, *specs) or (channel in there and channel not in ignore)
        if wanted and not (made and channel == "t"):
            spec = specs.get(channel, ColumnSpec())
            columns[channel] = _column(table, channel, spec, channel_unit(channel, output_unit))
    if made:
        columns = {"t": _made(table, columns, clock, means=bool(means), dwell=dwell)} | columns
    known = {name for column in columns.values() for name in column.names} | {*required, *optional, *ignore}
    missing = {channel: channel_unit(channel, output_unit) for channel in optional if channel not in columns}
    for name in (name for name in table.columns if not {name, bare(name)} & known):
        meant, unit = nearly(bare(name), tuple(missing)), bracketed(name)
        # numbers without a unit may be a channel's, and so may what a converter gives
        if meant and (unit is None or any(units.converts(unit, o) for o in (missing[meant], *_CONVERTED))):
            raise DataError(
                f"{table.file}: column '{name}' is no channel, and there is no {meant}: did you mean"
                f" '{meant}'?"
                f' Rename it, or say in the study columns = {{ {meant} = "{bare(name)}" }}, or that it is'
                f' none, ignore = ["{bare(name)}"]'
            )
    return columns


def nearly(name: str, channels: Sequence[str]) -> str:
    """Channel whose name a column's name nearly is; empty if there is none.

    A name of the same family with another axis, spelled in another way, or with one letter too many.

    Examples
    --------
    >>> [nearly(name, ["f_j", "w_k"]) for name in ("f_q", "Fj", "f_jj", "omega_k", "w_norm", "adc")]
    ['f_j', 'f_j', 'f_j', 'w_k', '', '']
    """
    plain = "".join(letter for letter in name.lower() if letter.isalnum())
    for channel in channels:
        family, _, axis = channel.partition("_")
        if axis and plain in {f"{called}{axis}" for called in CALLED.get(family, ())}:
            return channel
    families = {channel.partition("_")[0]: channel for channel in reversed(channels) if "_" in channel}
    if plain[:-1] in families and (plain[-1] in AXES or not name.isalpha()):
        return families[plain[:-1]]
    long = [channel for channel in channels if len(channel) > 1]
    return next(iter(get_close_matches(name, long, n=1, cutoff=NEARLY)), "")


def _whole(values: NDArray[Any]) -> NDArray[Any]:
    """Time of time stamps as whole numbers; other columns as they are."""
    return values.astype(np.int64) if values.dtype.kind == "m" else values


def _made(
    table: FileTable, beside: Mapping[str, Column], spec: ColumnSpec, *, means: bool, dwell: float
) -> Column:
    """Clock of a file that has none in one of its columns, of which some are known.

    Of a table of means it is the middles of dwells that follow each other. Else rows come at a rate, or it is
    the sum of columns, in the finest of their units: whole numbers stay whole.
    """
    if means and DWELL in beside:
        lasting = beside[DWELL].si()
        return Column("t", "row", "s", np.cumsum(lasting) - 0.5 * lasting, 1.0, 0.0, 0.0, made=True)
    if rate := 1.0 / dwell if means and dwell else spec.rate:
        rows = ((next(iter(beside.values())).address, 0.0),)
        return Column("t", "row", "s", np.zeros(0), 1.0 / rate, 0.0, 0.0, parts=rows).read(table)
    parts = [_column(table, "t", part, "s") for part in spec.parts]
    finest = min(parts, key=lambda part: part.scale)
    sizes = [part.scale / finest.scale for part in parts]
    rounded = [round(size) if abs(size / round(size) - 1.0) < SAME_SIZE else size for size in sizes]
    names = tuple(zip((part.address for part in parts), rounded, strict=True))
    return replace(finest, address=" + ".join(part.address for part in parts), parts=names).read(table)


def _column(table: FileTable, channel: str, spec: ColumnSpec, like: str) -> Column:
    address, raw = table.locate(channel if spec.column is None else spec.column, channel)
    stamped = raw.dtype.kind == "m"
    unit = "ns" if stamped else spec.unit or bracketed(address)
    if unit is None and like:
        counts = ""
        if channel != "t" and raw.dtype.kind in "iu":
            how = _scaled(channel, address, "count", like)
            counts = f"; it holds whole numbers: counts need a scale,{how}"
        raise DataError(
            f"{table.file}: column '{address}' has no unit: write it in the header, "
            f"'{bare(address)} [{like}]', "
            f'or in the study, {channel} = {{ column = "{address}", unit = "{like}" }}{counts}'
        )
    try:
        scale = units.factor(unit or "", like) if spec.scale is None else spec.scale
    except UnitError as error:
        how = f";{_scaled(channel, address, unit or '', like)}" if unit in _CONVERTER else ""
        raise DataError(f"{table.file}: column '{address}', channel {channel}: {error}{how}") from None
    zero = units.offset(unit or "", like) if spec.scale is None else 0.0
    return Column(channel, address, unit or "", _whole(raw), scale, spec.offset or 0.0, zero, spec.wraps)


def _scaled(channel: str, address: str, unit: str, like: str) -> str:
    scale = {"m/s^2": "1/16384 g", "rad/s": "1/131 deg/s", "s": "1/64e6 s"}.get(like, f"0.01 {like}")
    return (
        f' such as {channel} = {{ column = "{address}", unit = "{unit}", scale = "{scale}/{unit}" }}'
        " with the scale of the data sheet"
    )


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


def unwrapped(table: FileTable, column: Column) -> tuple[Column, int]:
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


def between_set_backs(table: FileTable, column: Column) -> tuple[slice, tuple[str, ...]]:
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
