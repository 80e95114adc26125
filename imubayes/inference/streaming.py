"""A run that is read a part at a time, as rows of a linear model: every row counts, few are held.

The factor is that of all rows, whitened with the state carried from part to part. What looks at rows has
averages over about 1,500 blocks, which are rows of the same model under the same noise: the columns are
averaged, not made of averaged inputs. The noise is judged by these averages and by a ladder of ever longer
averages over a stretch at full rate, so that white noise is seen where it is larger than bias instability.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import factor as algebra
from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import Factor
from imubayes.inference.dwells import dwells_of
from imubayes.inference.linear import Linear, linear_of
from imubayes.inference.pieces import Pieces
from imubayes.inference.reml import Blocks
from imubayes.inference.stream_whitening import Carry, begin, padded, whiten_on
from imubayes.inference.whiten import Processes, Rows, mattering
from imubayes.rig.inputs import Part, Run, Stream
from imubayes.sensors.noise import Noise
from imubayes.sensors.terms import Library, columns

TILE = 8192
"""Rows whose columns are made, whitened and factored at a time: they stay in the cache."""

RUNGS = 192
"""Averages of one length in the ladder: each rung tells the noise there to 5 %."""

RATIO = 4
"""Length of the averages of a rung over that of the rung before."""

REMEMBERED = 4
"""Runs whose last pass is remembered: the factor and the dwells come of the same one."""


def streamed_rows(run: Run, lib: Library, stream: Stream) -> Linear:
    """Averages over the blocks of a run as rows of a linear model, with the stream behind them.

    Raises
    ------
    ValueError : if the run was read for another library.
    """
    if stream.library != lib:
        raise ValueError(
            f"run '{run.name}' is read a part at a time, for the terms {', '.join(stream.library.names)}:"
            " read it again for another library"
        )
    own = run.inputs.channels.get(lib.own, 0.0)
    return Linear(
        name=run.name,
        procedure=run.procedure,
        names=lib.names,
        t=run.inputs.t,
        duration=stream.duration,
        interval=run.inputs.interval,
        y=run.output - own,
        columns=lambda start, stop: stream.X[start:stop],
        stream=stream,
    )


def noise_blocks(rows: Linear, stream: Stream) -> Blocks:
    """Averages that tell the noise at all time scales: a ladder over the stretch, blocks beside it."""
    fine = linear_of(stream.stretch, stream.library)
    first = _ladder(len(fine))
    counts = np.diff(np.append(first, len(fine)))
    rungs = [np.add.reduceat(values, first) for values in (fine.t, fine.duration, fine.y)]
    X = np.add.reduceat(fine.columns(0, len(fine)), first, axis=0) / counts[:, None]
    before, after = beside_stretch(stream)

    def joined(coarse: FloatArray, ladder: FloatArray) -> FloatArray:
        return np.concatenate((coarse[before], ladder, coarse[after]))

    taken = Rows(joined(rows.t, rungs[0] / counts), joined(rows.duration, rungs[1]), None, stream.interval)
    return Blocks(taken, joined(stream.X, X), joined(rows.y, rungs[2] / counts))


def beside_stretch(stream: Stream) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which blocks (m,) end before the stretch at full rate begins, and which begin after its end."""
    begins = np.cumsum(stream.counts) - stream.counts
    ends = begins + stream.counts
    first = stream.stretch_first
    return ends <= first, begins >= first + len(stream.stretch.inputs)


def _ladder(n: int) -> NDArray[np.int64]:
    """First rows of averages over `n` rows whose length grows.

    Examples
    --------
    >>> _ladder(1000)[[0, 1, 191, 192, 193]].tolist()
    [0, 1, 191, 192, 196]
    """
    lengths = [np.full(RUNGS, RATIO**k) for k in range(1 + int(np.ceil(np.emath.logn(RATIO, n))))]
    first = np.cumsum(np.concatenate(([0], *lengths)))
    return first[first < n]


def streamed_pieces(rows: Linear, stream: Stream, noise: Noise, parts: Processes | None = None) -> Pieces:
    """Factors of the dwells of a run, whitened as a whole; one pass over its rows.

    Parameters
    ----------
    rows : averages over its blocks.
    stream : its rows.
    noise : that whitens it, SI.
    parts : the processes that stand for B; by default those that matter beside the white noise.
    """
    return _remembered(rows, noise) if parts is None else _pieces(rows, stream, noise, parts)


