"""The cheapest rung: averages over dwells, ordinary least squares, and BIC over subsets of the terms.

It knows no prior, no colour of the noise and no errors of the bench. The dwells' means count alike; with n of
them, ``BIC = n ln(rss/n) + k ln n`` of a model with k terms, and models count as ``exp(-BIC/2)``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra.arrays import BoolArray, FloatArray
from imubayes.algebra.factor import Factor, factor_of, reorder
from imubayes.inference.dwells import dwells_of
from imubayes.inference.linear import linear_of
from imubayes.inference.observability import observe
from imubayes.ladder.answer import Answer, answer_of
from imubayes.ladder.decided import Basis, Moments, allowed, decided
from imubayes.ladder.problem import Ground, Problem
from imubayes.rig.inputs import Facts, facts_of
from imubayes.selection.masks import sizes
from imubayes.selection.mixture import Components, candidates
from imubayes.selection.models import NO_SCALE, Models, Weighed, posterior_of
from imubayes.selection.moments import solutions
from imubayes.selection.spaces import Every, listed
from imubayes.selection.tree import walk

EXHAUSTIVE = 18
"""Most candidates of which every subset is looked at; with more, terms are taken and dropped singly."""

KEPT = 300
"""Most models whose coefficients are averaged; BIC makes the others count by less than a thousandth or so."""

SPARE = 4
"""Times as many are looked at: some have columns that depend on each other, or lack what a term needs."""

ALIKE = 1e-7
"""A column of which less is left beside the others of its model, relative to its norm, depends on them."""


@dataclass(frozen=True, slots=True, eq=False)
class _Averages:
    """Dwell means of all runs: their factor, how large each column is, and how long a run's dwells last."""

    factor: Factor
    reach: dict[str, float]
    duration: tuple[float, ...]
    facts: Facts


def means(ground: Ground) -> Answer:
    """Least squares on dwell means, averaged over models by BIC."""
    problem = ground.problem
    ground.tell("dwell means")
    averages = _averaged(problem)
    f = averages.factor
    models = by_bic(f, problem.hierarchical)
    scale = float(models.components.weight @ models.components.scale)
    sd = dict(zip(problem.library.names, problem.prior.sd.tolist(), strict=True))
    seen = observe(f, problem.prior.sd, averages.facts, scale=scale, reach=averages.reach)
    basis = Basis(
        library=problem.library,
        sd=sd,
        reach=averages.reach,
        seen=seen,
        costs=problem.costs,
        full=_full(f),
        doubt=lambda inclusion: (0.0, 1.0),
        why=f"by BIC on {f.n} dwell means, whose noise is taken as white",
    )
    noise = [(scale * math.sqrt(lasting), 0.0, 0.0) for lasting in averages.duration]
    return answer_of("means", decided(basis, models), noise)


def by_bic(f: Factor, hierarchical: bool = False) -> Models:
    """Weigh models of the columns of a factor of white rows by BIC, with flat priors.

    Models whose columns depend on each other count nothing, for least squares does not tell them; nor do
    those with more than half as many terms as rows, whose residuals say little of the noise.

    Parameters
    ----------
    f : of n rows; columns that are zero are no candidates.
    hierarchical : whether a term needs what it modifies.

    Examples
    --------
    >>> X = np.column_stack((np.ones(8), np.tile([1.0, -1.0], 4)))
    >>> y = 3.0 + np.array([0.1, 0.0, -0.1, 0.0, 0.1, -0.1, 0.0, 0.1])
    >>> by_bic(factor_of(X, y, ("one", "turn"))).best[0][0]
    ('one',)
    """
    names = tuple(n for n, size in zip(f.names, f.column_norms, strict=True) if size > 0.0)
    tested = reorder(f, names)
    norms = tested.column_norms
    scaled = tested.R / np.append(norms, 1.0)
    inside = _every(scaled, f.n) if len(names) <= EXHAUSTIVE else _stepwise(scaled, f.n)
    inside = inside[allowed(inside, names, hierarchical)][:KEPT]
    mean, variance, rss, _ = solutions(scaled, inside)
    sound = np.max(variance, axis=1, initial=0.0) < ALIKE**-2
    inside, rss = inside[sound], rss[sound]
    bic = _bic(rss, inside.sum(axis=1), f.n)
    weight = np.exp(0.5 * (bic.min() - bic))
    scale = np.sqrt(rss / (f.n - inside.sum(axis=1)))
    parts = Components(
        weight=weight / weight.sum(),
        inside=inside,
        scale=scale,
        mean=mean[sound] / norms,
        sd=scale[:, None] * np.sqrt(variance[sound]) / norms,
    )
    c = candidates(tested, names, (), np.full(len(names), math.inf))
    space, weight = listed(inside, weight)
    found = posterior_of(names, Weighed(c, space, NO_SCALE, weight, -0.5 * float(bic.min())), parts)
    return found if found.n_models == 1 << len(names) else replace(found, missing=math.nan, error=math.nan)


