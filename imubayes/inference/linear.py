"""A run as rows of a linear model, ``y = X theta + noise``, with columns made a part of the run at a time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import factor as algebra
from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import Factor
from imubayes.rig.inputs import Run, durations
from imubayes.sensors.noise import Noise
from imubayes.sensors.terms import Library, columns

if TYPE_CHECKING:
    from imubayes.inference.reml import Blocks
    from imubayes.inference.whiten import Processes, Rows
    from imubayes.rig.inputs import Stream


BLOCKS = 1500
"""Blocks that a run is averaged to: N is then known to 2 %, and an evaluation takes milliseconds."""

CHUNK = 200_000
"""Rows whose columns are held at a time while blocks are averaged or residuals taken."""


FAINT = 1e-6
"""Share of a component in a row below which the row says nothing of it."""


@dataclass(frozen=True, slots=True, eq=False)
class Linear:
    """Rows of a linear model.

    Attributes
    ----------
    name, procedure : of the run.
    names : the p columns: terms of the library, then what else moves the output.
    t : (n,) s, centres of the rows.
    duration : (n,) s, their averaging times.
    interval : averaging time of one sample, s.
    y : (n,) response, SI.
    columns : gives the columns (stop - start, p) of the rows from start to stop.
    axes : (n, a) weights of alike and independent components in each row; None for a single component.
    stream : the rows behind these, which are averages over blocks of them; None where these are all.
    shared : gives what `whitened_factor` does, where the work is shared with other components; None else.
    """

    name: str
    procedure: str
    names: tuple[str, ...]
    t: FloatArray
    duration: FloatArray
    interval: float
    y: FloatArray
    columns: Callable[[int, int], FloatArray]
    axes: FloatArray | None = None
    stream: Stream | None = None
    shared: Callable[[Noise], tuple[Factor, FloatArray]] | None = None

    def __len__(self) -> int:
        return len(self.y)

    @property
    def samples(self) -> int:
        """Rows of the run, held or not."""
        return len(self) if self.stream is None else self.stream.samples

    @property
    def counts(self) -> NDArray[np.int64]:
        """Samples (n,) behind each row."""
        return np.ones(len(self), dtype=np.int64) if self.stream is None else self.stream.counts

    @property
    def rows(self) -> Rows:
        """When the rows were taken."""
        from imubayes.inference.whiten import Rows

        return Rows(self.t, self.duration, self.axes, None if self.stream is None else self.stream.interval)


@dataclass(frozen=True, slots=True)
class Extra:
    """A column that is no term of the sensor: an error of the reference.

    It is in every model, under its own normal prior with mean zero.

    Attributes
    ----------
    name : unique among the columns, such as ``gravity`` or ``fixture_j.tumble.2``.
    kind : what it is an instance of: ``gravity``, ``fixture``.
    sd : of its prior, SI.
    unit : SI unit.
    printed : unit that people use.
    text : in words.
    """

    name: str
    kind: str
    sd: float
    unit: str
    printed: str
    text: str


def linear_of(run: Run, lib: Library) -> Linear:
    """Rows of a run with known inputs: output minus own input on the columns of the library.

    Of a run that is read a part at a time, averages over its blocks.
    """
    if run.stream is not None:
        from imubayes.inference.streaming import streamed_rows

        return streamed_rows(run, lib, run.stream)
    return Linear(
        name=run.name,
        procedure=run.procedure,
        names=lib.names,
        t=run.inputs.t,
        duration=durations(run.inputs.t, run.inputs.interval),
        interval=run.inputs.interval,
        y=deviation(run, lib),
        columns=lambda start, stop: library_rows(run, lib, start, stop),
    )


def library_rows(run: Run, lib: Library, start: int = 0, stop: int | None = None) -> FloatArray:
    """Columns of the library for a part of a run: (rows, p)."""
    part = {name: values[start:stop] for name, values in run.inputs.channels.items()}
    return columns(lib, part, len(run.inputs.t[start:stop]))


def deviation(run: Run, lib: Library) -> FloatArray:
    """Output minus own input, (n,), SI."""
    return run.output - run.inputs.channels.get(lib.own, 0.0)


def swing_of(run: Run, lib: Library) -> float:
    """Largest size of output minus own input, SI."""
    return float(np.max(np.abs(deviation(run, lib)))) if run.stream is None else run.stream.swing


def residuals(rows: Linear, theta: FloatArray) -> FloatArray:
    """Response minus what the coefficients `theta` (p,) explain: (n,)."""
    left = rows.y.copy()
    for a in range(0, len(rows), CHUNK):
        b = min(a + CHUNK, len(rows))
        left[a:b] -= rows.columns(a, b) @ theta
    return left


def reach_of(rows: Linear) -> FloatArray:
    """Largest size (p,) of each column."""
    if rows.stream is not None:
        return rows.stream.reach
    starts = range(0, len(rows), CHUNK)
    parts = (rows.columns(a, min(a + CHUNK, len(rows))) for a in starts)
    return np.max([np.abs(part).max(axis=0) for part in parts], axis=0)


def blocks_of(rows: Linear, blocks: int = BLOCKS) -> Blocks:
    """Averages over about so many short blocks that never reach across a gap."""
    from imubayes.inference.reml import Blocks, block_edges
    from imubayes.inference.whiten import Rows

    edges = block_edges(rows.t, rows.interval, blocks)
    counts = np.diff(np.append(edges, len(rows)))
    X = np.empty((len(edges), len(rows.names)))
    for inside, a, b in _whole_blocks(edges, len(rows)):
        X[inside] = np.add.reduceat(rows.columns(a, b), edges[inside] - a, axis=0)
    X /= counts[:, None]
    axes = None if rows.axes is None else np.add.reduceat(rows.axes, edges, axis=0) / counts[:, None]
    lasting = np.add.reduceat(rows.duration, edges)
    taken = Rows(np.add.reduceat(rows.t, edges) / counts, lasting, axes, rows.rows.finest)
    return Blocks(taken, X, np.add.reduceat(rows.y, edges) / counts)


def averaged(rows: Linear, blocks: int = BLOCKS) -> Linear:
    """Averages over the blocks of `blocks_of` as rows: they tell of the coefficients what the rows do."""
    taken = blocks_of(rows, blocks)
    return replace(
        rows,
        t=taken.rows.t,
        duration=taken.rows.duration,
        interval=float(np.median(taken.rows.duration)),
        y=taken.y,
        columns=lambda start, stop: taken.X[start:stop],
        axes=taken.rows.axes,
    )


def within_blocks(rows: Linear) -> FloatArray:
    """Triangular factor (p + 1, p + 1) of what the averages over the blocks of `blocks_of` leave of the rows.

    Columns are those of X, then the response; each row is divided by the square root of its share of white
    noise, ``1/sqrt(duration)``, so that white noise of unit density has unit variance.
    """
    from imubayes.inference.reml import block_edges

    if rows.stream is not None:
        from imubayes.inference.streaming import streamed_within

        return streamed_within(rows, rows.stream)
    edges = block_edges(rows.t, rows.interval)

    def parts():
        for inside, a, b in _whole_blocks(edges, len(rows)):
            part = np.column_stack((rows.columns(a, b), rows.y[a:b]))
            starts = edges[inside] - a
            counts = np.diff(np.append(starts, b - a))
            part -= np.repeat(np.add.reduceat(part, starts, axis=0) / counts[:, None], counts, axis=0)
            part *= np.sqrt(rows.duration[a:b])[:, None]
            yield from (part[i:j] for i, j in algebra.row_blocks(b - a))

    return algebra.triangular(parts(), len(rows.names) + 1)


def whitened_factor(
    rows: Linear, noise: Noise, parts: Processes | None = None, *, sharp: bool = False
) -> tuple[Factor, FloatArray]:
    """Factor of all rows, whitened, and the largest size (p,) of each column.

    Parameters
    ----------
    rows : of a run.
    noise : N, B, K, SI.
    parts : the processes that stand for B; by default those that matter beside the white noise.
    sharp : whether columns that are nearly dependent are factored once more in twice the digits: of use where
        no prior holds them apart, as that of errors of the bench does. A stream always is.
    """
    from imubayes.inference.whiten import whiten, whitener

    if rows.shared is not None and parts is None:
        return rows.shared(noise)
    if rows.stream is not None:
        from imubayes.inference.streaming import streamed_factor

        return streamed_factor(rows, rows.stream, noise, parts), rows.stream.reach
    n, p = len(rows), len(rows.names)
    table = np.empty((n, p + 1))
    for a in range(0, n, CHUNK):
        b = min(a + CHUNK, n)
        table[a:b, :p] = rows.columns(a, b)
    table[:, p] = rows.y
    blocks = tuple(algebra.row_blocks(n))
    reach = np.max([np.abs(table[i:j, :p]).max(axis=0) for i, j in blocks], axis=0)
    w = whitener(noise, rows.rows, parts)
    whiten(w, table)
    if not sharp:
        R = algebra.triangular((table[i:j] for i, j in blocks), p + 1)
        return Factor(rows.names, R, n, w.log_det), reach
    R, better = algebra.sharpened(lambda: (table[i:j] for i, j in blocks), p + 1)
    return Factor(rows.names, R if better is None else better.astype(np.float64), n, w.log_det), reach


def drive(rows: Sequence[Linear], columns: Sequence[str], names: Sequence[str]) -> Factor:
    """Factor of a component's columns over the samples of its runs: what the test's inputs were to it.

    Every sample counts alike, whatever its noise, and the response is zero. Where a row has a share of each
    component of a case (a free tumble), the share is that of the constant column, and is taken out.

    Parameters
    ----------
    rows : of each run.
    columns : of the component, as the rows name them.
    names : of its terms, in the same order; ``b0`` is among them.
    """
    R, n = np.zeros((len(names) + 1,) * 2), 0
    for part in rows:
        own = [part.names.index(name) for name in columns]
        for a in range(0, len(part), CHUNK):
            X = part.columns(a, min(a + CHUNK, len(part)))[:, own]
            share, counts = X[:, list(names).index("b0")], part.counts[a : a + CHUNK]
            here = np.abs(share) > FAINT
            X = X[here] * (np.sqrt(counts[here]) / share[here])[:, None]
            R = algebra.triangular((R, np.pad(X, ((0, 0), (0, 1)))), len(names) + 1)
            n += int(counts[here].sum())
    return Factor(tuple(names), R, n)


def _whole_blocks(edges: NDArray[np.int64], n: int):
    """Parts of the rows that hold whole blocks: (blocks, first row, row after the last)."""
    counts = np.diff(np.append(edges, n))
    per_part = max(1, CHUNK // int(counts.max()))
    for first in range(0, len(edges), per_part):
        inside = slice(first, min(first + per_part, len(edges)))
        yield inside, int(edges[first]), int(edges[inside.stop]) if inside.stop < len(edges) else n
