"""How well models predict what they have not seen: a dwell or a run left out, in closed form where it exists.

In a linear Gaussian model at a known noise scale the density of a part of the data given the others is a
ratio of two evidences, ``p(y_d | y_-d, M) = p(y | M) / p(y_-d | M)``: one walk of the tree for all data and
one for each part gives it for every model. The factor without a part is made from the factors of the others,
by QR: nothing is subtracted. Scores are on the deviance scale, -2 times the sum of the log densities.

A dwell's rows are whitened given those before them in their run. Leaving it out leaves out what it adds to
them; later dwells of the run stay whitened by it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import BoolArray, FloatArray
from imubayes.algebra import factor as algebra
from imubayes.inference.dwells import Pieces, few_rows, stacked
from imubayes.selection.mixture import Candidates, with_always
from imubayes.selection.model_sets import Space

TAIL_SHARE = 0.2
"""Largest share of the weights that counts as their tail (Vehtari et al. 2024, section 2.2)."""

TAIL_ROOT = 3.0
"""The tail of many draws: so many times their square root (ibid.)."""

SHORTEST_TAIL = 5
"""Weights below which no tail can be fitted: k is then infinite."""

GRID = 30
"""Points of the quadrature over the tail's shape, beside the root of its length (Zhang, Stephens 2009)."""

SHAPE_SPREAD = 3.0
"""How wide the prior of that quadrature is, in quarter-sample units (ibid.)."""

SHAPE_PRIOR = (10.0, 0.5)
"""Draws that the prior of k is worth, and its mean (Vehtari et al. 2024, appendix C)."""

RELIABLE = 0.7
"""Largest k at which importance sampling can be trusted (Vehtari et al. 2024, section 3.2.4)."""


@dataclass(frozen=True, slots=True, eq=False)
class Held:
    """q parts of the data, each to be predicted from the others, over the w columns of the candidates.

    `parts` (q, m, w + 1) are the whitened rows of each, as few as hold all that it says; `whole` is the
    factor (w + 1, w + 1) of all, the prior's rows stacked under it, `without` (q, w + 1, w + 1) that without
    each. A part adds `offset` (q,) to the deviance of every model: ``n ln(2 pi scale^2)`` and the log
    determinant of the noise that whitened it.
    """

    candidates: Candidates
    scale: float
    parts: FloatArray
    whole: FloatArray
    without: FloatArray
    offset: FloatArray


def by_dwell(pieces: Sequence[Pieces], c: Candidates, scale: float) -> Held:
    """Dwells of all runs, to be left out one at a time; pieces that are always there stay."""
    loose = [p for p in pieces if not p.kept]
    parts = np.concatenate([p.R[:, :, _places(p.names, c)] for p in loose])
    rows, log_det = np.concatenate([p.rows for p in loose]), np.concatenate([p.log_det for p in loose])
    return _held(parts, rows, log_det, pieces, c, scale)


def by_run(pieces: Sequence[Pieces], c: Candidates, scale: float) -> Held:
    """Whole runs, to be left out one at a time; pieces that are always there stay."""
    runs = [stacked([p]) for p in pieces if not p.kept]
    parts = np.array([f.R[:, _places(f.names, c)] for f in runs])
    rows, log_det = np.array([f.n for f in runs]), np.array([f.log_det for f in runs])
    return _held(parts, rows, log_det, pieces, c, scale)


def _places(names: tuple[str, ...], c: Candidates) -> list[int]:
    """Places of the columns of the enumeration, and of the response, among those of a factor."""
    return [*(names.index(name) for name in c.columns), len(names)]


def _held(
    parts: FloatArray,
    rows: NDArray[np.int64],
    log_det: FloatArray,
    pieces: Sequence[Pieces],
    c: Candidates,
    scale: float,
) -> Held:
    """Parts, how many rows each has and the log determinant of their noise, beside the prior."""
    width = parts.shape[2]
    every, telling = few_rows(parts)
    parts = every[:, : max(1, int(telling.sum(axis=1).max()))]

    def joined(R: FloatArray, part: FloatArray) -> FloatArray:
        return algebra.triangular((np.concatenate((R, part)),), width)

    prior = algebra.with_prior_rows(np.zeros((width, width)), scale / c.sd)
    known = [R for p in pieces if p.kept for R in p.R[:, :, _places(p.names, c)]]
    first = algebra.triangular((prior, *known), width) if known else prior
    before = list(accumulate(parts, joined, initial=first))
    after = list(accumulate(parts[::-1], joined, initial=np.zeros((width, width))))[::-1]
    return Held(
        candidates=c,
        scale=scale,
        parts=parts,
        whole=before[-1],
        without=np.array([joined(b, a) for b, a in zip(before[:-1], after[1:], strict=True)]),
        offset=rows * math.log(2.0 * math.pi * scale**2) + log_det,
    )


def fits(T: FloatArray, c: Candidates, space: Space) -> tuple[FloatArray, FloatArray]:
    """Residual sum of squares and log determinant of each model of a space: two arrays (m,).

    T (w + 1, w + 1) is the factor of all columns and the response.
    """
    from imubayes.selection.kernels import solutions
    from imubayes.selection.lanes import walk

    always = len(c.always)
    inner = np.ascontiguousarray(T[always:, always:])
    rss, log_det = walk(inner) if space.inside is None else solutions(inner, space.inside)[2:]
    with np.errstate(divide="ignore"):
        log_det += np.sum(np.log(np.abs(np.diag(T)[:always])))
    return rss, log_det


