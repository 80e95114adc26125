"""Independent ensembles of walkers, run by turns until they agree."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.inference.mcmc.chains import Diagnostics
from imubayes.inference.mcmc.engine import (
    LONG,
    Target,
    effective_size,
    load,
    sampler_of,
    save,
    split_rhat,
)
from imubayes.progress import Progress, silent

AT_ONCE, MOST_AT_ONCE = 50, 400
"""Steps of an ensemble before the next one has its turn, and is looked at: as it gets longer, a quarter to a
half of it, so that the looking costs little. They depend on nothing but the steps that are done."""

EVERY = 1.0
"""s between checkpoints, at least."""

RHAT = 1.01
"""Split R-hat below which ensembles agree (Vehtari et al. 2021)."""

DROPPED = 0.1
"""Share of the chain that is dropped at its start: the walkers start from the fitted proposal."""

STUCK, TRIED = 0.01, 500
"""Share of proposals accepted below which, after so many steps, the moves do not suit the density."""

STILL = "stopped, because the walkers stand still"
"""How the reason begins."""

LOOKED, SHORT = 0.25, 0.0625
"""Share of the time limit after which chains are given up that have a sixteenth of what is asked: they would
need four times the limit."""


@dataclass(frozen=True, slots=True)
class Limits:
    """When chains end, and where they are kept.

    Attributes
    ----------
    ess : effective sample size asked of every parameter.
    time_limit : s.
    seed : of the walkers' random numbers.
    ensembles : how many, independent of each other; four at least for R-hat.
    walkers : of each ensemble; 0 takes a little more than twice the parameters, 32 at least.
    checkpoint : file that holds the chains; None keeps them in memory.
    resume : go on from that file.
    fingerprint : of the problem: a file with another one is not resumed.
    steps : of each walker after which the chains end as they are; 0 for as many as it takes.
    """

    ess: float = 1000.0
    time_limit: float = 600.0
    seed: int = 0
    ensembles: int = 4
    walkers: int = 0
    checkpoint: Path | None = None
    resume: bool = False
    fingerprint: str = ""
    steps: int = 0


class History(NamedTuple):
    """Chains as they were drawn, without their start.

    Attributes
    ----------
    chains : of each ensemble, (steps, walkers, d).
    log_prob : of each ensemble, (steps, walkers).
    found : how well the readable parameters mixed, and why the chains ended.
    """

    chains: tuple[FloatArray, ...]
    log_prob: tuple[FloatArray, ...]
    found: Diagnostics


def walkers_for(d: int) -> int:
    """Walkers of an ensemble in d dimensions: even, more than emcee's least of 2 d."""
    return max(32, 2 * (d + 1))


