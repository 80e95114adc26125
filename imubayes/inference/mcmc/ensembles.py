"""Independent ensembles of walkers, run side by side until they agree: all that is emcee's.

The walkers of all ensembles make one sampler, so that a density of many is asked once a step; none proposes
from those of another ensemble.

A checkpoint is a whole file that takes the place of the one before: an interruption at any moment leaves the
last one, and the random numbers go on from where it was written, so that a resumed chain is the same chain.
`emcee.backends.HDFBackend` reads it, under the names ``ensemble_0`` and so on.

Walkers of one ensemble propose from each other, so they are no independent chains: the effective size comes
from emcee's autocorrelation time, averaged over the walkers, and split R-hat compares whole ensembles.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.errors import InputError
from imubayes.inference.mcmc import Diagnostics
from imubayes.work import Progress, silent

WINDOW = 5.0
"""Autocorrelation times that are added up (Sokal's rule, as emcee has it)."""

LOOKED_AT = 16
"""Walkers of an ensemble that the autocorrelation time is taken from: all of them would sharpen it by little,
and cost as much as sampling."""


@dataclass(frozen=True, slots=True, eq=False)
class Target:
    """What is sampled: d parameters, in the order of the coordinates, of a log density (m, d) -> (m,).

    Moves are (proposal, weight), None for differential evolution. First places (size, d) come from `start`;
    what must mix are the `readable` coordinates. Where a step takes `long` the walkers are looked at more
    often and are not given up; they start from draws, so that none of their steps is dropped.
    """

    names: tuple[str, ...]
    log_prob: Callable[[FloatArray], FloatArray]
    moves: tuple[tuple[Any, float], ...]
    start: Callable[[np.random.Generator, int], FloatArray]
    readable: Callable[[FloatArray], FloatArray]
    long: bool = False


def sampler_of(target: Target, limits: Limits, backend: Any = None) -> Any:
    """Emcee's sampler of the walkers of all ensembles, one after the other, with the chain so far."""
    emcee = _emcee()
    d, (proposals, weights) = len(target.names), zip(*target.moves, strict=True)
    moves = [emcee.moves.MHMove(one, ndim=d) if one else _differential(limits.ensembles) for one in proposals]
    weighted, size = [*zip(moves, weights, strict=True)], limits.ensembles * walkers_for(d, limits)
    return emcee.EnsembleSampler(size, d, target.log_prob, moves=weighted, backend=backend, vectorize=True)


def _emcee() -> Any:
    """Emcee without scipy.stats, which takes longer to load than all else, for a move that is not used."""
    loaded: dict[str, Any] = sys.modules
    hidden = loaded.setdefault("scipy.stats", None) is None
    try:
        import emcee
    finally:
        if hidden:
            del loaded["scipy.stats"]
    return emcee


def _differential(ensembles: int) -> Any:
    """Differential evolution of every other walker by those between, of its own ensemble."""
    move: Any = _emcee().moves.DEMove(randomize_split=False)
    of_one = move.get_proposal

    def of_each(moved: FloatArray, still: list[FloatArray], random: Any) -> tuple[FloatArray, FloatArray]:
        pairs = zip(np.split(moved, ensembles), np.split(np.concatenate(still), ensembles), strict=True)
        proposed, factors = zip(*(of_one(own, [others], random) for own, others in pairs), strict=True)
        return np.concatenate(proposed), np.concatenate(factors)

    move.get_proposal = of_each
    return move


FIRST = 4
"""Steps that are made whatever the time: fewer have no autocorrelation."""


def advance(sampler: Any, target: Target, seed: int, steps: int, until: float) -> None:
    """Run some steps, from the last state of the walkers or from their first places.

    They end where `until` on the clock of `time.perf_counter` is over, but not before `FIRST` in all.
    """
    if sampler.iteration == 0:
        source = np.random.SeedSequence(seed)
        state = target.start(np.random.default_rng(source), sampler.nwalkers)
        sampler.random_state = np.random.RandomState(source.generate_state(4)).get_state()
    else:
        state = sampler.get_last_sample()
    for _ in sampler.sample(state, iterations=steps, skip_initial_state_check=True):
        if sampler.iteration >= FIRST and time.perf_counter() > until:
            break


def autocorrelation_time(chain: FloatArray) -> FloatArray:
    """Integrated autocorrelation time (d,) in steps of a chain (steps, walkers, d); 1 at least."""
    moved = np.ptp(chain, axis=0) > 0.0
    # a walker that has not moved yet may take as long as the chain, or longer; a constant takes no time
    tau = np.where(moved.any(axis=0), float(len(chain)), 1.0)
    for j in np.flatnonzero(moved.all(axis=0)):
        tau[j] = max(_integrated(chain[:, :, j]), 1.0)
    return tau


def _integrated(x: FloatArray) -> float:
    """Integrated autocorrelation time of one parameter (steps, walkers): emcee's, for all walkers at once."""
    from emcee.autocorr import auto_window

    power = np.abs(np.fft.rfft(x - x.mean(axis=0), 2 * len(x), axis=0)) ** 2
    covariance = np.fft.irfft(power, axis=0)[: len(x)]
    sums = 2.0 * np.cumsum((covariance / covariance[0]).mean(axis=1)) - 1.0
    return float(sums[auto_window(sums, WINDOW)])


def save(file: Path, backend: Any, limits: Limits, seconds: float) -> None:
    """Write the chains of all ensembles to the checkpoint, and put it in the place of the one before."""
    import h5py
    from emcee.backends import HDFBackend

    copy = file.with_suffix(".part")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        copy.unlink(missing_ok=True)
        count, kept = limits.ensembles, (backend.get_chain(), backend.get_log_prob(), backend.accepted[None])
        for k, parts in enumerate(zip(*(np.split(each, count, axis=1) for each in kept), strict=True)):
            into: Any = HDFBackend(str(copy), name=f"ensemble_{k}")
            into.reset(backend.shape[0] // count, backend.shape[1])
            into.grow(backend.iteration, None)
            with into.open("a") as stream:
                group = stream[into.name]
                group["chain"][...], group["log_prob"][...], group["accepted"][...] = *parts[:2], parts[2][0]
                group.attrs["iteration"] = backend.iteration
                for j, value in enumerate(backend.random_state):
                    group.attrs[f"random_state_{j}"] = value
        with h5py.File(copy, "a") as stream:
            stream.attrs.update({"seconds": seconds, "fingerprint": limits.fingerprint})
        with copy.open("rb+") as stream:
            os.fsync(stream.fileno())
        copy.replace(file)
    except OSError as problem:
        raise InputError(
            f"{file}: the checkpoint cannot be written ({problem}): choose another --out"
        ) from None


def load(file: Path, limits: Limits, d: int) -> tuple[Any, float]:
    """Read the chains of d dimensions of a checkpoint as one backend, and the seconds that they took.

    It is an `InputError` if there is no checkpoint, it cannot be read, or it is of another problem.
    """
    import h5py
    from emcee.backends import Backend, HDFBackend

    if not file.exists():
        raise InputError(f"{file}: there is no checkpoint to resume: run without --resume")
    try:
        with h5py.File(file) as stream:
            seconds, found = float(str(stream.attrs["seconds"])), stream.attrs["fingerprint"]
            kept = {
                (len(stream), int(group.attrs["nwalkers"]), int(group.attrs["ndim"]))
                for group in stream.values()
            }
    except (OSError, KeyError) as problem:
        raise InputError(
            f"{file}: is not a checkpoint that can be read ({problem}): run without --resume"
        ) from None
    if kept != {(limits.ensembles, walkers_for(d, limits), d)} or found != limits.fingerprint:
        raise InputError(
            f"{file}: was made by another study, seed or method: run without --resume to start anew"
        )
    each: Any = [HDFBackend(str(file), name=f"ensemble_{k}", read_only=True) for k in range(limits.ensembles)]
    whole: Any = Backend()
    whole.reset(sum(one.shape[0] for one in each), d)
    whole.chain = np.concatenate([one.get_chain() for one in each], axis=1)
    whole.log_prob = np.concatenate([one.get_log_prob() for one in each], axis=1)
    whole.accepted = np.concatenate([one.accepted for one in each])
    whole.iteration, whole.random_state = each[0].iteration, each[0].random_state
    return whole, seconds


LONG = 50.0
"""Steps in autocorrelation times below which emcee's estimate of that time is not to be trusted."""


def effective_size(chains: Sequence[FloatArray], walkers: int) -> tuple[FloatArray, FloatArray]:
    """Effective sample size and autocorrelation time (d,) of several ensembles (steps, walkers, d).

    The chains may be those of some of the walkers that an ensemble has.
    """
    tau = autocorrelation_time(np.concatenate([chain[:, :LOOKED_AT] for chain in chains], axis=1))
    return len(chains) * walkers * len(chains[0]) / tau, tau


def split_rhat(chains: list[FloatArray]) -> FloatArray:
    """Split R-hat (d,) over ensembles (steps, walkers, d): both halves of each one count as chains.

    Gelman et al., Bayesian Data Analysis (2013), section 11.4, with all walkers of an ensemble as one chain.
    """
    half = min(len(chain) for chain in chains) // 2
    d = chains[0].shape[2]
    if half < 1:
        return np.full(d, np.inf)
    parts = [part.reshape(-1, d) for chain in chains for part in (chain[:half], chain[-half:])]
    n = len(parts[0])
    means = np.array([part.mean(axis=0) for part in parts])
    within = np.mean([part.var(axis=0, ddof=1) for part in parts], axis=0)
    between = n * means.var(axis=0, ddof=1)
    still = within == 0.0
    pooled = (n - 1.0) / n * within + between / n
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(still, np.where(between == 0.0, 1.0, np.inf), np.sqrt(pooled / within))


AT_ONCE, MOST_AT_ONCE = 50, 400
"""Steps before the ensembles are looked at: as they get longer, a quarter to a half of them, so that the
looking costs little. They depend on nothing but the steps that are done."""

TURN = 10
"""The same where steps are long."""

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
    walkers : of each ensemble, an even number; 0 takes a little more than twice the parameters, 32 at least.
    checkpoint : file that holds the chains; None keeps them in memory.
    resume : go on from that file.
    fingerprint : of the problem: a file with another one is not resumed.
    steps : of each walker after which the chains end as they are; 0 for as many as it takes.
    draws : of the noise at which every submodel is weighed again.
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
    draws: int = 16


class ChainHistory(NamedTuple):
    """Chains (steps, walkers, d) of each ensemble, without their start, and log densities (steps, walkers).

    `found` is how well the readable parameters mixed, and why the chains ended.
    """

    chains: tuple[FloatArray, ...]
    log_prob: tuple[FloatArray, ...]
    found: Diagnostics


def walkers_for(d: int, limits: Limits | None = None) -> int:
    """Walkers of an ensemble in d dimensions: as asked for, else more than emcee's least of 2 d."""
    return (limits.walkers if limits else 0) or max(32, 2 * (d + 1))


def run_ensembles(target: Target, limits: Limits, progress: Progress = silent) -> ChainHistory:
    """Run ensembles until every parameter has mixed, or the time is up.

    It is an `InputError` if the checkpoint is of another problem, or cannot be read or written.
    """
    kept, before = None, 0.0
    if limits.resume and limits.checkpoint:
        kept, before = load(limits.checkpoint, limits, len(target.names))
    sampler = sampler_of(target, limits, kept)
    started, due = time.perf_counter(), 0.0
    until = started + limits.time_limit
    if not sampler.iteration:
        progress("starting the walkers", 0.0)
        advance(sampler, target, limits.seed, _turn(target, 0), until)
    while True:
        elapsed, steps = time.perf_counter() - started, int(sampler.iteration)
        done = _judged(target, sampler, before + elapsed, limits)
        told = done.found
        why = "" if target.long else _hopeless(told, steps, elapsed, limits)
        if why:
            done = done._replace(found=replace(told, text=f"{told.text}; {why}"))
        ended = told.converged or why or elapsed > limits.time_limit or 0 < limits.steps <= steps
        if limits.checkpoint and (ended or elapsed > due):
            save(limits.checkpoint, sampler.backend, limits, before + elapsed)
            # writing takes a tenth of the time at most
            due = elapsed + max(EVERY, 10.0 * (time.perf_counter() - started - elapsed))
        if ended:
            return done
        message = (
            f"accepted {told.acceptance:.0%}, tau {told.tau.max():.1f} of {told.steps} steps,"
            f" ESS {told.ess.min():.0f}/{limits.ess:.0f}, R-hat {told.rhat.max():.3f}"
        )
        progress(message, max(_share(told, limits), elapsed / limits.time_limit))
        advance(sampler, target, limits.seed, _turn(target, steps), until)


def _turn(target: Target, steps: int) -> int:
    """Steps before the ensembles are looked at again, after so many."""
    if target.long:
        return TURN
    return min(AT_ONCE * 2 ** (max(steps // AT_ONCE, 2).bit_length() - 2), MOST_AT_ONCE)


def _judged(target: Target, sampler: Any, seconds: float, limits: Limits) -> ChainHistory:
    """What the chains are so far, without the share that is dropped at their start."""
    steps, count = int(sampler.iteration), limits.ensembles
    drop = 0 if target.long else int(DROPPED * steps)
    chains, log_prob = (
        tuple(np.split(values[drop:], count, axis=1))
        for values in (sampler.get_chain(), sampler.get_log_prob())
    )
    readable = [target.readable(chain) for chain in chains]
    ess, tau = effective_size(readable, sampler.nwalkers // count)
    rhat = split_rhat(readable)
    missing = []
    if ess.min() < limits.ess:
        missing.append(f"{ess.min():.0f} of {limits.ess:.0f} effective samples")
    if not rhat.max() < RHAT:
        missing.append(f"R-hat {rhat.max():.3f} where {RHAT} is asked")
    if steps - drop < LONG * tau.max():
        few = f"{steps - drop} steps are fewer than {LONG:.0f} autocorrelation times"
        missing.append(f"{few} of {tau.max():.1f}")
    text = f"not converged: {'; '.join(missing)}" if missing else "every parameter has mixed"
    mixed = (ess, rhat, tau, float(np.mean(sampler.acceptance_fraction)), steps - drop)
    shape = sampler.nwalkers // count, count
    return ChainHistory(
        chains, log_prob, Diagnostics(target.names, *mixed, *shape, seconds, not missing, text)
    )


def _hopeless(told: Diagnostics, steps: int, elapsed: float, limits: Limits) -> str:
    """Say why chains will not get there in time; empty as long as they may."""
    if told.converged:
        return ""
    if steps >= TRIED and told.acceptance < STUCK:
        return f"{STILL}: {told.acceptance:.1%} of the proposals are accepted"
    if LOOKED * limits.time_limit < elapsed < limits.time_limit and _share(told, limits) < SHORT:
        return f"stopped, because they would need more than four times the limit of {limits.time_limit:g} s"
    return ""


def _share(told: Diagnostics, limits: Limits) -> float:
    """What part of the steps that are asked for is done, by the autocorrelation so far."""
    return min(1.0, float(told.ess.min()) / limits.ess, told.steps / (LONG * float(told.tau.max())))