def leave_out(held: Held, space: Space) -> FloatArray:
    """Deviance of every model when each part is predicted from the others, in closed form: (m,).

    ``-2 sum_d [log p(y | M) - log p(y_-d | M)]``; infinite where one part alone excites a column
    with a flat prior.
    """
    whole = _minus_twice_log(held.whole, held, space)
    total = np.full(len(space), held.offset.sum())
    for T in held.without:
        total += whole
        total -= _minus_twice_log(T, held, space)
    return total


def _minus_twice_log(T: FloatArray, held: Held, space: Space) -> FloatArray:
    """-2 times the log evidence, without what all models or all parts share."""
    rss, log_det = fits(T, held.candidates, space)
    rss /= held.scale**2
    log_det *= 2.0
    return np.add(rss, log_det, out=rss)


def waic(held: Held, inside: BoolArray) -> float:
    """Widely applicable information criterion of one model over the parts, in closed form.

    The posterior is ``theta = m + s T^-1 e`` with e standard normal. With ``A = X_d T^-1`` and the scaled
    residual ``r = (y_d - X_d m)/s``, a part's log likelihood ``-|r - A e|^2/2`` is quadratic in e: its
    exponential has the mean ``exp(-r'(I + AA')^-1 r/2)/sqrt|I + AA'|``, and its variance, the number of
    parameters that Watanabe (2010) subtracts, is ``|A'r|^2 + |A'A|^2/2``.

    Which candidates are in the model says `inside` (p,).
    """
    from imubayes.selection.kernels import submodel

    T, columns = submodel(held.whole, with_always(held.candidates, inside[None, :])[0])
    A = held.parts[:, :, columns] @ algebra.invert_triangular(T[:, :-1])
    r = (held.parts[:, :, -1] - A @ T[:, -1]) / held.scale
    outer = A @ A.transpose(0, 2, 1)
    spread = np.eye(A.shape[1]) + outer
    explained = np.sum(r * np.linalg.solve(spread, r[:, :, None])[:, :, 0], axis=1)
    log_mean = -0.5 * (explained + np.linalg.slogdet(spread)[1] + held.offset)
    # |A'r|^2 and |A'A|^2 from AA', which is as small as a part has rows
    variance = np.sum(r * (outer @ r[:, :, None])[:, :, 0], axis=1) + 0.5 * np.sum(outer**2, axis=(1, 2))
    return float(-2.0 * np.sum(log_mean - variance))


def psis_loo(log_lik: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Leave-one-out by importance sampling, the largest weights smoothed (PSIS; Vehtari et al. 2017, 2024).

    Parameters
    ----------
    log_lik : (draws, q) log likelihood of each point under each draw of the posterior of all.

    Returns
    -------
    (elpd, k) : arrays (q,), log density of each point given the others, and the shape of its weights' tail.
        Above 0.7 the density cannot be trusted: the posterior without that point is another one.

    Examples
    --------
    >>> mean = np.random.default_rng(1).normal(size=(4000, 1)) / 3.0
    >>> elpd, k = psis_loo(-0.5 * (np.array([[0.0, 9.0]]) - mean) ** 2)
    >>> (k > RELIABLE).tolist()
    [False, True]
    """
    elpd, k = np.empty(log_lik.shape[1]), np.empty(log_lik.shape[1])
    for d, column in enumerate(log_lik.T):
        weights, k[d] = _smoothed(-column)
        elpd[d] = np.logaddexp.reduce(column + weights) - np.logaddexp.reduce(weights)
    return elpd, k


def _smoothed(log_ratio: FloatArray) -> tuple[FloatArray, float]:
    """Log weights, the tail replaced by the quantiles of the Pareto distribution fitted to it, and its k."""
    weights = log_ratio - log_ratio.max()
    length = math.ceil(min(TAIL_SHARE * len(weights), TAIL_ROOT * math.sqrt(len(weights))))
    if length < SHORTEST_TAIL:
        return weights, math.inf
    order = np.argsort(weights)
    tail = order[-length:]
    cutoff = max(float(weights[order[-length - 1]]), math.log(np.finfo(float).tiny))
    excess = np.exp(weights[tail]) - math.exp(cutoff)
    if excess[-1] <= 0.0 or excess[0] == excess[-1]:  # equal weights: nothing to smooth
        return weights, 0.0
    k, sigma = _pareto(np.maximum(excess, np.finfo(float).tiny))
    p = (np.arange(length) + 0.5) / length
    quantile = -sigma * np.log1p(-p) if k == 0.0 else sigma * np.expm1(-k * np.log1p(-p)) / k
    weights[tail] = np.minimum(np.log(quantile + math.exp(cutoff)), 0.0)
    return weights, k


def _pareto(x: FloatArray) -> tuple[float, float]:
    """Shape and scale of the generalised Pareto distribution of x (n,), sorted (Zhang and Stephens 2009)."""
    n = len(x)
    m = GRID + math.floor(math.sqrt(n))
    quarter = x[math.floor(n / 4.0 + 0.5) - 1]
    theta = 1.0 / x[-1] + (1.0 - np.sqrt(m / (np.arange(m) + 0.5))) / (SHAPE_SPREAD * quarter)
    shape = np.mean(np.log1p(-theta[:, None] * x), axis=1)
    height = n * (np.log(-theta / shape) - shape - 1.0)
    best = float(np.sum(theta * np.exp(height - np.logaddexp.reduce(height))))
    k = float(np.mean(np.log1p(-best * x)))
    draws, mean = SHAPE_PRIOR
    return (k * n + mean * draws) / (n + draws), -k / best
