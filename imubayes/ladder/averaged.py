"""The rungs that weigh every submodel without a chain: at the noise as estimated, and averaged over draws.

For the second, each run's posterior of ln N, ln B, ln K is taken as a Student distribution about its peak.
Draws of it are weighted by the exact posterior of all runs together, and resampled by these weights (Rubin
1988): what comes out counts as draws of the posterior.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import posterior
from imubayes.campaign.prepared import Prepared
from imubayes.inference.importance import Student
from imubayes.inference.mcmc.chains import NoiseDraw, at_noise, noises_at, places_of
from imubayes.inference.mcmc.split import Coordinates, coordinates, log_likelihood, splits_of
from imubayes.ladder.problem import Ground, Posterior, once, prepared

PROPOSED = 24
"""Noises at which all rows are whitened; about half as many count."""

ENOUGH = 8.0
"""Draws that must count; else as many more are taken."""

ROUNDS = 4
"""Most times that draws are taken."""

RESAMPLED = 16
"""Noises at which every submodel is weighed."""

TINY = np.finfo(float).tiny
"""In place of a zero whose logarithm is averaged."""

STEPS = (1.0, 0.05, 0.3)
"""Steps of the second differences: of ln N in its white sd, of ln B, and of ln K, which moves far."""


class Weighted(NamedTuple):
    """Draws of the noise.

    Attributes
    ----------
    noises : (m, g, 3) N, B, K of every run.
    draws : m problems.
    weight : (m,) posterior over proposal, summing to 1.
    log_evidence : of the full library, the noise integrated out.
    """

    noises: FloatArray
    draws: tuple[NoiseDraw, ...]
    weight: FloatArray
    log_evidence: float

    @property
    def count(self) -> float:
        """How many of the draws count."""
        return 1.0 / float(np.sum(self.weight**2))


def plug_in(ground: Ground) -> Posterior:
    """Take the noise as estimated; the decision averages over its common scale, which has a closed form."""
    return Posterior("plug-in", estimated_noise(prepared(ground)))


def averaged(ground: Ground) -> Posterior:
    """Draw the noise about its peak; the full library over all weighted draws."""
    ready, drawn = prepared(ground), weighted(ground)
    which = np.zeros(1, dtype=int)
    if len(drawn.weight) > 1:  # draws that stand for all of them, systematically
        ticks = (np.arange(RESAMPLED) + ground.rngs["averaged"].random()) / RESAMPLED
        which = np.minimum(np.searchsorted(np.cumsum(drawn.weight), ticks), len(drawn.weight) - 1)
    noises = tuple(drawn.draws[k] for k in which.tolist())
    noise = np.exp(np.tensordot(drawn.weight, np.log(np.maximum(drawn.noises, TINY)), axes=1))
    each = np.array([posterior(draw.factor, ready.prior.sd) for draw in drawn.draws])
    mean = drawn.weight @ each[:, 0]
    sd = np.sqrt(drawn.weight @ (each[:, 1] ** 2 + (each[:, 0] - mean) ** 2))
    return Posterior("averaged", noise, noises, drawn.log_evidence, (mean, sd))


def weighted(ground: Ground) -> Weighted:
    """Draws of the noise about its peak, with the exact posterior's weights; more of them where few count."""

    def make() -> Weighted:
        ready = prepared(ground)
        ground.tell("the noise's posterior about its peak")
        q, prior = peak_of(ready)
        found = _drawn(ready, q, prior, ground.rngs["averaged"])
        for _ in range(ROUNDS - 1 if len(q.center) else 0):
            if found.count >= ENOUGH:
                break
            more = _drawn(ready, q, prior, ground.rngs["averaged"])
            logs = np.array([math.log(len(one.draws)) + one.log_evidence for one in (found, more)])
            whole = float(np.logaddexp(*logs))
            share = np.exp(logs - whole)
            weight = np.concatenate((share[0] * found.weight, share[1] * more.weight))
            noises, draws = np.concatenate((found.noises, more.noises)), (*found.draws, *more.draws)
            found = Weighted(noises, draws, weight, whole - math.log(len(draws)))
        return found

    return once(ground, "noises", make)


