"""The posterior of the coefficients as a mixture: a Gaussian for each model and noise scale that counts."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import BoolArray, FloatArray
from imubayes.algebra.factor import Factor, reorder, solve_triangular, with_prior_rows
from imubayes.inference.importance import picked
from imubayes.selection.model_sets import Space

CHOSEN = 2_000
"""Most models that moments are computed for; beyond, a systematic sample of them stands for all."""

LEFT_OUT = 1e-10
"""Most posterior probability that the models left out may carry together."""

ROOT_OF_TURN = math.sqrt(2.0 * math.pi)

COMFORTABLE = 250
"""Exponent of two of the largest and smallest numbers whose fourth powers a double holds."""


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """What is enumerated, with what is in every model.

    Attributes
    ----------
    names, always : p candidates, and a columns that are in every model; these come first in `whole`.
    sd : (a + p,) prior sd of each column; inf for a flat prior (and for candidates of the g-family).
    whole : (a + p + 1, a + p + 1) factor of all of them and the response.
    dof, log_det : rows minus columns with a flat prior; log determinant of the noise covariance that whitened
        the rows.
    unit : (a + p + 1,) exponents of two that `whole` and `sd` count each column and the response in; 0
        where their squares stay in the range of doubles anyway.
    """

    names: tuple[str, ...]
    always: tuple[str, ...]
    sd: FloatArray
    whole: FloatArray
    dof: int
    log_det: float
    unit: NDArray[np.int64] | int = 0

    @property
    def columns(self) -> tuple[str, ...]:
        """Every column: those that are always in, then the candidates."""
        return (*self.always, *self.names)

    def at(self, scale: float) -> FloatArray:
        """Factor of all columns with the rows of the prior stacked under it, at a noise scale."""
        return with_prior_rows(self.whole, scale / self.sd)

    @property
    def response_unit(self) -> int:
        """Exponent of two of the unit of the response, and of the noise scale."""
        return int(np.broadcast_to(self.unit, len(self.whole))[-1])

    def given(self, values: FloatArray) -> FloatArray:
        """Coefficients (..., a + p) of `whole` in the units of the data."""
        if isinstance(self.unit, int):
            return values
        return np.ldexp(values, self.unit[-1] - self.unit[:-1])


@dataclass(frozen=True, slots=True, eq=False)
class Components:
    """Components of the mixture: weight (c,), of sum 1, candidates inside (c, p), and noise scale (c,).

    Mean and sd (c, a + p) are of all columns; zero where a candidate is out, NaN for columns that are always
    in under a prior of their own, which are integrated out before the candidates are looked at.
    """

    weight: FloatArray
    inside: BoolArray
    scale: FloatArray
    mean: FloatArray
    sd: FloatArray

    def moments(self) -> tuple[FloatArray, FloatArray]:
        """Mean and sd of each column, averaged over the components; NaN where there are none."""
        if not len(self.weight):
            return np.full(self.mean.shape[1], math.nan), np.full(self.mean.shape[1], math.nan)
        mean = self.weight @ self.mean
        peak = np.maximum(np.abs(self.mean), self.sd).max(axis=0)
        unit = np.frexp(np.where(np.isfinite(peak), peak, 1.0))[1]
        off, sd = np.ldexp(self.mean - mean, -unit), np.ldexp(self.sd, -unit)
        return mean, np.ldexp(np.sqrt(self.weight @ (sd**2 + off**2)), unit)


def no_mixture(c: Candidates) -> Components:
    """Mixture of no components, where nobody asks for coefficients."""
    none = np.zeros((0, len(c.columns)))
    return Components(none[:, 0], np.zeros((0, len(c.names)), dtype=bool), none[:, 0], none, none)


def candidates(factor: Factor, names: tuple[str, ...], always: tuple[str, ...], sd: FloatArray) -> Candidates:
    """Bring the columns of a factor into the order of the enumeration: `always`, then `names`."""
    whole = factor if factor.names == (*always, *names) else reorder(factor, (*always, *names))
    dof = factor.n - int(np.sum(np.isinf(sd[: len(always)])))
    unit = _units(whole.R, sd)
    if unit is None:
        return Candidates(names, always, sd, whole.R, dof, factor.log_det)
    inside = np.ldexp(sd, unit[:-1] - unit[-1])
    return Candidates(names, always, inside, np.ldexp(whole.R, -unit), dof, factor.log_det, unit)


def _units(R: FloatArray, sd: FloatArray) -> NDArray[np.int64] | None:
    """Exponents of two (p + 1,) that bring columns and response near one; None where they are near enough.

    A column counts with the row of its prior where the data say less than that.
    """
    peak = np.abs(R).max(axis=0)
    own = np.frexp(peak)[1].astype(np.int64)
    prior = np.where(np.isfinite(sd), own[-1] - np.frexp(sd)[1], own[:-1])
    unit = np.append(np.where(peak[:-1] > 0.0, np.maximum(own[:-1], prior), prior), own[-1])
    return unit if max(np.abs(unit).max(), np.abs(own).max()) > COMFORTABLE else None


def merged(shares: Sequence[float], parts: Sequence[Components]) -> tuple[Components, list[Components]]:
    """One mixture of several over the same columns, each with its share; and the several, in its memory."""
    total = sum(shares)
    weights = [share / total * part.weight for share, part in zip(shares, parts, strict=True)]
    whole = Components(
        weight=np.concatenate(weights),
        inside=np.concatenate([part.inside for part in parts]),
        scale=np.concatenate([part.scale for part in parts]),
        mean=np.concatenate([part.mean for part in parts]),
        sd=np.concatenate([part.sd for part in parts]),
    )
    ends = np.cumsum([len(part.weight) for part in parts])[:-1]
    cut = (np.split(each, ends) for each in (whole.inside, whole.scale, whole.mean, whole.sd))
    return whole, [Components(part.weight, *own) for part, *own in zip(parts, *cut, strict=True)]


class Scales(NamedTuple):
    """Noise scales (q,) that stand for all, and the logarithm of what each counts for, up to a constant."""

    at: FloatArray
    log_share: FloatArray

    @classmethod
    def only(cls, scale: float) -> Scales:
        """One scale that is given."""
        return cls(np.array([scale]), np.zeros(1))


def scale_components(c: Candidates, space: Space, over: Scales, weight: FloatArray) -> Components:
    """Components for independent physical priors: each chosen model at each noise scale.

    The weights (m,) are the posterior probability of each model, up to a factor.
    """
    scales = over.at
    which, share = _chosen(weight)
    inside = space.members(which)
    skip = 0 if np.isinf(c.sd).any() else len(c.always)
    mean, sd = np.full((2, len(scales), len(which), len(c.columns)), np.nan)
    log_joint = np.empty((len(scales), len(which)))
    for q, scale in enumerate(scales.tolist()):
        log_joint[q], mean[q, :, skip:], sd[q, :, skip:] = _at_scale(c, scale, inside, skip)
    log_joint += over.log_share[:, None]
    # within a model the scales share its probability
    given = np.exp(log_joint - log_joint.max(axis=0))
    weights = share * given / given.sum(axis=0)
    keep = weights > LEFT_OUT / weights.size
    # of the others a component for each model, with the same moments: what carries next to no probability
    # can carry a variance, as a prior of 1e10 sd at an inclusion of 1e-15
    light = np.where(keep, 0.0, weights)
    total = light.sum(axis=0)
    part, rest = (light / np.where(total > 0.0, total, 1.0))[:, :, None], total > 0.0
    merged_mean = np.sum(part * mean, axis=0)
    merged_sd = np.sqrt(np.sum(part * (sd**2 + (mean - merged_mean) ** 2), axis=0))
    weight = np.concatenate((weights[keep], total[rest]))
    in_rows = np.broadcast_to(inside, (len(scales), *inside.shape))
    in_scale = np.broadcast_to(scales[:, None], weights.shape)
    middle = np.full(int(rest.sum()), float(np.sum(weights * in_scale) / np.sum(weights)))
    return Components(
        weight=weight / weight.sum(),
        inside=np.concatenate((in_rows[keep], inside[rest])),
        scale=np.ldexp(np.concatenate((in_scale[keep], middle)), c.response_unit),
        mean=c.given(np.concatenate((mean[keep], merged_mean[rest]))),
        sd=c.given(np.concatenate((sd[keep], merged_sd[rest]))),
    )


def _at_scale(
    c: Candidates, scale: float, inside: BoolArray, skip: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Log of p(data, scale | model) up to a constant, and moments of the columns from `skip` on."""
    from imubayes.selection.kernels import solutions

    T = c.at(scale)
    b, v, rss, log_det = solutions(
        np.ascontiguousarray(T[skip:, skip:]), inside if skip else with_always(c, inside)
    )
    rows = np.log(scale / c.sd[len(c.always) :])
    # columns that are always in are part of log_det where they were not skipped
    shared = log_flat(c, T, scale) + (
        0.0 if skip else float(np.sum(np.log(np.abs(np.diag(T)[: len(c.always)]))))
    )
    return shared - rss / (2.0 * scale**2) - log_det + inside @ rows, b, scale * np.sqrt(v)


