"""Rows made of arrays, their dense covariance, and runs as they are read from long files, shared by tests."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet as pq

from imubayes.inference.linear import Linear, Rows
from imubayes.inference.whiten import Processes
from imubayes.rig import formats, runs, streams
from imubayes.rig.inputs import Run
from imubayes.rig.recordings import RunSpec
from imubayes.rig.runs import read_imu_run, read_run
from imubayes.sensors.noise import Noise


def rows_of(y, X=None, *, t=None, duration=1.0, interval=None) -> Linear:
    """Rows without a gap, of one duration and with a constant alone, where nothing else is said."""
    n, interval = len(y), duration if interval is None else interval
    columns, centers = np.ones((n, 1)) if X is None else X, duration * np.arange(n) if t is None else t
    names, lasting = tuple(f"b{k}" for k in range(columns.shape[1])), duration * np.ones(n)
    return Linear("run", "static", names, centers, lasting, interval, y, lambda a, b: columns[a:b])


_nodes, _weights = np.polynomial.legendre.leggauss(40)
LAGS, LAG_WEIGHTS = 0.5 + 0.5 * _nodes, 0.5 * _weights


def dense(noise: Noise, rows: Rows, parts: Processes) -> np.ndarray:
    """Covariance of the averages, pair by pair as double integrals of the processes' own covariance."""
    T, start, end = rows.duration, rows.t - 0.5 * rows.duration, rows.t + 0.5 * rows.duration
    gap = start[None, :] - end[:, None]  # from the end of the earlier row to the start of the later
    earlier = np.tri(len(T), k=-1, dtype=bool).T
    C = noise.K**2 * np.where(earlier, rows.t[:, None] - start[0], 0.0)
    for variance, tau in zip(noise.B**2 * parts.variance, parts.tau, strict=True):
        share = -np.expm1(-T / tau) / (T / tau)
        C += np.where(
            earlier, variance * np.exp(-np.where(earlier, gap, 0.0) / tau) * np.outer(share, share), 0.0
        )
    C += C.T
    own = (noise.N**2 + noise.B**2 * parts.white) / T + noise.K**2 * (start - start[0] + T / 3.0)
    for variance, tau in zip(noise.B**2 * parts.variance, parts.tau, strict=True):
        # (1/T^2) int int exp(-|s - t|/tau) = 2 int_0^1 (1 - u) exp(-x u) du
        own += variance * (np.exp(-np.outer(T / tau, LAGS)) @ (2.0 * LAG_WEIGHTS * (1.0 - LAGS)))
    C += np.diag(own)
    return C if rows.axes is None else C * (rows.axes @ rows.axes.T)


def in_parts(patch: pytest.MonkeyPatch, rows: int, *, tile: int | None = None, stretch: int | None = None):
    """From now on files of more than 1000 rows are read so many rows at a time."""
    patch.setattr(streams, "STREAMED", 1000)
    patch.setattr(formats, "ROWS", rows)
    patch.setattr(runs, "TILE", tile or runs.TILE)
    patch.setattr(runs, "STRETCH", stretch or runs.STRETCH)


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
