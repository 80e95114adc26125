"""A run's rows as averages over short blocks and what they leave: any noise in a millisecond.

The averages are whitened exactly; what they leave is white but for a small rise of its variance by B and K.
The sum is mended by five exact whitenings of all rows near the maximum of the run's posterior.
Gram matrices are harmless in the coordinates that are used for the coefficients.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import FloatArray
from imubayes.algebra.factor import Factor, invert_triangular, with_prior_rows
from imubayes.inference.dwells import whitened_factor, within_blocks
from imubayes.inference.linear import BLOCKS, Linear, Rows, block_edges, blocks_of
from imubayes.inference.minimum import EVERYWHERE, Cost, Reached, descended
from imubayes.inference.summary import RunSummary
from imubayes.inference.whiten import Processes, Together, averaged_variance, nbk, processes, whiten_by
from imubayes.sensors.noise import Noise

WHOLE = 4000
"""Rows up to which a run is whitened as it is: each row is its own block."""

HOLD = 1e-9
"""Precision, in that of all runs together, that is added where a run is looked at alone: a tumble says 1e20
times less of a cubic term than a centrifuge at 1e5 g, and its Gram matrix would be singular to rounding."""

FARTHEST = 2.0
"""Most of ln(B/N) and ln(K/N) to which the correction to exact whitenings is followed on both sides."""

REACH = 6.0
"""Sds of the ratios' logarithms to which it is followed."""

NEAR = 0.01
"""Fall, nats, to which the maximum is looked for, some 0.1 sd: what is done about it reaches far beyond."""

ASIDE = 0.05
"""Sds to both sides of where a slope is a difference."""

CROSS = np.array([[0.0, 0.0], [-0.5, 0.0], [0.5, 0.0], [0.0, -0.5], [0.0, 0.5]])
"""Exact whitenings, in units of that reach about the maximum."""


@dataclass(frozen=True, slots=True, eq=False)
class Split:
    """A run as block averages and what they leave.

    The averages over `rows` are a `table` (n, p + 1) in the coordinates c, and have noise of the states
    `units`. What exact whitenings have more is a polynomial, `correction` (k, e), in the distances of
    ln(B/N) and ln(K/N) from `middle` (2,), which are followed to `reach` (2,): a matrix E, packed, such that
    with the factor L of rows and prior at the white noise `level` the Gram matrix is ``L (I + E) L'``, and
    the log determinant's rest. As a share of the matrix it stays small where the matrix does: it can be
    carried on.
    """

    table: FloatArray
    rows: Rows
    units: Together
    parts: Processes
    within: FloatArray
    inside: int
    rise: FloatArray
    c: Coordinates
    level: float
    correction: FloatArray
    middle: FloatArray
    reach: FloatArray


def splits_of(
    rows: Sequence[Linear], runs: Sequence[RunSummary], c: Coordinates
) -> tuple[tuple[Split, ...], FloatArray]:
    """Splits of runs that share their noise, and ln N, ln B, ln K (3,) at the maximum of their posterior."""
    bare = tuple(_bare(part, run, c) for part, run in zip(rows, runs, strict=True))
    start = np.log([runs[0].noise.N, runs[0].noise.B, runs[0].noise.K])
    H = np.diag(np.array(runs[0].found.sd) ** -2.0)
    cost = cost_of(bare, runs[0])
    top = descended(cost, Reached(start, *cost(start)), H, EVERYWHERE, NEAR).x
    sd = np.hypot(runs[0].found.sd[1:], runs[0].found.sd[0])
    reach = np.minimum(REACH * sd, FARTHEST)
    return tuple(_corrected(s, part, top, reach) for s, part in zip(bare, rows, strict=True)), top


def log_likelihoods(splits: Sequence[Split], x: FloatArray) -> FloatArray:
    """Log marginal likelihoods (m,) of runs with the noise x (m, 3), each by itself, up to a constant."""
    ratios, log_n = x[:, 1:] - x[:, :1], x[:, 0]
    return np.sum([log_densities(values_at(split, ratios), split, log_n) for split in splits], axis=0)


def log_posteriors(splits: Sequence[Split], run: RunSummary, x: FloatArray) -> FloatArray:
    """Log posterior (m,) of ln N, ln B, ln K (m, 3) that runs share, up to a constant."""
    center, width = np.array([(math.log(m), s) for m, s in run.found.steering.values()]).T
    return log_likelihoods(splits, x) - 0.5 * np.sum(((x - center) / width) ** 2, axis=1)