def g_components(
    c: Candidates, inside: BoolArray, total: float, integrals: FloatArray, weight: FloatArray
) -> Components:
    """Components under the g-family: least squares shrunk towards the fit of the forced columns alone.

    With s = g/(1 + g) the coefficients are ``b0 + s (b - b0)``, and only the part of their variance that
    the candidates cause is shrunk.

    Parameters
    ----------
    inside, weight : (m, p) and (m,), which candidates are in each model, and its probability up to a factor.
    total : residual sum of squares of the forced columns alone.
    integrals : (m, 5) of `kernels.g_integrals`.
    """
    from imubayes.selection.kernels import solutions

    there = weight > 0.0
    inside, integrals, weight = inside[there], integrals[there], weight[there]
    b, v, _, _ = solutions(c.whole, with_always(c, inside))
    b0, v0, _, _ = solutions(c.whole, with_always(c, np.zeros((1, len(c.names)), dtype=bool)))
    shrink, wide, spread, unshrunk = integrals[:, 1:].T[:, :, None]
    unit = total / (c.dof - 2) if c.dof > 2 else math.inf  # a t distribution of two degrees has no variance
    with np.errstate(invalid="ignore"):
        variance = np.where(v > 0.0, unit * (unshrunk * v0 + spread * (v - v0)), 0.0) + wide * (b - b0) ** 2
    scale = np.ldexp(np.sqrt(unit * unshrunk[:, 0]), c.response_unit)
    mean, share = c.given(b0 + shrink * (b - b0)), weight / weight.sum()
    return Components(share, inside, scale, mean, c.given(np.sqrt(variance)))


