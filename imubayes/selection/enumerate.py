"""The posterior over all submodels of a summary, exactly.

With independent physical priors the noise scale sigma is integrated numerically: the tree is walked once for
each node of a trapezoid rule in ln sigma (spectrally accurate for a smooth peak). With the g-family sigma is
integrated analytically and one walk serves all models.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from imubayes.errors import TermError, UnobservableError
from imubayes.factor import VANISHED
from imubayes.inference.prior import GFamily, Prior, ScalePrior, g_nodes
from imubayes.inference.summary import Summary
from imubayes.selection.masks import fold, mass, sizes
from imubayes.selection.mixture import (
    Candidates,
    Components,
    candidates,
    g_components,
    log_flat,
    merged,
    scale_components,
)

FloatArray = NDArray[np.float64]
ModelPrior = str | float

LARGEST = 26
"""Most candidates that are enumerated: 2^26 models of 8 bytes are half a gigabyte a noise scale."""

NEGLIGIBLE = 28.0
"""Log of the share below which a noise scale no longer counts: exp(-28) = 7e-13."""

FINE_STEPS = 18
"""Up to so many candidates sigma takes steps of one sd (error 1e-8); beyond, of 1.5 sd (error 5e-4)."""

FEW = 9.0
"""Added to the degrees of freedom nu in the sd of ln sigma, 1/sqrt(2 nu), which makes the steps' error,
2 |Gamma((nu + 2 pi i/step)/2) / Gamma(nu/2)|, less than 1.1e-8 for every nu: few make ln sigma skew."""

COARSE = 12.0
"""What `NEGLIGIBLE` is beyond that many candidates: exp(-12) = 6e-6."""

WIDEST = math.log(1e8)
"""Farthest that ln sigma goes from its start."""

SEED = 0.5
"""Distance in ln sigma of the seeds where data and prior disagree."""

EXACT = 1e-10
"""Smallest noise scale, relative to the rms of the data: below, rounding would be read as signal."""


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
    n_models : how many were visited.
    candidates : what was enumerated.
    scales : (q,) nodes of the noise scale; one NaN with the g-family, which integrates it.
    weight : (n_models,) posterior probability of each model, by mask.
    components : the mixture behind `mean` and `sd`.
    parts : (weight, posterior) at each noise, where they are averaged over several; empty otherwise.
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
    scales: FloatArray
    weight: FloatArray
    components: Components
    parts: tuple[tuple[float, Models], ...] = ()


def enumerate_models(
    summary: Summary,
    prior: Prior,
    model_prior: ModelPrior = "beta-binomial",
    *,
    forced: tuple[str, ...] | list[str] = (),
    always: tuple[str, ...] | list[str] = (),
    scale_limit: float = math.inf,
    scale: float | None = None,
) -> Models:
    """Evidence of every submodel, inclusion probabilities and model-averaged coefficients.

    Parameters
    ----------
    summary : the data's factor.
    prior : on the coefficients; the sds of a `ScalePrior` are those of the summary's terms, or of the
        terms that are not forced, or one for all.
    model_prior : ``beta-binomial`` (every size equally likely), ``uniform``, or the prior probability of
        each candidate.
    forced : terms that are in every model with a flat prior; the others are taken orthogonal to them.
    always : terms that are in every model with their own physical prior (`ScalePrior` only).
    scale_limit : largest noise scale, relative to that of the full library (`ScalePrior` only): noise that
        was estimated with the library in the mean cannot be far stronger, whatever the prior makes of it.
    scale : the noise scale where it is known, 1 for rows whitened by the true noise (`ScalePrior` only).

    Raises
    ------
    TermError : if a name is unknown, the prior does not fit the terms, or there are over 26 candidates.
    UnobservableError : with the g-family, if a candidate depends linearly on others.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> X = rng.normal(size=(50, 3))
    >>> s = Summary.from_arrays(X, 2.0 * X[:, 0] + rng.normal(size=50), ("a", "b", "c"))
    >>> enumerate_models(s, ScalePrior(1.0)).best[0][0]
    ('a',)
    """
    c = _prepare(summary, prior, tuple(forced), tuple(always))
    log_prior = _log_model_prior(model_prior, len(c.names))
    if isinstance(prior, ScalePrior):
        scales, weight, peak = (
            _over_scales(c, log_prior, scale_limit) if scale is None else _at_scale(c, log_prior, scale)
        )
        parts = scale_components(c, scales, weight)
    else:
        scales, weight, peak, parts = _over_g(c, prior, log_prior)
    return _posterior(summary.names, c, scales, weight, peak, parts)


def inclusion_given(models: Models, required: tuple[str, ...]) -> FloatArray:
    """Inclusion of each candidate, given that the terms `required` are in the model: (p,)."""
    sums, total = fold(_containing(models, required), len(models.candidates.names))
    return np.minimum(sums / total, 1.0)


def components_given(models: Models, required: tuple[str, ...]) -> Components:
    """Return the mixture over the models that contain `required`, for a physical prior."""
    if models.parts:
        bits = [models.candidates.names.index(name) for name in required]
        inside = [weight * mass(part.weight, bits) for weight, part in models.parts]
        shares = inside if sum(inside) > 0.0 else [weight for weight, _ in models.parts]
        return merged(shares, [components_given(part, required) for _, part in models.parts])
    return scale_components(models.candidates, models.scales, _containing(models, required))


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
    weight = np.sum([w * m.weight for w, m in zip(share, models, strict=True)], axis=0)
    parts = merged(share.tolist(), [m.components for m in models])
    return replace(
        _posterior(first.names, first.candidates, np.array([math.nan]), weight, evidence, parts),
        log_evidence=evidence,
        parts=tuple(zip(share.tolist(), models, strict=True)),
    )


def _containing(models: Models, required: tuple[str, ...]) -> FloatArray:
    """Weights of the models that contain `required`; zero for the others.

    If the data all but exclude them, so that every such weight has underflowed, the largest of them is taken
    alone: the model with every candidate.
    """
    weight = models.weight
    if required:
        mask = sum(1 << models.candidates.names.index(name) for name in required)
        weight = np.where((np.arange(len(weight)) & mask) == mask, weight, 0.0)
    if not weight.any():
        weight[-1] = 1.0
    return weight


def _prepare(summary: Summary, prior: Prior, forced: tuple[str, ...], always: tuple[str, ...]) -> Candidates:
    names = summary.names
    unknown = [name for name in (*forced, *always) if name not in names]
    if unknown:
        raise TermError(f"term '{unknown[0]}' is not in the summary: its terms are {', '.join(names)}")
    free = tuple(name for name in names if name not in forced and name not in always)
    if len(free) > LARGEST:
        raise TermError(
            f"{len(free)} candidate terms are more than the {LARGEST} that are enumerated: lower powers,"
            " asymmetry or temperature, or use the slide set"
        )
    sd = _sd_by_name(prior, names, forced)
    order = (*forced, *always, *free)
    return candidates(summary.factor, free, (*forced, *always), np.array([sd[name] for name in order]))


def _sd_by_name(prior: Prior, names: tuple[str, ...], forced: tuple[str, ...]) -> dict[str, float]:
    """Prior sd by name; inf where a term is forced (and with the g-family, which has no sd)."""
    flat = dict.fromkeys(names, math.inf)
    if not isinstance(prior, ScalePrior):
        return flat
    proper = [name for name in names if name not in forced]
    given = names if len(prior.sd) == len(names) else proper
    values = np.broadcast_to(prior.sd, len(given)) if prior.sd.size == 1 else prior.sd
    if len(values) != len(given):
        raise TermError(f"the prior has {len(values)} sds for {len(given)} terms: {', '.join(given)}")
    sds = dict(zip(given, values.tolist(), strict=True))
    return {name: math.inf if name in forced else sds[name] for name in names}


def _log_model_prior(model_prior: ModelPrior, p: int) -> FloatArray:
    """Log prior probability of one model of each size 0 ... p."""
    k = np.arange(p + 1)
    if model_prior == "beta-binomial":
        return -math.log(p + 1) - np.array([math.log(math.comb(p, i)) for i in k])
    share = 0.5 if model_prior == "uniform" else model_prior
    if isinstance(share, str) or not 0.0 < share < 1.0:
        raise TermError(
            f"model_prior = {share!r}: expected 'beta-binomial', 'uniform' or a probability between 0 and 1"
        )
    return k * math.log(share) + (p - k) * math.log1p(-share)


def _over_scales(c: Candidates, log_prior: FloatArray, limit: float) -> tuple[FloatArray, FloatArray, float]:
    """Nodes of the noise scale, and each model's probability over all of them, ``weight * exp(peak)``.

    From the scale of the full library outwards, until both ends are negligible. Where data and prior differ,
    a second peak can lie at a larger scale, at which the prior wins: seeds up to the data's size find it.
    """
    fine = len(c.names) <= FINE_STEPS
    start, largest, step = _first_scale(c)
    step, negligible = (step, NEGLIGIBLE) if fine else (1.5 * step, COARSE)
    model_prior = log_prior[sizes(len(c.names))] + math.log(step)
    sums = _Sums(np.zeros(len(model_prior)), -math.inf)
    heights: dict[int, float] = {}

    def visit(m: int) -> float:
        if m not in heights:
            heights[m] = sums.add(_log_joint(c, start * math.exp(m * step)) + model_prior)
        return heights[m]

    lowest = math.ceil(math.log(EXACT * largest / start) / step)
    highest = math.ceil(min(WIDEST, math.log(limit)) / step)
    reached = min(math.floor(math.log(largest / start) / step) + 1, highest)
    seeds = range(0, reached, max(1, round(SEED / step))) if _disagree(c, start) else [0]
    for seed in seeds:
        for direction in (1, -1):
            m = seed
            while lowest <= m < highest and visit(m) > sums.peak - negligible:
                m += direction
    return start * np.exp(np.array(sorted(heights)) * step), sums.weight, sums.peak


def _at_scale(c: Candidates, log_prior: FloatArray, scale: float) -> tuple[FloatArray, FloatArray, float]:
    """One noise scale, which is known."""
    log_joint = _log_joint(c, scale) + log_prior[sizes(len(c.names))]
    peak = float(log_joint.max())
    return np.array([scale]), np.exp(log_joint - peak), peak


def _disagree(c: Candidates, scale: float) -> bool:
    """Whether the prior pulls the full library's fit off the data, as far as a noise scale goes."""
    inside, free = float(c.at(scale)[-1, -1]), float(c.whole[-1, -1])
    return 0.5 * (inside**2 - free**2) / scale**2 > NEGLIGIBLE


