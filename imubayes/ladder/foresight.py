"""What the rung above would change, foreseen without climbing it.

Each step has a formula of its own that takes milliseconds to tens of them; its reason says which.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import cache, reduce

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import Factor, add, factor_of, noise_scale, posterior, reorder
from imubayes.campaign.prepared import Prepared
from imubayes.inference.dwells import dwells_of
from imubayes.inference.linear import Linear, blocks_of, linear_of
from imubayes.inference.noise_model import estimate
from imubayes.inference.prior import ScalePrior
from imubayes.inference.summary import Summary
from imubayes.inference.whiten import whiten
from imubayes.ladder import RungName
from imubayes.ladder.averaged import weighted
from imubayes.ladder.problem import Answer, Ground, Problem, prepared
from imubayes.ladder.regression import EXHAUSTIVE, by_bic
from imubayes.selection.effects import effects_of, log_evidence, refitted
from imubayes.selection.enumerate import enumerate_models
from imubayes.selection.model_prior import log_model_prior
from imubayes.sensors.noise import Noise, noise_prior

BLOCKS = 400
"""Blocks that a run is averaged to where the noise is moved: it is the change that counts."""

CERTAIN = 1e-12
"""An inclusion is taken no nearer to 0 or 1 than this: log odds stay finite."""


Foresight = tuple[tuple[float, float], str]
"""Largest change of a coefficient in posterior sd, and of an inclusion; and how it was foreseen."""


def foresee(ground: Ground, found: Answer) -> Foresight:
    """Foresee what the rung above `found` would change."""
    return STEPS[found.rung](ground, found)


def _colour(ground: Ground, found: Answer) -> Foresight:
    """Means: weigh the dwell means again, with noise of all colours that is estimated from them."""
    problem = ground.problem
    prior = noise_prior(problem.spec.sensor_class) if problem.spec.sensor_class else None
    factors = []
    for run in problem.runs:
        d = dwells_of(linear_of(run, problem.library))
        noise = estimate(d.means, prior).noise
        factors.append(_factor(d.means, noise, problem.library.names))
    whole = reduce(add, factors)
    full, sd = posterior(whole, problem.prior.sd)
    mean, inclusion = _weighed(whole, problem, found)
    apart = np.maximum(np.abs(full - found.full_mean), np.abs(mean - found.mean))
    change = float(np.max(apart / sd)), float(np.max(np.abs(inclusion - found.inclusion)))
    return change, "the dwell means weighed again, with drift estimated from them and the class's prior"


def _weighed(f: Factor, problem: Problem, found: Answer) -> tuple[FloatArray, FloatArray]:
    """Averaged coefficients and inclusions (p,) on whitened dwell means, where they are tested."""
    names = tuple(n for n, size in zip(f.names, f.column_norms, strict=True) if size > 0.0)
    if len(names) <= EXHAUSTIVE:
        sd = dict(zip(f.names, problem.prior.sd.tolist(), strict=True))
        prior = ScalePrior([sd[name] for name in names])
        models = enumerate_models(Summary(reorder(f, names)), prior, scale=1.0)
    else:
        models = by_bic(f, problem.hierarchical)
    mean, inclusion = found.mean.copy(), found.inclusion.copy()
    tested = [f.names.index(name) for name in models.names]
    mean[tested], inclusion[tested] = models.mean, models.inclusion
    return mean, inclusion


def _neighbours(ground: Ground, found: Answer) -> Foresight:
    """Sparse: weigh the chosen model against those with one term more or less."""
    ready = prepared(ground)
    f, sd = ready.summary.factor, ready.prior.sd
    e = effects_of(f, sd, found.names, noise_scale(f, sd))
    here = np.array([name in found.model for name in e.names])
    around = np.vstack((here, here ^ np.eye(len(here), dtype=bool)))
    by_size = log_model_prior("beta-binomial", len(here), ())
    score = log_evidence(e, around) + by_size[around.sum(axis=1)]
    weight = np.exp(score - score.max())
    weight /= weight.sum()
    moved = weight @ refitted(e, around) - refitted(e, around[:1])[0]
    change = (
        float(np.max(np.abs(moved), initial=0.0)),
        float(np.max(np.abs(weight @ around - here), initial=0.0)),
    )
    return change, "the chosen model weighed against those with one term more or less"


def _moved_noise(ground: Ground, found: Answer) -> Foresight:
    """Plug-in: move each noise parameter by its sd either way, on block averages."""
    ready = prepared(ground)
    blocks = [blocks_of(rows, BLOCKS) for rows in ready.rows]
    noises = [run.noise for run in ready.summary.runs]
    names, p = ready.summary.names, len(found.names)
    plain = [_factor(b, noise, names) for b, noise in zip(blocks, noises, strict=True)]
    mean, sd = (moments[:p] for moments in posterior(reduce(add, plain), ready.prior.sd))
    held = np.clip(found.inclusion, CERTAIN, 1.0 - CERTAIN)
    usual = np.log(held / (1.0 - held))
    # where an inclusion is 1 to rounding, the Bayes factor against zero
    against = 0.5 * (mean / sd) ** 2 + np.log(sd / ready.prior.sd[:p])
    odds = np.where(found.inclusion < 1.0 - CERTAIN, usual, against)
    shift, turn = np.zeros(p), np.zeros(p)

    @cache
    def others(k: int) -> list[Factor]:
        rest = [*plain[:k], *plain[k + 1 :]]
        return [reduce(add, rest)] if rest else []

    for k, away in _steps(ready):
        found_here = np.array([noises[k].N, noises[k].B, noises[k].K])
        for sign in (1.0, -1.0):
            noise = Noise(*(found_here * np.exp(sign * away)).tolist())
            moved = _factor(blocks[k], noise, names)
            m, s = (moments[:p] for moments in posterior(reduce(add, others(k), moved), ready.prior.sd))
            shift += 0.5 * (m - mean)
            gained = 0.5 * ((m / s) ** 2 - (mean / sd) ** 2) + np.log(s / sd)
            turn += 0.5 * (np.exp(-np.logaddexp(0.0, -odds - gained)) - found.inclusion)
    change = float(np.max(np.abs(shift) / sd)), float(np.max(np.abs(turn)))
    return change, "each noise parameter moved by its sd either way, on block averages"


def _few_draws(ground: Ground, found: Answer) -> Foresight:
    """Averaged: the Monte Carlo error of the draws that count, and that of the chains above."""
    count = weighted(ground).count
    coefficients, inclusions = _spread(found, prepared(ground).prior.sd)
    error = math.hypot(1.0 / math.sqrt(count), 1.0 / math.sqrt(len(found.posterior.noises)))
    reason = f"the Monte Carlo error of draws of the noise, of which {count:.0f} count"
    return (coefficients * error, inclusions * error), reason


def _chain_error(ground: Ground, found: Answer) -> Foresight:
    """Errors of averages over draws of the noise, and of the coefficients' own draws.

    To full they are all that changes; to raw also what the log density is off between whitenings. Two
    densities whose logarithms differ by e have means that differ by e sds at most, to first order; it is the
    noise's density that is off, so that the sd is that of the averages over the noise.
    """
    nats, reason, chains = 0.0, "the Monte Carlo errors of the chains", found.posterior.chains
    if found.rung == "full":
        nats = chains.interpolation_error if chains else 0.0
        reason = f"the {nats:.2g} nats that the log density is off between whitenings, and Monte Carlo errors"
    coefficients, inclusions = _spread(found, prepared(ground).prior.sd)
    few = max(math.sqrt(2.0 / max(len(found.posterior.noises), 1)), nats)
    own = 0.0
    if chains:
        own = math.sqrt(2.0 / min(chains.theta[..., 0].size, float(chains.diagnostics.ess.min())))
    return (max(coefficients * few, own), inclusions * few), reason


def _spread(found: Answer, prior_sd: FloatArray) -> tuple[float, float]:
    """Largest sd over the draws of the noise: of a coefficient, in posterior sd, and of an inclusion."""
    p, models = len(found.names), [one.models for one in found.selections]
    means = np.array([posterior(noise.factor, prior_sd)[0][:p] for noise in found.posterior.noises])
    if len(means) < 2 or not all(one.parts for one in models):
        return 0.0, 0.0
    inclusions = np.hstack([[part.inclusion for _, part in one.parts] for one in models])
    return float(np.max(means.std(axis=0) / found.full_sd)), float(np.max(inclusions.std(axis=0)))


def _steps(ready: Prepared) -> list[tuple[int, FloatArray]]:
    """One sd of ln N, ln B or ln K (3,) of each run whose noise was estimated."""
    steps = []
    for k, run in enumerate(ready.summary.runs):
        sds = np.array(run.noise_sd)
        # blocks leave N less certain than all rows do
        sds[0] = min(float(sds[0]), 1.0 / math.sqrt(2.0 * run.samples)) if run.steering else 0.0
        steps += [(k, np.eye(3)[j] * sds[j]) for j in range(len(run.steering)) if sds[j] > 0.0]
    return steps


def _factor(blocks: Linear, noise: Noise, names: tuple[str, ...]) -> Factor:
    """Factor of block averages, whitened."""
    white = whiten(noise, blocks.rows, np.column_stack((blocks.X, blocks.y)))[0]
    return factor_of(white[:, :-1], white[:, -1], names)


STEPS: Mapping[RungName, Callable[[Ground, Answer], Foresight]] = {
    "means": _colour,
    "sparse": _neighbours,
    "plug-in": _moved_noise,
    "averaged": _few_draws,
    "collapsed": _chain_error,
    "full": _chain_error,
}
"""How the change from each rung to the next is foreseen."""
