"""The posterior over more models than can be enumerated: those that carry it are searched for."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import Factor, noise_scale
from imubayes.selection.mixture import Candidates, log_flat, scale_components
from imubayes.selection.model_prior import Needs
from imubayes.selection.models import Models, Weighed, posterior_of
from imubayes.selection.search import Found, search
from imubayes.selection.spaces import listed

TOLERANCE = 1e-6
"""Posterior probability that the models which are not listed may carry together."""

EFFORT = 8.0
"""Of a search, about in seconds; where half will be too little, a walk over the models takes the rest."""

SEED = 20231
"""Of the walk, so that it gives the same numbers twice."""

MANY = 100
"""Models by which a walk's share of the evidence is judged: those it stayed at longest."""


def search_models(
    names: tuple[str, ...], c: Candidates, by_size: FloatArray, needs: Needs, scale: float | None
) -> Models:
    """Posterior over the models that carry it, with a bound on the probability of the others.

    Parameters
    ----------
    names : the summary's columns.
    c : candidates, under physical priors.
    by_size : (p + 1,) log prior probability of one model of each size.
    needs : (child, parent) by the candidates' numbers.
    scale : the noise scale; None takes the one that the full library leaves, whose uncertainty, a share of
        ``1/sqrt(2 n)``, moves the log odds of a term t sd from zero by no more than ``t^2/sqrt(2 n)``.
    """
    proper = np.isfinite(c.sd)
    sd = np.where(proper, c.sd, 1e8 * np.max(c.sd[proper]))
    held = noise_scale(Factor(c.columns, c.whole, c.dof), sd) if scale is None else scale
    a, T = len(c.always), c.at(held)
    found = search(
        np.ascontiguousarray(T[a:, a:]),
        np.log(held / c.sd[a:]),
        held,
        by_size,
        needs=tuple(needs),
        tolerance=TOLERANCE,
        effort=EFFORT,
        rng=np.random.default_rng(SEED),
    )
    space, weight = listed(found.inside, found.weight)
    w = Weighed(c, space, np.array([held]), weight, _log_evidence(found) + log_flat(c, T, held))
    posterior = posterior_of(names, w, scale_components(c, space, w.scales, weight))
    if found.certified:
        return replace(posterior, missing=float(found.error.max()))
    return replace(posterior, missing=math.nan, error=float(found.error.max()))


def _log_evidence(found: Found) -> float:
    """Log of the summed joint probability of all models, from the share that some of them have of it."""
    most = np.argsort(-found.weight, kind="stable")[:MANY]
    return float(np.logaddexp.reduce(found.log_joint[most]) - math.log(found.weight[most].sum()))
