"""Gram matrices of a run's rows at any noise, from whitenings that were computed beforehand.

The covariance is ``N^2 C(B/N, K/N)``, so that only two ratios need a grid; N is a factor. On the grid the
values of `split` are smooth, and Chebyshev polynomials run through them; `interpolation_error` of the chains
says how well.

Gram matrices may be used here, and nowhere else, because their columns have been made orthonormal first: in
the coordinates of `Coordinates` the matrix is the identity at the estimated noise, and its condition number
elsewhere is that of the change of noise alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial.chebyshev import chebvander
from numpy.typing import NDArray

from imubayes.algebra import FloatArray
from imubayes.inference.linear import Linear
from imubayes.inference.mcmc.split import (
    Coordinates,
    Split,
    log_densities,
    log_likelihoods,
    packed_of,
    splits_of,
    values_at,
)
from imubayes.inference.summary import RunSummary

SPENT = 18.0
"""Log of the density's fall at which a ratio has been followed far enough: exp(-18) = 1.5e-8."""

WIDER = 1.4
"""Factor on that distance: the other ratio is held still while one is followed."""

NEGLIGIBLE = 1e-3
"""Nats below which a process that is made smaller no longer changes anything."""

STEP = 0.5
"""First step of the search for the ends, in posterior sds of the logarithm."""

GROWTH = 1.2
"""Ratio of a step to the one before."""

SEARCH = 40
"""Most steps of that search."""

TOLERANCE = 0.01
"""Nats: error of the log density that the polynomials may have."""

ORDERS = (7, 11, 16, 23, 33, 47)
"""Numbers of polynomials that are tried in each ratio."""

ANYWHERE, LEVELS = 40, 23
"""Places anywhere on the grid, and levels of white noise there, at which the polynomials must not mislead."""

ALONG = 10
"""Probes of them along a line."""

ROUNDED = 1e-6
"""Size of a combination, at the run's own noise, from which it is kept; some ten times as many nats."""

MANY = 600
"""Polynomials from which it takes longer to find the combinations than they save."""

PROBES = 24
"""Points at which the polynomials are held against whitenings."""


@dataclass(frozen=True, slots=True, eq=False)
class Whitenings:
    """Gram matrix and log determinant of one run over ln(B/N) and ln(K/N), at N = 1.

    Attributes
    ----------
    n : rows.
    low, high : (2,) ends of the ratios' logarithms.
    flat : (2,) whether a smaller ratio than `low` changes nothing.
    order : (2,) polynomials in each ratio.
    table : (r, e) of the Gram's lower triangle and the log determinant: coefficients of the polynomials, or
        of the r combinations of them that matter.
    basis : (order[0] * order[1], r) of these combinations; None where `table` has the polynomials singly.
    error : largest error of the log density that the probes found, nats.
    top : (3,) ln N, ln B, ln K at the maximum of the run's own posterior; (1,) ln N where that is all.
    misleads : whether the polynomials make a noise likely that is not, however many they are.
    """

    n: int
    low: FloatArray
    high: FloatArray
    flat: NDArray[np.bool_]
    order: tuple[int, int]
    table: FloatArray
    error: float
    top: FloatArray
    misleads: bool = False
    basis: FloatArray | None = None


def fixed_whitening(run: RunSummary, c: Coordinates) -> Whitenings:
    """Whitening of a run whose noise is known but for its level N, if that."""
    N = run.noise.N if run.found.steering else 1.0
    gram = c.gram(run.factor.R * N)
    log_det = run.factor.log_det - 2.0 * run.factor.n * math.log(N)
    table = np.append(packed_of(gram), log_det)[None, :]
    nothing, flat = np.zeros(2), np.ones(2, dtype=bool)
    return Whitenings(run.factor.n, nothing, nothing, flat, (1, 1), table, 0.0, np.log([N]))


