"""Steps and bad stretches of a record where its inputs are constant: a knock, a restart."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra.arrays import BoolArray, FloatArray
from imubayes.rig.checks import RESTLESS, STEPS, stretches_of
from imubayes.rig.filtering import steady_edges
from imubayes.rig.inputs import Run
from imubayes.sensors.imu import COMPONENTS, kind_of
from imubayes.sensors.terms import Kind

FEWEST, BLOCKS = 16, 400
"""Rows of a block at least, and blocks of a record, about."""

ENOUGH = 20
"""Blocks that tell what is usual."""

LOUDER = 3.0
"""Scatter of a bad stretch over the usual one: noise does it in one block of 1e15."""

RARE = 0.1
"""Share of the blocks above which a larger scatter is not a disturbance, but how the sensor is."""

HIGHER = 10.0
"""Change of level over that which is usual from block to block."""

LEVEL = 5
"""Blocks that a level is taken from."""


@dataclass(frozen=True, slots=True, eq=False)
class _Blocks:
    """Start and end (m,) of blocks of rows at constant inputs, s, mean and variance, and their stretch."""

    start: FloatArray
    stop: FloatArray
    mean: FloatArray
    variance: FloatArray
    stretch: NDArray[np.int64]


def with_disturbances(run: Run, kind: Kind) -> Run:
    """Run with known inputs, whose notes say at what time which output is disturbed."""
    if not run.known:
        return run
    edges, notes = steady_edges(run.inputs), list[str]()
    for name in COMPONENTS if run.of_case else ("output",):
        one, of = (run.component(name), kind_of(name)) if run.of_case else (run, kind)
        left = one.output - one.inputs.channels.get("f_i" if of == "accelerometer" else "w_i", 0.0)
        notes += _of_output(name, _blocks(run.t, left, edges), "m/s^2" if of == "accelerometer" else "rad/s")
    return replace(run, source=replace(run.source, notes=(*run.source.notes, *notes))) if notes else run


def _blocks(t: FloatArray, y: FloatArray, edges: NDArray[np.int64]) -> _Blocks:
    width = max(FEWEST, len(t) // BLOCKS)
    long = np.flatnonzero(np.diff(edges) >= width)
    whole = [np.arange(edges[k], edges[k + 1] - width + 1, width) for k in long]
    first = np.concatenate([np.zeros(0, dtype=np.int64), *whole])
    values = y[first[:, None] + np.arange(width)]
    stretch = np.repeat(long, [len(one) for one in whole])
    return _Blocks(t[first], t[first + width - 1], values.mean(axis=1), values.var(axis=1), stretch)


def _of_output(name: str, blocks: _Blocks, unit: str) -> Iterator[str]:
    """Say at what time an output is disturbed."""
    if len(blocks.mean) < ENOUGH:
        return
    usual = float(np.median(blocks.variance))
    loud = (blocks.variance > LOUDER**2 * usual) & (usual > 0.0)
    if 0 < np.count_nonzero(loud) <= RARE * len(loud):
        parts = stretches_of(loud).tolist()
        a, b = max(parts, key=lambda part: blocks.variance[part[0] : part[1]].max())
        ratio = float(np.sqrt(blocks.variance[a:b].max() / usual))
        more = f", and at {len(parts) - 1} other times" if len(parts) > 1 else ""
        yield (
            f"{name} {RESTLESS} from t = {blocks.start[a]:.6g} s to {blocks.stop[b - 1]:.6g} s{more}: its"
            f" scatter there is {ratio:.2g} times the usual"
        )
    yield from _steps(name, blocks, loud, unit)


def _steps(name: str, blocks: _Blocks, loud: BoolArray, unit: str) -> Iterator[str]:
    """Say where the level of an output changes for good."""
    quiet = np.flatnonzero(~loud)
    mean, stretch = blocks.mean[quiet], blocks.stretch[quiet]
    change = np.where(np.diff(stretch) == 0, np.diff(mean), np.nan)
    known = change[np.isfinite(change)]
    if len(known) < ENOUGH:
        return
    usual = 1.4826 * float(np.median(np.abs(known - np.median(known))))
    found = [
        (k, size)
        for k in np.flatnonzero(np.abs(np.nan_to_num(change)) > HIGHER * usual).tolist()
        if (size := _size(mean, stretch, k)) and abs(size) > HIGHER * usual > 0.0
    ]
    if found:
        k, size = max(found, key=lambda one: abs(one[1]))
        more = f", and {len(found) - 1} times more" if len(found) > 1 else ""
        yield f"{name} {STEPS} {size:.3g} {unit} at t = {blocks.start[quiet[k + 1]]:.6g} s{more}"


def _size(mean: FloatArray, stretch: NDArray[np.int64], k: int) -> float:
    """Change of level after block k, by the medians of blocks before and after in the same stretch."""
    here = np.flatnonzero(stretch == stretch[k])
    before, after = here[here <= k][-LEVEL:], here[here > k][:LEVEL]
    return float(np.median(mean[after]) - np.median(mean[before]))
