"""The two cheapest rungs: BIC on averages over dwells, and one path of sparse regression.

Means knows no prior, no colour of the noise and no errors of the bench. The dwells' means count alike; with n
of them, ``BIC = n ln(rss/n) + k ln n`` of a model with k terms, and models count as ``exp(-BIC/2)``. Sparse
thresholds least squares on the whitened factor, and judges the supports along its path. Neither weighs every
submodel, so that the report's form of a decision is made here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import BoolArray, FloatArray
from imubayes.algebra.factor import FAINT, Factor, factor_of, noise_scale, posterior, reorder
from imubayes.campaign.prepared import Prepared
from imubayes.inference.dwells import dwells_of
from imubayes.inference.linear import linear_of
from imubayes.inference.observability import Observability, carried, observe
from imubayes.ladder.posteriors import estimated_noise
from imubayes.ladder.problem import Answer, Ground, Posterior, Problem, answer_of, prepared
from imubayes.rig.inputs import facts_of
from imubayes.selection.decision import WIDTHS, Selection
from imubayes.selection.mixture import Components, Scales, candidates, limit, probability_within
from imubayes.selection.model_sets import Space, admissible, by_number, hierarchy, listed, sizes
from imubayes.selection.models import NO_SCALE, Models, WeightedModels, inclusion_given, posterior_of
from imubayes.selection.sindy import THRESHOLDS, best_of, effects_of, log_evidence, on_path
from imubayes.selection.verdicts import (
    TENTH,
    Evidence,
    TermVerdict,
    median_model,
    moments_of,
    untested_verdict,
    verdict_of,
    with_tied,
)
from imubayes.sensors.equations import symbols
from imubayes.sensors.terms import Term

OPTIMIZER = "stlsq"
"""Sequentially thresholded least squares: one fit is its whole path."""

EXHAUSTIVE = 18
"""Most candidates of which every subset is looked at; with more, terms are taken and dropped singly."""

KEPT = 300
"""Most models whose coefficients are averaged; BIC makes the others count by less than a thousandth or so."""

ALIKE = 1e-7
"""A column of which less is left beside the others of its model, relative to its norm, depends on them."""


class Basis(NamedTuple):
    """What a decision is about, besides the models: `reach` is the largest size of each column, SI.

    A term that the full library's mean and sd lack has those of its prior; `why` ends every reason.
    """

    problem: Problem
    reach: Mapping[str, float]
    seen: Observability
    full: Mapping[str, tuple[float, float]]
    why: str


def means(ground: Ground) -> Answer:
    """Least squares on dwell means, averaged over models by BIC."""
    problem, names, sd = ground.problem, ground.problem.library.names, ground.problem.prior.sd
    ground.tell("dwell means")
    dwells = [dwells_of(linear_of(run, problem.library)) for run in problem.runs]
    X, y = np.concatenate([d.means.X for d in dwells]), np.concatenate([d.means.y for d in dwells])
    f = factor_of(X, y, names)
    # a column that no prior lets act is an input's rounding, and would be as good a column as any
    X[:, f.column_norms * sd <= FAINT * noise_scale(f, sd)] = 0.0
    f, reach = factor_of(X, y, names), dict(zip(names, np.abs(X).max(axis=0).tolist(), strict=True))
    models = by_bic(f, problem.hierarchical)
    scale = float(models.components.weight @ models.components.scale)
    facts = facts_of([run.inputs.channels for run in problem.runs], problem.spec.kind)
    seen = observe(f, sd, facts, scale=scale, reach=reach)
    why = f"by BIC on {f.n} dwell means, whose noise is taken as white"
    noise = [(scale * math.sqrt(float(d.means.rows.duration.mean())), 0.0, 0.0) for d in dwells]
    fitted = Posterior("means", np.array(noise))
    return answer_of(fitted, [selection_of(Basis(problem, reach, seen, _full(f), why), models)], None)


def sparse(ground: Ground) -> Answer:
    """Choose the support with the largest evidence along one path, and refit it."""
    ready, problem = prepared(ground), ground.problem
    ground.tell("sparse regression along its path")
    f, sd, reach = ready.summary.factor, ready.prior.sd, ready.summary.reach
    scale = noise_scale(f, sd)
    moments = (values.tolist() for values in posterior(f, sd, scale))
    seen = observe(f, sd, ready.summary.facts, scale=scale, reach=reach)
    full = dict(zip(f.names, zip(*moments, strict=True), strict=True))
    why = "of the models along one path, so that 0 and 1 are a choice and no probability"
    models = _chosen(ready, scale, problem.hierarchical)
    fitted = Posterior("sparse", estimated_noise(ready))
    return answer_of(fitted, [selection_of(Basis(problem, reach, seen, full, why), models)], ready)


def by_bic(f: Factor, hierarchical: bool = False) -> Models:
    """Weigh models of the columns of a factor of white rows by BIC, with flat priors.

    Models whose columns depend on each other count nothing, for least squares does not tell them; nor do
    those with more than half as many terms as rows, whose residuals say little of the noise.

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
    sound = list[tuple[BoolArray, FloatArray, FloatArray, FloatArray]]()
    for best in _every(scaled, f.n) if len(names) <= EXHAUSTIVE else [_stepwise(scaled, f.n)]:
        sound.append(_sound(scaled, best[_allowed(best, names, hierarchical)]))
        if sum(len(inside) for inside, *_ in sound) >= KEPT:
            break
    inside, mean, variance, rss = (np.concatenate(each)[:KEPT] for each in zip(*sound, strict=True))
    bic = _bic(rss, inside.sum(axis=1), f.n)
    weight = np.exp(0.5 * (bic.min() - bic))
    scale = np.sqrt(rss / (f.n - inside.sum(axis=1)))
    parts = Components(
        weight=weight / weight.sum(),
        inside=inside,
        scale=scale,
        mean=mean / norms,
        sd=scale[:, None] * np.sqrt(variance) / norms,
    )
    c = candidates(tested, names, (), np.full(len(names), math.inf))
    space, weight = listed(inside, weight)
    models = posterior_of(names, WeightedModels(c, space, NO_SCALE, weight, -0.5 * float(bic.min())), parts)
    return models if models.n_models == 1 << len(names) else replace(models, missing=math.nan, error=math.nan)


