"""Noise of a run by restricted maximum likelihood, with the full library in the mean.

What the library can explain is projected out before the noise is judged, so that a coefficient is not
mistaken for drift nor drift for a coefficient. The rows are averages over short blocks: the model is linear,
so averages of its columns are exact, and only the noise within a block is lost. White noise, bias instability
and random walk, or quantization, a ramp and a Gauss-Markov process beside them, are parameters of one model.

With the whitened columns and response ``W = [W_x w]``, R their triangular factor with the rows of the prior,
the likelihood is ``-sum(ln d)/2 - sum(ln |R_jj|) - rho^2/2``, and by the whitened rows it changes by
``e beta' - W_x (R_x' R_x)^-1`` and ``-e``, with the coefficients beta and what they leave, e. From there the
whitening is gone through backwards to the sizes of the processes.

What processes a run has is judged by averages of many lengths, whatever the number of samples. Quantization
and white noise show in single samples, random walk and ramp only over the whole run. So most of the run is
averaged to long blocks, and a stretch of it for each shorter length is cut finer. The likelihood of these
averages is exact; what is lost is the noise within the blocks outside the stretches.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import FloatArray
from imubayes.algebra.factor import invert_triangular, triangular
from imubayes.inference.linear import Linear, Rows, averages, block_edges, blocks_of, stretch_of, with_columns
from imubayes.inference.minimum import minimum
from imubayes.inference.whiten import (
    Processes,
    States,
    apart,
    common,
    flickering,
    gauss_markov,
    nbk_states,
    processes,
    quantization,
    together,
    whiten_by,
)
from imubayes.rig.inputs import Stream
from imubayes.sensors.noise import Noise, NoisePrior, allan_variance, vague_prior

RANK = 1e-7
"""Singular values of the scaled mean's columns below this share of the largest are left out.

