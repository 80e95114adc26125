"""The posterior over more models than can be enumerated: those that carry it are searched for."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from imubayes.factor import Factor, noise_scale
from imubayes.selection.mixture import Candidates, log_flat, scale_components
from imubayes.selection.model_prior import Needs
from imubayes.selection.models import Models, Weighed, posterior_of
from imubayes.selection.spaces import listed

FloatArray = NDArray[np.float64]

TOLERANCE = 1e-6
"""Posterior probability that the models which are not listed may carry together."""

TIME_LIMIT = 20.0
"""Seconds after which the search gives way to a walk over the models."""

SEED = 20231
"""Of the walk, so that a study gives the same numbers twice."""


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
    from imubayes.selection.search import search

    proper = np.isfinite(c.sd)
    sd = np.where(proper, c.sd, 1e8 * np.max(c.sd[proper]))
    held = noise_scale(Factor(c.columns, c.whole, c.dof), sd) if scale is None else scale
    a, T = len(c.always), c.at(held)
    found = search(
        np.ascontiguousarray(T[a:, a:]),
        np.log(held / c.sd[a:]),
        held,
        by_size,
        needs=needs,
        tolerance=TOLERANCE,
        time_limit=TIME_LIMIT,
        rng=np.random.default_rng(SEED),
    )
    peak = float(found.log_joint.max())
    space, weight = listed(found.inside, np.exp(found.log_joint - peak))
    w = Weighed(c, space, np.array([held]), weight, peak + log_flat(c, T, held))
    return posterior_of(names, w, scale_components(c, space, w.scales, weight))
