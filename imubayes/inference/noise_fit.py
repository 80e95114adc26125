"""Posterior and evidence of one set of noise processes.

The mode and its curvature give Laplace's approximation, and the proposal of importance draws that put right
what is not normal: a process that hides below the others has a long tail to small sizes, and of a slow
Gauss-Markov process only the walk ``2 G^2 / tau`` is known. A ramp is linear: with and without it the
evidence comes from the same factor.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.inference.noise_draws import Hump, drawn_until
from imubayes.inference.noise_models import Likelihood, NoiseData, likelihood
from imubayes.inference.reml import REACH, STEP
from imubayes.sensors.noise_processes import NoiseProcesses


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


def fit_mode(data: NoiseData, names: tuple[str, ...], starts: Sequence[FloatArray]) -> ProcessFit:
    """Laplace's approximation of one set of processes.

    Parameters
    ----------
    data : the run.
    names : logarithms that vary, as `parameters` gives them.
    starts : (k,) where to begin; the best of them is taken.
    """
    cost = _cost_of(data, names)
    mode = _lowest(cost, min(starts, key=cost))
    told = cost.told(mode)
    root = np.asarray(np.linalg.cholesky(_covariance(cost, mode, cost.width)), dtype=np.float64)
    spread = 0.5 * len(mode) * math.log(2.0 * math.pi) + float(np.sum(np.log(np.diag(root))))
    level = cost.log_prior(mode) + spread
    shares = np.array([told.without, told.ramp]) - np.logaddexp(told.without, told.ramp)
    return ProcessFit(
        names=names,
        mode=mode,
        root=root,
        log_evidence=(level + told.without, level + told.ramp),
        draws=mode[None, :],
        weights=np.exp(shares)[None, :],
        ramps=np.array([[told.ramp_mean, told.ramp_sd]]) * data.prior.ramp,
    )


def fit_draws(data: NoiseData, fit: ProcessFit, rng: np.random.Generator, *, enough: float) -> ProcessFit:
    """Put Laplace's approximation right by importance draws.

    Parameters
    ----------
    data : the run.
    fit : of `fit_mode`.
    rng : the source of randomness.
    enough : effective draws.
    """
    cost = _cost_of(data, fit.names)

    def target(x: FloatArray) -> Sequence[float]:
        told, prior = cost.told(x), cost.log_prior(x)
        both = float(np.logaddexp(told.without, told.ramp))
        return both + prior, told.without + prior, told.ramp + prior, told.ramp_mean, told.ramp_sd

    found = drawn_until(target, Hump(fit.mode, fit.root), cost.width, rng, enough=enough)
    logs = found.told[:, 1:3] - found.log_proposal[:, None]
    peak = float(np.max(logs))
    weights = np.exp(logs - peak)
    levels = np.log(np.maximum(weights.mean(axis=0), np.finfo(float).tiny)) + peak
    return replace(
        fit,
        log_evidence=(float(levels[0]), float(levels[1])),
        draws=found.draws,
        weights=weights / weights.sum(),
        ramps=found.told[:, 3:] * data.prior.ramp,
    )


def _lowest(cost: _Cost, start: FloatArray) -> FloatArray:
    from scipy.optimize import minimize

    ends = np.minimum(cost.center, start), np.maximum(cost.center, start)
    bounds = [*zip(ends[0] - REACH * cost.width, ends[1] + REACH * cost.width, strict=True)]
    options = {"maxiter": 60, "ftol": 1e-9}
    return minimize(cost, start, method="L-BFGS-B", bounds=bounds, options=options).x


@dataclass(frozen=True, slots=True, eq=False)
class _Cost:
    """Negative log posterior of the logarithms, averaged over ramp and no ramp, up to a constant."""

    data: NoiseData
    names: tuple[str, ...]
    center: FloatArray
    width: FloatArray

    def told(self, x: FloatArray) -> Likelihood:
        return likelihood(self.data, NoiseProcesses(**dict(zip(self.names, np.exp(x).tolist(), strict=True))))

    def pull(self, x: FloatArray) -> float:
        return 0.5 * float(np.sum(((x - self.center) / self.width) ** 2))

    def log_prior(self, x: FloatArray) -> float:
        """Log density of the logarithms."""
        spread = 0.5 * len(x) * math.log(2.0 * math.pi) + float(np.sum(np.log(self.width)))
        return -self.pull(x) - spread

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
