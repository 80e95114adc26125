"""A run as averages of many lengths: what its noise is judged by, whatever the number of samples.

Quantization and white noise show in single samples, random walk and ramp only over the whole run. So most of
the run is averaged to long blocks, and a stretch of it for each shorter length is cut finer. The likelihood
of these averages is exact; what is lost is the noise within the blocks outside the stretches.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import FloatArray
from imubayes.inference.linear import Linear, averages, block_edges, blocks_of, stretch_of, with_columns
from imubayes.rig.inputs import Stream

COARSE = 1000
"""Blocks that the run is averaged to."""

FINE = 1000
"""Averages of each shorter length."""

STEP = 8
"""Ratio of neighbouring lengths."""

NORMAL_MEDIAN = 0.6744897501960817
"""Median of the size of a standard normal variable."""


def noise_rows(rows: Linear) -> tuple[Linear, tuple[tuple[float, int], ...]]:
    """Averages over pieces of a run, in time order, and (length in s, how many) of each length.

    Of a run that is read a part at a time, a stretch at full rate has pieces of many lengths, and the blocks
    beside it are taken as they are.
    """
    fine = stretch_of(rows)
    edges, levels = piece_edges(fine.t, fine.interval)
    means = averages(fine, edges)
    if rows.stream:
        beside = len(rows) - int(np.count_nonzero(_stretched(rows.stream)))
        levels = (*levels, (float(np.median(rows.duration)), beside))
        means = _around_stretch(rows, rows.stream, means)
    return means, levels


def noise_blocks(rows: Linear) -> Linear:
    """Averages that the noise of a run is judged by.

    Of a run that is read a part at a time they tell it at all time scales: a ladder of ever longer averages
    over the stretch at full rate, so that white noise is seen where it is larger than bias instability, and
    the blocks beside it.
    """
    if not rows.stream:
        return blocks_of(rows)
    fine = stretch_of(rows)
    return _around_stretch(rows, rows.stream, averages(fine, _ladder(len(fine))))


def _around_stretch(rows: Linear, stream: Stream, inside: Linear) -> Linear:
    """Averages over the stretch at full rate, in the place of the blocks that it touches."""
    touched = _stretched(stream)
    first = int(np.argmax(touched))

    def joined(coarse: FloatArray, fine: FloatArray) -> FloatArray:
        return np.concatenate((coarse[:first], fine, coarse[first:][~touched[first:]]))

    times = replace(rows, t=joined(rows.t, inside.t), duration=joined(rows.duration, inside.duration))
    return with_columns(times, joined(rows.X, inside.X), joined(rows.y, inside.y))


def _stretched(stream: Stream) -> NDArray[np.bool_]:
    """Which blocks (m,) the stretch at full rate touches."""
    ends = np.cumsum(stream.counts)
    first = stream.stretch.first
    return (ends > first) & (ends - stream.counts < first + len(stream.stretch))


def piece_edges(t: FloatArray, interval: float) -> tuple[NDArray[np.int64], tuple[tuple[float, int], ...]]:
    """Start indices of the pieces, and (length in s, how many) of each length.

    Examples
    --------
    >>> edges, levels = piece_edges(np.arange(100_000.0), 1.0)
    >>> len(edges) < 4000, [length for length, _ in levels]
    (True, [1.0, 8.0, 100.0])
    """
    coarse = block_edges(t, interval, COARSE)
    longest = int(np.ceil(len(t) / COARSE))
    lengths = [STEP**k for k in range(12) if 2 * STEP**k <= longest]
    if longest <= 2:  # a short run is taken sample by sample
        return np.arange(len(t)), ((interval, len(t)),)
    ends = np.append(coarse, len(t))
    parts, levels, done = [], [], 0
    for k, length in enumerate(lengths):
        # fine stretches lie evenly over the run, each inside its own share of it
        wanted = min(max(1, FINE * length // longest), len(coarse) // (2 * len(lengths)))
        first = max(done, (2 * k + 1) * len(coarse) // (2 * len(lengths)) - wanted // 2)
        cut = np.concatenate(
            [np.arange(a, b, length) for a, b in pairwise(ends[first : first + wanted + 1].tolist())]
        )
        parts += [coarse[done:first], cut]
        levels.append((length * interval, len(cut)))
        done = first + wanted
    parts.append(coarse[done:])
    edges = np.concatenate(parts)
    rest = len(edges) - sum(count for _, count in levels)
    return edges, (*levels, (longest * interval, rest))


def scatter(y: FloatArray, duration: FloatArray) -> float:
    """White noise, u/sqrt(Hz), that would scatter neighbouring averages (m,), SI, as they are.

    They last `duration` (m,), s. Steps among them hardly change it.
    """
    steps = np.abs(np.diff(y)) * np.sqrt(duration[1:])
    least = float(np.max(np.abs(y))) * float(np.finfo(float).eps) + float(np.finfo(float).tiny)
    return max(float(np.median(steps)) / (NORMAL_MEDIAN * np.sqrt(2.0)), least)


RUNGS = 192
"""Averages of one length in the ladder: each rung tells the noise there to 5 %."""

RATIO = 4
"""Length of the averages of a rung over that of the rung before."""


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
