"""The rungs that say what the noise is, over which every submodel is weighed.

As estimated; by weighted draws; by chains of emcee, over the noise, over coefficients and noise on
compressed rows, and on every row.

For the draws, each run's posterior of ln N, ln B, ln K is taken as a Student distribution about its peak, and
another one where there is more of it elsewhere. Draws of them, and of more humps where they are thin, are
weighted by the exact posterior of all runs together, and resampled by these weights (Rubin 1988): what comes
out counts as draws of the posterior.

On every row nothing is compressed and nothing interpolated between whitenings: each step factors the noise's
covariance of all rows and whitens what the coefficients leave, for all its walkers in one pass. Walkers
start from the posterior of the rung below, which also proposes: the acceptance is as good as that posterior
is right. Their every step is long, so that the time is looked at after each of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Literal, NamedTuple

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.algebra.factor import posterior
from imubayes.campaign.prepared import Prepared
from imubayes.inference.dwells import tiles
from imubayes.inference.importance import Student, drawn_until, picked
from imubayes.inference.linear import Linear
from imubayes.inference.mcmc import NoiseDraw, at_noise, by_dwell, noises_at, places_of
from imubayes.inference.mcmc.density import Density, over_prior, theta_of
from imubayes.inference.mcmc.ensembles import ChainHistory, run_ensembles
from imubayes.inference.mcmc.run import Sampled, flat, target_of, thinned
from imubayes.inference.mcmc.split import Coordinates, coordinates, cost_of, log_posteriors, splits_of
from imubayes.inference.minimum import EVERYWHERE, minimum
from imubayes.inference.summary import RunSummary
from imubayes.inference.whiten import Carry, begin, processes, states_of, whiten_on
from imubayes.ladder import RungName
from imubayes.ladder.problem import Ground, Posterior, chained, once, prepared
from imubayes.sensors.noise import Noise

PROPOSED = 1.5
"""Noises at which all rows are whitened, for each at which models are weighed; about half as many count."""

ENOUGH = 0.5
"""Share of the latter that must count; else as many more are taken, where they are thin."""

MOST = 4
"""Most times that draws are taken."""

MORE = 1.1
"""Rms distance from the peak, in sds by its curvature, from which there is more of B or K elsewhere."""

TINY = np.finfo(float).tiny
"""In place of a zero whose logarithm is averaged."""


class Weighted(NamedTuple):
    """Draws of the noise, N, B, K of every run (m, g, 3), the problem at each, and their weights, of sum 1.

    The evidence is that of the full library, the noise integrated out; `count` says how many count.
    """

    noises: FloatArray
    draws: tuple[NoiseDraw, ...]
    weight: FloatArray
    log_evidence: float
    count: float


def plug_in(ground: Ground) -> Posterior:
    """Take the noise as estimated; the decision averages over its common scale, which has a closed form."""
    return Posterior("plug-in", estimated_noise(prepared(ground)))


def averaged(ground: Ground) -> Posterior:
    """Draw the noise by its weights; the full library over all weighted draws."""
    ready, drawn = prepared(ground), weighted(ground)
    which = np.zeros(1, dtype=int)
    if len(drawn.weight) > 1:  # draws that stand for all of them, systematically
        count = ground.limits.draws
        ticks = (np.arange(count) + ground.rngs["averaged"].random()) / count
        which = picked(drawn.weight, ticks)
    noises = tuple(drawn.draws[k] for k in which.tolist())
    noise = np.exp(np.tensordot(drawn.weight, np.log(np.maximum(drawn.noises, TINY)), axes=1))
    each = np.array([posterior(draw.factor, ready.prior.sd) for draw in drawn.draws])
    mean = drawn.weight @ each[:, 0]
    sd = np.sqrt(drawn.weight @ (each[:, 1] ** 2 + (each[:, 0] - mean) ** 2))
    return Posterior("averaged", noise, noises, drawn.log_evidence, (mean, sd))


def weighted(ground: Ground) -> Weighted:
    """Draws of the noise, with the exact posterior's weights; more of them where few count."""

    def make() -> Weighted:
        ready = prepared(ground)
        ground.tell("draws of the noise")
        humps, prior = proposed(ready)
        noises, draws, (center, width) = list[FloatArray](), list[NoiseDraw](), prior.T
        constant = 0.5 * len(center) * math.log(2.0 * math.pi) + float(np.sum(np.log(width)))

        def target(x: FloatArray) -> tuple[float]:
            noises.append(noises_at(ready.summary.runs, x[None])[0])
            draws.append(at_noise(ready.summary, ready.rows, noises[-1], ready.prior.sd))
            return (draws[-1].log_marginal - 0.5 * float(np.sum(((x - center) / width) ** 2)) - constant,)

        # where nothing of the noise is open there is one draw
        count = ground.limits.draws
        dear = (math.ceil(PROPOSED * count), MOST) if len(center) else (1, 1)
        enough = ENOUGH * count if len(center) else 1.0
        mixed = drawn_until(target, humps, width, ground.rngs["averaged"], enough=enough, dear=dear)
        return Weighted(np.array(noises), tuple(draws), mixed.weights, mixed.log_integral, mixed.effective)

    return once(ground, "averaged", make)


