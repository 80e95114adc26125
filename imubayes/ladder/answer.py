"""What every rung of the ladder gives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.campaign.fidelity import RungName
from imubayes.campaign.preparation import Prepared
from imubayes.inference.mcmc.chains import Chains, NoiseDraw
from imubayes.selection.decision import Selection


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """What a rung says of one component.

    Attributes
    ----------
    rung : that was taken.
    names : of the p terms of the library, in its order.
    mean, sd : (p,) coefficients averaged over models, SI.
    inclusion : (p,) probability of each term; of a method that gives none, 0 or 1.
    full_mean, full_sd : (p,) under the full library.
    model : terms that are kept.
    noise : (N, B, K) by run, SI; of a method that knows only white noise, B and K are 0.
    selection : the decision, in the form that the report shows. Every rung gives one: of the cheap ones its
        means, inclusions and verdicts are those of the method.
    noises : draws of the noise that the decision averaged over; empty where it took one.
    chains : of emcee, where the rung has them.
    seconds : that it took, from rows to decision.
    converged : whether chains, where there are any, reached what was asked.
    ready : factor, rows and prior that it rests on; None of a method that has no use for them.
    """

    rung: RungName
    names: tuple[str, ...]
    mean: FloatArray
    sd: FloatArray
    inclusion: FloatArray
    full_mean: FloatArray
    full_sd: FloatArray
    model: tuple[str, ...]
    noise: tuple[tuple[float, float, float], ...]
    selection: Selection
    noises: tuple[NoiseDraw, ...] = ()
    chains: Chains | None = None
    seconds: float = 0.0
    converged: bool = True
    ready: Prepared | None = None


def answer_of(
    rung: RungName,
    selection: Selection,
    noise: Sequence[tuple[float, float, float]],
    *,
    noises: tuple[NoiseDraw, ...] = (),
    chains: Chains | None = None,
    converged: bool = True,
) -> Answer:
    """Answer that says what a decision says; `noise` is (N, B, K) by run."""
    terms = selection.terms
    return Answer(
        rung=rung,
        names=tuple(term.name for term in terms),
        mean=np.array([term.mean for term in terms]),
        sd=np.array([term.sd for term in terms]),
        inclusion=np.array([term.inclusion for term in terms]),
        full_mean=np.array([term.full_mean for term in terms]),
        full_sd=np.array([term.full_sd for term in terms]),
        model=selection.model,
        noise=tuple(noise),
        selection=selection,
        noises=noises,
        chains=chains,
        converged=converged,
    )


def change(before: Answer, after: Answer) -> tuple[float, float]:
    """How far two answers are apart: coefficients in posterior sd of the second, and inclusions.

    The largest over terms; of the averaged and the full-library coefficients, the larger.
    """
    apart = np.maximum(np.abs(after.mean - before.mean), np.abs(after.full_mean - before.full_mean))
    return float(np.max(apart / after.full_sd)), float(np.max(np.abs(after.inclusion - before.inclusion)))