def _bic(rss: FloatArray, count: NDArray[np.int64], n: int) -> FloatArray:
    """BIC (m,) of models with so many terms; inf beyond half as many as rows."""
    found = n * np.log(np.maximum(rss, np.finfo(float).tiny) / n) + count * math.log(n)
    return np.where(count <= n // 2, found, math.inf)


def _every(R: FloatArray, n: int) -> BoolArray:
    """The best of all subsets (m, p), best first."""
    p = R.shape[1] - 1
    bic = _bic(walk(np.ascontiguousarray(R))[0], sizes(p), n)
    best = np.argsort(bic, kind="stable")[: KEPT * SPARE]
    return Every(p).members(best[np.isfinite(bic[best])])


def _stepwise(R: FloatArray, n: int) -> BoolArray:
    """Models (m, p) next to the way of the best single step from none, best first."""
    p = R.shape[1] - 1
    here, seen, scores = np.zeros(p, dtype=bool), [], []
    best = math.inf
    while True:
        around = np.vstack((here, here ^ np.eye(p, dtype=bool)))
        score = _bic(solutions(R, around)[2], around.sum(axis=1), n)
        seen.append(around)
        scores.append(score)
        if not score.min() < best:
            break
        best, here = float(score.min()), around[int(np.argmin(score))]
    every, first = np.unique(np.concatenate(seen), axis=0, return_index=True)
    score = np.concatenate(scores)[first]
    order = np.argsort(score, kind="stable")
    return every[order[np.isfinite(score[order])]]


def _full(f: Factor) -> dict[str, Moments]:
    """Least squares under the full library, but for columns that depend on those before them."""
    norms = np.where(f.column_norms > 0.0, f.column_norms, 1.0)
    scaled = f.R / np.append(norms, 1.0)
    kept = np.abs(np.diag(scaled)[:-1]) > ALIKE
    dof = f.n - int(kept.sum())
    if dof < 1:
        return {}
    mean, variance, rss, _ = solutions(scaled, kept[None])
    sd = np.sqrt(variance[0] * rss[0] / dof) / norms
    found = zip(f.names, (mean[0] / norms).tolist(), sd.tolist(), kept.tolist(), strict=True)
    return {name: (m, s) for name, m, s, there in found if there}


def _averaged(problem: Problem) -> _Averages:
    """Dwell means of all runs, and how long a dwell of each lasts."""
    rows = [linear_of(run, problem.library) for run in problem.runs]
    dwells = [dwells_of(part) for part in rows]
    X, y = np.concatenate([d.means.X for d in dwells]), np.concatenate([d.means.y for d in dwells])
    reach = np.abs(X).max(axis=0).tolist()
    return _Averages(
        factor=factor_of(X, y, problem.library.names),
        reach=dict(zip(problem.library.names, reach, strict=True)),
        duration=tuple(float(d.means.rows.duration.mean()) for d in dwells),
        facts=facts_of([run.inputs.channels for run in problem.runs], problem.spec.kind),
    )
