"""Dwells of a run: the stretches of rows that are trusted or distrusted as a whole.

A run cut to them is one small factor each, which can be left out, doubled, and added up again. The rows are
whitened as a whole, in their order, so that a dwell's rows are what it adds to the dwells before it: the
pieces are independent given the coefficients, and their factors stack to the factor of the run.

A run that is read a part at a time counts with every row: its factor is that of all rows, whitened with the
state carried from part to part, and what looks at rows has averages over about 1,500 blocks, which are rows
of the same model under the same noise: the columns are averaged, not made of averaged inputs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import FloatArray
from imubayes.algebra import factor as algebra
from imubayes.algebra.factor import Factor
from imubayes.inference.linear import Linear, Rows, averages, block_edges, blocks_of, evenly, once, reach_of
from imubayes.inference.whiten import Carry, Processes, begin, processes, states_of, whiten_on
from imubayes.rig.filtering import LONG, PIECES
from imubayes.rig.inputs import between_gaps
from imubayes.sensors.noise import Noise

STEADY = 0.2
"""Change of the inputs within a dwell: root mean square over the columns that the run excites, each over its
largest size. With more, inputs vary and the part is cut. A sign that flickers where its axis is horizontal is
one column of many."""

QUARTERS = 4
"""Means whose change is looked at: that of single rows would be noise, where an input was measured."""

MOST = 400
"""Dwells of a run: with more gaps than that (lost samples), neighbouring parts are taken together."""


@dataclass(frozen=True, slots=True, eq=False)
class Dwells:
    """Averages over the q dwells of a run, which start and stop at (q,), s.

    `edges` (q + 1,) are the first row of each dwell, and the number of rows.
    """

    edges: NDArray[np.int64]
    start: FloatArray
    stop: FloatArray
    means: Linear

    def __len__(self) -> int:
        return len(self.means)


def dwells_of(rows: Linear) -> Dwells:
    """Average the rows of a run over its dwells.

    A dwell is what two gaps enclose. A part of more than an eighth of the run (a static log), or during which
    the inputs vary (a ramp), is cut to pieces of a two-hundredth of the run: a shock does not cost all of it.
    """
    return once(rows, Dwells, lambda: _dwells(rows))


def _dwells(rows: Linear) -> Dwells:
    size = reach_of(rows)
    excited = size > 0.0

    def varies(start: int, stop: int) -> bool:
        edges = np.unique(np.linspace(0, stop - start, QUARTERS + 1).astype(int))
        sums = np.add.reduceat(rows.columns(start, stop), edges[:-1], axis=0)
        means = sums / np.diff(edges)[:, None]
        change = np.ptp(means, axis=0)[excited] / size[excited]
        return bool(np.sum(change**2) > STEADY**2 * len(change))

    edges = dwell_edges(rows.t, rows.interval, varies)
    first, last, half = edges[:-1], edges[1:] - 1, 0.5 * rows.duration
    return Dwells(edges, (rows.t - half)[first], (rows.t + half)[last], averages(rows, first))


def dwell_edges(
    t: FloatArray, interval: float, varies: Callable[[int, int], bool] = lambda start, stop: False
) -> NDArray[np.int64]:
    """First row of each dwell, and the number of rows: (q + 1,), of samples at times t (n,), s.

    `varies` says whether the inputs do between two rows.

    Examples
    --------
    >>> three_rows_each = np.add.outer(60.0 * np.arange(9), np.arange(3.0)).ravel()
    >>> dwell_edges(three_rows_each, 1.0).tolist()
    [0, 3, 6, 9, 12, 15, 18, 21, 24, 27]
    >>> len(dwell_edges(np.arange(1000.0), 1.0)) - 1
    200
    """
    n = len(t)
    longest = math.ceil(n / PIECES)
    parts = between_gaps(t, interval)
    cuts = [evenly(a, b, longest) if (b - a) * LONG > n or varies(a, b) else [a] for a, b in parts]
    edges = np.concatenate([*cuts, [n]]).astype(np.int64)
    return edges if len(edges) <= MOST + 1 else _thinned(edges)


def _thinned(cuts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Edges at least a share `MOST` of the rows apart."""
    least = int(cuts[-1]) / MOST
    kept = [0]
    for cut in cuts[1:-1].tolist():
        if cut - kept[-1] >= least:
            kept.append(cut)
    return np.array([*kept, cuts[-1]])


