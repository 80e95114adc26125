"""Samplers of others on the likelihood of every row.

What costs time and can be done for them beforehand is not counted: their coordinates, imports, compilation,
and, for the stretch move, the way to the posterior, from which its walkers start. Each core has a chain, or
an ensemble, of its own.
"""

from __future__ import annotations

import os
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from unittest.mock import patch

import numpy as np

from imubayes.algebra import FloatArray
from studies.sampler_speed.full_data import FullData, OnFactor
from studies.speed.peers import nuts_draws

CORES = 2
WALKERS_A_PARAMETER = 4
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""Threads of the linear algebra would only take the cores from each other's chains."""


@dataclass(frozen=True, slots=True, eq=False)
class Sampled:
    """Draws (cores, steps, walkers, d) of a peer; NUTS has one walker.

    The seconds are those of the slowest core, warm-up included.
    """

    draws: FloatArray
    seconds: float


def stretch(problem: FullData | OnFactor, seconds: float, seed: int) -> Sampled:
    """Return what emcee's default, the stretch move, draws in so many seconds."""
    return _on_all_cores(partial(_stretch, problem, seconds), seed)


def nuts(problem: FullData, tune: int, draws: int, seed: int, *, low_rank: bool = False) -> Sampled:
    """Draws of nutpie's NUTS; with `low_rank` its mass matrix learns correlations too."""
    return _on_all_cores(partial(_nuts, problem, tune, draws, low_rank), seed)


def stretch_ess(sampled: Sampled) -> tuple[FloatArray, FloatArray]:
    """Effective sample sizes (d,), and emcee's autocorrelation times (d,) in steps that they come from."""
    from emcee.autocorr import integrated_time

    cores, steps, walkers = sampled.draws.shape[:3]
    tau = np.mean([integrated_time(chain, tol=0) for chain in sampled.draws], axis=0)
    return cores * steps * walkers / tau, tau


def nuts_ess(sampled: Sampled) -> FloatArray:
    """Effective sample sizes (d,): ArviZ' bulk value over all chains."""
    import arviz

    chains = sampled.draws[:, :, 0]
    return np.array([arviz.ess(chains[:, :, j], method="bulk") for j in range(chains.shape[-1])])


def _on_all_cores(sample, seed: int) -> Sampled:
    seeds = np.random.default_rng(seed).integers(2**31, size=CORES).tolist()
    with (
        patch.dict(os.environ, ONE_THREAD),
        ProcessPoolExecutor(CORES, mp_context=get_context("spawn")) as pool,
    ):
        done = list(pool.map(sample, seeds))
    shortest = min(len(draws) for draws, _ in done)
    return Sampled(np.array([draws[:shortest] for draws, _ in done]), max(taken for _, taken in done))


def _stretch(problem: FullData | OnFactor, seconds: float, seed: int) -> tuple[FloatArray, float]:
    import emcee

    d = len(problem.coordinates)
    walkers = WALKERS_A_PARAMETER * d
    ensemble = emcee.EnsembleSampler(walkers, d, problem.values, vectorize=True)
    ensemble.random_state = np.random.MT19937(seed).state
    first = np.random.default_rng(seed).normal(size=(walkers, d))
    chain, start = [], time.perf_counter()
    for state in ensemble.sample(first, iterations=2**62, store=False):
        chain.append(state.coords.copy())
        if (taken := time.perf_counter() - start) >= seconds:
            break
    return problem.coordinates.parameters(np.array(chain)), taken


def _nuts(problem: FullData, tune: int, draws: int, low_rank: bool, seed: int) -> tuple[FloatArray, float]:
    asked = {"tune": tune, "draws": draws, "seed": seed, "low_rank_modified_mass_matrix": low_rank}
    found, seconds = nuts_draws(problem.gradient, len(problem.coordinates), **asked)
    return problem.coordinates.parameters(found)[:, None], seconds