def whitenings(
    rows: Sequence[Linear], runs: Sequence[RunSummary], c: Coordinates, rng: np.random.Generator
) -> tuple[Whitenings, ...]:
    """Whitenings of runs that share N, B and K, which are to be sampled; `rng` is for the probes."""
    splits, top = splits_of(rows, runs, c)
    sd = np.hypot(runs[0].found.sd[1:], runs[0].found.sd[0])
    steering = list(runs[0].found.steering.values())
    ends = [_ends(splits, top, steering[axis], float(sd[axis - 1]), axis) for axis in (1, 2)]
    low, high = (np.array([end[side] for end in ends]) for side in (0, 1))
    flat = np.array([end[2] for end in ends])
    probes = np.clip(top[1:] - top[0] + sd * rng.standard_normal((PROBES, 2)), low, high)
    anywhere = low + (high - low) * rng.random((ANYWHERE, 2))
    bare = Whitenings(0, low, high, flat, (1, 1), np.empty((0, 0)), 0.0, top)
    return tuple(
        _interpolated(split, replace(bare, n=part.samples), probes, anywhere)
        for split, part in zip(splits, rows, strict=True)
    )


def _interpolated(split: Split, bare: Whitenings, probes: FloatArray, anywhere: FloatArray) -> Whitenings:
    """Polynomials through the values of a split, as many as it takes."""
    exact = _exact(split, bare, probes)
    first, second = (_enough(split, bare, axis, probes[:ALONG]) for axis in range(2))
    while True:
        order = (first, second)
        made = replace(bare, order=order, table=_chebyshev(split, bare.low, bare.high, order))
        misleads = _misleads(split, made, anywhere)
        if not misleads or order == (ORDERS[-1], ORDERS[-1]):
            if len(made.table) <= MANY:  # the few combinations that matter, at the level of the run's noise
                scale = np.append(np.full(made.table.shape[1] - 1, math.exp(-2.0 * made.top[0])), 1.0)
                U, s, V = np.linalg.svd(made.table * scale, full_matrices=False)
                kept = s > ROUNDED
                made = replace(made, basis=U[:, kept] * s[kept], table=V[kept] / scale)
            return replace(made, error=_error(split, made, probes, exact), misleads=misleads)
        first, second = (next((n for n in ORDERS if n > count), ORDERS[-1]) for count in order)


def _misleads(split: Split, w: Whitenings, places: FloatArray) -> bool:
    """Whether the polynomials make one of the `places` (m, 2) likely that is not.

    A walker that comes there would stay.
    """
    best = float(_exact(split, w, (w.top[1:] - w.top[0])[None])[0])
    made = _over_levels(_evaluate(w, places), split, w.top[0])
    likely = made > best - SPENT
    if not likely.any():
        return False
    exact = _over_levels(values_at(split, places[likely]), split, w.top[0])
    return bool(np.any(made[likely] - exact > 1.0))


def _over_levels(packed: FloatArray, split: Split, log_n: float) -> FloatArray:
    """Largest log density (m,) over white noise from a third to three times as strong."""
    levels = np.tile(log_n + np.linspace(-1.1, 1.1, LEVELS), len(packed))
    return log_densities(np.repeat(packed, LEVELS, axis=0), split, levels).reshape(-1, LEVELS).max(axis=1)


def _enough(split: Split, bare: Whitenings, axis: int, probes: FloatArray) -> int:
    """Polynomials that one ratio needs, tried along a line through the maximum on which the other is held."""
    middle = bare.top[1:] - bare.top[0]
    low, high, places = middle.copy(), middle + 1.0, np.repeat(middle[None], len(probes), axis=0)
    low[axis], high[axis], places[:, axis] = bare.low[axis], bare.high[axis], probes[:, axis]
    exact, count = _exact(split, bare, places), 1
    for count in ORDERS:
        order = (count, 1) if axis == 0 else (1, count)
        ends = (low, np.where(np.arange(2) == axis, high, middle))
        line = replace(bare, low=low, high=high, order=order, table=_chebyshev(split, *ends, order))
        if _error(split, line, places, exact) < TOLERANCE:
            break
    return count


