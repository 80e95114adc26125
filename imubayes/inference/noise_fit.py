"""Posterior and evidence of one set of noise processes.

The mode and its curvature give Laplace's approximation, and the proposal of importance draws that put right
what is not normal: a process that hides below the others has a long tail to small sizes, and of a slow
Gauss-Markov process only the walk ``2 G^2 / tau`` is known. A ramp is linear: with and without it the
evidence comes from the same factor.

The draws go on until enough of them count. The proposal begins as Student's t at the mode, and a wide one.
Where a draw weighs most the proposal is too thin: a hump is added there, shaped like the weighted draws
nearest to it. All draws of all rounds are kept, and weighed by the whole mixture: incremental mixture
importance sampling (Raftery and Bao, Biometrics 66 (2010) 1162).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.inference.noise_model import Cost, NoiseModel, likelihood, mode_of


@dataclass(frozen=True, slots=True, eq=False)
class ProcessFit:
    """Posterior of one set of processes, from mode and curvature alone or with importance draws.

    Attributes
    ----------
    names : logarithms that vary: N, then those of B, K, Q, G, tau that the set has.
    mode : (k,) of the logarithms.
    root : (k, k) lower triangular, of the covariance at the mode.
    log_evidence : (without a ramp, with one), of the data under the set and its priors.
    draws : (m, k) logarithms; the mode alone where nothing was drawn.
    weights : (m, 2) posterior weights without a ramp and with one; they add up to 1.
    ramps : (m, 2) mean and sd of the ramp, u/s, given each draw.
    """

    names: tuple[str, ...]
    mode: FloatArray
    root: FloatArray
    log_evidence: tuple[float, float]
    draws: FloatArray
    weights: FloatArray
    ramps: FloatArray


def parameters(processes: Sequence[str]) -> tuple[str, ...]:
    """Logarithms that a set of processes has.

    Examples
    --------
    >>> parameters(("K", "G"))
    ('N', 'K', 'G', 'tau')
    """
    return ("N", *(name for name in "BKQ" if name in processes), *(("G", "tau") if "G" in processes else ()))


def fit_mode(model: NoiseModel, names: tuple[str, ...], starts: Sequence[FloatArray]) -> ProcessFit:
    """Laplace's approximation of one set of processes.

    Parameters
    ----------
    model : of the run.
    names : logarithms that vary, as `parameters` gives them.
    starts : (k,) where to begin; the best of them is taken.
    """
    cost = Cost(model, names)
    mode, covariance = mode_of(model, names, min(starts, key=cost.value))
    told = likelihood(model, names, mode)
    root = np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)
    spread = 0.5 * len(mode) * math.log(2.0 * math.pi) + float(np.sum(np.log(np.diag(root))))
    without, ramp = (told.levels + cost.log_prior(mode) + spread).tolist()
    return ProcessFit(
        names=names,
        mode=mode,
        root=root,
        log_evidence=(without, ramp),
        draws=mode[None, :],
        weights=np.exp(told.levels - told.level)[None, :],
        ramps=np.array([told.last]) * model.prior.ramp,
    )


def fit_draws(model: NoiseModel, fit: ProcessFit, rng: np.random.Generator, *, enough: float) -> ProcessFit:
    """Put Laplace's approximation right by importance draws.

    Parameters
    ----------
    model : of the run.
    fit : of `fit_mode`.
    rng : the source of randomness.
    enough : effective draws.
    """
    cost = Cost(model, fit.names)

    def target(x: FloatArray) -> Sequence[float]:
        told, prior = likelihood(model, fit.names, x), cost.log_prior(x)
        return told.level + prior, *(told.levels + prior).tolist(), *told.last

    found = drawn_until(target, Hump(fit.mode, fit.root), cost.prior[1], rng, enough=enough)
    logs = found.told[:, 1:3] - found.log_proposal[:, None]
    peak = float(np.max(logs))
    weights = np.exp(logs - peak)
    levels = np.log(np.maximum(weights.mean(axis=0), np.finfo(float).tiny)) + peak
    return replace(
        fit,
        log_evidence=(float(levels[0]), float(levels[1])),
        draws=found.draws,
        weights=weights / weights.sum(),
        ramps=found.told[:, 3:] * model.prior.ramp,
    )


BATCH = 64
"""Draws of each hump, and neighbours that shape a new one."""

WIDE = 3.0
"""Width of the second hump over that of the first: it meets a ridge that the first would miss."""

MOST = 48
"""Most humps: what is left thin then has a weight that more draws would hardly mend."""

FREEDOM = 5.0
"""Degrees of freedom of Student's t: tails heavier than a posterior's."""

ROUND = 0.05
"""Share of the first hump's covariance that a new one has at least: no hump is flat."""


