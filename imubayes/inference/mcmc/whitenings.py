"""Gram matrices of a run's rows at any noise, from whitenings that were computed beforehand.

The covariance is ``N^2 C(B/N, K/N)``, so that only two ratios need a grid; N is a factor. A run's rows are
split into averages over short blocks, which are whitened exactly, and what the averages leave, which is white
but for a small rise of its variance by B and K. The sum is set to the exact factor of all rows at the
estimated noise, so the split only costs accuracy away from it; `interpolation_error` of the chains says how
much. On the grid the entries are smooth, and Chebyshev polynomials run through them.

Gram matrices may be used here, and nowhere else, because their columns have been made orthonormal first: in
the coordinates of `Coordinates` the matrix is the identity at the estimated noise, and its condition number
elsewhere is that of the change of noise alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from imubayes.factor import Factor, invert_triangular, with_prior_rows
from imubayes.inference.linear import Linear, blocks_of, whitened_factor, within_blocks
from imubayes.inference.reml import Blocks
from imubayes.inference.summary import RunSummary
from imubayes.inference.whiten import Processes, averaged_variance, mattering, whiten, whitener
from imubayes.sensors.noise import Noise

FloatArray = NDArray[np.float64]

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

REACH = 6.0
"""Sds of ln(B/N) to which the correction to exact whitenings is followed."""

TOLERANCE = 0.01
"""Nats: error of the log density that the polynomials may have."""

ORDERS = (7, 11, 16, 23, 33, 47)
"""Numbers of polynomials that are tried in each ratio."""

ALONG = 10
"""Probes of them along a line."""

PROBES = 24
"""Points at which the polynomials are held against whitenings."""


@dataclass(frozen=True, slots=True, eq=False)
class Coordinates:
    """Coefficients ``theta = origin + inverse phi``: standard normal at the estimated noise.

    Attributes
    ----------
    origin : (p,) posterior mean.
    inverse : (p, p) upper triangular, of the factor of rows and prior.
    prior : (p + 1, p + 1) Gram matrix of the prior's rows in these coordinates.
    log_volume : log determinant of `inverse`.
    """

    origin: FloatArray
    inverse: FloatArray
    prior: FloatArray
    log_volume: float

    def gram(self, R: FloatArray) -> FloatArray:
        """Gram matrix (p + 1, p + 1) of rows with the factor R, their response taken relative to `origin`."""
        T = np.column_stack((R[:, :-1] @ self.inverse, R[:, -1] - R[:, :-1] @ self.origin))
        return T.T @ T


@dataclass(frozen=True, slots=True, eq=False)
class Whitenings:
    """Gram matrix and log determinant of one run over ln(B/N) and ln(K/N), at N = 1.

    Attributes
    ----------
    n : rows.
    low, high : (2,) ends of the ratios' logarithms.
    flat : (2,) whether a smaller ratio than `low` changes nothing.
    order : (2,) polynomials in each ratio.
    table : (order[0] * order[1], e) coefficients of the Gram's lower triangle and the log determinant.
    error : largest error of the log density that the probes found, nats.
    top : (3,) ln N, ln B, ln K at the maximum of the run's own posterior; (1,) ln N where that is all.
    """

    n: int
    low: FloatArray
    high: FloatArray
    flat: NDArray[np.bool_]
    order: tuple[int, int]
    table: FloatArray
    error: float
    top: FloatArray


def coordinates(f: Factor, sd: FloatArray) -> Coordinates:
    """Coordinates of the posterior under prior sds (p,) at the noise that whitened the factor."""
    T = with_prior_rows(f.R, 1.0 / sd)
    inverse = invert_triangular(T[:-1, :-1])
    origin = inverse @ T[:-1, -1]
    volume = float(np.sum(np.log(np.abs(np.diag(inverse)))))
    bare = Coordinates(origin, inverse, np.zeros((0, 0)), volume)
    rows = np.column_stack((np.diag(1.0 / sd), np.zeros(len(sd))))
    return Coordinates(origin, inverse, bare.gram(rows), volume)


def fixed_whitening(run: RunSummary, c: Coordinates) -> Whitenings:
    """Whitening of a run whose noise is known but for its level N, if that."""
    scaled = run.factor.R * run.noise.N
    gram = c.gram(scaled)
    log_det = run.factor.log_det - 2.0 * run.factor.n * math.log(run.noise.N)
    table = np.append(gram[np.tril_indices(len(gram))], log_det)[None, :]
    nothing = np.zeros(2)
    level = np.log([run.noise.N])
    return Whitenings(run.factor.n, nothing, nothing, np.ones(2, dtype=bool), (1, 1), table, 0.0, level)


def whitenings(rows: Linear, run: RunSummary, c: Coordinates, rng: np.random.Generator) -> Whitenings:
    """Whitenings of a run whose N, B and K are to be sampled.

    Parameters
    ----------
    rows : of the run.
    run : its summary, with the estimated noise that the search starts from.
    c : coordinates of the coefficients.
    rng : for the probes.
    """
    split, top = _corrected(rows, run, c)
    sd = np.hypot(run.noise_sd[1:], run.noise_sd[0])
    ends = [_ends(split, top, np.array(run.steering), float(sd[axis - 1]), axis) for axis in (1, 2)]
    low, high = (np.array([end[side] for end in ends]) for side in (0, 1))
    flat = np.array([end[2] for end in ends])
    middle = top[1:] - top[0]
    probes = np.clip(middle + sd * rng.standard_normal((PROBES, 2)), low, high)
    bare = Whitenings(len(rows), low, high, flat, (1, 1), np.empty((0, 0)), 0.0, top)
    orders = [_enough(split, top, bare, (axis, middle, probes[:ALONG])) for axis in range(2)]
    order = (orders[0], orders[1])
    made = replace(bare, order=order, table=_chebyshev(split, low, high, order))
    return replace(made, error=_error(split, top, made, probes))


def _enough(
    split: _Split, top: FloatArray, bare: Whitenings, along: tuple[int, FloatArray, FloatArray]
) -> int:
    """Polynomials that one ratio needs, tried along a line through the maximum on which the other is held."""
    axis, middle, probes = along
    low, high, places = middle.copy(), middle + 1.0, np.repeat(middle[None], len(probes), axis=0)
    low[axis], high[axis], places[:, axis] = bare.low[axis], bare.high[axis], probes[:, axis]
    count = 1
    for count in ORDERS:
        order = (count, 1) if axis == 0 else (1, count)
        ends = (low, np.where(np.arange(2) == axis, high, middle))
        line = replace(bare, low=low, high=high, order=order, table=_chebyshev(split, *ends, order))
        if _error(split, top, line, places) < TOLERANCE:
            break
    return count


def _error(split: _Split, top: FloatArray, w: Whitenings, places: FloatArray) -> float:
    """Largest error of the log density (nats) at `places` (m, 2), N at the maximum."""
    exact = [_log_density(_at(split, *place), split, float(top[0])) for place in places]
    try:
        made = [_log_density(packed, split, float(top[0])) for packed in _evaluate(w, places)]
    except np.linalg.LinAlgError:
        return math.inf  # so few polynomials that the matrix is not even positive definite
    return float(np.max(np.abs(np.subtract(made, exact))))


def grams(w: Whitenings, log_noise: FloatArray) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Gram matrices, log determinants and validity at noises given by ln N, ln B, ln K: (m, 3) or (m, 1).

    Returns
    -------
    (m, p + 1, p + 1), (m,), (m,) : the last is False outside the ratios that were computed.
    """
    if w.table.shape[0] == 1:
        values, inside = np.repeat(w.table, len(log_noise), axis=0), np.ones(len(log_noise), dtype=bool)
    else:
        ratio = log_noise[:, 1:] - log_noise[:, :1]
        inside = np.asarray((ratio <= w.high) & ((ratio >= w.low) | w.flat)).all(axis=1)
        values = _evaluate(w, np.clip(ratio, w.low, w.high))
    scale = np.exp(-2.0 * log_noise[:, 0])
    size = math.isqrt(2 * (values.shape[1] - 1))
    full = np.zeros((len(values), size, size))
    rows, columns = np.tril_indices(size)
    full[:, rows, columns] = values[:, :-1] * scale[:, None]
    full[:, columns, rows] = full[:, rows, columns]
    return full, values[:, -1] + 2.0 * w.n * log_noise[:, 0], np.asarray(inside, dtype=bool)


