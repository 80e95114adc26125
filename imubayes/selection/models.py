"""The posterior over submodels: what it says of each candidate and of groups, at one noise or several."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from imubayes.selection.mixture import Candidates, Components, merged, scale_components
from imubayes.selection.spaces import Every, Space, united

FloatArray = NDArray[np.float64]

NO_SCALE = np.array([math.nan])
"""In place of the nodes of a noise scale that was integrated out."""


@dataclass(frozen=True, slots=True, eq=False)
class Models:
    """Posterior over all submodels, and model-averaged coefficients.

    Attributes
    ----------
    names : the summary's terms, p of them, forced ones included.
    inclusion : (p,) posterior probability of each term; 1 where forced.
    mean, sd : (p,) model-averaged.
    log_evidence : of the data, averaged over the models' prior (noise scale under the Jeffreys prior).
    best : the ten most probable models, best first: (candidates in it, probability).
    by_size : log of the summed joint probability of all models of 0, 1, ... candidates.
    n_models : how many were weighed: all 2^p, or those of a list.
    candidates : what was weighed.
    space : the models behind `weight`.
    scales : (q,) nodes of the noise scale; one NaN with the g-family, which integrates it.
    weight : (n_models,) posterior probability of each model of `space`.
    components : the mixture behind `mean` and `sd`.
    parts : (weight, posterior) at each noise, where they are averaged over several; empty otherwise.
    missing : bound on the probability of all models that are not in `space`; NaN where there is none.
    error : largest standard error of an inclusion, where models or few noises were drawn; 0 where all were.
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
    scales: FloatArray
    weight: FloatArray
    components: Components
    parts: tuple[tuple[float, Models], ...] = ()
    missing: float = 0.0
    error: float = 0.0


def inclusion_given(models: Models, required: tuple[str, ...]) -> FloatArray:
    """Inclusion of each candidate, given that the terms `required` are in the model: (p,)."""
    sums, total = models.space.sums(_containing(models, required))
    return np.minimum(sums / total, 1.0)


def inclusion_of_any(models: Models, names: tuple[str, ...]) -> float:
    """Probability that at least one of the candidates `names` is in the model."""
    bits = [models.candidates.names.index(name) for name in names]
    return min(float(models.weight[models.space.having_any(bits)].sum()), 1.0)


def components_given(models: Models, required: tuple[str, ...]) -> Components:
    """Return the mixture over the models that contain `required`, for a physical prior."""
    if models.parts:
        bits = [models.candidates.names.index(name) for name in required]
        inside = [weight * float(part.weight[part.space.having(bits)].sum()) for weight, part in models.parts]
        shares = inside if sum(inside) > 0.0 else [weight for weight, _ in models.parts]
        return merged(shares, [components_given(part, required) for _, part in models.parts])
    return scale_components(models.candidates, models.space, models.scales, _containing(models, required))


def average(models: Sequence[Models], log_weight: FloatArray) -> Models:
    """Posterior over the models of one library, averaged over draws of the noise.

    Parameters
    ----------
    models : at each draw, of the same candidates.
    log_weight : logarithm of what each draw counts, beside the evidence that its models give it.

    Returns
    -------
    with ``log_evidence`` the logarithm of the mean of all ``exp(log_weight + log_evidence)``.
    """
    logs = np.array([m.log_evidence for m in models]) + log_weight
    share = np.exp(logs - logs.max())
    evidence = float(logs.max() + math.log(share.mean()))
    share /= share.sum()
    first = models[0]
    space, weight = united(
        [m.space for m in models], [w * m.weight for w, m in zip(share, models, strict=True)]
    )
    parts = merged(share.tolist(), [m.components for m in models])
    error = 0.0 if isinstance(space, Every) else _error_of_few(models, share)
    return replace(
        posterior_of(first.names, Weighed(first.candidates, space, NO_SCALE, weight, evidence), parts),
        log_evidence=evidence,
        parts=tuple(zip(share.tolist(), models, strict=True)),
        missing=float(share @ [m.missing for m in models]),
        error=error,
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
    bits = [models.candidates.names.index(name) for name in required]
    weight = np.where(models.space.having(bits), models.weight, 0.0)
    if not weight.any():
        weight[models.space.full] = 1.0
    return weight


@dataclass(frozen=True, slots=True, eq=False)
class Weighed:
    """Models and how much each counts.

    Attributes
    ----------
    candidates : what they are models of.
    space : which models.
    scales : (q,) nodes of the noise scale.
    weight : (m,) joint probability of each model and the data, times ``exp(-peak)``.
    peak : logarithm of what the weights were divided by.
    """

    candidates: Candidates
    space: Space
    scales: FloatArray
    weight: FloatArray
    peak: float


def posterior_of(names: tuple[str, ...], w: Weighed, parts: Components) -> Models:
    """Posterior over weighed models, and model-averaged coefficients of the columns `names`."""
    c, p = w.candidates, len(w.candidates.names)
    sums, total = w.space.sums(w.weight)
    certain = np.concatenate((np.ones(len(c.always)), np.minimum(sums / total, 1.0)))
    mean, sd = parts.moments()
    order = [c.columns.index(name) for name in names]
    share = np.bincount(w.space.sizes(), weights=w.weight, minlength=p + 1)
    with np.errstate(divide="ignore"):
        by_size = w.peak + np.log(share)
    return Models(
        names=names,
        inclusion=certain[order],
        mean=mean[order],
        sd=sd[order],
        log_evidence=w.peak + math.log(total),
        best=_best(c.names, w.space, w.weight / total),
        by_size=by_size,
        n_models=len(w.space),
        candidates=c,
        space=w.space,
        scales=w.scales,
        weight=w.weight / total,
        components=parts,
    )


def _best(
    names: tuple[str, ...], space: Space, weight: FloatArray
) -> tuple[tuple[tuple[str, ...], float], ...]:
    count = min(10, len(weight))
    top = np.argpartition(weight, -count)[-count:]
    top = top[np.argsort(-weight[top], kind="stable")]
    inside = space.members(top)
    return tuple(
        (tuple(name for name, there in zip(names, row, strict=True) if there), float(weight[m]))
        for m, row in zip(top.tolist(), inside.tolist(), strict=True)
    )