def rows_kept(rows: Linear, kept: NDArray[np.bool_]) -> Linear:
    """The rows of a run that are `kept` (n,)."""
    where = np.flatnonzero(kept)
    first = rows.columns

    def columns(start: int, stop: int) -> FloatArray:
        inside = where[start:stop]
        return first(int(inside[0]), int(inside[-1]) + 1)[inside - inside[0]]

    return replace(
        rows,
        t=rows.t[kept],
        duration=rows.duration[kept],
        y=rows.y[kept],
        axes=None if rows.axes is None else rows.axes[kept],
        columns=columns,
        stream=rows.stream and rows.stream.left(kept),
    )


ROUNDING = 1e-15
"""A direction of a dwell that is smaller, beside the columns of all dwells, is rounding."""


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """Factors of the q dwells of a run, which start and stop at (q,), s.

    Attributes
    ----------
    rows : (q,) samples of each dwell.
    R : (q, p + 1, p + 1) triangular factor of the whitened ``[X y]`` of each dwell.
    log_det : (q,) log determinant of the noise covariance of each dwell, given those before it.
    kept : whether they are always there: never left out, and never drawn twice.
    """

    run: str
    names: tuple[str, ...]
    start: FloatArray
    stop: FloatArray
    rows: NDArray[np.int64]
    R: FloatArray
    log_det: FloatArray
    kept: bool = False

    def __len__(self) -> int:
        return len(self.rows)


def always(f: Factor) -> Pieces:
    """A factor from elsewhere as one piece that is always there."""
    nowhen = np.array([np.nan])
    return Pieces("", f.names, nowhen, nowhen, np.array([f.n]), f.R[None], np.array([f.log_det]), kept=True)


