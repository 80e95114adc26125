"""Posterior and evidence of one set of noise processes.

The mode and its curvature give Laplace's approximation, and the proposal of an importance sample that puts
right what is not normal: a process that hides below the others has a long tail to small sizes. A ramp is
linear: with and without it the evidence comes from the same factor.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from imubayes.inference.noise_models import Likelihood, NoiseData, likelihood
from imubayes.inference.reml import REACH, STEP
from imubayes.sensors.noise_processes import NoiseProcesses

FloatArray = NDArray[np.float64]

DRAWS = 64
"""Importance draws of a round: the evidence is then known to about 0.1 nats."""

FREEDOM = 5.0
"""Degrees of freedom of Student's t from which the draws come: tails heavier than the posterior's."""


@dataclass(frozen=True, slots=True, eq=False)
class ProcessFit:
    """Posterior of one set of processes, from mode and curvature alone or with importance draws.

    Attributes
    ----------
    names : logarithms that vary: N, then those of B, K, Q, G, tau that the set has.
    mode : (k,) of the logarithms.
    covariance : (k, k) at the mode.
    log_evidence : (without a ramp, with one), of the data under the set and its priors.
    draws : (m, k) logarithms; the mode alone where nothing was drawn.
    weights : (m, 2) posterior weights without a ramp and with one; they add up to 1.
    ramps : (m, 2) mean and sd of the ramp, u/s, given each draw.
    """

    names: tuple[str, ...]
    mode: FloatArray
    covariance: FloatArray
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


def fit_mode(data: NoiseData, names: tuple[str, ...], starts: Sequence[FloatArray]) -> ProcessFit:
    """Laplace's approximation of one set of processes.

    Parameters
    ----------
    data : the run.
    names : logarithms that vary, as `parameters` gives them.
    starts : (k,) where to begin; the best of them is taken.
    """
    from scipy.optimize import minimize

    cost = _cost_of(data, names)
    first = min(starts, key=cost)
    bounds = [
        (min(c, s) - REACH * w, max(c, s) + REACH * w)
        for c, s, w in zip(cost.center, first, cost.width, strict=True)
    ]
    found = minimize(cost, first, method="L-BFGS-B", bounds=bounds, options={"maxiter": 60, "ftol": 1e-9})
    covariance = _covariance(cost, found.x, cost.width)
    told = cost.told(found.x)
    level = -cost.pull(found.x) - cost.log_widths + 0.5 * float(np.linalg.slogdet(covariance)[1])
    weights = np.exp(np.array([told.without, told.ramp]) - np.logaddexp(told.without, told.ramp))
    return ProcessFit(
        names=names,
        mode=found.x,
        covariance=covariance,
        log_evidence=(level + told.without, level + told.ramp),
        draws=found.x[None, :],
        weights=weights[None, :],
        ramps=np.array([[told.ramp_mean, told.ramp_sd]]) * data.prior.ramp,
    )


def fit_draws(data: NoiseData, fit: ProcessFit, rng: np.random.Generator) -> ProcessFit:
    """Put Laplace's approximation right by two rounds of importance draws; the first shapes the second."""
    cost = _cost_of(data, fit.names)
    first = _round(cost, fit.mode, fit.covariance, rng)
    center, covariance = _moments(first, fit)
    second = _round(cost, center, covariance, rng)
    peak = float(np.max(second.log_weights))
    weights = np.exp(second.log_weights - peak)
    total = weights.mean(axis=0)
    levels = np.log(np.maximum(total, np.finfo(float).tiny)) + peak
    return replace(
        fit,
        log_evidence=(float(levels[0]), float(levels[1])),
        draws=second.draws,
        weights=weights / weights.sum(),
        ramps=second.ramps * data.prior.ramp,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Round:
    draws: FloatArray
    log_weights: FloatArray
    ramps: FloatArray


def _round(cost: _Cost, center: FloatArray, covariance: FloatArray, rng: np.random.Generator) -> _Round:
    k = len(center)
    root = np.linalg.cholesky(covariance)
    stretch = np.sqrt(FREEDOM / rng.chisquare(FREEDOM, size=(DRAWS, 1)))
    z = stretch * rng.standard_normal((DRAWS, k))
    draws = center + z @ root.T
    log_q = (
        math.lgamma(0.5 * (FREEDOM + k)) - math.lgamma(0.5 * FREEDOM)
        - 0.5 * k * math.log(FREEDOM * math.pi) - float(np.sum(np.log(np.diag(root))))
        - 0.5 * (FREEDOM + k) * np.log1p(np.sum(z * z, axis=1) / FREEDOM)
    )  # fmt: skip
    told = [cost.told(x) for x in draws]
    prior = np.array([-cost.pull(x) for x in draws]) - cost.log_widths - 0.5 * k * math.log(2.0 * math.pi)
    levels = np.array([[one.without, one.ramp] for one in told])
    ramps = np.array([[one.ramp_mean, one.ramp_sd] for one in told])
    return _Round(draws, levels + (prior - log_q)[:, None], ramps)


def _moments(first: _Round, fit: ProcessFit) -> tuple[FloatArray, FloatArray]:
    """Center and covariance of the second proposal: of the weighted draws, with some of the first."""
    whole = np.logaddexp(first.log_weights[:, 0], first.log_weights[:, 1])
    weights = np.exp(whole - whole.max())
    weights /= weights.sum()
    effective = 1.0 / float(weights @ weights)
    center = weights @ first.draws
    apart = first.draws - center
    trust = effective / (effective + 2.0 * len(fit.mode))
    covariance = trust * (apart * weights[:, None]).T @ apart + (1.0 - trust) * fit.covariance
    return trust * center + (1.0 - trust) * fit.mode, covariance


@dataclass(frozen=True, slots=True, eq=False)
class _Cost:
    """Negative log posterior of the logarithms, averaged over ramp and no ramp, up to a constant."""

    data: NoiseData
    names: tuple[str, ...]
    center: FloatArray
    width: FloatArray

    @property
    def log_widths(self) -> float:
        return float(np.sum(np.log(self.width)))

    def told(self, x: FloatArray) -> Likelihood:
        return likelihood(self.data, NoiseProcesses(**dict(zip(self.names, np.exp(x).tolist(), strict=True))))

    def pull(self, x: FloatArray) -> float:
        return 0.5 * float(np.sum(((x - self.center) / self.width) ** 2))

    def __call__(self, x: FloatArray) -> float:
        told = self.told(x)
        return self.pull(x) - float(np.logaddexp(told.without, told.ramp))


def _cost_of(data: NoiseData, names: tuple[str, ...]) -> _Cost:
    known = [data.prior.log_normal[name] for name in names]
    return _Cost(
        data, names, np.log([median for median, _ in known]), np.array([width for _, width in known])
    )


def _covariance(cost: Callable[[FloatArray], float], best: FloatArray, width: FloatArray) -> FloatArray:
    """Inverse of the second differences; the data never say less than the prior does."""
    eye, middle = STEP * np.eye(len(best)), cost(best)
    single = [cost(best + e) + cost(best - e) - 2.0 * middle for e in eye]
    H = np.diag(single)
    for i in range(len(best)):
        for j in range(i):
            both = cost(best + eye[i] + eye[j]) + cost(best - eye[i] - eye[j]) - 2.0 * middle
            H[i, j] = H[j, i] = 0.5 * (both - single[i] - single[j])
    # in prior sds a curvature below 1 would say less than the prior alone
    values, vectors = np.linalg.eigh(H / STEP**2 * np.outer(width, width))
    scaled = vectors * width[:, None]
    return (scaled / np.maximum(values, 1.0)) @ scaled.T