def with_always(c: Candidates, inside: BoolArray) -> BoolArray:
    """Which of all columns are in models of these candidates (m, p): (m, a + p)."""
    return np.hstack((np.ones((len(inside), len(c.always)), dtype=bool), inside))


class Marginal(NamedTuple):
    """One column of a mixture: normal components, and point masses at some places."""

    weight: FloatArray
    mean: FloatArray
    sd: FloatArray
    mass: FloatArray
    place: FloatArray

    @classmethod
    def of(cls, parts: Components, column: int) -> Marginal:
        """Marginal of a column, in which all components without spread at one place are one."""
        mean, sd = parts.mean[:, column], parts.sd[:, column]
        wide = sd != 0.0
        place, which = np.unique(mean[~wide], return_inverse=True)
        mass = np.bincount(which, parts.weight[~wide], len(place)).astype(np.float64)
        return cls(parts.weight[wide], mean[wide], sd[wide], mass, place)

    def cdf(self, x: float, *, strict: bool = False) -> float:
        """Probability of values up to x; `strict`, of those below it."""
        from scipy.special import ndtr

        points = self.mass @ (self.place < x if strict else self.place <= x)
        return float(self.weight @ ndtr((x - self.mean) / self.sd) + points)

    def density(self, x: float) -> float:
        """Density at x beside the point masses."""
        z = (x - self.mean) / self.sd
        return float(self.weight @ (np.exp(-0.5 * z * z) / self.sd)) / ROOT_OF_TURN

    def within(self, bound: float) -> float:
        """Probability of values no larger than a bound."""
        return self.cdf(bound) - self.cdf(-bound, strict=True)


def quantiles(parts: Components, column: int, levels: tuple[float, ...]) -> tuple[float, ...]:
    """Quantiles of one column under the mixture, with its point mass at zero."""
    marginal, mean, reach = Marginal.of(parts, column), parts.mean[:, column], 12.0 * parts.sd[:, column]
    ends, at_zero = (float(np.min(mean - reach)), float(np.max(mean + reach))), marginal.cdf(0.0)
    below = marginal.cdf(0.0, strict=True)

    def quantile(level: float) -> float:
        if below < level <= at_zero:
            return 0.0
        return _root(lambda x: marginal.cdf(x) - level, marginal.density, *ends)

    return tuple(map(quantile, levels))