def few_rows(R: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Rows (q, w, w) that say what the factors R (q, w, w) of dwells do, and which (q, w) say something.

    A dwell at constant inputs moves the columns in a few directions only.
    """
    size = np.linalg.norm(R, axis=(0, 1))
    _, s, directions = np.linalg.svd(R / np.where(size > 0.0, size, 1.0), full_matrices=False)
    return s[:, :, None] * directions * size, s > ROUNDING


def joined(pieces: Pieces, labels: NDArray[np.int64]) -> Pieces:
    """Dwells of a run that have one label (q,) as one, in the order of the labels."""
    groups = [labels == label for label in np.unique(labels)]
    factors = [stacked([pieces], [group.astype(np.int64)]) for group in groups]
    return replace(
        pieces,
        start=np.array([pieces.start[group].min() for group in groups]),
        stop=np.array([pieces.stop[group].max() for group in groups]),
        rows=np.array([f.n for f in factors]),
        R=np.array([f.R for f in factors]),
        log_det=np.array([f.log_det for f in factors]),
    )


def stacked(pieces: Sequence[Pieces], counts: Sequence[NDArray[np.int64]] | None = None) -> Factor:
    """Factor of the dwells of some runs, each taken as often as `counts` (q,) of its run says, or once.

    A count of 0 leaves a dwell out, 2 doubles it; the columns of all runs are the same.
    """
    times = [np.ones(len(p), dtype=np.int64) for p in pieces] if counts is None else list(counts)
    names = pieces[0].names
    kept = [np.sqrt(c[c > 0])[:, None, None] * p.R[c > 0] for p, c in zip(pieces, times, strict=True)]
    tall, width = np.concatenate([part.reshape(-1, part.shape[-1]) for part in kept]), len(names) + 1
    alone = len(tall) == width  # of one dwell, which is triangular already
    return Factor(
        names=names,
        R=tall if alone else algebra.triangular([tall], width),
        n=int(sum(np.sum(c * p.rows) for p, c in zip(pieces, times, strict=True))),
        log_det=float(sum(np.sum(c * p.log_det) for p, c in zip(pieces, times, strict=True))),
    )


TILE = 8192
"""Rows whose columns are made, whitened and factored at a time: they stay in the cache."""


def whitened_factor(
    rows: Linear, noise: Noise, parts: Processes | None = None, *, sharp: bool = False
) -> Factor:
    """Factor of all rows, whitened.

    `parts` are the processes that stand for B; by default those that matter beside the white noise. Where it
    is asked to be `sharp`, columns that are nearly dependent are factored once more in twice the digits: of
    use where no prior holds them apart, as that of errors of the bench does.
    """
    chosen, log_d = parts or processes(rows.rows, noise), list[float]()

    def tables(purpose: str) -> Iterator[FloatArray]:
        for _, logs, table in _whitened(rows, noise, chosen, purpose):
            log_d.append(float(logs.sum()))
            yield table

    if rows.stream:  # its dwells are asked for, too: one pass serves both
        made = stacked([pieces_of(rows, noise, parts)])
    else:
        R = algebra.triangular(tables("factor"), len(rows.names) + 1)
        made = Factor(rows.names, R, len(rows), sum(log_d))
    better = algebra.sharpened(made.R, lambda: tables("columns that are nearly alike")) if sharp else None
    return made if better is None else replace(made, R=better.astype(np.float64))


def pieces_of(rows: Linear, noise: Noise, parts: Processes | None = None) -> Pieces:
    """Whiten a run as a whole and factor each of its dwells; one pass over its rows.

    `parts` are the processes that stand for B; by default those that matter beside the white noise.
    """
    if parts is not None:
        return _pieces(rows, noise, parts)
    return once(rows, noise, lambda: _pieces(rows, noise, processes(rows.rows, noise)))


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
        for first, tile, table in tiles(rows, "noise within blocks"):
            for k, a, b in _shares(edges, first, first + len(table)):
                table[a - first : b - first] -= means[k]
            table *= np.sqrt(tile.duration)[:, None]
            yield table

    return algebra.triangular(left(), means.shape[1])


def _whitened(
    rows: Linear, noise: Noise, parts: Processes, purpose: str
) -> Iterator[tuple[int, FloatArray, FloatArray]]:
    """Whitened rows a tile at a time: number of the first, logs of their variances, and the table."""
    carry: Carry | None = None
    for first, tile, table in tiles(rows, purpose):
        states = states_of(noise, parts, tile.duration, tile.axes)
        if carry is None:
            start = float(tile.t[0] - 0.5 * tile.duration[0])
            carry = begin(len(states.rates), start, table.shape[1])
        log_d = np.log(whiten_on(carry, states, tile.t, tile.duration, table))
        yield first, log_d, table


def tiles(rows: Linear, purpose: str) -> Iterator[tuple[int, Rows, FloatArray]]:
    """All rows of a run, a tile at a time: number of the first, when, and columns with the response.

    The table is used again for the next tile.
    """
    whole = np.empty((TILE, len(rows.names) + 1))
    parts = iter([(0, range(len(rows)), rows.rows, rows.filled)])
    if rows.stream is not None and (fill := rows.fill) is not None:
        each = rows.stream.read(purpose)
        parts = (
            (part.first, part.own, Rows(part.t, part.inputs.durations), partial(fill, part)) for part in each
        )
    for first, own, taken, write in parts:
        for a in own[::TILE]:
            inside = slice(a, min(a + TILE, own.stop))
            table, axes = whole[: inside.stop - a], None if taken.axes is None else taken.axes[inside]
            write(inside, table)
            yield first + a, Rows(taken.t[inside], taken.duration[inside], axes), table


def _shares(edges: NDArray[np.int64], start: int, stop: int) -> Iterator[tuple[int, int, int]]:
    """Pieces that rows from start to stop belong to, and which of them: (piece, from, to)."""
    first = int(np.searchsorted(edges, start, side="right")) - 1
    last = int(np.searchsorted(edges, stop, side="left"))
    for k in range(first, last):
        yield k, max(start, int(edges[k])), min(stop, int(edges[k + 1]))