def proposed(ready: Prepared) -> tuple[list[Student], FloatArray]:
    """Humps of the noise's posterior, each run's by itself: about its peak, and all over its prior.

    The second one is left out where it is the first. Beside them stands the prior (d, 2): mean and sd of
    each logarithm.
    """
    c = coordinates(ready.summary.factor, ready.prior.sd)
    each = [_humps(ready, name, c) for name in places_of(ready.summary.runs)]
    prior = np.concatenate([np.zeros((0, 2)), *(prior for _, prior in each)])
    count = max((len(humps) for humps, _ in each), default=1)
    return [_joined([humps[min(k, len(humps) - 1)] for humps, _ in each]) for k in range(count)], prior


def _joined(parts: Sequence[Student]) -> Student:
    """Hump of independent parts."""
    from scipy.linalg import block_diag

    L = block_diag(np.zeros((0, 0)), *(part.L for part in parts))
    return Student(
        np.concatenate([np.zeros(0), *(part.center for part in parts)]), np.asarray(L, dtype=float)
    )


def _humps(ready: Prepared, name: str, c: Coordinates) -> tuple[list[Student], FloatArray]:
    """One or two humps of the noise of the runs that share it, and its prior."""
    pairs = [(r, s) for r, s in zip(ready.rows, ready.summary.runs, strict=True) if s.noise_run == name]
    rows, runs = [r for r, _ in pairs], [s for _, s in pairs]
    prior = np.array([(math.log(median), spread) for median, spread in runs[0].found.steering.values()])
    if len(prior) == 1:
        known = 1.0 / math.sqrt(2.0 * sum(r.samples for r in rows))
        return [Student(np.log([runs[0].noise.N]), np.array([[known]]))], prior
    splits, top = splits_of(rows, runs, c)
    near = np.diag(np.square(runs[0].found.sd))
    center, covariance = minimum(cost_of(splits, runs[0]), top, prior[:, 1], EVERYWHERE, near)
    peak = Student(center, np.asarray(np.linalg.cholesky(covariance), dtype=float))
    middle, sd, pair = center.copy(), np.sqrt(np.diag(covariance)), np.arange(1, 3)
    told, near = partial(log_posteriors, splits, runs[0]), sd.copy()
    middle[pair], sd[pair] = over_prior(told, center, sd[pair], prior[pair], pair)
    if np.all(np.hypot(middle - center, sd) < MORE * near):
        return [peak], prior
    return [peak, Student(middle, np.diag(sd))], prior


def estimated_noise(ready: Prepared) -> FloatArray:
    """N, B, K (g, 3) of each run as it was estimated."""
    return np.array([(run.noise.N, run.noise.B, run.noise.K) for run in ready.summary.runs])


def sampled_noise(method: Literal["collapsed", "full"], ground: Ground) -> Posterior:
    """Sample the noise, with the coefficients integrated out and drawn exactly, or sampled too."""
    return _by_chains(method, *chained(ground, method))


def _by_chains(rung: RungName, sampled: Sampled, converged: bool) -> Posterior:
    """Noises of some draws; of the full library, what the chains say."""
    chains, every = sampled.chains, (0, 1)
    moments = chains.theta.mean(axis=every), chains.theta.std(axis=every)
    noise = np.median(chains.noise, axis=every)
    return Posterior(rung, noise, sampled.noises, chains.log_evidence[0], moments, chains, converged)