def _evaluate(w: Whitenings, ratio: FloatArray) -> FloatArray:
    unit = 2.0 * (ratio - w.low) / (w.high - w.low) - 1.0
    first, second = (np.polynomial.chebyshev.chebvander(unit[:, k], w.order[k] - 1) for k in range(2))
    both = (first[:, :, None] * second[:, None, :]).reshape(len(ratio), -1)
    return both @ w.table


@dataclass(frozen=True, slots=True, eq=False)
class _Split:
    """A run as block averages and what they leave.

    `correction` (k, e) adds to the packed values what exact whitenings have more, as a polynomial in the
    distance of ln(B/N) from `middle`, which is followed to `reach` on both sides.
    """

    blocks: Blocks
    stacked: FloatArray
    parts: Processes
    within: FloatArray
    inside: int
    rise: tuple[float, float]
    c: Coordinates
    correction: FloatArray
    middle: float = 0.0
    reach: float = 0.0


def _corrected(rows: Linear, run: RunSummary, c: Coordinates) -> tuple[_Split, FloatArray]:
    """Split with its correction from three exact whitenings, and ln N, ln B, ln K (3,) at its maximum."""
    from scipy.optimize import minimize

    split = _split(rows, run, c)
    center, width = np.array([(math.log(m), s) for m, s in run.steering]).T

    def cost(x: FloatArray) -> float:
        pull = 0.5 * float(np.sum(((x - center) / width) ** 2))
        return pull - _log_density(_at(split, x[1] - x[0], x[2] - x[0]), split, float(x[0]))

    start = np.log([run.noise.N, run.noise.B, run.noise.K])
    corners = start + np.vstack((np.zeros(3), np.diag(run.noise_sd)))
    options = {"initial_simplex": corners, "xatol": 1e-3, "fatol": 1e-2, "maxiter": 150}
    top = minimize(cost, start, method="Nelder-Mead", options=options).x
    reach = REACH * float(np.hypot(run.noise_sd[0], run.noise_sd[1]))
    beta, kappa = float(top[1] - top[0]), float(top[2] - top[0])
    places = beta + 0.5 * reach * np.array([-1.0, 0.0, 1.0])
    missing = [_exact(rows, split, at, kappa) - _at(split, at, kappa) for at in places]
    polynomials = np.linalg.solve(np.vander(places - beta, 3, increasing=True), np.array(missing))
    return replace(split, correction=polynomials, middle=beta, reach=reach), top


