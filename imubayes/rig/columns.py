"""Columns of a file as channels of a run: which one, in which unit."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches

import numpy as np
from numpy.typing import NDArray

from imubayes import units
from imubayes.algebra.arrays import FloatArray
from imubayes.errors import DataError, UnitError
from imubayes.rig.formats import Table, bare, bracketed
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

_OWN_UNITS = {
    "t": "s",
    "mount": "",
    **dict.fromkeys(ACCELEROMETERS, "m/s^2"),
    **dict.fromkeys(GYROSCOPES, "rad/s"),
    **dict.fromkeys(("roll", "pitch", "yaw"), "rad"),
    "q": "",
}
"""SI units of the channels that are no input, and no output of a single component; a count needs none."""


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
    """

    column: str | int | None = None
    unit: str | None = None
    scale: float | None = None
    offset: float | None = None
    wraps: float | None = None


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
    """

    channel: str
    address: str
    unit: str
    raw: NDArray[np.generic]
    scale: float
    offset: float
    zero: float
    wraps: float | None = None

    def si(self) -> FloatArray:
        """Return the column in SI, a fresh array."""
        return (self.raw.astype(np.float64) - self.offset) * self.scale + self.zero

    def in_file(self, value: float) -> float:
        """Return the file's number for a value in SI."""
        return (value - self.zero) / self.scale + self.offset


def unwrapped(table: Table, column: Column) -> tuple[Column, int]:
    """Let a clock that wraps around count on: each step is taken modulo the wrap.

    Parameters
    ----------
    table : the file, for messages.
    column : a clock of finite numbers; integers stay integers, so that no step is rounded.

    Returns
    -------
    (column, count) : the clock without wraps, and how often it wrapped.

    Raises
    ------
    DataError : if the clock goes further than its wrap allows, or counts integers to a wrap that is none.
    """
    if column.wraps is None or len(column.raw) < 2:
        return column, 0
    whole = column.raw.dtype.kind in "iu"
    wraps = int(column.wraps) if whole else column.wraps
    low, high = column.raw.min().item(), column.raw.max().item()
    if wraps != column.wraps or high - low >= wraps:
        raise DataError(
            f"{table.file}: clock '{column.address}' runs from {low:.15g} to {high:.15g}"
            f"{' in integers' if whole else ''}, so that it cannot wrap around at {column.wraps:.15g}: "
            "correct 'wraps' in the study"
        )
    clock = column.raw.astype(np.int64 if whole else np.float64)
    # a sum of whole wraps on top of the file's own numbers, which keeps these as they are
    steps = np.diff(clock)
    turns = np.concatenate(([0], np.cumsum(steps < 0)))
    return replace(column, raw=clock + turns * wraps), int(turns[-1])


def channel_unit(channel: str, output_unit: str) -> str:
    """SI unit of a channel.

    Examples
    --------
    >>> channel_unit("dw_k", "m/s^2")
    'rad/s^2'
    """
    return {**CHANNEL_UNITS, **_OWN_UNITS}.get(channel.partition("_")[0], output_unit)


def resolve(
    table: Table,
    specs: Mapping[str, ColumnSpec],
    *,
    required: tuple[str, ...],
    optional: tuple[str, ...],
    output_unit: str,
    ignore: Collection[str] = (),
) -> dict[str, Column]:
    """Find the channels of a run in a file.

    Parameters
    ----------
    table : the file.
    specs : what the study says, by channel; other channels are found under their own name.
    required, optional : channels to look for; an optional one that is in neither is left out.
    output_unit : SI unit of the sensor's outputs.
    ignore : names in the file, with or without unit, of columns that are no channel.

    Raises
    ------
    DataError : for a channel that is required or listed and not there, that is there twice, or has no unit
        that measures what the channel holds; for a column that is none but for its name, which is nearly that
        of a channel that is not there.
    """
    found = {}
    for channel in (*required, *optional):
        if channel in specs or channel in required or _has(table, channel):
            spec = specs.get(channel, ColumnSpec())
            found[channel] = _column(table, channel, spec, channel_unit(channel, output_unit))
    known = {column.address for column in found.values()} | {*required, *optional, *ignore}
    left = [name for name in table.columns if not {name, bare(name)} & known]
    missing = {channel: channel_unit(channel, output_unit) for channel in optional if channel not in found}
    _refuse_nearly(table.file, left, missing)
    return found


def _refuse_nearly(file: str, left: Sequence[str], missing: Mapping[str, str]) -> None:
    """Refuse a column whose name is nearly that of a channel which is missing, by its SI unit."""
    for name in left:
        if (meant := nearly(bare(name), tuple(missing))) and _may_measure(bracketed(name), missing[meant]):
            raise DataError(
                f"{file}: column '{name}' is no channel, and there is no {meant}: did you mean '{meant}'?"
                f' Rename it, or say in the study columns = {{ {meant} = "{bare(name)}" }}, or that it is'
                f' none, ignore = ["{bare(name)}"]'
            )


def _may_measure(unit: str | None, like: str) -> bool:
    """Tell whether numbers of a unit may be a channel's: by themselves, or as what a converter gives.

    Examples
    --------
    >>> [_may_measure(unit, "m/s^2") for unit in ("g", "count", "V", None, "Hz")]
    [True, True, True, True, False]
    """
    return unit is None or any(units.converts(unit, one) for one in (like, *_CONVERTED))


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


def _has(table: Table, channel: str) -> bool:
    return any(bare(name) == channel for name in table.columns)


def _column(table: Table, channel: str, spec: ColumnSpec, like: str) -> Column:
    address, raw = table.locate(channel if spec.column is None else spec.column, channel)
    unit = spec.unit or bracketed(address)
    if unit is None and like:
        raise DataError(
            f"{table.file}: column '{address}' has no unit: write it in the header, "
            f"'{bare(address)} [{like}]', "
            f'or in the study, {channel} = {{ column = "{address}", unit = "{like}" }}'
        )
    try:
        scale = units.factor(unit or "", like) if spec.scale is None else spec.scale
    except UnitError as error:
        raise DataError(f"{table.file}: column '{address}', channel {channel}: {error}") from None
    zero = units.offset(unit or "", like) if spec.scale is None else 0.0
    return Column(channel, address, unit or "", raw, scale, spec.offset or 0.0, zero, spec.wraps)
