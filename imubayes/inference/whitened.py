"""Rows whitened, as one factor or a dwell at a time, whether they are held or read a part at a time.

A run that is read a part at a time counts with every row: its factor is that of all rows, whitened with the
state carried from part to part, and what looks at rows has averages over about 1,500 blocks, which are rows
of the same model under the same noise: the columns are averaged, not made of averaged inputs.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import factor as algebra
from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import Factor
from imubayes.inference.dwells import Pieces, dwells_of, stacked
from imubayes.inference.linear import CHUNK, Linear, Rows, block_edges, blocks_of, once, reach_of
from imubayes.inference.whiten import Carry, Processes, begin, mattering, padded, states_of, whiten, whiten_on
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
    if rows.stream:
        return _streamed_factor(rows, noise, parts), reach_of(rows)
    n, p = len(rows), len(rows.names)
    table = np.empty((n, p + 1))
    for a in range(0, n, CHUNK):
        rows.filled(slice(a, min(a + CHUNK, n)), table[a : a + CHUNK])
    blocks = tuple(algebra.row_blocks(n))
    reach = np.max([np.abs(table[i:j, :p]).max(axis=0) for i, j in blocks], axis=0)
    _, d = whiten(noise, rows.rows, table, parts)
    log_det = float(np.sum(np.log(d)))
    if not sharp:
        R = algebra.triangular((table[i:j] for i, j in blocks), p + 1)
        return Factor(rows.names, R, n, log_det), reach
    R, better = algebra.sharpened(lambda: (table[i:j] for i, j in blocks), p + 1)
    return Factor(rows.names, R if better is None else better.astype(np.float64), n, log_det), reach


def pieces_of(rows: Linear, noise: Noise, parts: Processes | None = None) -> Pieces:
    """Whiten a run as a whole and factor each of its dwells; one pass over its rows.

    Parameters
    ----------
    rows : of the run.
    noise : that whitens it, SI.
    parts : the processes that stand for B; by default those that matter beside the white noise.
    """
    if parts is not None:
        return _pieces(rows, noise, parts)
    return once(rows, noise, lambda: _pieces(rows, noise, mattering(noise, rows.rows)))


def _pieces(rows: Linear, noise: Noise, parts: Processes) -> Pieces:
    dwells, width = dwells_of(rows), len(rows.names) + 1
    edges = np.concatenate(([0], np.cumsum(rows.counts)))[dwells.edges]
    R, log_det = np.zeros((len(dwells), width, width)), np.zeros(len(dwells))
    for first, log_d, table in _whitened(rows, noise, parts, "whitening"):
        for k, a, b in _shares(edges, first, first + len(log_d)):
            inside = slice(a - first, b - first)
            R[k] = algebra.triangular((R[k], table[inside]), width)
            log_det[k] += float(log_d[inside].sum())
    return Pieces(rows.name, rows.names, dwells.start, dwells.stop, np.diff(edges), R, log_det)


def _streamed_factor(rows: Linear, noise: Noise, parts: Processes | None) -> Factor:
    """Factor of a run, whitened as a whole: one pass over its rows, and one more where columns are alike."""
    made = stacked([pieces_of(rows, noise, parts)])
    chosen = mattering(noise, rows.rows) if parts is None else parts
    tiles = _whitened(rows, noise, chosen, "columns that are nearly alike")
    sharp = algebra.sharpened_by(made.R, lambda: (table for _, _, table in tiles))
    return made if sharp is None else replace(made, R=sharp.astype(np.float64))


def within_blocks(rows: Linear) -> FloatArray:
    """Triangular factor (p + 1, p + 1) of what the averages over the blocks of `blocks_of` leave of the rows.

    Columns are those of X, then the response; each row is divided by the square root of its share of white
    noise, ``1/sqrt(duration)``, so that white noise of unit density has unit variance. One pass.
    """
    blocks, edges = rows, np.concatenate(([0], np.cumsum(rows.counts)))
    if rows.stream is None:
        blocks, edges = blocks_of(rows), np.append(block_edges(rows.t, rows.interval), len(rows))
    means = np.column_stack((blocks.X, blocks.y))

    def left() -> Iterator[FloatArray]:
        for first, tile, table in _tiles(rows, "noise within blocks"):
            for k, a, b in _shares(edges, first, first + len(table)):
                table[a - first : b - first, : means.shape[1]] -= means[k]
            yield table[:, : means.shape[1]] * np.sqrt(tile.duration)[:, None]

    return algebra.triangular(left(), means.shape[1])


def _whitened(
    rows: Linear, noise: Noise, parts: Processes, purpose: str
) -> Iterator[tuple[int, FloatArray, FloatArray]]:
    """Whitened rows a tile at a time: number of the first, logs of their variances, and the table."""
    carry: Carry | None = None
    for first, tile, table in _tiles(rows, purpose):
        states = states_of(noise, parts, tile.duration, tile.axes)
        if carry is None:
            start = float(tile.t[0] - 0.5 * tile.duration[0])
            carry = begin(len(states.rates), start, table.shape[1])
        log_d = np.log(whiten_on(carry, states, tile.t, tile.duration, table))
        yield first, log_d, table[:, : len(rows.names) + 1]


def _tiles(rows: Linear, purpose: str) -> Iterator[tuple[int, Rows, FloatArray]]:
    """All rows of a run, a tile at a time: number of the first, when, and columns with the response, padded.

    The table is used again for the next tile.
    """
    p, whole = len(rows.names), np.zeros((TILE, padded(len(rows.names) + 1)))
    for first, own, taken, fill in rows.parts(purpose):
        for a in own[::TILE]:
            inside = slice(a, min(a + TILE, own.stop))
            table, axes = whole[: inside.stop - a], None if taken.axes is None else taken.axes[inside]
            fill(inside, table)
            table[:, p + 1 :] = 0.0
            yield first + a, Rows(taken.t[inside], taken.duration[inside], axes), table


def _shares(edges: NDArray[np.int64], start: int, stop: int) -> Iterator[tuple[int, int, int]]:
    """Pieces that rows from start to stop belong to, and which of them: (piece, from, to)."""
    first = int(np.searchsorted(edges, start, side="right")) - 1
    last = int(np.searchsorted(edges, stop, side="left"))
    for k in range(first, last):
        yield k, max(start, int(edges[k])), min(stop, int(edges[k + 1]))