@dataclass(slots=True, eq=False)
class _Sums:
    """Running sum of exponentials, ``weight * exp(peak)`` by model, that neither over- nor underflows."""

    weight: FloatArray
    peak: float

    def add(self, logs: FloatArray) -> float:
        """Add exp(logs); return the largest of them."""
        height = float(logs.max())
        if height > self.peak:
            self.weight *= math.exp(self.peak - height)
            self.peak = height
        self.weight += np.exp(logs - self.peak)
        return height


def _first_scale(c: Candidates) -> tuple[float, float, float]:
    """Noise scale of the full library to start from, the data's rms, and the sd of the scale's logarithm."""
    length = max(float(np.linalg.norm(c.whole[len(c.always) :, -1])), np.finfo(float).tiny)
    dof = max(c.dof - len(c.columns), c.dof / 2.0, 1.0)
    left = abs(float(c.whole[-1, -1]))
    if c.dof <= len(c.columns):  # the columns alone fit exactly: ask what a fit within the prior leaves
        left = abs(float(c.at(length / math.sqrt(dof))[-1, -1]))
    step = 1.0 / math.sqrt(2.0 * (c.dof + FEW))  # the model with the most degrees of freedom is the narrowest
    return max(left, EXACT * length) / math.sqrt(dof), length / math.sqrt(dof), step