def _bic(rss: FloatArray, count: NDArray[np.int64], n: int) -> FloatArray:
    """BIC (m,) of models with so many terms; inf beyond half as many as rows."""
    bic = n * np.log(np.maximum(rss, np.finfo(float).tiny) / n) + count * math.log(n)
    return np.where(count <= n // 2, bic, math.inf)


def _sound(R: FloatArray, inside: BoolArray) -> tuple[BoolArray, FloatArray, FloatArray, FloatArray]:
    """Models (m, p) whose columns do not depend on each other, with mean, variance and rss of each."""
    from imubayes.selection.kernels import solutions

    mean, variance, rss, _ = solutions(R, inside)
    sound = np.max(variance, axis=1, initial=0.0) < ALIKE**-2
    return inside[sound], mean[sound], variance[sound], rss[sound]


def _every(R: FloatArray, n: int) -> Iterator[BoolArray]:
    """All subsets (m, p), best first, in parts."""
    from imubayes.selection.lanes import residuals

    p = R.shape[1] - 1
    bic = _bic(residuals(R), sizes(p), n)
    order = np.argsort(bic, kind="stable")[: int(np.isfinite(bic).sum())]
    yield from (Space(p).members(order[k : k + KEPT]) for k in range(0, len(order), KEPT))


def _stepwise(R: FloatArray, n: int) -> BoolArray:
    """Models (m, p) next to the way of the best single step from none, best first."""
    p = R.shape[1] - 1
    here, seen, scores = np.zeros(p, dtype=bool), [], []
    best = math.inf
    while True:
        around, _, _, rss = _sound(R, np.vstack((here, here ^ np.eye(p, dtype=bool))))
        score = _bic(rss, around.sum(axis=1), n)
        seen.append(around)
        scores.append(score)
        if not score.min() < best:
            break
        best, here = float(score.min()), around[int(np.argmin(score))]
    every, first = np.unique(np.concatenate(seen), axis=0, return_index=True)
    score = np.concatenate(scores)[first]
    order = np.argsort(score, kind="stable")
    return every[order[np.isfinite(score[order])]]


def _full(f: Factor) -> dict[str, tuple[float, float]]:
    """Least squares under the full library, but for columns that depend on those before them."""
    from imubayes.selection.kernels import solutions

    norms = np.where(f.column_norms > 0.0, f.column_norms, 1.0)
    scaled = f.R / np.append(norms, 1.0)
    kept = np.abs(np.diag(scaled)[:-1]) > ALIKE
    dof = f.n - int(kept.sum())
    if dof < 1:
        return {}
    mean, variance, rss, _ = solutions(scaled, kept[None])
    sd = np.sqrt(variance[0] * rss[0] / dof) / norms
    moments = zip(f.names, (mean[0] / norms).tolist(), sd.tolist(), kept.tolist(), strict=True)
    return {name: (m, s) for name, m, s, there in moments if there}


def _chosen(ready: Prepared, scale: float, hierarchical: bool) -> Models:
    """The one model that is chosen along the path, refitted under the prior."""
    f, sd = ready.summary.factor, ready.prior.sd
    terms = {term.name for term in ready.summary.library.terms} if ready.summary.library else set(f.names)
    e = effects_of(f, sd, [name for name in f.names if name in terms], scale)
    supports = on_path(OPTIMIZER, e, THRESHOLDS)
    supports = np.vstack(
        (supports[_allowed(supports, e.names, hierarchical)], np.ones((1, len(e.names)), bool))
    )
    score = log_evidence(e, supports)
    best = best_of(supports, score)
    always = tuple(name for name in f.names if name not in terms)
    by_name = dict(zip(f.names, sd.tolist(), strict=True))
    columns = (*always, *e.names)
    c = candidates(f, e.names, always, np.array([by_name[name] for name in columns]))
    space, weight = listed(supports[best : best + 1], np.ones(1))
    models = posterior_of(columns, WeightedModels(c, space, Scales.only(scale), weight, float(score[best])))
    return replace(models, missing=math.nan, error=math.nan)


def selection_of(basis: Basis, models: Models) -> Selection:
    """Give a verdict on every term of the library."""
    lib, costs = basis.problem.library, basis.problem.costs
    by_candidate = inclusion_given(models, ())
    # given how many others are in, every size of the model being as likely as another
    alone = float(by_candidate.sum() + 1.0) / (len(by_candidate) + 2.0)
    prior_sd = dict(zip(lib.names, basis.problem.prior.sd.tolist(), strict=True))
    terms = with_tied(
        tuple(
            _tested(basis, models, term, prior_sd[term.name])
            if term.name in models.candidates.names
            else untested_verdict(term, symbols(lib)[term.name], prior_sd[term.name], alone)
            for term in lib.terms
        ),
        lib.tied,
    )
    return Selection(
        terms=terms,
        columns=lib.names,
        model=median_model(terms, costs),
        log_evidence=models.log_evidence,
        models=models,
        by_width=tuple((width, by_candidate) for width in WIDTHS),
        observability=carried(basis.seen, dict(zip(lib.names, lib.carriers, strict=True))),
        free=np.array([term.full_mean for term in terms]),
        ties=lib.tied,
        costs=costs,
    )


def _allowed(inside: BoolArray, names: Sequence[str], hierarchical: bool) -> BoolArray:
    """Which models (m, p) hold what each of their terms calls for: (m,); all if not `hierarchical`."""
    return admissible(Space.of(inside), by_number(hierarchy(names), names) if hierarchical else ())


def _tested(basis: Basis, models: Models, term: Term, prior_sd: float) -> TermVerdict:
    parts, column, seen = models.components, models.candidates.columns.index(term.name), basis.seen
    inclusion = float(models.inclusion[models.names.index(term.name)])
    (mean, sd), most = moments_of(parts, column), limit(parts, column)
    full = basis.full.get(term.name, (0.0, prior_sd))
    partners = tuple(n for n in seen.partners(term.name) if n in models.candidates.names)
    evidence = Evidence(
        inclusion=inclusion,
        range=(0.0, 1.0) if partners else (inclusion, inclusion),
        small=probability_within(parts, column, TENTH * prior_sd),
        ratio=float(seen.ratio[seen.names.index(term.name)]),
        pull=abs(mean) / sd if sd > 0.0 else 0.0,
        partners=partners,
        remedy=next((group.remedy for group in seen.groups if term.name in group.terms), ""),
        prior_sd=prior_sd,
        full=full,
        # in no model: under the full library
        limit95=most if math.isfinite(most) else abs(full[0]) + 1.96 * full[1],
        reach=basis.reach[term.name],
    )
    symbol = symbols(basis.problem.library)[term.name]
    verdict = verdict_of(term, symbol, parts, column, evidence, basis.problem.costs)
    return replace(verdict, reason=f"{verdict.reason}; {basis.why}")