@lru_cache(maxsize=REMEMBERED)
def _remembered(rows: Linear, noise: Noise) -> Pieces:
    if rows.stream is None:
        raise ValueError("only rows that are read a part at a time are passed over again")
    return _pieces(rows, rows.stream, noise, mattering(noise, rows.rows))


def streamed_factor(rows: Linear, stream: Stream, noise: Noise, parts: Processes | None = None) -> Factor:
    """Factor of a run, whitened as a whole: one pass over its rows, and one more where columns are alike.

    Parameters as of `streamed_pieces`.
    """
    from imubayes.inference.pieces import stacked

    made = stacked([streamed_pieces(rows, stream, noise, parts)])
    chosen, width = mattering(noise, rows.rows) if parts is None else parts, len(rows.names) + 1
    tiles = _whitened(stream, noise, chosen, "columns that are nearly alike")
    sharp = algebra.sharpened_by(made.R, lambda: (table[:, :width] for _, _, table in tiles))
    return made if sharp is None else replace(made, R=sharp.astype(np.float64))


def _whitened(
    stream: Stream, noise: Noise, parts: Processes, purpose: str
) -> Iterator[tuple[int, FloatArray, FloatArray]]:
    """Whitened rows a tile at a time: number of the first, logs of their variances, and the table."""
    carry: Carry | None = None
    for first, t, duration, table in _tiles(stream, purpose):
        if carry is None:
            carry = begin(noise, parts, float(t[0] - 0.5 * duration[0]), table.shape[1])
        yield first, np.log(whiten_on(carry, t, duration, table)), table


def _pieces(rows: Linear, stream: Stream, noise: Noise, parts: Processes) -> Pieces:
    dwells = dwells_of(rows)
    edges = np.concatenate(([0], np.cumsum(stream.counts)))[dwells.edges]
    width = len(rows.names) + 1
    R, log_det = np.zeros((len(dwells), width, width)), np.zeros(len(dwells))
    for first, log_d, table in _whitened(stream, noise, parts, "whitening"):
        for k, a, b in _shares(edges, first, first + len(log_d)):
            inside = slice(a - first, b - first)
            R[k] = algebra.triangular((R[k], table[inside, :width]), width)
            log_det[k] += float(log_d[inside].sum())
    return Pieces(rows.name, rows.names, dwells.start, dwells.stop, np.diff(edges), R, log_det)


def _tiles(stream: Stream, purpose: str) -> Iterator[tuple[int, FloatArray, FloatArray, FloatArray]]:
    """Rows a tile at a time: number of the first, time, averaging time, and columns with the response.

    The table is used again for the next tile.
    """
    p = len(stream.library.names)
    whole = np.zeros((TILE, padded(p + 1)))
    for part in stream.parts(purpose):
        for a in range(0, len(part), TILE):
            b = min(a + TILE, len(part))
            table = whole[: b - a]
            _fill(table, stream.library, part, slice(a, b))
            yield part.first + a, part.t[a:b], part.duration[a:b], table


def _fill(table: FloatArray, lib: Library, part: Part, inside: slice) -> None:
    """Columns of the library and the response of some rows of a part; zeros beside them."""
    p = len(lib.names)
    channels = {name: values[inside] for name, values in part.channels.items()}
    columns(lib, channels, len(table), out=table[:, :p])
    table[:, p] = part.output[inside] - channels.get(lib.own, 0.0)
    table[:, p + 1 :] = 0.0


def _shares(edges: NDArray[np.int64], start: int, stop: int) -> Iterator[tuple[int, int, int]]:
    """Pieces that rows from start to stop belong to, and which of them: (piece, from, to)."""
    first = int(np.searchsorted(edges, start, side="right")) - 1
    last = int(np.searchsorted(edges, stop, side="left"))
    for k in range(first, last):
        yield k, max(start, int(edges[k])), min(stop, int(edges[k + 1]))


def streamed_within(rows: Linear, stream: Stream) -> FloatArray:
    """Triangular factor (p + 1, p + 1) of what the averages over the blocks leave of the rows.

    As `imubayes.inference.linear.within_blocks`; one pass.
    """
    width = len(rows.names) + 1
    means = np.column_stack((stream.X, rows.y))
    edges = np.concatenate(([0], np.cumsum(stream.counts)))

    def left() -> Iterator[FloatArray]:
        for first, t, duration, table in _tiles(stream, "noise within blocks"):
            for k, a, b in _shares(edges, first, first + len(t)):
                table[a - first : b - first, :width] -= means[k]
            yield table[:, :width] * np.sqrt(duration)[:, None]

    return algebra.triangular(left(), width)