@dataclass(frozen=True, slots=True, eq=False)
class Hump:
    """Student's t with `FREEDOM` degrees of freedom.

    Attributes
    ----------
    center : (k,).
    root : (k, k) lower triangular, its square the scale matrix.
    """

    center: FloatArray
    root: FloatArray

    def drawn(self, rng: np.random.Generator) -> FloatArray:
        """Draws (BATCH, k)."""
        stretch = np.sqrt(FREEDOM / rng.chisquare(FREEDOM, size=(BATCH, 1)))
        return self.center + stretch * rng.standard_normal((BATCH, len(self.center))) @ self.root.T

    def log_density(self, x: FloatArray) -> FloatArray:
        """Logarithm of the density (m,) at points (m, k)."""
        k = len(self.center)
        z = np.linalg.solve(self.root, (x - self.center).T)
        level = math.lgamma(0.5 * (FREEDOM + k)) - math.lgamma(0.5 * FREEDOM)
        level -= 0.5 * k * math.log(FREEDOM * math.pi) + float(np.sum(np.log(np.diag(self.root))))
        return level - 0.5 * (FREEDOM + k) * np.log1p(np.sum(z * z, axis=0) / FREEDOM)


@dataclass(frozen=True, slots=True, eq=False)
class Drawn:
    """Weighted draws.

    Attributes
    ----------
    draws : (m, k).
    told : (m, q) what the target said of each; its first column is the log density.
    log_proposal : (m,) log density of the proposal at each.
    """

    draws: FloatArray
    told: FloatArray
    log_proposal: FloatArray

    @property
    def weights(self) -> FloatArray:
        """Weights (m,) that add up to 1."""
        logs = self.told[:, 0] - self.log_proposal
        weights = np.exp(logs - logs.max())
        return np.asarray(weights / weights.sum(), dtype=np.float64)

    @property
    def effective(self) -> float:
        """Effective number of draws."""
        return 1.0 / float(self.weights @ self.weights)


def drawn_until(
    target: Callable[[FloatArray], Sequence[float]],
    hump: Hump,
    width: FloatArray,
    rng: np.random.Generator,
    *,
    enough: float,
) -> Drawn:
    """Draw from a density until enough draws count.

    Parameters
    ----------
    target : gives, at a point (k,), the log density up to a constant and what else is kept of the point.
    hump : to begin with.
    width : (k,) sizes that make distances along the axes alike.
    rng : the source of randomness.
    enough : effective draws.

    Examples
    --------
    >>> bent = lambda x: (-0.5 * x[0] ** 2 - 0.5 * (x[1] - x[0] ** 2) ** 2,)
    >>> start = Hump(np.zeros(2), np.eye(2))
    >>> found = drawn_until(bent, start, np.ones(2), np.random.default_rng(1), enough=200.0)
    >>> found.effective > 200.0, abs(float(found.weights @ found.draws[:, 1]) - 1.0) < 0.5
    (True, True)
    """
    parts, points, told = [hump, Hump(hump.center, WIDE * hump.root)], [], []
    while True:
        for part in parts[len(points) :]:
            points.append(part.drawn(rng))
            told.append(np.array([target(x) for x in points[-1]], dtype=float))
        found = _weighed(parts, np.concatenate(points), np.concatenate(told))
        if found.effective >= enough or len(parts) >= MOST:
            return found
        parts.append(_added(found, hump, width))


def _weighed(parts: Sequence[Hump], draws: FloatArray, told: FloatArray) -> Drawn:
    each = np.array([hump.log_density(draws) for hump in parts])
    return Drawn(draws, told, np.logaddexp.reduce(each, axis=0) - math.log(len(parts)))


def _added(found: Drawn, first: Hump, width: FloatArray) -> Hump:
    """Hump where a draw weighs most, of the shape of the weighted draws nearest to it."""
    weights = found.weights
    center = found.draws[np.argmax(weights)]
    apart = found.draws - center
    near = np.argsort(np.sum((apart / width) ** 2, axis=1))[:BATCH]
    share = weights[near] + 1.0 / len(weights)
    covariance = (apart[near] * (share / share.sum())[:, None]).T @ apart[near]
    return Hump(center, np.linalg.cholesky(covariance + ROUND * first.root @ first.root.T))