def cost_of(splits: Sequence[Split], run: RunSummary) -> Cost:
    """Negative log posterior of ln N, ln B, ln K (3,) that runs share; the slope is by differences."""
    sd, aside = np.array(run.found.sd), ASIDE * np.eye(3)
    places = sd * np.vstack((np.zeros(3), aside, -aside))

    def cost(x: FloatArray) -> tuple[float, FloatArray]:
        level, *around = -log_posteriors(splits, run, x + places)
        return float(level), np.subtract(*np.split(np.array(around), 2)) / (2.0 * ASIDE * sd)

    return cost


def _corrected(split: Split, rows: Linear, top: FloatArray, reach: FloatArray) -> Split:
    """Split that is right at the maximum and about it."""
    middle = top[1:] - top[0]
    places = middle + reach * CROSS
    packed, exact = values_at(split, places), []
    for b, k in np.exp(places).tolist():
        whitened = whitened_factor(rows, Noise(1.0, b, k), split.parts)
        exact.append(np.append(packed_of(split.c.gram(whitened.R)), whitened.log_det))
    missing, L = np.array(exact) - packed, _with_prior(split, packed)
    half = np.linalg.solve(L, unpacked(missing[:, :-1]) / split.level**2)
    more = np.asarray(np.linalg.solve(L, half.swapaxes(1, 2)), dtype=float)
    missing[:, :-1] = packed_of(more)
    correction = np.linalg.lstsq(_powers(places - middle), missing, rcond=None)[0]
    return replace(split, correction=np.asarray(correction), middle=middle, reach=reach)


def _powers(away: FloatArray) -> FloatArray:
    """Terms of the polynomial (m, 5): 1, b, b^2, k, k^2."""
    b, k = away.T
    return np.column_stack((np.ones(len(b)), b, b * b, k, k * k))


def _bare(rows: Linear, run: RunSummary, c: Coordinates) -> Split:
    blocks = blocks_of(rows, len(rows) if len(rows) <= WHOLE or rows.stream else BLOCKS)
    parts, within, rise = processes(rows.rows, run.noise), np.zeros_like(c.prior), np.zeros(2)
    if len(blocks) < rows.samples:
        within = c.gram(within_blocks(rows))
        # variance within a block by unit B and K, relative to that of unit white noise in a sample: of blocks
        # of the mean number of rows, those of a single row (beside lost samples) left aside
        counts = np.diff(np.append(block_edges(rows.t, rows.interval), len(rows)))
        counts = rows.counts if rows.stream else counts
        count = float(counts[counts > 1].mean())
        sample = float(rows.duration.sum()) / rows.samples
        gained = averaged_variance(sample / parts.tau) - averaged_variance(count * sample / parts.tau)
        flicker = float(np.sum(parts.variance * gained)) * count / (count - 1.0)
        rise = np.array([sample * flicker + parts.white, sample * sample * (count + 1.0) / 6.0])
    table, when = c.of_rows(np.column_stack((blocks.X, blocks.y))), blocks.rows
    units, inside = nbk(parts, when), rows.samples - len(blocks)
    none, nothing = np.zeros((0, 0)), np.zeros(2)
    return Split(table, when, units, parts, within, inside, rise, c, run.noise.N, none, nothing, nothing)


