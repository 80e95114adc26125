"""Write a run as a file that reads back exactly."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

from imubayes.rig.columns import channel_unit
from imubayes.rig.inputs import Run
from imubayes.rig.runs import MOUNT, OUTPUT_UNIT
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
    import pyarrow as pa
    from pyarrow import csv

    inputs = {name: values for name, values in run.inputs.channels.items() if name not in DERIVED}
    mount = {} if run.inputs.mount is None else {MOUNT: run.inputs.mount}
    columns = {"t": run.inputs.t, **mount, **inputs, "output": run.output}
    header = ",".join(_header(name, channel_unit(name, OUTPUT_UNIT[kind])) for name in columns)

    def write(stream: BinaryIO) -> None:
        stream.write(f"{header}\n".encode())
        csv.write_csv(pa.table(columns), stream, csv.WriteOptions(include_header=False))

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