def _split(rows: Linear, run: RunSummary, c: Coordinates) -> _Split:
    blocks = blocks_of(rows)
    parts = mattering(run.noise, rows.rows)
    return _Split(
        blocks=blocks,
        stacked=np.column_stack((blocks.X, blocks.y)),
        parts=parts,
        within=c.gram(within_blocks(rows)),
        inside=len(rows) - len(blocks.y),
        rise=_rise(rows, blocks, parts),
        c=c,
        correction=np.zeros((1, 1)),
    )


def _exact(rows: Linear, split: _Split, log_b: float, log_k: float) -> FloatArray:
    """Packed Gram and log determinant of all rows at N = 1."""
    noise = Noise(1.0, math.exp(log_b), math.exp(log_k))
    f, _ = whitened_factor(rows, noise, split.parts)
    return np.append(_packed(split.c.gram(f.R)), f.log_det)


def _rise(rows: Linear, blocks: Blocks, parts: Processes) -> tuple[float, float]:
    """Variance within a block by unit B and by unit K, relative to that of unit white noise in a sample."""
    if len(blocks.y) == len(rows):
        return 0.0, 0.0
    sample, block = float(np.median(rows.duration)), float(np.median(blocks.rows.duration))
    count = block / sample
    gained = averaged_variance(sample / parts.tau) - averaged_variance(block / parts.tau)
    flicker = float(np.sum(parts.variance * gained)) * count / (count - 1.0)
    return sample * flicker, sample * sample * (count + 1.0) / 6.0