def run_ensembles(target: Target, limits: Limits, progress: Progress = silent) -> History:
    """Run ensembles until every parameter has mixed, or the time is up.

    Raises
    ------
    InputError : if the checkpoint is of another problem, or cannot be read or written.
    """
    walkers = limits.walkers or walkers_for(len(target.names))
    shape = limits.ensembles, walkers, len(target.names)
    kept, before = [None] * limits.ensembles, 0.0
    if limits.resume and limits.checkpoint:
        kept, before = load(limits.checkpoint, shape, limits.fingerprint)
    samplers = [sampler_of(target, walkers, backend) for backend in kept]
    seeds = np.random.SeedSequence(limits.seed).spawn(limits.ensembles)
    started, due = time.perf_counter(), 0.0
    while True:
        elapsed = time.perf_counter() - started
        done = judged(target, samplers, before + elapsed, limits)
        told = done.found
        if why := _hopeless(told, samplers[0].iteration, elapsed, limits):
            done = done._replace(found=replace(told, text=f"{told.text}; {why}"))
        spent = elapsed > limits.time_limit or 0 < limits.steps <= samplers[0].iteration
        ended = told.converged or bool(why) or (spent and told.steps > 1)
        if limits.checkpoint and samplers[0].iteration and (ended or elapsed > due):
            save(limits.checkpoint, [s.backend for s in samplers], before + elapsed, limits.fingerprint)
            # writing takes a tenth of the time at most
            due = elapsed + max(EVERY, 10.0 * (time.perf_counter() - started - elapsed))
        if ended:
            return done
        progress(_message(told, limits), max(share(told, limits), elapsed / limits.time_limit))
        for sampler, seed in zip(samplers, seeds, strict=True):
            doubled = AT_ONCE * 2 ** (max(int(sampler.iteration) // AT_ONCE, 2).bit_length() - 2)
            advance(sampler, target, seed, min(doubled, MOST_AT_ONCE))


def advance(sampler: Any, target: Target, seed: np.random.SeedSequence, steps: int) -> None:
    """Run some steps of an ensemble, from its last state or from the start."""
    state = None
    if sampler.iteration == 0:
        state = target.start(np.random.default_rng(seed), sampler.nwalkers)
        sampler.random_state = np.random.RandomState(seed.generate_state(4)).get_state()
    sampler.run_mcmc(state, steps, skip_initial_state_check=True)


def judged(
    target: Target, samplers: Sequence[Any], seconds: float, limits: Limits, dropped: float = DROPPED
) -> History:
    """What the chains are so far, without the share that is dropped at their start."""
    steps, walkers, d = min(s.iteration for s in samplers), samplers[0].nwalkers, len(target.names)
    shape = walkers, len(samplers)
    if steps == 0:
        nothing, empty = np.zeros(d), np.zeros((0, walkers, d))
        none = (nothing, nothing + np.inf, nothing, 0.0, 0)
        found = Diagnostics(target.names, *none, *shape, seconds, False, "")
        return History((empty,), (empty[..., 0],), found)
    drop = int(dropped * steps)
    chains = tuple(sampler.get_chain()[drop:] for sampler in samplers)
    readable = [target.readable(chain) for chain in chains]
    ess, tau = effective_size(readable)
    rhat = split_rhat(readable)
    missing = wanting(ess, rhat, tau, steps - drop, limits)
    accepted = float(np.mean([sampler.acceptance_fraction for sampler in samplers]))
    mixed = (ess, rhat, tau, accepted, len(chains[0]))
    found = Diagnostics(target.names, *mixed, *shape, seconds, not missing, verdict(missing))
    return History(chains, tuple(sampler.get_log_prob()[drop:] for sampler in samplers), found)


def wanting(ess: FloatArray, rhat: FloatArray, tau: FloatArray, steps: int, limits: Limits) -> list[str]:
    """What is still missing, in words; nothing when the chains may end."""
    found = []
    if ess.min() < limits.ess:
        found.append(f"{ess.min():.0f} of {limits.ess:.0f} effective samples")
    if not rhat.max() < RHAT:
        found.append(f"R-hat {rhat.max():.3f} where {RHAT} is asked")
    if steps < LONG * tau.max():
        found.append(f"{steps} steps are fewer than {LONG:.0f} autocorrelation times of {tau.max():.1f}")
    return found


def verdict(missing: Sequence[str]) -> str:
    """Say why chains ended, given what is `wanting`."""
    return f"not converged: {'; '.join(missing)}" if missing else "every parameter has mixed"


def _hopeless(told: Diagnostics, steps: int, elapsed: float, limits: Limits) -> str:
    """Say why chains will not get there in time; empty as long as they may."""
    if told.converged:
        return ""
    if steps >= TRIED and told.acceptance < STUCK:
        return f"{STILL}: {told.acceptance:.1%} of the proposals are accepted"
    if steps and LOOKED * limits.time_limit < elapsed < limits.time_limit and share(told, limits) < SHORT:
        return f"stopped, because they would need more than four times the limit of {limits.time_limit:g} s"
    return ""


def share(told: Diagnostics, limits: Limits) -> float:
    """What part of the steps that are asked for is done, by the autocorrelation so far."""
    if told.steps == 0:
        return 0.0
    return min(1.0, float(told.ess.min()) / limits.ess, told.steps / (LONG * float(told.tau.max())))


def _message(told: Diagnostics, limits: Limits) -> str:
    """One line for somebody who waits."""
    if told.steps == 0:
        return "starting the walkers"
    return (
        f"accepted {told.acceptance:.0%}, tau {told.tau.max():.1f} of {told.steps} steps,"
        f" ESS {told.ess.min():.0f}/{limits.ess:.0f}, R-hat {told.rhat.max():.3f}"
    )
