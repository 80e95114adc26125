"""Rows whitened, as one factor or a dwell at a time, whether they are held or read a part at a time.

A run that is read a part at a time counts with every row: its factor is that of all rows, whitened with the
state carried from part to part, and what looks at rows has averages over about 1,500 blocks, which are rows
of the same model under the same noise: the columns are averaged, not made of averaged inputs.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import factor as algebra
from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import Factor
from imubayes.inference.dwells import Pieces, dwells_of, stacked
from imubayes.inference.linear import CHUNK, Linear, block_edges, once, whole_parts
from imubayes.inference.whiten import Carry, Processes, begin, mattering, padded, states_of, whiten, whiten_on
from imubayes.rig.inputs import Stream
from imubayes.sensors.noise import Noise

TILE = 8192
"""Rows whose columns are made, whitened and factored at a time: they stay in the cache."""


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
    if rows.shared is not None and parts is None:
        return rows.shared(noise)
    if rows.stream is not None:
        return streamed_factor(rows, rows.stream, noise, parts), rows.stream.reach
    table = _table(rows)
    n, p = len(rows), len(rows.names)
    blocks = tuple(algebra.row_blocks(n))
    reach = np.max([np.abs(table[i:j, :p]).max(axis=0) for i, j in blocks], axis=0)
    _, d = whiten(noise, rows.rows, table, parts)
    log_det = float(np.sum(np.log(d)))
    if not sharp:
        R = algebra.triangular((table[i:j] for i, j in blocks), p + 1)
        return Factor(rows.names, R, n, log_det), reach
    R, better = algebra.sharpened(lambda: (table[i:j] for i, j in blocks), p + 1)
    return Factor(rows.names, R if better is None else better.astype(np.float64), n, log_det), reach


def pieces_of(rows: Linear, noise: Noise) -> Pieces:
    """Whiten a run as a whole and factor each of its dwells.

    Parameters
    ----------
    rows : of the run.
    noise : that whitens it, SI.
    """
    if rows.stream is not None:
        return streamed_pieces(rows, rows.stream, noise)
    dwells, table = dwells_of(rows), _table(rows)
    _, d = whiten(noise, rows.rows, table)
    return Pieces(
        run=rows.name,
        names=rows.names,
        start=dwells.start,
        stop=dwells.stop,
        rows=np.diff(dwells.edges),
        R=np.array(
            [algebra.triangular([table[a:b]], table.shape[1]) for a, b in pairwise(dwells.edges.tolist())]
        ),
        log_det=np.add.reduceat(np.log(d), dwells.edges[:-1]),
    )


def _table(rows: Linear) -> FloatArray:
    """Columns and, last, the response of all rows: (n, p + 1)."""
    table = np.empty((len(rows), len(rows.names) + 1))
    for a in range(0, len(rows), CHUNK):
        b = min(a + CHUNK, len(rows))
        table[a:b, :-1] = rows.columns(a, b)
    table[:, -1] = rows.y
    return table


def within_blocks(rows: Linear) -> FloatArray:
    """Triangular factor (p + 1, p + 1) of what the averages over the blocks of `blocks_of` leave of the rows.

    Columns are those of X, then the response; each row is divided by the square root of its share of white
    noise, ``1/sqrt(duration)``, so that white noise of unit density has unit variance.
    """
    if rows.stream is not None:
        return streamed_within(rows, rows.stream)
    edges = block_edges(rows.t, rows.interval)

    def parts():
        for inside, a, b in whole_parts(edges, len(rows)):
            part = np.column_stack((rows.columns(a, b), rows.y[a:b]))
            starts = edges[inside] - a
            counts = np.diff(np.append(starts, b - a))
            part -= np.repeat(np.add.reduceat(part, starts, axis=0) / counts[:, None], counts, axis=0)
            part *= np.sqrt(rows.duration[a:b])[:, None]
            yield from (part[i:j] for i, j in algebra.row_blocks(b - a))

    return algebra.triangular(parts(), len(rows.names) + 1)


def streamed_pieces(rows: Linear, stream: Stream, noise: Noise, parts: Processes | None = None) -> Pieces:
    """Factors of the dwells of a run, whitened as a whole; one pass over its rows.

    Parameters
    ----------
    rows : averages over its blocks.
    stream : its rows.
    noise : that whitens it, SI.
    parts : the processes that stand for B; by default those that matter beside the white noise.
    """
    if parts is not None:
        return _pieces(rows, stream, noise, parts)
    return once(rows, noise, lambda: _pieces(rows, stream, noise, mattering(noise, rows.rows)))


def streamed_factor(rows: Linear, stream: Stream, noise: Noise, parts: Processes | None = None) -> Factor:
    """Factor of a run, whitened as a whole: one pass over its rows, and one more where columns are alike.

    Parameters as of `streamed_pieces`.
    """
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
        states = states_of(noise, parts, duration)
        if carry is None:
            carry = begin(len(states.rates), float(t[0] - 0.5 * duration[0]), table.shape[1])
        yield first, np.log(whiten_on(carry, states, t, duration, table)), table


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
    p = stream.X.shape[1]
    whole = np.zeros((TILE, padded(p + 1)))
    for part in stream.parts(purpose):
        for a in range(0, len(part), TILE):
            b = min(a + TILE, len(part))
            table = whole[: b - a]
            stream.fill(part, slice(a, b), table)
            table[:, p + 1 :] = 0.0
            yield part.first + a, part.t[a:b], part.duration[a:b], table


def _shares(edges: NDArray[np.int64], start: int, stop: int) -> Iterator[tuple[int, int, int]]:
    """Pieces that rows from start to stop belong to, and which of them: (piece, from, to)."""
    first = int(np.searchsorted(edges, start, side="right")) - 1
    last = int(np.searchsorted(edges, stop, side="left"))
    for k in range(first, last):
        yield k, max(start, int(edges[k])), min(stop, int(edges[k + 1]))


def streamed_within(rows: Linear, stream: Stream) -> FloatArray:
    """Triangular factor (p + 1, p + 1) of what the averages over the blocks leave of the rows.

    As `imubayes.inference.whitened.within_blocks`; one pass.
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