def _at(split: _Split, log_b: float, log_k: float) -> FloatArray:
    """Packed Gram and log determinant at N = 1, of the split with its correction."""
    b, k = math.exp(log_b), math.exp(log_k)
    w = whitener(Noise(1.0, b, k), split.blocks.rows, split.parts)
    white = whiten(w, split.stacked.copy())
    gram = split.c.gram(np.asarray(np.linalg.qr(white, mode="r")))
    level = 1.0 + split.rise[0] * b * b + split.rise[1] * k * k
    log_det = w.log_det + split.inside * math.log(level)
    away = np.clip(log_b - split.middle, -split.reach, split.reach) ** np.arange(len(split.correction))
    return np.append(_packed(gram + split.within / level), log_det) + away @ split.correction


def _packed(gram: FloatArray) -> FloatArray:
    return gram[np.tril_indices(len(gram))]


def _chebyshev(split: _Split, low: FloatArray, high: FloatArray, order: tuple[int, int]) -> FloatArray:
    """Coefficients of the tensor product through the Chebyshev points of the first kind."""
    points = [np.cos(np.pi * (np.arange(count) + 0.5) / count) for count in order]
    first, second = (low[k] + 0.5 * (high[k] - low[k]) * (points[k] + 1.0) for k in range(2))
    values = np.array([[_at(split, b, k) for k in second] for b in first])
    for axis, (count, x) in enumerate(zip(order, points, strict=True)):
        transform = 2.0 / count * np.polynomial.chebyshev.chebvander(x, count - 1).T
        transform[0] *= 0.5
        values = np.moveaxis(np.tensordot(transform, values, axes=(1, axis)), 0, axis)
    return values.reshape(order[0] * order[1], -1)


def _ends(
    split: _Split, top: FloatArray, steering: FloatArray, sd: float, axis: int
) -> tuple[float, float, bool]:
    """How far the logarithm of one ratio is followed: (low, high, whether lower changes nothing)."""
    start = float(top[axis] - top[0])
    center = math.log(steering[axis, 0]) - top[0]

    def density(at: float) -> tuple[float, float]:
        point = top - top[0]
        point[axis] = at
        likelihood = _log_density(_at(split, *point[1:]), split, float(top[0]))
        return likelihood, likelihood - 0.5 * ((at - center) / steering[axis, 1]) ** 2

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


def _log_density(packed: FloatArray, split: _Split, log_n: float) -> float:
    """Log marginal likelihood of the run alone at white noise N, up to a constant."""
    size = len(split.c.prior)
    gram = np.zeros((size, size))
    gram[np.tril_indices(size)] = packed[:-1] * math.exp(-2.0 * log_n)
    gram = gram + np.tril(gram, -1).T + split.c.prior
    diagonal = np.diag(np.linalg.cholesky(gram))
    rows = split.inside + len(split.blocks.y)
    log_det = float(packed[-1]) + 2.0 * rows * log_n
    return -0.5 * log_det - float(np.sum(np.log(diagonal[:-1]))) - 0.5 * float(diagonal[-1] ** 2)
