"""What a rung says of a component, without the models behind it: small enough to pass between processes."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import posterior
from imubayes.campaign.fidelity import RungName
from imubayes.inference.mcmc.diagnostics import LONG
from imubayes.ladder.answer import Answer
from imubayes.selection.draws import posterior_draws

DRAWS = 500
"""Draws of the coefficients and of the noise that are kept."""


@dataclass(frozen=True, slots=True, eq=False)
class Told:
    """What a rung says of one component.

    Attributes
    ----------
    rung : that says it.
    names : of the p terms.
    mean, inclusion : (p,) averaged over models, SI.
    full_mean, full_sd : (p,) under the full library.
    prior_sd, limit95 : (p,) of each term.
    verdicts : of each term.
    model : terms that are kept.
    draws : (m, p) of the coefficients, averaged over models.
    noises : (k, g, 3) draws of N, B, K of each run; one where the rung knows one noise.
    monte_carlo : (p,) error that few draws leave in the means, in posterior sd; 0 without draws.
    ess : least effective sample size of the chains; infinite without.
    wanting : times that the chains would have to be as long as they are, to reach what was asked; 1 at least.
    chain_seconds : that the chains took.
    seconds : that the rung took.
    """

    rung: RungName
    names: tuple[str, ...]
    mean: FloatArray
    inclusion: FloatArray
    full_mean: FloatArray
    full_sd: FloatArray
    prior_sd: FloatArray
    limit95: FloatArray
    verdicts: tuple[str, ...]
    model: tuple[str, ...]
    draws: FloatArray
    noises: FloatArray
    monte_carlo: FloatArray
    ess: float
    wanting: float
    chain_seconds: float
    seconds: float


def told_of(answer: Answer, ess: float, rng: np.random.Generator) -> Told:
    """Keep of an answer what others compare.

    Parameters
    ----------
    answer : of any rung.
    ess : effective sample size that was asked of the chains.
    rng : draws from the posterior.
    """
    terms, diagnostics = answer.selection.terms, answer.chains.diagnostics if answer.chains else None
    return Told(
        rung=answer.rung,
        names=answer.names,
        mean=answer.mean,
        inclusion=answer.inclusion,
        full_mean=answer.full_mean,
        full_sd=answer.full_sd,
        prior_sd=np.array([term.prior_sd for term in terms]),
        limit95=np.array([term.limit95 for term in terms]),
        verdicts=tuple(term.verdict for term in terms),
        model=answer.model,
        draws=posterior_draws(answer.selection, DRAWS, rng),
        noises=_noises(answer),
        monte_carlo=monte_carlo(answer),
        ess=float(diagnostics.ess.min()) if diagnostics else math.inf,
        wanting=1.0 if answer.converged else _wanting(answer, ess),
        chain_seconds=diagnostics.seconds if diagnostics else 0.0,
        seconds=answer.seconds,
    )


def _wanting(answer: Answer, ess: float) -> float:
    """How many times longer chains would have to be."""
    if answer.chains is None:
        return 1.0
    d = answer.chains.diagnostics
    return max(1.0, ess / float(d.ess.min()), LONG * float(d.tau.max()) / d.steps)


def _noises(answer: Answer) -> FloatArray:
    if answer.chains is None:
        return np.array([answer.noise])
    every = answer.chains.noise.reshape(-1, *answer.chains.noise.shape[2:])
    return np.asarray(every[np.linspace(0, len(every) - 1, DRAWS).astype(int)], dtype=float)


def monte_carlo(answer: Answer) -> FloatArray:
    """Error (p,) that few draws leave in the coefficients' means, in posterior sd.

    An average over n draws of the noise is off by the sd of the mean given the noise over sqrt(n), where of
    draws that were taken several times fewer count; one over chains by one over the root of their effective
    size, and of the draws that are kept of them.
    """
    p = len(answer.names)
    few, own = np.zeros(p), 0.0
    if answer.noises and answer.ready is not None:
        each = [posterior(noise.factor, answer.ready.prior.sd)[0][:p] for noise in answer.noises]
        often = np.array(list(Counter(map(id, answer.noises)).values()), dtype=float)
        count = often.sum() ** 2 / float(np.sum(often**2))
        few = np.std(each, axis=0) / answer.full_sd / math.sqrt(max(count - 1.0, 1.0))
    if answer.chains is not None:
        kept = answer.chains.theta[..., 0].size
        own = 1.0 / math.sqrt(min(float(answer.chains.diagnostics.ess.min()), kept))
    return np.maximum(few, own)
