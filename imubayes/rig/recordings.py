"""A recording: what a study says of it, what the columns of its file become, and how a run is written."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from stat import S_ISDIR
from typing import BinaryIO, Literal

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import FloatArray
from imubayes.errors import DataError
from imubayes.rig.columns import ColumnSpec, channel_unit
from imubayes.rig.inputs import DWELL, MOUNT, SCATTER, Run, RunSection
from imubayes.sensors.imu import ACCELEROMETERS, CASE_CHANNELS, COMPONENTS, GYROSCOPES
from imubayes.sensors.noise import NoiseRule
from imubayes.sensors.terms import OUTPUT_UNIT, Kind

Procedure = Literal[
    "tumble",
    "centrifuge",
    "rate-table",
    "oscillation",
    "thermal",
    "static",
    "free-tumble",
    "ferraris",
    "other",
]
"""What a study can call a run."""

FREE_TUMBLE: Procedure = "free-tumble"
FERRARIS: Procedure = "ferraris"
"""Positions of which the case axis that points up is known, and turns about it by a known angle."""

TRIADS: Mapping[Kind, tuple[str, ...]] = {"accelerometer": ACCELEROMETERS, "gyroscope": GYROSCOPES}
"""Outputs of a triad in one case, along its axes."""

IMU_CHANNELS = ("t", *COMPONENTS)
"""Columns of a run of a whole IMU."""

CASES = (FREE_TUMBLE, FERRARIS)
"""Procedures of several components in one case whose inputs are known in part."""

SECOND = "T_2"
"""Column of a second thermometer, which is read as what it is above the first."""

INPUTS = ("f_i", "f_j", "f_k", "w_i", "w_j", "w_k", "dw_i", "dw_j", "dw_k", "T", "dT", SECOND)

KNOWN_IMU_CHANNELS = (*IMU_CHANNELS, *CASE_CHANNELS, MOUNT, DWELL)
"""Columns of a run of a whole IMU with known inputs, which are along the axes x, y, z of the case."""

RUN_CHANNELS = ("t", "output", *INPUTS, MOUNT, DWELL, SCATTER)
"""Columns of a run with known inputs."""


@dataclass(frozen=True, slots=True)
class RunSpec:
    """A run before it is read.

    Attributes
    ----------
    name : as in the study, unique within the sensor.
    procedure : a `Procedure`.
    file : the recorded file; None for a simulated run.
    shown : the file as the study gives it, for messages and the report.
    columns : where the file's own names or units differ, by channel.
    gravity : local gravity, m/s^2, of runs of `CASES`; not of a turntable.
    noise : how the noise of the run is to be known.
    simulate : for a simulated run, ``profile`` (a key of `PROFILES`) and the arguments of its function by
        name, in SI.
    origin : where a public file comes from, for the message when it is not there.
    gyroscope_file, gyroscope_shown : of an IMU whose gyroscopes have a file of their own, on the same clock;
        as the study gives it.
    sections : of an IMU: the parts of the run whose inputs are known.
    ignore : columns of the file that are no channel, though their names are nearly those of one.
    still_window, still_threshold : s and m/s^2, which tell rest from motion in the hand; 0 for the usual.
    dwell : s, of a table of means of which each row is one over so long; 0 where the file says it, or the
        rows are samples.
    """

    name: str
    procedure: Procedure
    file: Path | None = None
    shown: str = ""
    columns: Mapping[str, ColumnSpec] = field(default_factory=dict)
    gravity: float | None = None
    noise: NoiseRule = field(default_factory=NoiseRule)
    simulate: Mapping[str, object] | None = None
    origin: str = ""
    gyroscope_file: Path | None = None
    gyroscope_shown: str = ""
    sections: tuple[RunSection, ...] = ()
    ignore: tuple[str, ...] = ()
    dwell: float = 0.0
    still_window: float = 0.0
    still_threshold: float = 0.0

    @property
    def turntable(self) -> bool:
        """Whether of gyroscopes only the rates are known, and no direction."""
        return any(section.rate for section in self.sections)


def assumed(kind: Kind, channels: Collection[str], axes: str = "ijk") -> tuple[str, ...]:
    """Say which inputs are taken as zero because they are not among the channels of the file."""
    families = ("f", "w", "dw") if kind == "accelerometer" else ("w", "f", "dw")
    absent = [
        f"{family}_{axis}" for family in families for axis in axes if f"{family}_{axis}" not in channels
    ]
    return (f"{ABSENT}: {', '.join(absent)}",) if absent else ()


ABSENT = "not in the file, taken as zero"
"""How the notes of a run begin that name its absent inputs."""


def files_of(spec: RunSpec) -> tuple[Path, ...]:
    """Files of a run, none of a simulated one; a `DataError` if one is not there, or is a directory."""
    named = ((spec.file, spec.shown), (spec.gyroscope_file, spec.gyroscope_shown))
    return tuple(_existing(path, shown, spec.origin) for path, shown in named if path is not None)


def _existing(path: Path, shown: str, origin: str) -> Path:
    """Path of a file; `shown` is what the study calls it, if it does, `origin` where it is public."""
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):
        public = f"; the data are public ({origin}): download them, and name their folder in IMUBAYES_DATA"
        hint = public if origin else "; check the run's key 'file'"
        raise DataError(f"{shown or path}: there is no such file (looked for {path}){hint}") from None
    if S_ISDIR(mode):
        raise DataError(f"{shown or path}: is a directory where a file with a run was expected")
    return path


DERIVED = ("dT", "gT")
"""Channels that are computed from others when a run is read."""


BINS = 2000
"""Averages that a recorded temperature is taken to at most before its rate is looked for."""

RATE_NOISE = 0.05
"""Noise of a derived rate over its own rms at which the window is long enough: it shortens a coefficient by
the square of this, 0.25 %; a longer window would round off the corners of a ramp by more."""

LONGEST = 0.1
"""Share of a record that the window may take at most: slower than this nothing would be left of a ramp."""

STEP_NOISE = 0.3
"""Rms error of a slope over (step of a quantised temperature / window), where the steps are not blurred."""

ENOUGH = 5
"""Averages in a window, at least: two more than a parabola has coefficients."""


def temperature_rate(t: FloatArray, T: FloatArray) -> FloatArray:
    """Rate (n,) in K/s of a recorded temperature T (n,), K, at increasing times t (n,), s.

    A parabola is fitted by least squares to a window about each instant, and its slope there is the rate.
    Noise of a regressor shortens its coefficient and passes what is lost to others (errors in variables), so
    the window is no matter of taste: it is the shortest at which the rate's own noise is below a twentieth of
    its rms, which costs a coefficient a quarter of a percent. The noise is that of neighbouring averages, and
    of the steps of a temperature that was quantised. Where even a tenth of the record is too short for that,
    the temperature did not change by anything that the thermometer tells.

    Examples
    --------
    >>> t = np.arange(3600.0)
    >>> quantised = np.round((280.0 + t / 60.0) / 0.25) * 0.25
    >>> bool(np.std(temperature_rate(t, quantised) * 60.0) < 0.05)
    True
    """
    if len(t) < ENOUGH:
        return np.gradient(T, t) if len(t) > 1 else np.zeros(len(t))
    centres, means = _averaged(t, T)
    if len(centres) < ENOUGH:
        return np.full(len(t), np.polyfit(t - t.mean(), T, 1)[0])
    off = means[1:-1] - 0.5 * (means[:-2] + means[2:])
    # an average's distance to the straight line between its neighbours
    white, step = float(np.median(np.abs(off))) / (0.6745 * math.sqrt(1.5)), _step(T)
    found = np.zeros(len(centres))
    # windows to try, s: from one that holds enough averages to the longest
    span = float(centres[-1] - centres[0])
    shortest = ENOUGH * float(np.median(np.diff(centres)))
    longest = max(LONGEST * span, shortest)
    for window in np.geomspace(shortest, longest, max(2, math.ceil(4.0 * math.log2(longest / shortest)) + 1)):
        found = _slopes(centres, means, window)
        inside = max(window / (centres[-1] - centres[0]) * len(centres), 1.0)
        noise = math.hypot(white * math.sqrt(12.0 / inside), STEP_NOISE * step) / window
        if noise <= RATE_NOISE * math.sqrt(float(found @ found) / len(found)):
            break
    return np.interp(t, centres, found)


def _averaged(t: FloatArray, T: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean time and temperature over at most so many equal times."""
    if len(t) <= BINS:
        return t - t[0], T
    bins = np.minimum(((t - t[0]) / (t[-1] - t[0]) * BINS).astype(np.int64), BINS - 1)
    counts = np.bincount(bins, minlength=BINS)
    there = counts > 0
    means = [np.bincount(bins, values, BINS)[there] / counts[there] for values in (t - t[0], T - T[0])]
    return means[0], means[1] + T[0]


