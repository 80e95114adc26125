"""The rungs that say what the noise is, over which every submodel is weighed.

As estimated; by draws about its peak; by chains of emcee, over the noise, over coefficients and noise on
compressed rows, and on every row.

For the draws, each run's posterior of ln N, ln B, ln K is taken as a Student distribution about its peak.
Draws of it, and of more humps where it is thin, are weighted by the exact posterior of all runs together, and
resampled by these weights (Rubin 1988): what comes out counts as draws of the posterior.

On every row nothing is compressed and nothing interpolated between whitenings: each step factors the noise's
covariance of all rows and whitens what the coefficients leave, for all its walkers in one pass. Walkers
start from the posterior of the rung below, which also proposes: the acceptance is as good as that posterior
is right. Their every step is long, so that the time is looked at after each of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.algebra.factor import posterior
from imubayes.campaign.prepared import Prepared
from imubayes.inference.dwells import tiles
from imubayes.inference.importance import Student, drawn_until, picked
from imubayes.inference.linear import Linear
from imubayes.inference.mcmc import Chains, NoiseDraw, at_noise, by_dwell, noises_at, places_of
from imubayes.inference.mcmc.density import TAIL, Density, density_of, independent, theta_of
from imubayes.inference.mcmc.ensembles import ChainHistory, Target, run_ensembles
from imubayes.inference.mcmc.run import DIFFERENTIAL, INDEPENDENT, Sampled, flat, thinned
from imubayes.inference.mcmc.split import Coordinates, coordinates, cost_of, splits_of
from imubayes.inference.minimum import EVERYWHERE, minimum
from imubayes.inference.summary import RunSummary
from imubayes.inference.whiten import Carry, begin, mattering, states_of, whiten_on
from imubayes.ladder import RungName
from imubayes.ladder.problem import Ground, Posterior, chained, once, prepared
from imubayes.sensors.noise import Noise

PROPOSED = 1.5
"""Noises at which all rows are whitened, for each at which models are weighed; about half as many count."""

ENOUGH = 0.5
"""Share of the latter that must count; else as many more are taken, where they are thin."""

MOST = 4
"""Most times that draws are taken."""

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
    """Draw the noise about its peak; the full library over all weighted draws."""
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
    """Draws of the noise about its peak, with the exact posterior's weights; more of them where few count."""

    def make() -> Weighted:
        ready = prepared(ground)
        ground.tell("the noise's posterior about its peak")
        q, prior = peak_of(ready)
        noises, draws, (center, width) = list[FloatArray](), list[NoiseDraw](), prior.T
        constant = 0.5 * len(center) * math.log(2.0 * math.pi) + float(np.sum(np.log(width)))

        def target(x: FloatArray) -> tuple[float]:
            noises.append(noises_at(ready.summary.runs, x[None])[0])
            draws.append(at_noise(ready.summary, ready.rows, noises[-1], ready.prior.sd))
            return (draws[-1].log_marginal - 0.5 * float(np.sum(((x - center) / width) ** 2)) - constant,)

        # where nothing of the noise is open there is one draw
        count = ground.limits.draws
        proposed = (math.ceil(PROPOSED * count), MOST) if len(center) else (1, 1)
        enough = ENOUGH * count if len(center) else 1.0
        found = drawn_until(target, q, width, ground.rngs["averaged"], enough=enough, dear=proposed)
        return Weighted(np.array(noises), tuple(draws), found.weights, found.log_integral, found.effective)

    return once(ground, "averaged", make)


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
    prior = np.array([(math.log(median), spread) for median, spread in runs[0].found.steering.values()])
    if len(prior) == 1:
        known = 1.0 / math.sqrt(2.0 * sum(r.samples for r in rows))
        return np.log([runs[0].noise.N]), np.array([[known]]), prior
    splits, top = splits_of(rows, runs, c)
    near = np.diag(np.square(runs[0].found.sd))
    peak, covariance = minimum(cost_of(splits, runs[0]), top, prior[:, 1], EVERYWHERE, near)
    return peak, np.asarray(np.linalg.cholesky(covariance), dtype=float), prior


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
    rng = ground.rngs["raw"]
    ground.tell("every row at every step")
    density = density_of(ready.summary, ready.rows, ready.prior.sd, rng)
    limits = replace(ground.limits, seed=int(rng.integers(2**32)), checkpoint=None)
    history = run_ensembles(_target(ready, density, below.chains), limits, ground.tell)
    sampled = _sampled(ready, density, history, below.chains, limits.draws)
    return _by_chains("raw", sampled, history.found.converged)


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
    parts, p, found = mattering(run.noise, rows.rows), len(rows.names), np.zeros(len(theta))
    each, carried = [Noise(*noise) for noise in noises.tolist()], dict[int, Carry]()
    for _, tile, table in tiles(rows, "every row"):
        left = table[:, p] - theta @ table[:, :p].T
        for k, noise in enumerate(each):
            states = states_of(noise, parts, tile.duration, tile.axes)
            if k not in carried:
                carried[k] = begin(len(states.rates), float(tile.t[0] - 0.5 * tile.duration[0]), 1)
            d = whiten_on(carried[k], states, tile.t, tile.duration, left[k, :, None])
            found[k] += np.sum(np.log(d)) + left[k] @ left[k]
    return found


def _target(ready: Prepared, density: Density, below: Chains) -> Target:
    """What is sampled, started and proposed from the chains below."""
    p, theta = density.p, flat(below.theta)
    phi = np.linalg.solve(density.coordinates.inverse, (theta - density.coordinates.origin).T).T
    noise, runs = below.noise.reshape(-1, *below.noise.shape[2:]), ready.summary.runs
    own, d = [run.noise_run for run in runs], density.d
    x = np.zeros((len(noise), d))  # its logarithms, where it is not known: `noises_at`, backwards
    for name, place in places_of(runs).items():
        x[:, place] = np.log(noise[:, own.index(name), : place.stop - place.start])

    def start(rng: np.random.Generator, size: int) -> FloatArray:
        # of many terms there are more walkers than draws that are kept
        which = rng.choice(len(phi), size, replace=size > len(phi))
        return np.asarray(np.column_stack((phi[which], x[which])), dtype=float)

    root = np.linalg.cholesky(np.cov(x.T).reshape(d, d)) if d else np.zeros((0, 0))
    q = Student(x.mean(axis=0), np.asarray(root, dtype=float), TAIL)
    return Target(
        names=(*density.names, *density.parameters),
        log_prob=log_density(ready, density),
        moves=((independent(density, q), INDEPENDENT), (None, DIFFERENTIAL)),
        start=start,
        readable=lambda c: np.concatenate((theta_of(density, c[..., :p]), c[..., p:]), axis=-1),
        long=True,
    )


def _sampled(ready: Prepared, density: Density, history: ChainHistory, below: Chains, count: int) -> Sampled:
    """Chains with all that a report asks of them, and the problem at so many of their noises."""
    p = density.p
    c = np.array([thinned(chain) for chain in history.chains])
    theta = theta_of(density, c[..., :p])
    x = c[..., p:].reshape(-1, density.d)
    noise = noises_at(ready.summary.runs, x)
    estimated = [run.noise for run in ready.summary.runs]
    scored = by_dwell(ready.rows, estimated, flat(theta), noise)
    shape = theta.shape[:2]
    chains = replace(
        below,
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
    return Sampled(
        chains, tuple(at_noise(ready.summary, ready.rows, noise[k], ready.prior.sd) for k in chosen)
    )