def _root(
    distance: Callable[[float], float], slope: Callable[[float], float], low: float, high: float
) -> float:
    """Root of what rises from below zero to above it, to 1e-14 of the bracket.

    Newton's steps, and halves of the bracket where these leave it or do not shrink. Where sds are lost in the
    rounding of their means the bracket may have no root: it is then one of its ends.
    """
    if not distance(low) < 0.0 < distance(high):
        return low if distance(low) >= 0.0 else high
    exact = max(1e-14 * (high - low), math.ulp(max(abs(low), abs(high))))
    x, last = 0.5 * (low + high), high - low
    while high - low > exact:
        off, rise = distance(x), slope(x)
        low, high = (x, high) if off < 0.0 else (low, x)
        step = off / rise if 0.0 < rise < math.inf else math.inf
        if abs(step) < exact:  # past the root, so that the bracket ends
            step = math.copysign(0.5 * exact, off)
        if abs(step) > 0.5 * last or not low < x - step < high:
            step = x - 0.5 * (low + high)
        x, last = x - step, abs(step)
    return high


def probability_within(parts: Components, column: int, bound: float) -> float:
    """Posterior probability that ``|theta| <= bound`` for one column."""
    return Marginal.of(parts, column).within(bound)


def limit(parts: Components, column: int, level: float = 0.95) -> float:
    """Size that ``|theta|`` stays below with probability `level`, where the column is in the model.

    The point mass at zero is left out: with it, the limit of whatever is not needed would be zero. NaN if no
    component contains the column.
    """
    marginal, nothing = Marginal.of(parts, column), np.zeros(0)
    if marginal.weight.sum() == 0.0:
        return float("nan")
    given = marginal._replace(weight=marginal.weight / marginal.weight.sum(), mass=nothing, place=nothing)
    most = float(np.max(np.abs(marginal.mean) + 12.0 * marginal.sd))
    return _root(
        lambda size: given.within(size) - level,
        lambda size: given.density(size) + given.density(-size),
        0.0,
        most,
    )


def draw(c: Candidates, parts: Components, chance: FloatArray, normal: FloatArray) -> FloatArray:
    """Draws (k, a + p) of all columns from the mixture of a physical prior.

    Each is made of its own numbers, one of `chance` (k,) from 0 to 1 and a row of `normal` (k, a + p) of sd
    1, so that a posterior that has hardly changed has draws that have hardly changed.
    """
    from imubayes.selection.kernels import submodel

    out, at = np.zeros(normal.shape), cache(c.at)  # scales are few where components are many
    which = picked(parts.weight, chance)
    for component in np.unique(which):
        rows = np.flatnonzero(which == component)
        scale = math.ldexp(float(parts.scale[component]), -c.response_unit)
        T, columns = submodel(at(scale), with_always(c, parts.inside[component : component + 1])[0])
        own = np.ix_(rows, columns)
        out[own] = solve_triangular(T[:, :-1], T[:, -1:] + scale * normal[own].T).T
    return c.given(out)


def drawn_of(weight: FloatArray) -> int:
    """Number of draws that stand for the models of these weights; 0 where each that counts has its own."""
    return CHOSEN if int(np.count_nonzero(_counts(weight))) > CHOSEN else 0


def _counts(weight: FloatArray) -> BoolArray:
    """Which models matter one by one; of a few, all that have any weight."""
    least = LEFT_OUT / max(int(np.count_nonzero(weight)), 1) if len(weight) > CHOSEN else 0.0
    return weight > least * weight.sum()


def _chosen(weight: FloatArray) -> tuple[NDArray[np.int64], FloatArray]:
    """Numbers of the models that carry the posterior, and their weights.

    Those that matter one by one, or, when they are more than `CHOSEN`, a systematic sample of them (unbiased,
    each with the weight of its draws).
    """
    chosen = np.flatnonzero(_counts(weight))
    if len(chosen) <= CHOSEN:
        return chosen, weight[chosen] / weight[chosen].sum()
    sums = np.cumsum(weight[chosen])
    ticks = (np.arange(CHOSEN) + 0.5) / CHOSEN * sums[-1]
    drawn, repeats = np.unique(np.searchsorted(sums, ticks), return_counts=True)
    return chosen[np.minimum(drawn, len(chosen) - 1)], repeats / CHOSEN


def log_flat(c: Candidates, T: FloatArray, scale: float) -> float:
    """Log of what the columns that are always in contribute to the evidence of every model at a scale."""
    a = len(c.always)
    proper = np.isfinite(c.sd[:a])
    own = float(np.sum(np.log(scale / c.sd[:a][proper])) - np.sum(np.log(np.abs(np.diag(T)[:a]))))
    unit = np.broadcast_to(c.unit, len(c.whole))
    in_units = math.log(2.0) * (c.dof * float(unit[-1]) + float(np.sum(unit[:a][~proper])))
    return own - 0.5 * c.log_det - 0.5 * c.dof * math.log(2.0 * math.pi * scale**2) - in_units
