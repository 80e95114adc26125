"""The posterior of the coefficients as a mixture: a Gaussian for each model and noise scale that counts."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from imubayes.factor import Factor, reorder, solve_triangular, with_prior_rows

FloatArray = NDArray[np.float64]
MaskArray = NDArray[np.int64]

COMPONENTS = 8_000
"""Most components that moments are computed for; beyond, a systematic sample of them stands for all."""

LEFT_OUT = 1e-10
"""Most posterior probability that the components left out may carry together."""

BISECTIONS = 60
"""Halvings of a bracket of +-12 sd: to rounding."""


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """What is enumerated, with what is in every model.

    Attributes
    ----------
    names : candidates, p of them.
    always : columns that are in every model, a of them; they come first in `whole`.
    sd : (a + p,) prior sd of each column; inf for a flat prior (and for candidates of the g-family).
    whole : (a + p + 1, a + p + 1) factor of all of them and the response.
    dof : rows minus columns with a flat prior.
    log_det : log determinant of the noise covariance that whitened the rows.
    """

    names: tuple[str, ...]
    always: tuple[str, ...]
    sd: FloatArray
    whole: FloatArray
    dof: int
    log_det: float

    @property
    def columns(self) -> tuple[str, ...]:
        """Every column: those that are always in, then the candidates."""
        return (*self.always, *self.names)

    def at(self, scale: float) -> FloatArray:
        """Factor of all columns with the rows of the prior stacked under it, at a noise scale."""
        return with_prior_rows(self.whole, scale / self.sd)


@dataclass(frozen=True, slots=True, eq=False)
class Components:
    """Components of the mixture.

    Attributes
    ----------
    weight : (c,) summing to 1.
    mask : (c,) included candidates, bit j for candidate j.
    scale : (c,) noise scale.
    mean, sd : (c, a + p) of all columns; zero where a candidate is out, NaN for columns that are always in
        under a prior of their own, which are integrated out before the candidates are looked at.
    """

    weight: FloatArray
    mask: MaskArray
    scale: FloatArray
    mean: FloatArray
    sd: FloatArray

    def moments(self) -> tuple[FloatArray, FloatArray]:
        """Mean and sd of each column, averaged over the components."""
        mean = self.weight @ self.mean
        return mean, np.sqrt(self.weight @ (self.sd**2 + (self.mean - mean) ** 2))


def candidates(factor: Factor, names: tuple[str, ...], always: tuple[str, ...], sd: FloatArray) -> Candidates:
    """Bring the columns of a factor into the order of the enumeration: `always`, then `names`."""
    whole = factor if factor.names == (*always, *names) else reorder(factor, (*always, *names))
    flat = int(np.sum(np.isinf(sd[: len(always)])))
    return Candidates(names, always, sd, whole.R, factor.n - flat, factor.log_det)


def scale_components(c: Candidates, scales: FloatArray, log_joint: FloatArray) -> Components:
    """Components for independent physical priors.

    Parameters
    ----------
    c : what was enumerated.
    scales : (q,) nodes of the noise scale.
    log_joint : (q, 2^p) log of p(data, model, scale); -inf shuts a model out.
    """
    from imubayes.selection.moments import solutions

    chosen, weight = _chosen(log_joint)
    node, mask = np.divmod(chosen, log_joint.shape[1])
    skip = 0 if np.isinf(c.sd).any() else len(c.always)
    mean, sd = np.full((2, len(mask), len(c.columns)), np.nan)
    for q in np.unique(node):
        of = node == q
        T = np.ascontiguousarray(c.at(float(scales[q]))[skip:, skip:])
        b, v = solutions(T, mask[of] if skip else with_always(c, mask[of]))
        mean[of, skip:], sd[of, skip:] = b, scales[q] * np.sqrt(v)
    return Components(weight, mask, scales[node], mean, sd)


def g_components(c: Candidates, total: float, integrals: FloatArray, log_joint: FloatArray) -> Components:
    """Components under the g-family: least squares shrunk towards the fit of the forced columns alone.

    With s = g/(1 + g) the coefficients are ``b0 + s (b - b0)``, and only the part of their variance that
    the candidates cause is shrunk.

    Parameters
    ----------
    c : what was enumerated.
    total : residual sum of squares of the forced columns alone.
    integrals : (2^p, 5) of `moments.g_integrals`.
    log_joint : (1, 2^p).
    """
    from imubayes.selection.moments import solutions

    chosen, weight = _chosen(log_joint)
    b, v = solutions(c.whole, with_always(c, chosen))
    b0, v0 = solutions(c.whole, with_always(c, np.zeros(1, dtype=np.int64)))
    shrink, square, spread, unshrunk = integrals[chosen, 1:].T[:, :, None]
    unit = total / (c.dof - 2)
    variance = unit * (unshrunk * v0 + spread * (v - v0)) + (square - shrink**2) * (b - b0) ** 2
    return Components(
        weight, chosen, np.sqrt(unit * unshrunk[:, 0]), b0 + shrink * (b - b0), np.sqrt(variance)
    )


def with_always(c: Candidates, mask: MaskArray) -> MaskArray:
    """Masks over all columns, from masks over the candidates."""
    return (mask << len(c.always)) | ((1 << len(c.always)) - 1)


def quantiles(parts: Components, column: int, levels: tuple[float, ...]) -> tuple[float, ...]:
    """Quantiles of one column under the mixture, with its point mass at zero, by bisection."""
    return tuple(_quantile(parts, column, level) for level in levels)


def _quantile(parts: Components, column: int, level: float) -> float:
    mean, sd, weight = parts.mean[:, column], parts.sd[:, column], parts.weight
    if weight @ _cdf(0.0, mean, sd, strict=True) < level <= weight @ _cdf(0.0, mean, sd):
        return 0.0
    low, high = float(np.min(mean - 12.0 * sd)), float(np.max(mean + 12.0 * sd))
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if weight @ _cdf(middle, mean, sd) < level else (low, middle)
    return high


def probability_within(parts: Components, column: int, bound: float) -> float:
    """Posterior probability that ``|theta| <= bound`` for one column."""
    mean, sd = parts.mean[:, column], parts.sd[:, column]
    return float(parts.weight @ (_cdf(bound, mean, sd) - _cdf(-bound, mean, sd, strict=True)))


def limit(parts: Components, column: int, level: float = 0.95) -> float:
    """Size that ``|theta|`` stays below with probability `level`, where the column is in the model.

    The point mass at zero is left out: with it, the limit of whatever is not needed would be zero. NaN if no
    component contains the column.
    """
    inside = parts.sd[:, column] > 0.0
    weight = np.where(inside, parts.weight, 0.0)
    if weight.sum() == 0.0:
        return float("nan")
    given = Components(weight / weight.sum(), parts.mask, parts.scale, parts.mean, parts.sd)
    low, high = 0.0, float(np.max(np.abs(parts.mean[inside, column]) + 12.0 * parts.sd[inside, column]))
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if probability_within(given, column, middle) >= level else (middle, high)
    return high


def draw(c: Candidates, parts: Components, size: int, rng: np.random.Generator) -> FloatArray:
    """Independent draws of all columns from the mixture of a physical prior: (size, a + p)."""
    from imubayes.selection.moments import submodel

    out = np.zeros((size, len(c.columns)))
    which = rng.choice(len(parts.weight), size=size, p=parts.weight)
    for component in np.unique(which):
        rows = np.flatnonzero(which == component)
        scale = float(parts.scale[component])
        T, columns = submodel(c.at(scale), int(with_always(c, parts.mask[component : component + 1])[0]))
        z = T[:-1, -1:] + scale * rng.standard_normal((len(columns), len(rows)))
        out[np.ix_(rows, columns)] = solve_triangular(T[:-1, :-1], z).T
    return out


def _cdf(x: float, mean: FloatArray, sd: FloatArray, *, strict: bool = False) -> FloatArray:
    """Distribution of each component at x; without spread a step, which counts x itself unless `strict`."""
    point = sd == 0.0
    step = mean < x if strict else mean <= x
    return np.where(point, step, ndtr((x - mean) / np.where(point, 1.0, sd)))


def _chosen(log_joint: FloatArray) -> tuple[MaskArray, FloatArray]:
    """Flat indices of the components that carry the posterior, and their weights.

    Those that matter one by one, or, when they are more than `COMPONENTS`, a systematic sample of them
    (unbiased, each with the weight of its draws).
    """
    flat = log_joint.ravel()
    weight = np.exp(flat - flat.max())
    weight /= weight.sum()
    chosen = np.flatnonzero(weight > LEFT_OUT / max(int(np.count_nonzero(weight)), 1))
    if len(chosen) <= COMPONENTS:
        return chosen, weight[chosen] / weight[chosen].sum()
    ticks = (np.arange(COMPONENTS) + 0.5) / COMPONENTS
    drawn, repeats = np.unique(np.searchsorted(np.cumsum(weight[chosen]), ticks), return_counts=True)
    return chosen[np.minimum(drawn, len(chosen) - 1)], repeats / COMPONENTS


def log_flat(c: Candidates, T: FloatArray, scale: float) -> float:
    """Log of what the columns that are always in contribute to the evidence of every model at a scale."""
    a = len(c.always)
    proper = np.isfinite(c.sd[:a])
    own = float(np.sum(np.log(scale / c.sd[:a][proper])) - np.sum(np.log(np.abs(np.diag(T)[:a]))))
    return own - 0.5 * c.log_det - 0.5 * c.dof * math.log(2.0 * math.pi * scale**2)
