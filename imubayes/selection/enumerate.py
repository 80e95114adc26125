"""The posterior over all submodels of a summary, exactly.

With independent physical priors the noise scale sigma is integrated numerically: the tree is walked once for
each node of a Gauss rule in ln sigma where rows are many, so that the peak is all but normal, else of a
trapezoid rule (spectrally accurate for a smooth peak). With the g-family sigma is integrated analytically and
one walk serves all models.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.algebra.digits import HALF_UNIT
from imubayes.algebra.factor import vanished
from imubayes.errors import InputError, TermError, UnobservableError
from imubayes.inference.prior import GFamily, Prior, ScalePrior, g_nodes
from imubayes.inference.summary import Summary, check_names
from imubayes.selection.evidence import (
    Sums,
    g_curves,
    integrals_at,
    integration_error,
    log_bayes_factors,
    weights_of,
)
from imubayes.selection.mixture import Candidates, Scales, candidates, g_components, no_mixture, with_always
from imubayes.selection.model_sets import (
    ModelPrior,
    Needs,
    Space,
    admissible,
    by_number,
    log_model_prior,
    sizes,
)
from imubayes.selection.models import NO_SCALE, Models, WeightedModels, posterior_of, thinned, totals

LARGEST = 26
"""Most candidates that are enumerated: the weights of 2^26 models, of 8 bytes, are half a gigabyte."""

STORED_BITS = 22
"""Most candidates of which every model's weight is kept; of more, models that stand for all are."""

STORED = 2**15
"""Models, about, that stand for all: each heavier than a STORED-th of all, and a sample of the others. The
mixture under a prior of the g-family has no more."""

CURVES = 13
"""Candidates from which on the integrals over g are read off curves: cheaper than one by one."""

NEGLIGIBLE = 36.0
"""Log of the share below which all noise scales beyond one no longer count: exp(-36) = 2e-16. Of a term with
an inclusion of 1e-8 they have more: louder noise lets it in."""

FINE_STEPS = 22
"""Up to so many candidates sigma takes steps of one sd (error 1e-8); beyond, of 1.5 sd (error 5e-4)."""

FEW = 9.0
"""Added to the degrees of freedom nu in the sd of ln sigma, 1/sqrt(2 nu), which makes the steps' error,
2 |Gamma((nu + 2 pi i/step)/2) / Gamma(nu/2)|, less than 1.1e-8 for every nu: few make ln sigma skew."""

COARSE = 9.0
"""What `NEGLIGIBLE` is beyond that many candidates: exp(-9) = 1e-4."""

QUADRATURE = 1.1e-8
"""Largest error of the log evidence by these steps."""

ROUGH = 2.5e-3
"""The same beyond `FINE_STEPS`, of wider steps and of Gauss rules alike."""

COUNTS = tuple(range(3, 11))
"""Nodes that a Gauss rule may have."""

OFF_CENTRE = 0.2
"""Distance of the peak from the middle of a Gauss rule, in sd of ln sigma, that it is good for."""

ALIKE = 0.9
"""Variance of ln sigma in one model over that in all from which on the peaks of models are near enough to
each other for a Gauss rule."""

SERIES = 100
"""Rows from which on Stirling's series is good to 1e-12."""

WIDEST = math.log(1e8)
"""Farthest that ln sigma goes from its start."""

SEED = 0.5
"""Distance in ln sigma of the seeds where data and prior disagree."""

APART = 100.0
"""Powers of ten from the response to a given noise scale, beyond which squares leave the range of doubles."""

EXACT = 1e-14
"""Smallest noise scale, relative to the rms of the data: below, rounding would be read as signal. A full
library that leaves less fits exactly, and the noise scale is taken as this."""


