"""Every other method on one component, run as its own authors would run it, beside the decision."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from imubayes.factor import add, reorder
from imubayes.inference.apart import Apart, apart
from imubayes.inference.effective import effective_samples
from imubayes.inference.linear import Linear, residuals
from imubayes.inference.mcmc.chains import Chains
from imubayes.inference.pieces import always, pieces_of
from imubayes.inference.prior import ScalePrior
from imubayes.inference.residuals import SUSPECT, judge
from imubayes.inference.summary import Summary
from imubayes.selection.criteria import LARGEST, Criterion, criteria, with_sampled_noise
from imubayes.selection.decision import Selection, loose_fit
from imubayes.selection.model_prior import hierarchy
from imubayes.selection.models import Models
from imubayes.selection.reduced import Reduced, design_factor, reduced
from imubayes.selection.sensitivity import MORE, Sensitivity, of_decision, sensitivity
from imubayes.selection.sindy import Sparse, sparse_regressions
from imubayes.selection.votes import Votes, votes

BoolArray = NDArray[np.bool_]

LISTED = 20_000
"""Most models that are compared where all subsets are too many, and as many that are near them."""


@dataclass(frozen=True, slots=True, eq=False)
class Panel:
    """What the other methods say of one component.

    Attributes
    ----------
    criteria : information criteria and predictive scores.
    sindy : sparse regressions.
    sensitivity : inclusion under other priors.
    votes : all of them beside the decision.
    reduced : the smallest model that predicts the test as well as the posterior does.
    """

    criteria: tuple[Criterion, ...]
    sindy: tuple[Sparse, ...]
    sensitivity: Sensitivity
    votes: Votes
    reduced: Reduced


def panel_of(
    summary: Summary,
    prior: ScalePrior,
    rows: Sequence[Linear],
    selection: Selection,
    *,
    rng: np.random.Generator,
    resamples: int = 100,
    chains: Chains | None = None,
    hierarchical: bool = False,
    widths: Sequence[float] = (),
    parts: Sequence[int] = (),
) -> Panel:
    """Ask every other method about the candidates of a decision.

    A component of a case is asked about on its own runs; what the case's other runs say stays in every model.

    Parameters
    ----------
    summary, prior, selection : the problem, and the decision on one of its components.
    rows : of each run, in the order of the summary's.
    rng : for resampling dwells, and for draws of the posterior.
    resamples : campaigns drawn for the frequencies of the sparse regressions.
    chains : that sampled the noise, for importance sampling beside the closed-form leave-one-out.
    hierarchical : whether a model must hold what its terms call for.
    widths : factors on every prior sd that are tried; by default as many as do not take long.
    parts : indices of the component's own runs, where others take part in the factor.
    """
    models = selection.models
    candidates = models.candidates.names
    own = apart(summary, prior.sd, rows, parts or range(len(rows)), candidates)
    names = tuple(name for name in own.summary.names if name in models.candidates.columns)
    factor = reorder(own.summary.factor, names)
    sd = own.sd[[own.summary.names.index(name) for name in names]]
    needs = hierarchy(names) if hierarchical else ()
    pieces = [pieces_of(r, run.noise) for r, run in zip(own.rows, own.summary.runs, strict=True)]
    samples = _effective(own, candidates)
    if own.known is not None:
        pieces.append(always(own.known))
    among = _most_probable(models) if len(candidates) > LARGEST else None
    compared = criteria(factor, pieces, sd, candidates, needs=needs, samples=samples, among=among, widen=True)
    if chains is not None:
        log_lik = chains.log_likelihood
        compared = with_sampled_noise(compared, log_lik.reshape(-1, log_lik.shape[-1]))
    sparse = sparse_regressions(factor, pieces, sd, candidates, rng=rng, resamples=resamples)
    known = [extra.name for extra in summary.extras]
    others = (
        sensitivity(factor, sd, candidates, known=known, needs=needs, costs=selection.costs, widths=widths)
        if len(candidates) <= MORE
        else of_decision(selection)
    )
    return Panel(
        criteria=compared,
        sindy=sparse,
        sensitivity=others,
        votes=votes(selection, compared, sparse, others, coloured=coloured(summary, prior, rows, parts)),
        reduced=reduced(selection, design_factor(own.rows), rng=rng),
    )


def _effective(own: Apart, candidates: tuple[str, ...]) -> float:
    """Effective sample size of a component's own runs."""
    runs = own.summary.runs
    factor = reduce(add, (reorder(run.factor, candidates) for run in runs))
    return effective_samples(factor, own.rows, [run.noise for run in runs])


def _most_probable(models: Models) -> BoolArray:
    """Models (m, p) of the largest posterior probability, and what differs from the first of them by a term.

    Another criterion may prefer a model to which the evidence gives nothing: it is looked for among these.
    """
    order = np.argsort(-models.weight, kind="stable")[:LISTED]
    found = models.space.members(order)
    flips = np.eye(found.shape[1], dtype=bool)
    near = found[: max(1, LISTED // found.shape[1]), None, :] ^ flips
    return np.unique(np.concatenate((found, near.reshape(-1, found.shape[1]))), axis=0)


def coloured(
    summary: Summary, prior: ScalePrior, rows: Sequence[Linear], parts: Sequence[int] = ()
) -> tuple[str, ...]:
    """Names of the runs (of the indices `parts`) whose noise was assumed white, and which are not."""
    asked = [(rows[k], summary.runs[k]) for k in parts or range(len(rows))]
    white = [(r, run) for r, run in asked if run.noise_origin == "white"]
    theta, _ = loose_fit(summary, prior)
    return tuple(
        run.name for r, run in white if judge(residuals(r, theta), r.rows, run, {}).whiteness_p < SUSPECT
    )
