"""A recording: what a study says of it, what the columns of its file become, and how a run is written."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from stat import S_ISDIR
from typing import BinaryIO, Literal

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra.arrays import FloatArray
from imubayes.errors import DataError
from imubayes.rig.columns import ColumnSpec, channel_unit
from imubayes.rig.inputs import DWELL, MOUNT, SCATTER, Run, Section
from imubayes.sensors.imu import ACCELEROMETERS, CASE_CHANNELS, COMPONENTS, GYROSCOPES
from imubayes.sensors.noise import NoiseRule
from imubayes.sensors.terms import Kind

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

OUTPUT_UNIT: Mapping[Kind, str] = {"accelerometer": "m/s^2", "gyroscope": "rad/s"}

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
    sections: tuple[Section, ...] = ()
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


def existing(path: Path, shown: str, origin: str) -> Path:
    """Path of a file that is there.

    Raises
    ------
    DataError : if it is not, or is a directory. `shown` is what the study calls it, `origin` where it is
        public.
    """
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):
        public = f"; the data are public ({origin}): download them, and name their folder in IMUBAYES_DATA"
        hint = public if origin else "; check the run's key 'file'"
        raise DataError(f"{shown}: there is no such file (looked for {path}){hint}") from None
    if S_ISDIR(mode):
        raise DataError(f"{shown}: is a directory where a file with a run was expected")
    return path


def sha256_of(path: Path) -> str:
    """Hash of a file's bytes."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def frozen(values: FloatArray) -> FloatArray:
    """Make an array read-only."""
    values.setflags(write=False)
    return values


DERIVED = ("dT", "gT")
"""Channels that are computed from others when a run is read."""


def with_gradient(channels: Mapping[str, FloatArray], shown: str) -> dict[str, FloatArray]:
    """Channels with what a second thermometer reads above the first in the place of its own column.

    Raises
    ------
    DataError : if there is a second thermometer and no first.
    """
    found = dict(channels)
    if (second := found.pop(SECOND, None)) is None:
        return found
    if "T" not in found:
        raise DataError(f"{shown}: has a second thermometer '{SECOND}' and no first: name its column T")
    return {**found, "gT": frozen(second - found["T"])}


def write_run(run: Run, path: Path, *, kind: Kind) -> None:
    """Write a run as CSV, in SI with the units in the header, every number to its last bit.

    The file appears under its name when it is complete. The channel ``dT`` is left out: reading computes
    it from ``T``; ``gT`` is there as a second thermometer.

    Parameters
    ----------
    run : with known inputs, of a component, or of a whole IMU along the axes of the case.
    path : of the file, in a folder that exists.
    kind : of the sensor; it says what unit the output of a component has.

    Raises
    ------
    OSError : if the file cannot be written.
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