def _log_joint(c: Candidates, scale: float) -> FloatArray:
    """Log p(data | model, scale) of every model, for theta_j ~ N(0, sd_j^2)."""
    from imubayes.selection.tree import walk

    a, T = len(c.always), c.at(scale)
    rss, log_det = walk(np.ascontiguousarray(T[a:, a:]))
    log_rows = np.zeros(1)
    for width in np.log(scale / c.sd[a:]):
        log_rows = np.concatenate((log_rows, log_rows + width))
    return log_flat(c, T, scale) - rss / (2.0 * scale**2) - log_det + log_rows


def _over_g(
    c: Candidates, prior: GFamily, log_prior: FloatArray
) -> tuple[FloatArray, FloatArray, float, Components]:
    """The g-family: noise scale integrated analytically, one walk for all models."""
    from imubayes.selection.moments import g_integrals
    from imubayes.selection.tree import walk

    _check_independent(c)
    a = len(c.always)
    rss, _ = walk(np.ascontiguousarray(c.whole[a:, a:]))
    count, total = sizes(len(c.names)), float(rss[0])
    g, log_weight = g_nodes(prior, c.dof + a)
    integrals = g_integrals(np.clip(rss / total, 0.0, 1.0), count, float(c.dof), g, log_weight)
    null = math.lgamma(c.dof / 2) - c.dof / 2 * math.log(math.pi * total) - math.log(2.0) - 0.5 * c.log_det
    null -= float(np.sum(np.log(np.abs(np.diag(c.whole)[:a]))))
    log_joint = null + integrals[:, 0] + log_prior[count]
    peak = float(log_joint.max())
    weight = np.exp(log_joint - peak)
    return np.array([math.nan]), weight, peak, g_components(c, total, integrals, weight)