Rotations of mounts beside misalignments leave some near 1e-9, the square of an angle: what decided on these
would be rounding.
"""

NBK = ("N", "B", "K")
"""White noise, bias instability and random walk: what a decision takes into account."""

REACH = 6.0
"""Prior sds of the logarithms within which the maximum is sought."""

STEP = 1e-3
"""Step in the logarithm of a time constant of the difference that its slope is."""

IMPOSSIBLE = -1e300
"""Log likelihood of what is no covariance."""


@dataclass(frozen=True, slots=True)
class NoiseEstimate:
    """Noise of rows: at the maximum of its restricted posterior, or as a rule says.

    Attributes
    ----------
    noise : N, B, K, SI.
    sd : of ln N, ln B, ln K (from the curvature); 0 where the noise was given.
    prior : of the class for each; empty without a class.
    steering : that the estimate was made under, with a class or without; of N alone for white noise of
        unknown scale; empty where the noise was given.
    origin : ``REML``, ``white``, ``given``, ``class`` or ``run <name>``.
    run : the other run whose noise it is; empty for the run's own.
    """

    noise: Noise
    sd: tuple[float, float, float] = (0.0, 0.0, 0.0)
    prior: NoisePrior = field(default_factory=dict)
    steering: NoisePrior = field(default_factory=dict)
    origin: str = "REML"
    run: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class NoiseModel:
    """Rows of a run, and the processes that their noise may have.

    Attributes
    ----------
    rows : when they were taken.
    table : (n, r + 1) columns of the mean, and the response.
    means : of each model of the mean the columns (k,) that it has, and roots (k,) of their prior precision.
    states : of each process of unit size that has fixed states.
    prior : of the processes that are looked for.
    joined : (n,) whether a row begins where the one before it ends, where processes are looked for.
    levels : (length of a row in s, how many) of each length, as `noise_rows` has them.
    """

    rows: Rows
    table: FloatArray
    means: tuple[tuple[NDArray[np.intp], FloatArray], ...]
    states: Mapping[str, States]
    prior: NoisePrior
    joined: NDArray[np.bool_] = field(default_factory=lambda: np.empty(0, dtype=bool))
    levels: tuple[tuple[float, int], ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Likelihood:
    """Restricted log likelihood at one point, up to a constant that all sets of processes share.

    `levels` (m,) are those of each model of the mean, `last` (mean, sd) of the last column's coefficient
    under the last of them, and `slope` (k,) the derivatives of the logarithm of their sum by the logarithms,
    empty where not asked for.
    """

    levels: FloatArray
    last: tuple[float, float]
    slope: FloatArray

    @property
    def level(self) -> float:
        """Logarithm of the sum over the models of the mean."""
        return float(np.logaddexp.reduce(self.levels))


def estimate(blocks: Linear, prior: NoisePrior | None = None, sd: FloatArray | None = None) -> NoiseEstimate:
    """Noise parameters at the maximum of their restricted posterior.

    Parameters
    ----------
    blocks : averaged rows of one run.
    prior : of N, B, K; vague and from the data if None or empty.
    sd : (p,) prior sds of the coefficients; None takes the whole span of the columns out (REML). With fewer
        rows than columns need, only a proper prior leaves anything to judge the noise by.
    """
    level = scatter(blocks.y, blocks.duration)
    vague = vague_prior(level, blocks.rows.span, float(blocks.duration.min()))
    steering = prior or {name: vague[name] for name in NBK}
    model = nbk_model(blocks, steering, sd)
    (_, B, K), (_, by_B, by_K) = prior_of(model, NBK)

    def start(K: float) -> FloatArray:
        places = [np.array([math.log(level), B + shift * by_B, K]) for shift in (-2.0, 0.0, 2.0)]
        return min(places, key=lambda x: cost(model, NBK, x)[0])

    # what wanders can be bias instability or random walk: there may be two maxima
    best, covariance = mode_of(model, NBK, np.array([start(K), start(K + 2.0 * by_K)]))
    closer = processes(blocks.rows, Noise(*np.exp(best).tolist()))
    if len(closer.tau) > len(model.states["B"].rates):
        best, covariance = mode_of(nbk_model(blocks, steering, sd, closer), NBK, best)
    N, B, K = np.exp(best).tolist()
    spread = np.sqrt(np.diag(covariance))
    return NoiseEstimate(Noise(N, B, K), (spread[0], spread[1], spread[2]), prior or {}, steering)


def nbk_model(
    blocks: Linear, prior: NoisePrior, sd: FloatArray | None, parts: Processes | None = None
) -> NoiseModel:
    """Lay out the states and the columns of a run; parameters as `estimate` has them."""
    X, rows = span(blocks.X) if sd is None else blocks.X * sd, blocks.rows
    every, proper = np.arange(X.shape[1]), np.full(X.shape[1], float(sd is not None))
    states = nbk_states(rows.duration, parts or processes(rows))
    return NoiseModel(rows, np.column_stack((X, blocks.y)), ((every, proper),), states, prior)


CONTIGUOUS = 0.5
"""Share of an interval that may lie between two rows which share the boundary of their averages."""


def process_model(means: Linear, levels: tuple[tuple[float, int], ...], prior: NoisePrior) -> NoiseModel:
    """Lay out the states and the columns of a run, with and without a ramp, of what `noise_rows` gives."""
    rows, interval, half = Rows(means.t, means.duration), means.sampling, 0.5 * means.duration
    gaps = (rows.t - half)[1:] - (rows.t + half)[:-1]
    joined = np.concatenate(([False], gaps < CONTIGUOUS * interval))
    middle = rows.t - (rows.t[0] - half[0] + 0.5 * rows.span)
    basis, y = span(means.X), means.y
    # what the columns explain is projected out beforehand too: the response is then of the noise's own size
    left = y - basis @ (basis.T @ y)
    table = np.ascontiguousarray(np.column_stack((basis, prior["R"][1] * middle, left)))
    parts = flickering(interval, max(rows.span, interval))
    states = nbk_states(rows.duration, parts) | {"Q": quantization(rows.duration, joined)}
    free = np.zeros(basis.shape[1])
    of_mean = ((np.arange(len(free)), free), (np.arange(len(free) + 1), np.append(free, 1.0)))
    return NoiseModel(rows, table, of_mean, states, prior, joined, levels)


def likelihood(model: NoiseModel, names: Sequence[str], x: FloatArray, *, slopes: bool = False) -> Likelihood:
    """Restricted likelihood of k processes, and its derivatives where these are asked for.

    `x` (k,) are the logarithms of their sizes, SI; with G ``tau`` is among the names, for the time constant.
    """
    rows, states = model.rows, dict(model.states)
    sizes = {name: size for name, size in zip(names, np.exp(x).tolist(), strict=True) if name != "tau"}
    if "G" in sizes:
        unit = Processes(np.ones(1), np.exp(x[[names.index("tau")]]))
        states["G"] = gauss_markov(common(rows.duration), unit)
    every = together([states[name] for name in sizes], rows.axes)
    size = np.array([*sizes.values()])
    made, table = every.sized(size), model.table.copy()
    gains = np.empty((len(table), len(made.rates))) if slopes else None
    d = whiten_by(made, rows, table, gains)
    if not np.all(d > 0.0):
        return Likelihood(np.full(len(model.means), IMPOSSIBLE), (0.0, 1.0), np.zeros(len(x)))
    R = triangular((table,), table.shape[1])
    factors = [_with_prior(R, columns, root) for columns, root in model.means]
    levels = -0.5 * float(np.sum(np.log(d))) + np.array([_level(factor) for factor in factors])
    # of a mean without columns there is none
    last = factors[-1][-2, -2:] if len(factors[-1]) > 1 else np.array([1.0, 0.0])
    told = Likelihood(levels, (float(last[1] / last[0]), 1.0 / abs(float(last[0]))), np.empty(0))
    if gains is None:
        return told
    from imubayes.inference.noise_kernel import swept_back

    by_row = table @ _by_row(model, factors, np.exp(levels - told.level))
    start = float(rows.t[0] - 0.5 * rows.duration[0])
    gap, step = apart(rows.t, rows.duration, (start, start))
    J, width = len(made.rates), table.shape[1]
    by = np.empty(len(table)), np.zeros(J), np.zeros(J)
    room = (np.zeros((J, J)), np.zeros((J, width)), np.zeros(width), *np.zeros((2, J)))
    swept_back(table, d, step, made.over(gap), gains, by_row, by, room)
    slope = dict(zip(sizes, every.by_size(size, by).tolist(), strict=True))
    if "tau" in names:
        # all weights depend on the time constant: a central difference
        step = STEP * (np.array(names) == "tau")
        ends = [likelihood(model, names, x + sign * step).level for sign in (1.0, -1.0)]
        slope["tau"] = (ends[0] - ends[1]) / (2.0 * STEP)
    return replace(told, slope=np.array([slope[name] for name in names]))


def _with_prior(R: FloatArray, columns: NDArray[np.intp], root: FloatArray) -> FloatArray:
    """Factor of some columns and the response with the rows of their prior."""
    prior = np.zeros((len(columns), len(columns) + 1))
    np.fill_diagonal(prior, root)
    return triangular((np.concatenate((R[:, np.append(columns, -1)], prior)),), len(columns) + 1)


def _level(R: FloatArray) -> float:
    diagonal = np.abs(np.diag(R))
    return -float(np.sum(np.log(diagonal[:-1])) + 0.5 * diagonal[-1] ** 2)


def _by_row(model: NoiseModel, factors: Sequence[FloatArray], weights: FloatArray) -> FloatArray:
    """Matrix (r + 1, r + 1) that turns the whitened table into the derivatives by it, over the models.

    With ``v = [-beta 1]`` that of each is ``-(v v' + (R_x' R_x)^-1)``.
    """
    slope = np.zeros((model.table.shape[1],) * 2)
    for (columns, _), R, weight in zip(model.means, factors, weights.tolist(), strict=True):
        inverse = invert_triangular(R[:-1, :-1])
        beta = inverse @ R[:-1, -1]
        own = np.outer(v := np.append(-beta, 1.0), v)
        own[:-1, :-1] += inverse @ inverse.T
        at = np.append(columns, -1)
        slope[np.ix_(at, at)] -= weight * own
    return slope


def prior_of(model: NoiseModel, names: Sequence[str]) -> FloatArray:
    """Mean and sd (2, k) of the normal prior of k logarithms."""
    known = [model.prior[name] for name in names]
    return np.array([[math.log(median), width] for median, width in known]).T


def log_prior(model: NoiseModel, names: Sequence[str], x: FloatArray) -> float:
    """Log density of the logarithms x (k,) under their prior."""
    center, width = prior_of(model, names)
    spread = 0.5 * len(x) * math.log(2.0 * math.pi) + float(np.sum(np.log(width)))
    return -0.5 * float(np.sum(((x - center) / width) ** 2)) - spread


def cost(model: NoiseModel, names: Sequence[str], x: FloatArray) -> tuple[float, FloatArray]:
    """Negative log posterior of the logarithms x (k,), up to a constant, and its derivatives (k,)."""
    told, (center, width) = likelihood(model, names, x, slopes=True), prior_of(model, names)
    pull = (x - center) / width
    return 0.5 * float(pull @ pull) - told.level, pull / width - told.slope


def mode_of(
    model: NoiseModel, names: tuple[str, ...], start: FloatArray, near: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Maximum (k,) of the posterior of the logarithms, and the covariance (k, k) of its curvature there.

    The maximum is sought from a start (k,), or several (s, k), within `REACH` prior sds of the prior's
    medians, and of the starts where these are farther out; `near` (k, k) is about what the covariance will
    be, where that is known. The data never say less than the prior does: along no direction is the covariance
    wider.
    """
    center, width = prior_of(model, names)
    inner = np.vstack((center, start))
    ends = inner.min(axis=0) - REACH * width, inner.max(axis=0) + REACH * width
    return minimum(partial(cost, model, names), start, width, ends, near)


def span(X: FloatArray) -> FloatArray:
    """Orthonormal basis (m, rank) of the columns' span; REML depends on nothing else."""
    norms = np.linalg.norm(X, axis=0)
    U, s, _ = np.linalg.svd(X[:, norms > 0.0] / norms[norms > 0.0], full_matrices=False)
    return U[:, s > RANK * s[0]] if len(s) else U


HIDDEN = 0.5
"""Allan variance of bias instability over that of white noise in a block from which N is judged by shorter
ones: blocks tell the less of it, the stronger the flicker is."""

COARSE = 1000
"""Blocks that the run is averaged to."""

FINE = 1000
"""Averages of each shorter length."""

LONGER = 8
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
    return replace(means, finest=fine.interval), levels


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


def hides_white(blocks: Linear, noise: Noise) -> bool:
    """Whether blocks of a static log that is held show bias instability and its samples white noise."""
    floor = allan_variance({"B": noise.B}, np.ones(1))[0] * float(np.median(blocks.duration))
    return blocks.procedure == "static" and blocks.stream is None and floor > HIDDEN * noise.N**2


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
    lengths = [LONGER**k for k in range(12) if 2 * LONGER**k <= longest]
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