def values_at(split: Split, ratios: FloatArray) -> FloatArray:
    """Packed Gram matrices and log determinants (m, e) at N = 1 and ln B, ln K (m, 2), corrected."""
    noises, p = np.column_stack((np.ones(len(ratios)), np.exp(ratios))), len(split.c.prior)
    level = 1.0 + noises[:, 1:] ** 2 @ split.rise
    packed = np.empty((len(ratios), p * (p + 1) // 2 + 1))
    for own, noise, share in zip(packed, noises, level.tolist(), strict=True):
        white = split.table.copy()
        d = whiten_by(split.units.sized(noise), split.rows, white)
        own[:-1] = packed_of(white.T @ white + split.within / share)
        own[-1] = float(np.sum(np.log(d))) + split.inside * math.log(share)
    if not len(split.correction):
        return packed
    missing = _powers(np.clip(ratios - split.middle, -split.reach, split.reach)) @ split.correction
    L = _with_prior(split, packed)
    missing[:, :-1] = packed_of(L @ unpacked(missing[:, :-1]) @ L.swapaxes(1, 2) * split.level**2)
    return packed + missing


def _with_prior(split: Split, packed: FloatArray) -> FloatArray:
    """Cholesky factors of the Gram matrices at the white noise `level`, with the prior's."""
    gram = unpacked(packed[:, :-1]) / split.level**2 + _held(split)
    return np.asarray(np.linalg.cholesky(gram), dtype=float)


def _held(split: Split) -> FloatArray:
    """Gram matrix of the prior's rows, and of what holds a run alone where the others hold it."""
    return split.c.prior + HOLD * np.eye(len(split.c.prior))


def unpacked(triangle: FloatArray) -> FloatArray:
    """Whole symmetric matrices (..., k, k) of packed lower triangles (..., e)."""
    rows, columns = lower(size := math.isqrt(2 * triangle.shape[-1]))
    gram = np.empty((*triangle.shape[:-1], size, size))
    gram[..., rows, columns] = gram[..., columns, rows] = triangle
    return gram


def roots(A: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Cholesky factors of matrices (m, k, k), and which of them have one; the others get the identity's."""
    try:
        return np.asarray(np.linalg.cholesky(A), dtype=float), np.ones(len(A), dtype=bool)
    except np.linalg.LinAlgError:  # far from the posterior polynomials may not be positive definite
        sound = np.linalg.eigvalsh(A)[:, 0] > 0.0
        L = np.linalg.cholesky(np.where(sound[:, None, None], A, np.eye(A.shape[1])))
        return np.asarray(L, dtype=float), np.asarray(sound, dtype=bool)


def packed_of(gram: FloatArray) -> FloatArray:
    """Lower triangles of symmetric matrices (..., k, k), row by row."""
    return gram[..., *lower(gram.shape[-1])]


@cache
def lower(size: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows and columns of a lower triangle, row by row."""
    return np.tril_indices(size)


def log_densities(packed: FloatArray, split: Split, log_n: FloatArray) -> FloatArray:
    """Log marginal likelihoods (m,) of the run alone, up to a constant; -inf where there is none.

    They are of m Gram matrices and log determinants, packed (m, e), at white noise N (m,).
    """
    L, sound = roots(unpacked(packed[:, :-1]) * np.exp(-2.0 * log_n)[:, None, None] + _held(split))
    diagonal = np.diagonal(L, axis1=1, axis2=2)
    log_det = packed[:, -1] + 2.0 * (split.inside + len(split.table)) * log_n
    found = -0.5 * (log_det + diagonal[:, -1] ** 2) - np.sum(np.log(diagonal[:, :-1]), axis=1)
    return np.where(sound, found, -np.inf)


@dataclass(frozen=True, slots=True, eq=False)
class Coordinates:
    """Coefficients ``theta = origin + inverse phi``: phi is standard normal at the estimated noise.

    The origin (p,) is the posterior mean, the inverse (p, p) that of the factor of rows and prior, upper
    triangular, of a log determinant `log_volume`; `prior` (p + 1, p + 1) is the Gram matrix of the prior's
    rows in these coordinates.
    """

    origin: FloatArray
    inverse: FloatArray
    prior: FloatArray
    log_volume: float

    def gram(self, R: FloatArray) -> FloatArray:
        """Gram matrix (p + 1, p + 1) of rows with the factor R, their response taken relative to `origin`."""
        T = self.of_rows(R)
        return T.T @ T

    def of_rows(self, table: FloatArray) -> FloatArray:
        """Rows (n, p + 1) of columns and response in these coordinates."""
        X, y = table[:, :-1], table[:, -1]
        return np.column_stack((X @ self.inverse, y - X @ self.origin))


def coordinates(f: Factor, sd: FloatArray) -> Coordinates:
    """Coordinates of the posterior under prior sds (p,) at the noise that whitened the factor."""
    T = with_prior_rows(f.R, 1.0 / sd)
    inverse = invert_triangular(T[:-1, :-1])
    origin = inverse @ T[:-1, -1]
    volume = float(np.sum(np.log(np.abs(np.diag(inverse)))))
    bare = Coordinates(origin, inverse, np.zeros((0, 0)), volume)
    rows = np.column_stack((np.diag(1.0 / sd), np.zeros(len(sd))))
    return Coordinates(origin, inverse, bare.gram(rows), volume)