def _check_independent(c: Candidates) -> None:
    norms = np.linalg.norm(c.whole[:, :-1], axis=0)
    lost = np.abs(np.diag(c.whole)[:-1]) <= VANISHED * norms
    if lost.any():
        terms = tuple(name for name, gone in zip(c.columns, lost, strict=True) if gone)
        raise UnobservableError(
            f"a g-prior needs independent columns: {', '.join(terms)} depends on others", terms
        )


def _posterior(
    names: tuple[str, ...],
    c: Candidates,
    scales: FloatArray,
    weight: FloatArray,
    peak: float,
    parts: Components,
) -> Models:
    p = len(c.names)
    sums, total = fold(weight, p)
    certain = np.concatenate((np.ones(len(c.always)), np.minimum(sums / total, 1.0)))
    mean, sd = parts.moments()
    order = [c.columns.index(name) for name in names]
    share = np.bincount(sizes(p), weights=weight, minlength=p + 1)
    with np.errstate(divide="ignore"):
        by_size = peak + np.log(share)
    return Models(
        names=names,
        inclusion=certain[order],
        mean=mean[order],
        sd=sd[order],
        log_evidence=peak + math.log(total),
        best=_best(c.names, weight / total),
        by_size=by_size,
        n_models=1 << p,
        candidates=c,
        scales=scales,
        weight=weight / total,
        components=parts,
    )


def _best(names: tuple[str, ...], weight: FloatArray) -> tuple[tuple[tuple[str, ...], float], ...]:
    count = min(10, len(weight))
    top = np.argpartition(weight, -count)[-count:]
    top = top[np.argsort(-weight[top], kind="stable")]
    return tuple((tuple(name for j, name in enumerate(names) if m >> j & 1), float(weight[m])) for m in top)
