"""The rungs of emcee on the factor: noise alone, or noise and coefficients; then every model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from imubayes.campaign.fidelity import RungName
from imubayes.inference.mcmc.run import Sampled
from imubayes.ladder.answer import Answer, answer_of
from imubayes.ladder.problem import Ground, chained, prepared
from imubayes.selection.decision import select
from imubayes.units import counted


def collapsed(ground: Ground) -> Answer:
    """Sample the noise, with the coefficients integrated out and drawn exactly."""
    return by_chains("collapsed", ground, *chained(ground, "collapsed"))


def full(ground: Ground) -> Answer:
    """Sample coefficients and noise."""
    return by_chains("full", ground, *chained(ground, "full"))


def by_chains(rung: RungName, ground: Ground, sampled: Sampled, converged: bool) -> Answer:
    """Weigh every model at the noises of some draws; of the full library, say what the chains say."""
    ready, problem, chains = prepared(ground), ground.problem, sampled.chains
    ground.tell(f"every model at {counted(len(sampled.noises), 'draw')} of the noise")
    selection = select(
        ready.summary,
        ready.prior,
        noises=sampled.noises,
        log_evidence=chains.log_evidence[0],
        costs=problem.costs,
        hierarchical=problem.hierarchical,
    )
    found = np.median(chains.noise, axis=(0, 1)).tolist()
    answer = answer_of(
        rung,
        selection,
        [(N, B, K) for N, B, K in found],
        noises=sampled.noises,
        chains=chains,
        converged=converged,
    )
    theta = chains.theta[..., [chains.names.index(name) for name in answer.names]]
    return replace(answer, full_mean=theta.mean(axis=(0, 1)), full_sd=theta.std(axis=(0, 1)))