def _step(T: FloatArray) -> float:
    """Step of a quantised temperature: the smallest difference, where most neighbours share their value."""
    values = np.unique(T)
    if len(values) < 2 or len(values) > len(T) // 2:
        return 0.0
    return float(np.median(np.diff(values)))


def _slopes(t: FloatArray, T: FloatArray, window: float) -> FloatArray:
    """Slope at each instant of the parabola through the window about it."""
    # at the ends the window stays inside; beside gaps it reaches farther to one side
    middle = np.clip(t, t[0] + 0.5 * window, t[-1] - 0.5 * window)
    first = np.searchsorted(t, middle - 0.5 * window * (1.0 + 1e-12))
    last = np.searchsorted(t, middle + 0.5 * window * (1.0 + 1e-12), side="right")
    first = np.clip(np.minimum(first, last - ENOUGH), 0, len(t) - ENOUGH)
    last = np.maximum(last, first + ENOUGH)
    rates = np.empty(len(t))
    for k, (a, b) in enumerate(zip(first.tolist(), last.tolist(), strict=True)):
        x = (t[a:b] - t[k]) / window
        basis = np.column_stack((np.ones(b - a), x, x * x))
        rates[k] = np.linalg.lstsq(basis, T[a:b] - T[k], rcond=None)[0][1] / window
    return rates


