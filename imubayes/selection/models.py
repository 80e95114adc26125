"""The posterior over submodels: what it says of each candidate, at one noise or several, and how exactly."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.algebra.digits import HALF_UNIT, Digits, bounds, digits_within, norms, rounding_of
from imubayes.algebra.factor import invert_triangular, solve_triangular
from imubayes.inference.summary import Summary
from imubayes.selection.mixture import (
    Candidates,
    Components,
    Scales,
    drawn_of,
    merged,
    no_mixture,
    scale_components,
)
from imubayes.selection.model_sets import Space, Totals, Union, heaviest, listed, standing_for, tally

NO_SCALE = Scales.only(math.nan)
"""In place of the nodes of a noise scale that was integrated out."""


@dataclass(frozen=True, slots=True, eq=False)
class Models:
    """Posterior over all submodels, and model-averaged coefficients.

    Attributes
    ----------
    names : the summary's terms, p of them, forced ones included.
    inclusion : (p,) posterior probability of each term; 1 where forced.
    mean, sd : (p,) model-averaged; under physical priors, where `mixture.CHOSEN` models count and more, over
        so many that are drawn: right to about 0.02 sd. Under the g-family beyond 15 candidates over 2^15
        models that stand for all: right to about 0.005 sd.
    log_evidence : of the data, averaged over the models' prior (noise scale under the Jeffreys prior).
    best : the ten most probable models, best first: (candidates in it, probability).
    by_size : log of the summed joint probability of all models of 0, 1, ... candidates.
    n_models : how many were weighed: all 2^p, or those of a list.
    candidates : what was weighed.
    space : the models behind `weight`.
    scales : nodes of the noise scale; one NaN with the g-family, which integrates it.
    weight : (n_models,) posterior probability of each model of `space`.
    components : the mixture behind `mean` and `sd`; where models are many, of some that stand for all.
    parts : (weight, posterior) at each noise, without its models, where they are averaged over several; empty
        otherwise.
    given : mixtures over the models that have some terms, where they are averaged: see `components_given`.
    missing : bound on the probability of all models that are not in `space`; NaN where there is none.
    error : largest standard error of an inclusion, where models or few noises were drawn; 0 where all were;
        NaN where a rule picked them, so that nothing is known of the others.
    quadrature : bound on the error of the log evidence by the integration over the noise scale.
    drawn : number of draws that `mean` and `sd` are over, where more models count than that; else 0.
    """

    names: tuple[str, ...]
    inclusion: FloatArray
    mean: FloatArray
    sd: FloatArray
    log_evidence: float
    best: tuple[tuple[tuple[str, ...], float], ...]
    by_size: FloatArray
    n_models: int
    candidates: Candidates
    space: Space
    scales: Scales
    weight: FloatArray
    components: Components
    parts: tuple[tuple[float, Models], ...] = ()
    given: Mapping[tuple[str, ...], Components] = field(default_factory=dict)
    missing: float = 0.0
    error: float = 0.0
    quadrature: float = 0.0
    drawn: int = 0

    @property
    def scale(self) -> float:
        """Posterior mean of the noise scale, in the units of the candidates."""
        weight, each = self.components.weight, self.components.scale
        peak = float(each.max())
        return math.ldexp(peak * float(weight @ (each / peak)), -self.candidates.response_unit)

    @property
    def digits(self) -> Digits:
        """Digits that the arithmetic leaves, of rows that were given as white."""
        return digits_of(self)


def inclusion_given(models: Models, required: tuple[str, ...]) -> FloatArray:
    """Inclusion of each candidate, given that the terms `required` are in the model: (p,)."""
    if not required:
        return models.inclusion[[models.names.index(name) for name in models.candidates.names]]
    sums, total = models.space.sums(_containing(models, required))
    return np.minimum(sums / total, 1.0)


def inclusion_of_any(models: Models, names: tuple[str, ...]) -> float:
    """Probability that at least one of the candidates `names` is in the model."""
    bits, weight = _bits(models, names), models.weight.reshape(models.space.shape)
    first = (weight[models.space.where([bit], bits[:k])].sum() for k, bit in enumerate(bits))
    return min(float(sum(first)), 1.0)


def _bits(models: Models, names: tuple[str, ...]) -> list[int]:
    return [models.candidates.names.index(name) for name in names]


def components_given(models: Models, required: tuple[str, ...]) -> Components:
    """Return the mixture over the models that contain `required`, for a physical prior.

    An average has those alone that it was made with.
    """
    if models.parts:
        return models.given[required]
    return scale_components(models.candidates, models.space, models.scales, _containing(models, required))


def average(
    drawn: Iterable[Models], log_weight: FloatArray, required: Sequence[tuple[str, ...]] = ()
) -> Models:
    """Posterior over the models of one library, averaged over draws of the noise.

    `log_weight` is the logarithm of what each draw counts, beside the evidence that its models give it: the
    ``log_evidence`` of all is the logarithm of the mean of ``exp(log_weight + log_evidence)``. The models of
    a draw are not kept, so that draws may be many; `components_given` has the terms that are `required`.
    """
    union, models, logs = Union(), list[Models](), np.empty(len(log_weight))
    having, mixtures = np.empty((len(required), len(logs))), [list[Components]() for _ in required]
    for k, m in enumerate(drawn):
        logs[k] = m.log_evidence + log_weight[k]
        union.add(m.space, m.weight, logs[k])
        models.append(replace(m, space=Space(m.space.p), weight=np.empty(0)))
        for names, inside, given in zip(required, having, mixtures, strict=True):
            inside[k] = m.weight.reshape(m.space.shape)[m.space.where(_bits(m, names))].sum()
            given.append(components_given(m, names))
    share = np.exp(logs - logs.max())
    evidence = float(logs.max() + math.log(share.mean()))
    share /= share.sum()
    first, (space, weight) = models[0], union.summed(len(models[0].candidates.names))
    every = all(m.n_models == 1 << len(m.candidates.names) for m in models)
    error = 0.0 if every else _error_of_few(models, share)
    by_size = [np.exp(m.by_size - m.log_evidence) for m in models]
    averaged = posterior_of(
        first.names,
        WeightedModels(first.candidates, space, NO_SCALE, weight, evidence),
        no_mixture(first.candidates),
        Totals(share @ [inclusion_given(m, ()) for m in models], 1.0, share @ by_size),
    )
    mean, off = share @ [m.mean for m in models], [m.mean for m in models]
    whole, parts = merged(share.tolist(), [m.components for m in models])
    return replace(
        averaged,
        mean=mean,
        sd=np.sqrt(share @ (np.square([m.sd for m in models]) + np.square(off - mean))),
        n_models=first.n_models if every else len(space),
        log_evidence=evidence,
        components=whole,
        parts=tuple(
            (w, replace(m, components=part)) for w, m, part in zip(share.tolist(), models, parts, strict=True)
        ),
        given={
            names: merged((share * inside if inside.any() else share).tolist(), given)[0]
            for names, inside, given in zip(required, having, mixtures, strict=True)
        },
        missing=float(share @ [m.missing for m in models]),
        error=error,
        drawn=max(m.drawn for m in models),
    )


def _error_of_few(models: Sequence[Models], share: FloatArray) -> float:
    """Largest standard error of an inclusion: of the walks, and of so few draws of the noise."""
    inclusion = np.array([m.inclusion for m in models])
    between = share @ (inclusion - share @ inclusion) ** 2
    count = 1.0 / float(share @ share)
    spread = between / max(count - 1.0, 1.0)
    walks = float(share**2 @ np.square([m.error for m in models]))
    return math.sqrt(float(spread.max()) + walks)


def _containing(models: Models, required: tuple[str, ...]) -> FloatArray:
    """Weights of the models that contain `required`; zero for the others.

    If the data all but exclude them, so that every such weight has underflowed, the largest of them is taken
    alone: the model with every candidate.
    """
    if not required:
        return models.weight
    weight, shape = np.zeros_like(models.weight), models.space.shape
    there = models.space.where(_bits(models, required))
    weight.reshape(shape)[there] = models.weight.reshape(shape)[there]
    if not weight.any():
        weight[-1] = 1.0
    return weight


@dataclass(frozen=True, slots=True, eq=False)
class WeightedModels:
    """Models and how much each counts: its joint probability with the data is ``weight * exp(peak)``.

    The noise scale was integrated by a rule at the nodes `scales`, whose error in the logarithms is `error`
    at most.
    """

    candidates: Candidates
    space: Space
    scales: Scales
    weight: FloatArray
    peak: float
    error: float = 0.0


def totals(w: WeightedModels) -> Totals:
    """Sums of the weights, by candidate, by size and in all."""
    p = len(w.candidates.names)
    if w.space.every:
        return tally(w.weight, p)
    sums, total = w.space.sums(w.weight)
    by_size = np.bincount(w.space.sizes(), weights=w.weight, minlength=p + 1).astype(np.float64)
    return Totals(sums, total, by_size)


def thinned(w: WeightedModels, count: int) -> WeightedModels:
    """Return about so many models that stand for all, and the model with every candidate."""
    which, weight = standing_for(w.weight, count)
    space, weight = listed(w.space.members(which), weight)
    return replace(w, space=space, weight=weight)


def posterior_of(
    names: tuple[str, ...], w: WeightedModels, parts: Components | None = None, told: Totals | None = None
) -> Models:
    """Posterior over weighed models, and model-averaged coefficients of the summary's columns `names`.

    Where the models only stand for all, `told` holds the `totals` of all. `parts` is the mixture, by default
    that of independent physical priors.
    """
    c = w.candidates
    parts = scale_components(c, w.space, w.scales, w.weight) if parts is None else parts
    every = told is not None or w.space.every
    sums, total, share = told or totals(w)
    weight = w.weight / total
    certain = np.concatenate((np.ones(len(c.always)), np.minimum(sums / total, 1.0)))
    (mean, sd), a = parts.moments(), len(c.always)
    if a and len(parts.weight) and np.isfinite(w.scales.at).all() and np.isnan(mean[:a]).all():
        mean[:a], sd[:a] = _always_moments(c, parts)
    order = [c.columns.index(name) for name in names]
    with np.errstate(divide="ignore"):
        by_size = w.peak + np.log(share)
    return Models(
        names=names,
        inclusion=certain[order],
        mean=mean[order],
        sd=sd[order],
        log_evidence=w.peak + math.log(total),
        best=_best(c.names, w.space, weight),
        by_size=by_size,
        n_models=1 << len(c.names) if every else len(w.space),
        candidates=c,
        space=w.space,
        scales=w.scales,
        weight=weight,
        components=parts,
        quadrature=w.error,
        drawn=drawn_of(w.weight) if len(parts.weight) and np.isfinite(w.scales.at).all() else 0,
    )


def _always_moments(c: Candidates, parts: Components) -> tuple[FloatArray, FloatArray]:
    """Mean and sd (a,) of the columns that are always in, under physical priors, over the components.

    They come first in the factor and are integrated out before the candidates are looked at. Given the
    candidates' coefficients they are ``u - B theta`` with ``u = T_aa^-1 z_a`` and ``B = T_aa^-1 T_ap``, and
    noise of covariance ``sigma^2 (T_aa' T_aa)^-1``.
    """
    from imubayes.selection.kernels import covariance

    a, p = len(c.always), len(c.names)
    back = np.broadcast_to(c.unit, len(c.whole))[:-1] - c.response_unit
    theta = np.ldexp(parts.mean[:, a:], back[a:])
    middle = parts.weight @ theta
    scales, which = np.unique(parts.scale, return_inverse=True)
    levels, steps, spreads = [], [], []
    for q, scale in enumerate(np.ldexp(scales, -c.response_unit).tolist()):
        mine, T = which == q, c.at(scale)
        solved = solve_triangular(T[:a, :a], np.column_stack((T[:a, a:], np.eye(a))))
        u, B, root = solved[:, p], solved[:, :p], solved[:, p + 1 :]
        levels.append(u - B @ middle)
        steps.append(B @ ((parts.weight * mine) @ (theta - middle)))
        off, weight = theta[mine] - middle, parts.weight[mine]
        inner = covariance(np.ascontiguousarray(T[a:, a:]), parts.inside[mine], weight)
        second = (off * weight[:, None]).T @ off + scale**2 * inner
        spreads.append((scale**2 * np.sum(root**2, axis=1), np.sum((B @ second) * B, axis=1)))
    shares, variance = np.bincount(which, parts.weight), np.zeros(a)
    mean = shares @ np.array(levels) - np.array(steps).sum(axis=0)
    for share, level, step, (alone, around) in zip(shares, levels, steps, spreads, strict=True):
        off = level - mean
        variance += share * (off**2 + alone) - 2.0 * off * step
        variance += around
    given = c.given(np.pad((mean, np.sqrt(variance)), ((0, 0), (0, p))))[:, :a]
    return given[0], given[1]


def _best(
    names: tuple[str, ...], space: Space, weight: FloatArray
) -> tuple[tuple[tuple[str, ...], float], ...]:
    top = heaviest(weight, 10)
    return tuple(
        (tuple(name for name, there in zip(names, row, strict=True) if there), float(weight[m]))
        for m, row in zip(top.tolist(), space.members(top).tolist(), strict=True)
    )


LARGEST = 50.0
"""Error of a logarithm beyond which its size no longer matters: nothing is claimed then."""

TINY = np.finfo(float).tiny
"""In place of an inclusion of zero."""

PEAK = 6.0
"""Standard deviations of white noise that its largest sample reaches."""


def digits_of(models: Models, summary: Summary | None = None) -> Digits:
    """Digits of a posterior that the arithmetic leaves, the fewest at any noise that it is averaged over.

    The logarithm of a model's joint probability changes by ``rho e / sigma^2`` with the rounding of its
    residual and that of its determinant (`imubayes.algebra.digits`); an inclusion changes by no more than
    that. The full library bounds every submodel: its columns are the least independent.

    The summary is of the runs behind it; there is none where the rows were given as white.
    """
    before = 1.0 if summary is None else _backing(summary, models)
    every = [_trustworthy(part, before) for _, part in models.parts or ((1.0, models),)]
    return Digits(
        coefficients=min(digits.coefficients for digits in every),
        sd=min(digits.sd for digits in every),
        log_evidence=min(digits.log_evidence for digits in every),
        inclusion=min(digits.inclusion for digits in every),
    )


def _trustworthy(models: Models, before: FloatArray | float) -> Digits:
    """Digits that rounding leaves at one noise.

    The mixture's own inclusions may be off from those of all models, where it holds some that stand for all.
    """
    c, parts = models.candidates, models.components
    inclusion = inclusion_given(models, ())
    scale = models.scale
    T = c.at(scale)
    limits = bounds(T, rounding_of(c.dof, len(c.columns)) * np.maximum(before, 1.0))
    misfit = (abs(float(T[-1, -1])) / scale) * (limits.response / scale)
    log_error = misfit + limits.log_det + HALF_UNIT * (c.dof + 1.0) + models.quadrature
    missing = 1.0 if math.isnan(models.missing) else models.missing + models.error
    sampled, least = np.abs(parts.weight @ parts.inside - inclusion), np.maximum(inclusion, TINY)
    moved = math.expm1(min(2.0 * log_error, LARGEST))
    inverse = invert_triangular(T[:-1, :-1])
    size = np.maximum(np.abs(inverse @ T[:-1, -1]), scale * np.linalg.norm(inverse, axis=1))
    with np.errstate(invalid="ignore", divide="ignore"):
        relative = limits.coefficients / size
        mean = float(np.max(relative, initial=0.0)) + moved * _spread(parts)
    sd = float(np.max(limits.sd, initial=0.0)) + moved
    share = float(np.max(inclusion * (1.0 - inclusion), initial=0.0))
    return Digits(
        coefficients=digits_within(mean + float(np.max(sampled / np.sqrt(least), initial=0.0))),
        sd=digits_within(sd + float(np.max(0.5 * sampled / least, initial=0.0))),
        log_evidence=digits_within(
            (log_error + missing) / max(abs(models.log_evidence), 1.0) + 8.0 * HALF_UNIT
        ),
        inclusion=digits_within(moved * share + missing + 8.0 * HALF_UNIT),
    )


def _backing(summary: Summary, models: Models) -> FloatArray | float:
    """Size of each column, and of the response, before whitening over that after, at least 1.

    Whitening takes differences of neighbours, so that it keeps the rounding of what it takes away. Arrays
    from elsewhere than runs were white as they came.
    """
    f, runs = summary.factor, [run for run in summary.runs if run.noise.N > 0.0]
    if not runs:
        return 1.0
    theta = dict(zip(models.names, np.abs(models.mean).tolist(), strict=True))
    explained = np.array([theta.get(name, 0.0) for name in f.names])
    parts = []
    for run in runs:
        white = run.noise.N / math.sqrt(run.interval)
        largest = np.append(run.reach, run.reach @ explained + PEAK * white)
        parts.append(math.sqrt(run.samples) / white * largest)
    after = norms(f.R)
    ratio = np.linalg.norm(parts, axis=0) / np.where(after > 0.0, after, np.inf)
    return np.maximum(ratio, 1.0)[[*(f.names.index(name) for name in models.candidates.columns), f.p]]


def _spread(parts: Components) -> float:
    """Largest sd over the larger of size and sd: what a change of the weights of models can move."""
    mean, sd = parts.moments()
    size = np.maximum(np.abs(mean), sd)
    known = np.isfinite(size) & (size > 0.0)
    return float(np.max(sd[known] / size[known], initial=0.0)) if known.all() else 1.0
