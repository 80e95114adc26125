"""Decided components, dwells of rows that are given, and R's tables, shared by tests of the selection."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

import imubayes as ib
from imubayes.algebra.factor import triangular
from imubayes.inference.dwells import Pieces
from imubayes.inference.linear import Linear
from imubayes.selection.decision import Selection


class Campaign(NamedTuple):
    """A simulated component and the decision on it."""

    summary: ib.Summary
    prior: ib.ScalePrior
    rows: list[Linear]
    selection: Selection


def campaign_of(
    class_id, plans, *, kind="accelerometer", seed=3, truth=None, noise=None, rule="estimate", **options
) -> Campaign:
    """A unit of a class on these plans; `options` are the library's."""
    sensor, lib = ib.sensor(class_id, kind=kind), ib.library(kind, **options)
    runs = ib.simulate(sensor, plans, seed=seed, truth=truth, noise=noise)
    rules = {run.name: ib.NoiseRule(rule) for run in runs}
    summary, prior = ib.summarize(runs, lib, sensor=sensor, rules=rules), ib.prior(sensor, lib)
    return Campaign(summary, prior, [ib.linear_of(run, lib) for run in runs], ib.select(summary, prior))


@cache
def typical(class_id: str) -> Mapping[str, float]:
    """Prior sd by term of a class's accelerometers, SI."""
    lib = ib.library("accelerometer")
    return dict(zip(lib.names, ib.prior(ib.sensor(class_id, kind=lib.kind), lib).sd.tolist(), strict=True))


def dwells(blocks: Sequence[np.ndarray], names, *, run="run", log_det=0.0) -> Pieces:
    """A piece for each block of white rows, columns and response, with that log determinant a row."""
    R, rows = np.array([triangular((one,), len(names) + 1) for one in blocks]), np.array([*map(len, blocks)])
    start = np.arange(len(rows), dtype=float)
    return Pieces(run, tuple(names), start, start + 1.0, rows, R, log_det * rows)


def table(file: Path) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    """Names and columns of a table, and its response, which stands first."""
    rows = np.loadtxt(file, delimiter=",", skiprows=1)
    return tuple(file.read_text().partition("\n")[0].replace('"', "").split(",")[1:]), rows[:, 1:], rows[:, 0]


def records(file: Path) -> list[dict[str, str]]:
    """Rows of a table by the names of its columns."""
    with file.open(newline="") as lines:
        return list(csv.DictReader(lines))
