"""Rows made of arrays, and runs as they are read from long files, shared by tests."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet as pq

from imubayes.inference.linear import Linear
from imubayes.rig import formats, stream_survey, streams
from imubayes.rig.inputs import Run
from imubayes.rig.recordings import RunSpec
from imubayes.rig.runs import read_imu_run, read_run


def rows_of(y, X=None, *, t=None, duration=1.0, interval=None) -> Linear:
    """Rows without a gap, of one duration and with a constant alone, where nothing else is said."""
    n, interval = len(y), duration if interval is None else interval
    columns, centers = np.ones((n, 1)) if X is None else X, duration * np.arange(n) if t is None else t
    names, lasting = tuple(f"b{k}" for k in range(columns.shape[1])), duration * np.ones(n)
    return Linear("run", "static", names, centers, lasting, interval, y, lambda a, b: columns[a:b])


def in_parts(patch: pytest.MonkeyPatch, rows: int, *, tile: int | None = None, stretch: int | None = None):
    """From now on files of more than 1000 rows are read so many rows at a time."""
    patch.setattr(streams, "STREAMED", 1000)
    patch.setattr(formats, "ROWS", rows)
    patch.setattr(stream_survey, "TILE", tile or stream_survey.TILE)
    patch.setattr(stream_survey, "STRETCH", stretch or stream_survey.STRETCH)


def written(table: Mapping[str, np.ndarray], folder: Path, procedure: str = "other") -> RunSpec:
    """Run of a file with these columns."""
    pq.write_table(pa.table(dict(table)), folder / "run.parquet")
    return RunSpec("r", procedure, file=folder / "run.parquet")


def both_ways(spec: RunSpec, rows: int, kind: str = "accelerometer", **parts: int) -> tuple[Run, Run]:
    """The run in memory, and read a part at a time."""

    def read() -> Run:
        return read_imu_run(spec) if kind == "imu" else read_run(spec, kind)

    whole = read()
    with pytest.MonkeyPatch.context() as patch:
        in_parts(patch, rows, **parts)
        part = read()
    assert whole.stream is None
    assert part.stream is not None
    return whole, part
