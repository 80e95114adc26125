"""The rung of one path: thresholded least squares on the whitened factor, judged along its path."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from imubayes.algebra.factor import noise_scale, posterior
from imubayes.campaign.preparation import Prepared
from imubayes.inference.observability import observe
from imubayes.ladder.answer import Answer, answer_of
from imubayes.ladder.decided import Basis, allowed, decided
from imubayes.ladder.plug_in import noise_of
from imubayes.ladder.problem import Ground, prepared
from imubayes.selection.effects import best_of, effects_of, log_evidence
from imubayes.selection.mixture import candidates, scale_components
from imubayes.selection.models import Models, Weighed, posterior_of
from imubayes.selection.sindy import THRESHOLDS
from imubayes.selection.spaces import listed
from imubayes.selection.sparse_paths import PATHS

OPTIMIZER = "stlsq"
"""Sequentially thresholded least squares: one fit is its whole path."""


def sparse(ground: Ground) -> Answer:
    """Choose the support with the largest evidence along one path, and refit it."""
    ready, problem = prepared(ground), ground.problem
    ground.tell("sparse regression along its path")
    summary, library = ready.summary, problem.library
    scale = noise_scale(summary.factor, ready.prior.sd)
    mean, sd = posterior(summary.factor, ready.prior.sd, scale)
    full = zip(mean.tolist(), sd.tolist(), strict=True)
    basis = Basis(
        library=library,
        sd=dict(zip(summary.names, ready.prior.sd.tolist(), strict=True)),
        reach=summary.reach,
        seen=observe(summary.factor, ready.prior.sd, summary.facts, scale=scale, reach=summary.reach),
        costs=problem.costs,
        full=dict(zip(summary.names, full, strict=True)),
        doubt=lambda inclusion: (0.0, 1.0),
        why="of the models along one path, so that 0 and 1 are a choice and no probability",
    )
    return answer_of("sparse", decided(basis, _chosen(ready, scale, problem.hierarchical)), noise_of(ready))


def _chosen(ready: Prepared, scale: float, hierarchical: bool) -> Models:
    """The one model that is chosen along the path, refitted under the prior."""
    f, sd = ready.summary.factor, ready.prior.sd
    terms = {term.name for term in ready.summary.library.terms} if ready.summary.library else set(f.names)
    e = effects_of(f, sd, [name for name in f.names if name in terms], scale)
    supports = PATHS[OPTIMIZER](e.R[:-1, :-1], e.R[:-1, -1], THRESHOLDS)
    supports = np.vstack(
        (supports[allowed(supports, e.names, hierarchical)], np.ones((1, len(e.names)), bool))
    )
    score = log_evidence(e, supports)
    best = best_of(supports, score)
    always = tuple(name for name in f.names if name not in terms)
    by_name = dict(zip(f.names, sd.tolist(), strict=True))
    columns = (*always, *e.names)
    c = candidates(f, e.names, always, np.array([by_name[name] for name in columns]))
    space, weight = listed(supports[best : best + 1], np.ones(1))
    scales = np.array([scale])
    w = Weighed(c, space, scales, weight, float(score[best]))
    found = posterior_of(columns, w, scale_components(c, space, scales, weight))
    return replace(found, missing=math.nan, error=math.nan)
