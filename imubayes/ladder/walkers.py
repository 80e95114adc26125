"""Ensembles of walkers whose every step is long: the time is looked at after each of them."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from imubayes.inference.mcmc.diagnostics import effective_size, split_rhat
from imubayes.inference.mcmc.engine import Target, sampler_of
from imubayes.inference.mcmc.ensembles import History, Limits, verdict, walkers_for, wanting
from imubayes.ladder.problem import Tell
from imubayes.units import counted

FIRST = 4
"""Steps before the chains are looked at: fewer have no autocorrelation."""

TURN = 10
"""Steps of all ensembles before they are looked at again."""


def run_slowly(target: Target, limits: Limits, tell: Tell) -> History:
    """Run ensembles until they have mixed, or the time is up: after each step, for steps are long."""
    start = time.perf_counter()
    walkers = limits.walkers or walkers_for(len(target.names))
    samplers = [sampler_of(target, walkers) for _ in range(limits.ensembles)]
    for sampler, seed in zip(
        samplers, np.random.SeedSequence(limits.seed).spawn(limits.ensembles), strict=True
    ):
        state = target.start(np.random.default_rng(seed), walkers)
        sampler.random_state = np.random.RandomState(seed.generate_state(4)).get_state()
        sampler.run_mcmc(state, FIRST, skip_initial_state_check=True)
    while True:
        seconds = time.perf_counter() - start
        done = _judged(target, samplers, seconds, limits)
        if done.converged or seconds > limits.time_limit:
            return done
        tell(f"{counted(len(done.chains[0]), 'step')} on every row, {done.text}")
        _turn(samplers, start + limits.time_limit)


def _turn(samplers: Sequence[Any], deadline: float) -> None:
    """Give every ensemble the same number of steps, unless the time is up before."""
    for _ in range(TURN):
        for sampler in samplers:
            sampler.run_mcmc(None, 1, skip_initial_state_check=True)
        if time.perf_counter() > deadline:
            return


def _judged(target: Target, samplers: Sequence[Any], seconds: float, limits: Limits) -> History:
    """What the chains are so far."""
    chains = tuple(sampler.get_chain() for sampler in samplers)
    readable = [target.readable(chain) for chain in chains]
    ess, tau = effective_size(readable)
    rhat = split_rhat(readable)
    missing = wanting(ess, rhat, tau, len(chains[0]), limits)
    return History(
        chains=chains,
        log_prob=tuple(sampler.get_log_prob() for sampler in samplers),
        ess=ess,
        rhat=rhat,
        tau=tau,
        acceptance=float(np.mean([sampler.acceptance_fraction for sampler in samplers])),
        seconds=seconds,
        converged=not missing,
        text=verdict(missing),
    )