def _drawn(ready: Prepared, q: Student, prior: FloatArray, rng: np.random.Generator) -> Weighted:
    """Draws about the peak, of a Student distribution: its tails hold what a normal one would miss."""
    from scipy.special import ndtri

    d = len(q.center)
    size = PROPOSED if d else 1
    # in each coordinate one from every slice of equal probability
    slices = np.argsort(rng.random((d, size)), axis=1).T
    z = ndtri((slices + rng.random((size, d))) / size) if d else np.zeros((size, 0))
    z *= np.sqrt(q.freedom / rng.chisquare(q.freedom, len(z)))[:, None]
    x = q.center + z @ q.L.T
    noises = noises_at(ready.summary.runs, x)
    draws = tuple(at_noise(ready.summary, ready.rows, noise, ready.prior.sd) for noise in noises)
    center, width = prior.T
    log_p = -0.5 * np.sum(((x - center) / width) ** 2, axis=1) - float(np.sum(np.log(width)))
    logs = np.array([draw.log_marginal for draw in draws]) + log_p
    logs -= q.log_density(x)
    weight = np.exp(logs - logs.max())
    evidence = float(logs.max()) + math.log(float(weight.mean())) - 0.5 * d * math.log(2.0 * math.pi)
    return Weighted(noises, draws, weight / weight.sum(), evidence)


def peak_of(ready: Prepared) -> tuple[Student, FloatArray]:
    """Student distribution about the peak of the noise's posterior, each run's by itself, with its curvature.

    Beside it stands the prior (d, 2): mean and sd of each logarithm.
    """
    from scipy.linalg import block_diag

    c = coordinates(ready.summary.factor, ready.prior.sd)
    each = [_peak(ready, name, c) for name in places_of(ready.summary.runs)]
    center = np.concatenate([np.zeros(0), *(center for center, _, _ in each)])
    L = np.asarray(block_diag(np.zeros((0, 0)), *(root for _, root, _ in each)), dtype=float)
    return Student(center, L), np.concatenate([np.zeros((0, 2)), *(prior for _, _, prior in each)])


def _peak(ready: Prepared, name: str, c: Coordinates) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Peak, root of the covariance, and prior of the noise of the runs that share it."""
    pairs = [(r, s) for r, s in zip(ready.rows, ready.summary.runs, strict=True) if s.noise_run == name]
    rows, runs = [r for r, _ in pairs], [s for _, s in pairs]
    prior = np.array([(math.log(median), spread) for median, spread in runs[0].steering])
    known = 1.0 / math.sqrt(2.0 * sum(r.samples for r in rows))
    if len(prior) == 1:
        return np.log([runs[0].noise.N]), np.array([[known]]), prior
    splits, top = splits_of(rows, runs, c)

    def log_density(x: FloatArray) -> float:
        return log_likelihood(splits, x) - 0.5 * float(np.sum(((x - prior[:, 0]) / prior[:, 1]) ** 2))

    steps = np.array([known * STEPS[0], *STEPS[1:]])
    # lower triangular root of the covariance; along no direction is it wider than the prior, sds (d,)
    width = prior[:, 1]
    values, vectors = np.linalg.eigh(-_curvature(log_density, top, steps) * np.outer(width, width))
    covariance = (vectors / np.maximum(values, 1.0)) @ vectors.T
    return top, np.asarray(np.linalg.cholesky(covariance * np.outer(width, width)), dtype=float), prior


def _curvature(function: Callable[[FloatArray], float], x: FloatArray, steps: FloatArray) -> FloatArray:
    """Second derivatives (d, d) by central differences."""
    d = len(x)
    e, H = np.diag(steps), np.empty((d, d))
    for i in range(d):
        for j in range(i + 1):
            corners = ((e[i] + e[j], 1.0), (e[i] - e[j], -1.0), (e[j] - e[i], -1.0), (-e[i] - e[j], 1.0))
            rise = sum(sign * function(x + away) for away, sign in corners)
            H[i, j] = H[j, i] = rise / (4.0 * steps[i] * steps[j])
    return H


def estimated_noise(ready: Prepared) -> FloatArray:
    """N, B, K (g, 3) of each run as it was estimated."""
    return np.array([(run.noise.N, run.noise.B, run.noise.K) for run in ready.summary.runs])
