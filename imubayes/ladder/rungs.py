"""The rungs of the ladder as functions with one interface, and the way up: a problem in, an answer out.

A budget of time takes the best rung that fits; an accuracy climbs until the answer no longer changes. What
the rung above would change is foreseen without climbing it: each step has a formula of its own.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache, partial

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.algebra.factor import Factor, add, factor_of, noise_scale, posterior, reorder
from imubayes.campaign import Choice
from imubayes.campaign.prepared import Prepared
from imubayes.errors import ConvergenceError, InputError
from imubayes.inference.dwells import dwells_of
from imubayes.inference.linear import Linear, blocks_of, linear_of
from imubayes.inference.noise_model import estimate
from imubayes.inference.prior import ScalePrior
from imubayes.inference.summary import Summary
from imubayes.inference.whiten import whiten
from imubayes.ladder import AT_ONCE, CHAINED, NAMES, CostLaw, RungName, rung_of, rungs_for
from imubayes.ladder.costs import foreseen, within
from imubayes.ladder.posteriors import averaged, plug_in, raw, sampled_noise, weighted
from imubayes.ladder.problem import Answer, Ground, Posterior, change, decided, prepared, size_of
from imubayes.ladder.regression import EXHAUSTIVE, by_bic, means, sparse
from imubayes.selection.enumerate import enumerate_models
from imubayes.selection.model_sets import log_model_prior
from imubayes.selection.sindy import effects_of, log_evidence, refitted
from imubayes.sensors.noise import Noise, noise_prior
from imubayes.units import counted


def _over(posterior: Callable[[Ground], Posterior]) -> Callable[[Ground], Answer]:
    """Decide every component over what a rung says of the noise."""
    return lambda ground: decided(ground, posterior(ground))


RUNGS: Mapping[RungName, Callable[[Ground], Answer]] = {
    "means": means,
    "sparse": sparse,
    "plug-in": _over(plug_in),
    "averaged": _over(averaged),
    "collapsed": _over(partial(sampled_noise, "collapsed")),
    "full": _over(partial(sampled_noise, "full")),
    "raw": _over(raw),
}
"""Every rung as a function, all of one interface."""

LARGE = 2_000_000
"""Rows beyond which the noise is sampled only if asked: every draw that is averaged over whitens them all."""

WIDE = 30_000
"""Matrix entries that a draw of the noise adds up, runs times squared columns: more take minutes."""


def chosen_method(wanted: str, summary: Summary, *, spread: bool = False) -> tuple[RungName, str]:
    """Rung that a study asks for by `Method`, and the reason in words.

    `spread` tells whether how far bench and library are off is estimated, too.

    Examples
    --------
    >>> import numpy as np
    >>> chosen_method("exact", Summary.from_arrays(np.eye(2), np.ones(2), ("a", "b")))
    ('plug-in', 'the method exact was asked for')
    """
    if wanted != "auto":
        return rung_of("plug-in" if wanted == "exact" else wanted), f"the method {wanted} was asked for"
    estimated = [run.name for run in summary.runs if run.found.steering]
    if not estimated:
        return "plug-in", "the noise of every run is given, so that the exact posterior is the whole answer"
    if summary.factor.n > LARGE:
        return "plug-in", (
            f"{summary.factor.n:,} samples fix the noise, and sampling it would whiten them all again and"
            " again; ask for the method collapsed to average over it all the same"
        )
    columns = len(summary.names)
    if len(estimated) * columns**2 > WIDE:
        return "plug-in", (
            f"to sample the noise of {counted(len(estimated), 'run')} beside {columns} columns takes minutes;"
            " ask for the method collapsed to average over it all the same"
        )
    if spread:
        return "averaged", (
            "how far the bench and the library are off is told by the same data: draws of the noise are"
            " weighed with draws of that"
        )
    several = "s" if len(estimated) > 1 else ""
    return "collapsed", (
        f"the noise of run{several} {', '.join(estimated)} is estimated from the same data: its uncertainty"
        " is sampled, and the coefficients are exact at each draw"
    )


def by_method(wanted: str, ground: Ground) -> tuple[Answer, str]:
    """Answer of a method, and why by that one; plug-in where chains cannot be run.

    Raises
    ------
    InputError : if the method decides on its way, and so takes one component with known inputs.
    """
    if wanted in AT_ONCE and ground.problem.case is None:
        return RUNGS[rung_of(wanted)](ground), f"the method {wanted} was asked for"
    ready = prepared(ground)
    rung, reason = chosen_method(wanted, ready.summary, spread=bool(ready.spreads))
    if rung in AT_ONCE:
        raise InputError(
            f"sensor '{ground.problem.spec.id}': the method {rung} takes runs of one component with known"
            f" inputs, and these are of several: expected one of {', '.join(NAMES[len(AT_ONCE) :])}"
        )
    try:
        return RUNGS[rung](ground), reason
    except ConvergenceError as unfinished:
        reason = f"the noise, held at its estimate, cannot be sampled: {unfinished}"
        return RUNGS["plug-in"](ground), reason


def provisional(wanted: str, ground: Ground) -> Answer | None:
    """Answer at the estimated noise, where a method goes on with chains; None where it does not."""
    if wanted in AT_ONCE:
        return None
    ready = prepared(ground)
    rung, _ = chosen_method(wanted, ready.summary, spread=bool(ready.spreads))
    return RUNGS["plug-in"](ground) if rung in CHAINED else None


def stand(rung: RungName, ground: Ground) -> Answer:
    """Answer of one rung on a ground that others may have been on before: what they share is not done again.

    The seconds are those that the rung takes alone.

    Raises
    ------
    InputError : if there is no such rung, or the runs cannot be used.
    """
    name = rung_of(rung)
    shares = {"means": (), "raw": ("factor", "full")}.get(rung, ("factor", rung))
    done = sum(ground.shared[part][1] for part in shares if part in ground.shared)
    start = time.perf_counter()
    answer = RUNGS[name](ground)
    return replace(answer, seconds=time.perf_counter() - start + done)


def by_budget(ground: Ground, budget: float, law: CostLaw) -> tuple[Answer, Choice]:
    """Answer of the best rung that fits into a budget, s, straight away, without the rungs below it.

    Chains end in time, whether they have converged or not. The linearisation of a case is on the budget too.
    `law` is what the rungs take on this machine (see `imubayes.ladder.costs.calibrate`).
    """
    start, size = time.perf_counter() - _spent(ground), size_of(ground.problem)
    left = max(budget - _spent(ground), 0.0)
    rung = within(left, size, law)
    spare = max(left - 0.5 * foreseen(rung, size, law), 0.5 * left)  # for what is beside the chains
    ground = replace(ground, limits=replace(ground.limits, time_limit=min(ground.limits.time_limit, spare)))
    try:
        answer = stand(rung, ground)
    except ConvergenceError:  # where chains cannot be run, the best rung without
        answer = stand("averaged", ground)
    choice = _choice(ground, answer, law, f"a budget of {budget:g} s", start)
    return answer, replace(choice, budget=budget)


BY_CHANCE = 2.0
"""Sds by which the largest of some ten changes differs from zero by chance."""

FINEST = 0.01
"""Accuracy, in posterior sd, below which no more draws are taken: means over the chains are no better."""

MOST_DRAWS = 400
"""Draws of the noise: on two rungs they take 42 s, with 36,000 rows and 2^17 models."""


def _enough_draws(ground: Ground, answer: Answer, accuracy: float) -> int:
    """Draws of the noise by which averages over them differ by no more than the accuracy."""
    spread, _ = _spread(answer, prepared(ground).prior.sd)
    return min(math.ceil(2.0 * (BY_CHANCE * spread / max(accuracy, FINEST)) ** 2), MOST_DRAWS)


def by_accuracy(ground: Ground, accuracy: float, law: CostLaw) -> tuple[Answer, Choice]:
    """Climb until a rung changes no coefficient by more than `accuracy` against the one before.

    That is in posterior sd, of averaged and full-library coefficients alike. Where the noise moves them by
    more than the usual number of draws averages away, more are taken.
    """
    start = time.perf_counter() - _spent(ground)
    first, *above = rungs_for(size_of(ground.problem))
    answer = stand(first, ground)
    steps: list[tuple[RungName, float, float]] = [(answer.rung, 0.0, 0.0)]
    for name in above:
        try:
            below, answer = answer, stand(name, ground)
            if (
                name == "averaged"
                and (draws := _enough_draws(ground, answer, accuracy)) > ground.limits.draws
            ):
                del ground.shared[name]
                ground = replace(ground, limits=replace(ground.limits, draws=draws))
                answer = stand(name, ground)
        except ConvergenceError:  # and so it is with the rungs above
            break
        steps.append((name, *change(below, answer)))
        if steps[-1][1] <= accuracy:
            break
    asked = f"an accuracy of {accuracy:g} posterior sd"
    return answer, replace(
        _choice(ground, answer, law, asked, start), climbed=tuple(steps), accuracy=accuracy
    )


def _choice(ground: Ground, answer: Answer, law: CostLaw, asked: str, start: float) -> Choice:
    """What was taken, and what the next rung would change."""
    size = size_of(ground.problem)
    can = rungs_for(size)
    above = can[can.index(answer.rung) + 1 :]
    ahead, why = foresee(ground, answer) if above else ((0.0, 0.0), "there is no better rung")
    return Choice(
        rung=answer.rung,
        asked=asked,
        seconds=time.perf_counter() - start,
        foreseen=_spent(ground) + foreseen(answer.rung, size, law),
        climbed=(),
        next_rung=above[0] if above else None,
        next_seconds=foreseen(above[0], size, law) if above else 0.0,
        next_change=ahead,
        next_reason=why,
    )


def _spent(ground: Ground) -> float:
    """Seconds that a case took before any rung."""
    return ground.shared["factor"][1] if ground.problem.case else 0.0


BLOCKS = 400
"""Blocks that a run is averaged to where the noise is moved: it is the change that counts."""

CERTAIN = 1e-12
"""An inclusion is taken no nearer to 0 or 1 than this: log odds stay finite."""


Foresight = tuple[tuple[float, float], str]
"""Largest change of a coefficient in posterior sd, and of an inclusion; and how it was foreseen."""


def _colour(ground: Ground, answer: Answer) -> Foresight:
    """Means: weigh the dwell means again, with noise of all colours that is estimated from them."""
    problem = ground.problem
    by_class = noise_prior(problem.spec.sensor_class) if problem.spec.sensor_class else None
    factors = []
    for run in problem.runs:
        d = dwells_of(linear_of(run, problem.library))
        noise = estimate(d.means, by_class).noise
        factors.append(_factor(d.means, noise, problem.library.names))
    whole = add(*factors)
    full, sd = posterior(whole, problem.prior.sd)
    # averaged coefficients and inclusions on the whitened means, where they are tested
    names = tuple(n for n, size in zip(whole.names, whole.column_norms, strict=True) if size > 0.0)
    if len(names) <= EXHAUSTIVE:
        sds = dict(zip(whole.names, problem.prior.sd.tolist(), strict=True))
        prior = ScalePrior([sds[name] for name in names])
        models = enumerate_models(Summary(reorder(whole, names)), prior, scale=1.0)
    else:
        models = by_bic(whole, problem.hierarchical)
    mean, inclusion = answer.mean.copy(), answer.inclusion.copy()
    tested = [whole.names.index(name) for name in models.names]
    mean[tested], inclusion[tested] = models.mean, models.inclusion
    apart = np.maximum(np.abs(full - answer.full_mean), np.abs(mean - answer.mean))
    change = float(np.max(apart / sd)), float(np.max(np.abs(inclusion - answer.inclusion)))
    return change, "the dwell means weighed again, with drift estimated from them and the class's prior"


def _neighbours(ground: Ground, answer: Answer) -> Foresight:
    """Sparse: weigh the chosen model against those with one term more or less."""
    ready = prepared(ground)
    f, sd = ready.summary.factor, ready.prior.sd
    e = effects_of(f, sd, answer.names, noise_scale(f, sd))
    here = np.array([name in answer.model for name in e.names])
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


def _moved_noise(ground: Ground, answer: Answer) -> Foresight:
    """Plug-in: move each noise parameter by its sd either way, on block averages."""
    ready = prepared(ground)
    blocks = [blocks_of(rows, BLOCKS) for rows in ready.rows]
    noises = [run.noise for run in ready.summary.runs]
    names, p = ready.summary.names, len(answer.names)
    plain = [_factor(b, noise, names) for b, noise in zip(blocks, noises, strict=True)]
    mean, sd = (moments[:p] for moments in posterior(add(*plain), ready.prior.sd))
    held = np.clip(answer.inclusion, CERTAIN, 1.0 - CERTAIN)
    usual = np.log(held / (1.0 - held))
    # where an inclusion is 1 to rounding, the Bayes factor against zero
    against = 0.5 * (mean / sd) ** 2 + np.log(sd / ready.prior.sd[:p])
    odds = np.where(answer.inclusion < 1.0 - CERTAIN, usual, against)
    shift, turn = np.zeros(p), np.zeros(p)

    @cache
    def others(k: int) -> list[Factor]:
        rest = [*plain[:k], *plain[k + 1 :]]
        return [add(*rest)] if rest else []

    for k, away in _steps(ready):
        found_here = np.array([noises[k].N, noises[k].B, noises[k].K])
        for sign in (1.0, -1.0):
            noise = Noise(*(found_here * np.exp(sign * away)).tolist())
            moved = _factor(blocks[k], noise, names)
            m, s = (moments[:p] for moments in posterior(add(moved, *others(k)), ready.prior.sd))
            shift += 0.5 * (m - mean)
            gained = 0.5 * ((m / s) ** 2 - (mean / sd) ** 2) + np.log(s / sd)
            turn += 0.5 * (np.exp(-np.logaddexp(0.0, -odds - gained)) - answer.inclusion)
    change = float(np.max(np.abs(shift) / sd)), float(np.max(np.abs(turn)))
    return change, "each noise parameter moved by its sd either way, on block averages"


def _few_draws(ground: Ground, answer: Answer) -> Foresight:
    """Averaged: the Monte Carlo error of the draws that count, and that of the chains above."""
    count = weighted(ground).count
    coefficients, inclusions = _spread(answer, prepared(ground).prior.sd)
    error = math.hypot(1.0 / math.sqrt(count), 1.0 / math.sqrt(len(answer.posterior.noises)))
    reason = f"the Monte Carlo error of draws of the noise, of which {count:.0f} count"
    return (coefficients * error, inclusions * error), reason


def _chain_error(ground: Ground, answer: Answer) -> Foresight:
    """Errors of averages over draws of the noise, and of the coefficients' own draws.

    To full they are all that changes; to raw also what the log density is off between whitenings. Two
    densities whose logarithms differ by e have means that differ by e sds at most, to first order; it is the
    noise's density that is off, so that the sd is that of the averages over the noise.
    """
    nats, reason, chains = 0.0, "the Monte Carlo errors of the chains", answer.posterior.chains
    if answer.rung == "full":
        nats = chains.interpolation_error if chains else 0.0
        reason = f"the {nats:.2g} nats that the log density is off between whitenings, and Monte Carlo errors"
    coefficients, inclusions = _spread(answer, prepared(ground).prior.sd)
    few = max(math.sqrt(2.0 / max(len(answer.posterior.noises), 1)), nats)
    own = 0.0
    if chains:
        own = math.sqrt(2.0 / min(chains.theta[..., 0].size, float(chains.diagnostics.ess.min())))
    return (max(coefficients * few, own), inclusions * few), reason


def _spread(answer: Answer, prior_sd: FloatArray) -> tuple[float, float]:
    """Largest sd over the draws of the noise: of a coefficient, in posterior sd, and of an inclusion.

    Of full-library coefficients and of averaged ones: where a term is in doubt, its own moves more.
    """
    p, models = len(answer.names), [selection.models for selection in answer.selections]
    full = np.array([posterior(noise.factor, prior_sd)[0][:p] for noise in answer.posterior.noises])
    if len(full) < 2 or not all(each.parts for each in models):
        return 0.0, 0.0
    sd = dict(zip(answer.names, answer.full_sd.tolist(), strict=True))
    # many candidates are averaged over fewer draws of the noise than there are
    moved, inclusions = [full.std(axis=0) / answer.full_sd], list[FloatArray]()
    for weighed in models:
        parts = [part for _, part in weighed.parts]
        units = [sd.get(name, math.inf) for name in weighed.names]
        moved.append(np.std([part.mean for part in parts], axis=0) / units)
        inclusions.append(np.std([part.inclusion for part in parts], axis=0))
    return float(np.max(np.concatenate(moved))), float(np.max(np.concatenate(inclusions)))


def _steps(ready: Prepared) -> list[tuple[int, FloatArray]]:
    """One sd of ln N, ln B or ln K (3,) of each run whose noise was estimated."""
    steps = []
    for k, run in enumerate(ready.summary.runs):
        sds = np.array(run.found.sd)
        # blocks leave N less certain than all rows do
        sds[0] = min(float(sds[0]), 1.0 / math.sqrt(2.0 * run.samples)) if run.found.steering else 0.0
        steps += [(k, np.eye(3)[j] * sds[j]) for j in range(len(run.found.steering)) if sds[j] > 0.0]
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


def foresee(ground: Ground, answer: Answer) -> Foresight:
    """What the rung above the `answer` would change, without climbing it: in milliseconds to tens of them."""
    return STEPS[answer.rung](ground, answer)
