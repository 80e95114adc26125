"""Posterior and evidence of one set of noise processes.

The mode and its curvature give Laplace's approximation, and the proposal of importance draws that put right
what is not normal: a process that hides below the others has a long tail to small sizes, and of a slow
Gauss-Markov process only the walk ``2 G^2 / tau`` is known. A ramp is linear: with and without it the
evidence comes from the same factor.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.inference.importance import Student, drawn_until
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

    found = drawn_until(target, Student(fit.mode, fit.root), cost.prior[1], rng, enough=enough)
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