def _error(split: Split, w: Whitenings, places: FloatArray, exact: FloatArray) -> float:
    """Largest error of the log density (nats) at `places` (m, 2), `exact` there (m,); inf if none."""
    made = log_densities(_evaluate(w, places), split, np.full(len(places), w.top[0]))
    return float(np.max(np.abs(made - exact))) if np.isfinite(made).all() else math.inf


def _exact(split: Split, w: Whitenings, places: FloatArray) -> FloatArray:
    """Log density (m,) at `places` (m, 2), N at the maximum, without polynomials."""
    return log_densities(values_at(split, places), split, np.full(len(places), w.top[0]))


def grams(w: Whitenings, log_noise: FloatArray) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Gram matrices (m, e), packed, and log determinants (m,) at ln N, ln B, ln K, (m, 3) or (m, 1).

    With them comes whether a noise is inside the ratios that were computed, (m,).
    """
    if w.order == (1, 1):
        values, inside = np.repeat(w.table, len(log_noise), axis=0), np.ones(len(log_noise), dtype=bool)
    else:
        ratio = log_noise[:, 1:] - log_noise[:, :1]
        inside = np.asarray((ratio <= w.high) & ((ratio >= w.low) | w.flat)).all(axis=1)
        values = _evaluate(w, np.clip(ratio, w.low, w.high))
    scale = np.exp(-2.0 * log_noise[:, 0])
    log_det = values[:, -1] + 2.0 * w.n * log_noise[:, 0]
    return values[:, :-1] * scale[:, None], log_det, np.asarray(inside, dtype=bool)


def _evaluate(w: Whitenings, ratio: FloatArray) -> FloatArray:
    unit = 2.0 * (ratio - w.low) / (w.high - w.low) - 1.0
    first, second = (chebvander(unit[:, k], w.order[k] - 1) for k in range(2))
    both = (first[:, :, None] * second[:, None, :]).reshape(len(ratio), -1)
    return (both if w.basis is None else both @ w.basis) @ w.table


def _chebyshev(split: Split, low: FloatArray, high: FloatArray, order: tuple[int, int]) -> FloatArray:
    """Coefficients of the tensor product through the Chebyshev points of the first kind."""
    points = [np.cos(np.pi * (np.arange(count) + 0.5) / count) for count in order]
    first, second = (low[k] + 0.5 * (high[k] - low[k]) * (points[k] + 1.0) for k in range(2))
    places = np.array([(b, k) for b in first for k in second])
    values = values_at(split, places).reshape(*order, -1)
    for axis, (count, x) in enumerate(zip(order, points, strict=True)):
        transform = 2.0 / count * chebvander(x, count - 1).T
        transform[0] *= 0.5
        values = np.moveaxis(np.tensordot(transform, values, axes=(1, axis)), 0, axis)
    return values.reshape(order[0] * order[1], -1)


def _ends(
    splits: Sequence[Split], top: FloatArray, steering: tuple[float, float], sd: float, axis: int
) -> tuple[float, float, bool]:
    """How far the logarithm of one ratio is followed: (low, high, whether lower changes nothing)."""
    start = float(top[axis] - top[0])
    center = math.log(steering[0]) - top[0]

    def density(at: float) -> tuple[float, float]:
        point = top.copy()
        point[axis] = top[0] + at
        likelihood = float(log_likelihoods(splits, point[None])[0])
        return likelihood, likelihood - 0.5 * ((at - center) / steering[1]) ** 2

    without, best = density(-math.inf)[0], density(start)[1]
    steps = STEP * max(sd, 0.05) * np.cumsum(GROWTH ** np.arange(SEARCH))
    low = high = start
    flat = False
    for low in start - steps:
        likelihood, posterior = density(float(low))
        flat = abs(likelihood - without) < NEGLIGIBLE
        if flat or posterior < best - SPENT:
            break
    for high in start + steps:
        if density(float(high))[1] < best - SPENT:
            break
    below = start - low if flat else WIDER * (start - low)
    return float(start - below), float(start + WIDER * (high - start)), flat