def write_run(run: Run, path: Path, *, kind: Kind) -> None:
    """Write a run as CSV, in SI with the units in the header, every number to its last bit.

    The run has known inputs, and is of a component of the `kind`, or of a whole IMU along the axes of the
    case. The file appears under its name when it is complete, in a folder that exists. The channel ``dT`` is
    left out: reading computes it from ``T``; ``gT`` is there as a second thermometer.
    """
    import pyarrow as pa
    from pyarrow import csv

    inputs = run.inputs
    columns: dict[str, NDArray] = {"t": inputs.t}
    if inputs.mount is not None:
        columns[MOUNT] = inputs.mount
    columns |= {name: values for name, values in inputs.channels.items() if name not in DERIVED}
    if "gT" in inputs.channels:
        columns[SECOND] = inputs.channels["T"] + inputs.channels["gT"]
    outputs = np.ascontiguousarray(run.output.T) if run.of_case else [run.output]
    columns |= zip(COMPONENTS[: len(outputs)] if run.of_case else ("output",), outputs, strict=True)
    units = {name: channel_unit(name, OUTPUT_UNIT[kind]) for name in columns}
    header = ",".join(f"{name} [{unit}]" if unit else name for name, unit in units.items())

    def write(stream: BinaryIO) -> None:
        stream.write(f"{header}\n".encode())
        csv.write_csv(pa.table(columns), stream, csv.WriteOptions(include_header=False))

    write_whole(path, write)


def write_whole(path: Path, write: Callable[[BinaryIO], object]) -> None:
    """Write a file under another name, and rename it when it is complete."""
    part = path.with_name(f".{path.name}.part")
    try:
        with part.open("wb") as stream:
            write(stream)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