def enumerate_models(
    summary: Summary,
    prior: Prior,
    model_prior: ModelPrior = "beta-binomial",
    *,
    forced: tuple[str, ...] | list[str] = (),
    always: tuple[str, ...] | list[str] = (),
    scale_limit: float = math.inf,
    scale: float | None = None,
    needs: Sequence[tuple[str, str]] = (),
    coefficients: bool = True,
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
    needs : (child, parent): only models that hold the parent of every child are weighed.
    coefficients : whether to average them over models, too; where every model's weight is kept, they take a
        good part of the time. Without them mean and sd are NaN, and there is no mixture.

    Raises
    ------
    TermError : if a name is unknown or there twice, the prior or `needs` do not fit the terms, or there are
        over 26 candidates under a prior of the g-family.
    InputError : if `scale` is not positive and finite, or `scale_limit` is not above 1.
    UnobservableError : if a forced column depends linearly on those before it, or the rows are no more than
        the forced columns; with the g-family, if a candidate depends linearly on others; if the response is
        zero in every row and the noise scale is not given.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> X = rng.normal(size=(50, 3))
    >>> s = Summary.from_arrays(X, 2.0 * X[:, 0] + rng.normal(size=50), ("a", "b", "c"))
    >>> enumerate_models(s, ScalePrior(1.0)).best[0][0]
    ('a',)
    """
    if scale is not None and not 0.0 < scale < math.inf:
        raise InputError(
            f"scale = {scale:g}: expected the sd of the noise, positive and finite; leave it out where it is"
            " not known"
        )
    if not scale_limit > 1.0:
        raise InputError(
            f"scale_limit = {scale_limit:g}: expected more than 1, the largest noise scale over that of the"
            " full library; leave it out for no limit"
        )
    c = _prepare(summary, prior, tuple(forced), tuple(always))
    scale = _known_scale(c, scale)
    numbered = _numbered(c, needs)
    by_size = log_model_prior(model_prior, len(c.names), numbered)
    if len(c.names) > LARGEST:
        # what is compiled for a search is loaded where there is one
        from imubayes.selection.search import search_models

        return search_models(summary.names, c, by_size, numbered, scale)
    if not isinstance(prior, ScalePrior):
        return _over_g(summary.names, c, prior, by_size, numbered, coefficients=coefficients)
    sums = Sums(c, by_size, numbered, np.zeros(1 << len(c.names)))
    if scale is None:
        w = _over_scales(c, sums, scale_limit)
    else:
        sums.add(scale)
        w = WeightedModels(c, Space(len(c.names)), Scales.only(scale), sums.weight, sums.level)
    told = totals(w)
    w = thinned(w, STORED) if len(c.names) > STORED_BITS else w
    return posterior_of(summary.names, w, None if coefficients else no_mixture(c), told)


def _prepare(summary: Summary, prior: Prior, forced: tuple[str, ...], always: tuple[str, ...]) -> Candidates:
    names, taken = summary.names, (*forced, *always)
    check_names(names)
    for k, name in enumerate(taken):
        if name not in names:
            raise TermError(f"term '{name}' is not in the summary: its terms are {', '.join(names)}")
        if name in taken[:k]:
            raise TermError(
                f"forced and always: '{name}' is there twice, expected each term once; name it in one of them"
            )
    free = tuple(name for name in names if name not in forced and name not in always)
    if len(free) > LARGEST and not isinstance(prior, ScalePrior):
        raise TermError(
            f"{len(free)} candidate terms are more than the {LARGEST} that a g-prior is enumerated for: give"
            " a physical prior, or fewer terms"
        )
    sd = _sd_by_name(prior, names, forced)
    c = candidates(summary.factor, free, taken, np.array([sd[name] for name in (*taken, *free)]))
    # columns with a flat prior that the rows do not tell apart have a posterior without end
    if lost := tuple(name for name, gone in zip(forced, vanished(c.whole), strict=False) if gone):
        raise UnobservableError(
            f"forced: expected independent columns, but {', '.join(lost)} is zero or depends on the ones"
            " before; leave it out, or give it a prior of its own (`always`)",
            lost,
        )
    if forced and c.dof < 1:
        raise UnobservableError(
            f"forced: {c.dof + len(forced)} rows for {len(forced)} forced columns leave nothing to tell the"
            " rest by; add rows, or force fewer columns",
            forced,
        )
    return c


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


def _numbered(c: Candidates, needs: Sequence[tuple[str, str]]) -> Needs:
    """Needs by the candidates' numbers; a parent that is always in, or not there, is not asked for."""
    found = [(a, b) for a, b in dict.fromkeys(needs) if a in c.names and b in c.names]
    parents = dict(found)
    if len(parents) < len(found):
        child = next(a for a, b in found if parents[a] != b)
        raise TermError(f"needs: '{child}' has two parents, expected one; leave one of them out")
    for name in parents:
        line = [name]
        while (parent := parents.get(line[-1])) is not None:
            if parent in line:
                raise TermError(
                    f"needs: {' needs '.join((*line, parent))}: expected an end; take one of these pairs out"
                )
            line.append(parent)
    return by_number(found, c.names)


def _over_scales(c: Candidates, sums: Sums, limit: float) -> WeightedModels:
    """Weigh each model over all noise scales.

    From the scale of the full library outwards, until both ends are negligible. Where data and prior differ,
    a second peak can lie at a larger scale, at which the prior wins: seeds up to the data's size find it.
    """
    fine = len(c.names) <= FINE_STEPS
    start, largest, sd = _first_scale(c)
    step, negligible = (sd, NEGLIGIBLE) if fine else (1.5 * sd, COARSE)
    heights: dict[int, float] = {}

    def visit(m: int) -> float:
        if m not in heights:
            heights[m] = sums.add(start * math.exp(m * step), math.log(step))
        return heights[m]

    def beyond(m: int, direction: int) -> float:
        """Log of what all scales beyond m have, if falls change as those of one model's likelihood do."""
        here = visit(m)
        before, first = (heights.get(m - k * direction, math.nan) for k in (1, 2))
        fall, bend = before - here, math.exp(-2.0 * direction * step) * (2.0 * before - here - first)
        fall += 0.0 if math.isnan(bend) else bend
        left = highest - m if direction > 0 else m - lowest + 1
        return here - math.log(max(math.expm1(min(fall, 700.0)), 1.0 / left)) if fall > 0.0 else here

    lowest = math.ceil(math.log(_smallest(c) / start) / step)
    highest = math.ceil(min(WIDEST, math.log(limit)) / step)
    reached = min(math.floor(math.log(largest / start) / step) + 1, highest)
    # whether the prior pulls the full library's fit off the data, as far as a noise scale goes
    inside, alone = float(c.at(start)[-1, -1]), float(c.whole[-1, -1])
    disagree = 0.5 * (inside**2 - alone**2) / start**2 > NEGLIGIBLE
    free = not disagree and math.log(limit) > math.sqrt(2.0 * NEGLIGIBLE) * sd
    if free and (found := _at_peak(c, sums, start, QUADRATURE if fine else ROUGH)):
        return found
    seeds = range(0, reached, max(1, round(SEED / step))) if disagree else [0]
    for seed in seeds:
        for direction in (1, -1):
            m = seed
            while lowest <= m < highest and beyond(m, direction) > sums.height - negligible:
                m += direction
    at_ends = [heights[m] for m in (lowest, highest - 1) if m in heights]
    error = (QUADRATURE if fine else ROUGH) + len(heights) * math.exp(
        max(at_ends, default=-math.inf) - sums.height
    )
    scales = start * np.exp(np.array(sorted(heights)) * step)
    over = Scales(scales, np.full(len(heights), math.log(step)))
    return WeightedModels(c, Space(len(c.names)), over, sums.weight, sums.level, error)


def _at_peak(c: Candidates, sums: Sums, start: float, tolerance: float) -> WeightedModels | None:
    """Weigh each model by a Gauss rule about the peak; None where no rule is good enough, or no peak near."""
    if (rule := _gauss_rule(c.dof, tolerance)) is None:
        return None
    t, log_share = rule
    n = len(t)
    pairs, reach, near = ((0, n - 1), ((n - 1) // 2, n // 2)), float(t[-1]), float(t[n // 2])
    for _ in range(2):
        scales = start * np.exp(t)
        nodes = list(zip(scales.tolist(), log_share.tolist(), strict=True))
        heights = {k: sums.add(*nodes[k]) for k in sorted({*pairs[0], *pairs[1]})}
        outer, inner = ([heights[k] for k in pair] for pair in pairs)
        rows, away = _likelihood(outer, inner, reach, near)
        alike = rows > ALIKE * c.dof
        if alike and abs(away) < OFF_CENTRE * _sd_of_log_scale(c.dof):
            for k in range(n):
                if k not in heights:
                    sums.add(*nodes[k])
            over = Scales(scales, log_share)
            return WeightedModels(c, Space(len(c.names)), over, sums.weight, sums.level, tolerance)
        sums.clear()
        if not alike:
            break
        start *= math.exp(away)
    return None


def _likelihood(
    outer: Sequence[float], inner: Sequence[float], reach: float, near: float
) -> tuple[float, float]:
    """Rows and peak of the likelihood, ``-rows t - squares/2 exp(-2 t)`` in t = ln sigma, with these heights.

    They are at -reach and reach, and at -near and near, which may be 0. Models whose peaks differ are wider
    together than one, and so look like one of fewer rows. No rows where no likelihood has these heights.
    """
    squares = (sum(inner) - sum(outer)) / (2.0 * (math.sinh(reach) ** 2 - math.sinh(near) ** 2))
    rows = 0.5 * (squares * math.sinh(2.0 * reach) - (outer[1] - outer[0])) / reach
    return (rows, 0.5 * math.log(squares / rows)) if squares > 0.0 and rows > 0.0 else (0.0, 0.0)


@cache
def _gauss_rule(dof: int, tolerance: float) -> tuple[FloatArray, FloatArray] | None:
    """Nodes in ln sigma, and the log of what each counts for, of the smallest Gauss rule that is good enough.

    It is taken for the likelihood of `dof` rows, ``exp(-dof (t + (exp(-2 t) - 1)/2))``, farther off than
    `OFF_CENTRE` by an sd of peaks that are just `ALIKE`. By Stirling's series its integral is
    ``sqrt(pi/dof) exp(1/(6 dof) - 1/(45 dof^3))``.
    """
    from scipy.special import roots_hermitenorm

    sd = _sd_of_log_scale(dof)
    off = OFF_CENTRE + math.sqrt(1.0 / ALIKE - 1.0)
    whole = 0.5 * math.log(math.pi / dof) + 1.0 / (6.0 * dof) - 1.0 / (45.0 * dof**3)
    for count in COUNTS if dof > SERIES else ():
        x, weight = roots_hermitenorm(count)
        log_share = np.log(weight * sd) + 0.5 * x**2
        away = sd * (x + off * np.array([[-1.0], [1.0]]))
        told = np.logaddexp.reduce(log_share - dof * (away + 0.5 * np.expm1(-2.0 * away)), axis=1)
        if np.abs(told - whole).max() < tolerance:
            return sd * x, log_share
    return None


def _known_scale(c: Candidates, scale: float | None) -> float | None:
    """Noise scale in the units of the candidates, where it is given or the full library fits exactly."""
    size = float(np.linalg.norm(c.whole[:, -1]))
    if scale is not None:
        given = math.log10(size or 1.0) + c.response_unit * math.log10(2.0)
        if size > 0.0 and abs(math.log10(scale) - given) > APART:
            raise InputError(
                f"scale = {scale:g}: expected the sd of the noise in the units of the response, whose norm is"
                f" about 1e{given:.0f}; give both in the same units"
            )
        return math.ldexp(scale, -c.response_unit)
    if not c.whole[:, -1].any():
        raise UnobservableError(
            "the response is zero in every row, which any noise scale however small explains: give the scale,"
            " or a response that differs from zero",
            c.columns,
        )
    start, _, _ = _first_scale(c)
    return start if start <= _smallest(c) else None


def _smallest(c: Candidates) -> float:
    """Smallest noise scale that is told from rounding."""
    return EXACT * float(np.linalg.norm(c.whole[:, -1])) / math.sqrt(_spare(c))


def _spare(c: Candidates) -> float:
    """Degrees of freedom that the full library leaves, or half of all where it leaves few."""
    return max(c.dof - len(c.columns), c.dof / 2.0, 1.0)


def _first_scale(c: Candidates) -> tuple[float, float, float]:
    """Noise scale of the full library to start from, the data's rms, and the sd of the scale's logarithm."""
    least, rows = _smallest(c), math.sqrt(_spare(c))
    few = c.dof <= len(c.columns)  # the columns alone fit exactly: ask what a fit within the prior leaves
    length = max(float(np.linalg.norm(c.whole[0 if few else len(c.always) :, -1])) / rows, least)
    left = abs(float((c.at(length) if few else c.whole)[-1, -1])) / rows
    return max(left, least), length, _sd_of_log_scale(c.dof)


def _sd_of_log_scale(dof: int) -> float:
    """Sd of ln sigma of the model with the most degrees of freedom, which is the narrowest."""
    return 1.0 / math.sqrt(2.0 * (dof + FEW))


def _over_g(
    names: tuple[str, ...],
    c: Candidates,
    prior: GFamily,
    by_size: FloatArray,
    needs: Needs,
    *,
    coefficients: bool,
) -> Models:
    """The g-family: noise scale integrated analytically, one walk for all models."""
    from imubayes.selection.kernels import g_integrals, solutions
    from imubayes.selection.lanes import residuals

    if lost := tuple(name for name, gone in zip(c.columns, vanished(c.whole), strict=True) if gone):
        raise UnobservableError(
            f"a g-prior needs independent columns: {', '.join(lost)} depends on others", lost
        )
    a, p = len(c.always), len(c.names)
    rss, nodes = residuals(c.whole[a:, a:]), g_nodes(prior, c.dof + a)
    exact = (EXACT * float(np.linalg.norm(c.whole[:, -1]))) ** 2
    if rss[0] <= exact:
        raise UnobservableError(
            "the forced columns alone fit the response exactly, which leaves nothing to tell the others by;"
            " force fewer, or add rows",
            c.always,
        )
    np.maximum(rss, exact, out=rss)
    total, least = float(rss[0]), float(rss[-1])
    counted = math.lgamma(c.dof / 2), c.dof / 2 * math.log(math.pi * total)
    null = counted[0] - counted[1] - math.log(2.0) - 0.5 * c.log_det
    null -= float(np.sum(np.log(np.abs(np.diag(c.whole)[:a]))))
    error = integration_error(prior, nodes, least / total, p, float(c.dof))
    error += 2.0 * HALF_UNIT * (abs(counted[0]) + abs(counted[1]))
    if p < CURVES:
        integrals = g_integrals(np.clip(rss / total, 0.0, 1.0), sizes(p), float(c.dof), *nodes)
        count = sizes(p)
        rss[:] = np.where(count > 0, integrals[:, 0], 0.0) + by_size[count]
        rss[~admissible(Space(p), needs)] = -math.inf
        peak = float(rss.max())
        w = WeightedModels(c, Space(p), NO_SCALE, weights_of(rss, p, peak), null + peak, error)
        every = w.space.members(np.arange(len(w.space)))
        return posterior_of(names, w, g_components(c, every, total, integrals, w.weight))
    curves = g_curves(least / total, p, float(c.dof), nodes)
    peak = log_bayes_factors(rss, c, curves, by_size, needs)
    w = WeightedModels(c, Space(p), NO_SCALE, weights_of(rss, p, peak), null + peak, error + curves.off)
    told, few = totals(w), thinned(w, STORED)
    w = few if p > STORED_BITS else w
    if not coefficients:
        return posterior_of(names, w, no_mixture(c), told)
    inside = few.space.members(np.arange(len(few.space)))
    u = solutions(c.whole, with_always(c, inside))[2] / total
    parts = g_components(c, inside, total, integrals_at(curves, u, inside.sum(axis=1)), few.weight)
    return posterior_of(names, w, parts, told)
