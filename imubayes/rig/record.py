"""Write a run as a file that reads back exactly."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from imubayes.rig.columns import channel_unit
from imubayes.rig.inputs import Inputs, KnownRun, Run
from imubayes.rig.runs import MOUNT, OUTPUT_UNIT
from imubayes.sensors.imu import COMPONENTS
from imubayes.sensors.terms import Kind

DERIVED = ("dT",)
"""Channels that are computed from others when a run is read."""


def write_run(run: Run, path: Path, *, kind: Kind) -> None:
    """Write a run as CSV, in SI with the units in the header, every number to its last bit.

    The file appears under its name when it is complete. The channel ``dT`` is left out: reading computes
    it from ``T``.

    Parameters
    ----------
    run : with known inputs.
    path : of the file, in a folder that exists.
    kind : of the sensor; it says what unit the output has.

    Raises
    ------
    OSError : if the file cannot be written.
    """
    _write({**_inputs(run.inputs), "output": run.output}, path, output_unit=OUTPUT_UNIT[kind])


def write_imu_run(run: KnownRun, path: Path) -> None:
    """Write a run of a whole IMU as `write_run` does, the inputs along the axes of the case.

    Raises
    ------
    OSError : if the file cannot be written.
    """
    outputs = dict(zip(COMPONENTS, np.ascontiguousarray(run.output.T), strict=True))
    _write({**_inputs(run.inputs), **outputs}, path)


def _inputs(inputs: Inputs) -> dict[str, NDArray]:
    """Time, mounts, and the channels that reading does not derive."""
    channels = {name: values for name, values in inputs.channels.items() if name not in DERIVED}
    mount = {} if inputs.mount is None else {MOUNT: inputs.mount}
    return {"t": inputs.t, **mount, **channels}


def _write(columns: Mapping[str, NDArray], path: Path, *, output_unit: str = "") -> None:
    import pyarrow as pa
    from pyarrow import csv

    header = ",".join(_header(name, channel_unit(name, output_unit)) for name in columns)

    def write(stream: BinaryIO) -> None:
        stream.write(f"{header}\n".encode())
        csv.write_csv(pa.table(dict(columns)), stream, csv.WriteOptions(include_header=False))

    write_whole(path, write)


def _header(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


def write_whole(path: Path, write: Callable[[BinaryIO], None]) -> None:
    """Write a file under another name, and rename it when it is complete."""
    part = path.with_name(f".{path.name}.part")
    try:
        with part.open("wb") as stream:
            write(stream)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