def raw(ground: Ground) -> Posterior:
    """Sample coefficients and noise on every row."""
    ready = prepared(ground)
    below, _ = chained(ground, "full")
    ground.tell("every row at every step")
    limits = replace(ground.limits, seed=int(ground.rngs["raw"].integers(2**32)), checkpoint=None)
    target = target_of(below.density, below.proposal, "full")
    target = replace(target, log_prob=log_density(ready, below.density), long=True)
    history = run_ensembles(target, limits, ground.tell)
    return _by_chains("raw", _sampled(ready, history, below, limits.draws), history.found.converged)


def log_density(ready: Prepared, density: Density) -> Callable[[FloatArray], FloatArray]:
    """Log p(y, phi, x) (m,) of coordinates (m, p + d), from all rows.

    It is what `imubayes.inference.mcmc.density.log_joint` carries on between whitenings.
    """
    runs, p, n = ready.summary.runs, density.p, ready.summary.factor.n
    half = 0.5 * math.log(2.0 * math.pi)
    constant = density.coordinates.log_volume - float(np.sum(np.log(density.sd))) - (p + n) * half
    constant -= float(np.sum(np.log(density.width))) + density.d * half

    def of(c: FloatArray) -> FloatArray:
        theta, x = theta_of(density, c[:, :p]), c[:, p:]
        pull = np.sum((theta / density.sd) ** 2, axis=1)
        pull += np.sum(((x - density.center) / density.width) ** 2, axis=1)
        each = zip(ready.rows, runs, noises_at(runs, x).swapaxes(0, 1), strict=True)
        misfit = sum(_misfit(rows, run, theta, noises) for rows, run, noises in each)
        return constant - 0.5 * (pull + misfit)

    return of


def _misfit(rows: Linear, run: RunSummary, theta: FloatArray, noises: FloatArray) -> FloatArray:
    """Minus twice the log likelihood of a run, up to a constant, of coefficients (m, p) and N, B, K (m, 3).

    One pass: the rows are made a tile at a time, for all m, and whitened for each with what it carries on.
    """
    parts, p, misfit = processes(rows.rows, run.noise), len(rows.names), np.zeros(len(theta))
    each, carried = [Noise(*noise) for noise in noises.tolist()], dict[int, Carry]()
    for _, tile, table in tiles(rows, "every row"):
        left = table[:, p] - theta @ table[:, :p].T
        for k, noise in enumerate(each):
            states = states_of(noise, parts, tile.duration, tile.axes)
            if k not in carried:
                carried[k] = begin(len(states.rates), float(tile.t[0] - 0.5 * tile.duration[0]), 1)
            d = whiten_on(carried[k], states, tile.t, tile.duration, left[k, :, None])
            misfit[k] += np.sum(np.log(d)) + left[k] @ left[k]
    return misfit


def _sampled(ready: Prepared, history: ChainHistory, below: Sampled, count: int) -> Sampled:
    """Chains with all that a report asks of them, and the problem at so many of their noises."""
    density, p = below.density, below.density.p
    c = np.array([thinned(chain) for chain in history.chains])
    theta = theta_of(density, c[..., :p])
    x = c[..., p:].reshape(-1, density.d)
    noise = noises_at(ready.summary.runs, x)
    estimated = [run.noise for run in ready.summary.runs]
    scored = by_dwell(ready.rows, estimated, flat(theta), noise)
    shape = theta.shape[:2]
    chains = replace(
        below.chains,
        sampler="raw",
        theta=theta,
        noise=noise.reshape(*shape, *noise.shape[1:]),
        log_density=np.array([thinned(part[..., None])[:, 0] for part in history.log_prob]),
        log_likelihood=scored.log_likelihood.reshape(*shape, -1),
        predicted=scored.predicted.reshape(*shape, -1),
        diagnostics=history.found,
        interpolation_error=0.0,
    )
    chosen = np.linspace(0, len(noise) - 1, count if density.d else 1).astype(int)
    noises = tuple(at_noise(ready.summary, ready.rows, noise[k], ready.prior.sd) for k in chosen)
    return below._replace(chains=chains, noises=noises)
