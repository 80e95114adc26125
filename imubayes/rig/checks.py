"""Checks of a recorded run: what stops it, and what the report must mention."""

from __future__ import annotations

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.errors import DataError
from imubayes.rig.columns import Column
from imubayes.rig.formats import Table
from imubayes.rig.inputs import GAP, Inputs
from imubayes.rig.plans import EARTH_RATE

LARGEST = 1e100
"""In the file's own unit: beyond it a number is a placeholder, and its square leaves double precision."""

NOTICED = 0.05
"""Share of the Earth's rate across the axis of a table that is more than rounding: it is 1 at the equator."""

JUMP = 0.2
"""Relative change of the sampling interval, over a block of `BLOCK` steps, that is worth a note."""
BLOCK = 64


def check_values(table: Table, column: Column) -> None:
    """Refuse a column with an entry that is not a finite number below `LARGEST`.

    Raises
    ------
    DataError : naming the first such entry.
    """
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


def check_time(table: Table, column: Column, t: FloatArray) -> None:
    """Refuse a time that does not increase from row to row.

    Raises
    ------
    DataError : naming the first row that is not later than the one before, or that there are too few rows.
    """
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


def check_output(file: str, column: Column, output: FloatArray) -> None:
    """Refuse an output (n,) that never changes, SI.

    Raises
    ------
    DataError : if all samples are equal.
    """
    if np.all(output == output[0]):
        raise DataError(
            f"{file}: column '{column.address}' is {column.in_file(float(output[0])):g} in every row: "
            "expected a live output; check the wiring, or name another column in the study"
        )


def gaps(t: FloatArray) -> str:
    """Say how many gaps the time has, and how long the longest is; empty without gaps."""
    step = np.diff(t)
    long = step > GAP * np.median(step)
    worst = int(np.argmax(step))
    return gap_note(int(np.count_nonzero(long)), float(step[worst]), float(t[worst]))


def gap_note(count: int, longest: float, at: float) -> str:
    """Say how many gaps a time has, the longest of so many s at a time in s; empty without gaps."""
    plural = "s" if count > 1 else ""
    return f"{count} gap{plural} in time, the longest {longest:.4g} s at t = {at:.6g} s" if count else ""


def interval_jump(t: FloatArray) -> str:
    """Say where the sampling interval changes for longer than a gap; empty if it does not."""
    step = np.diff(t)
    blocks = len(step) // BLOCK
    if blocks < 2:
        return ""
    medians = np.median(step[: blocks * BLOCK].reshape(blocks, BLOCK), axis=1)
    usual = float(np.median(step))
    away = np.abs(medians - usual) > JUMP * usual
    if not away.any():
        return ""
    first = int(np.argmax(away))
    return jump_note(float(medians[first]), float(t[first * BLOCK]), usual)


def jump_note(interval: float, at: float, usual: float) -> str:
    """Say what the sampling interval is at a time, all in s."""
    return (
        f"the sampling interval is {interval:.4g} s around t = {at:.6g} s "
        f"where it is {usual:.4g} s over most of the run"
    )


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
    n = len(inputs)
    w = np.stack([inputs.channels.get(f"w_{axis}", np.zeros(n)) for axis in axes], axis=1)
    mount = np.zeros(n, dtype=np.int64) if inputs.mount is None else inputs.mount
    for number in np.unique(mount):
        here = w[mount == number]
        fastest = here[np.argmax(np.linalg.norm(here, axis=1))]
        across = np.linalg.norm(np.cross(here, fastest), axis=1).max()
        if across > NOTICED * EARTH_RATE * np.linalg.norm(fastest):
            return ()
    note = "the Earth's rate across the table's axis (15 deg/h x cos latitude) is not in w"
    return (note,) if w.any() else ()
