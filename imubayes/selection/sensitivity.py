"""How far a verdict hangs on the prior, on a part of the test, and on the method.

Of the prior say inclusion over prior widths, and a g-prior as a second opinion. The verdict itself is that of
three families. The evidence of the models says what is needed if the model of the test is right. A part of
the test (a run, a mount) without which a coefficient moves by more than chance allows says that it is not; so
do sparse regressions on resampled campaigns that hardly ever keep a term which is far from zero, or always
one which is not needed. Who objects leaves the term open, and the verdict says who, and why.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import FloatArray
from imubayes.algebra import factor as algebra
from imubayes.algebra.factor import Factor, noise_scale, reorder, with_prior_rows
from imubayes.inference.dwells import Pieces, joined
from imubayes.inference.prior import HyperG, ScalePrior
from imubayes.inference.summary import Summary
from imubayes.rig.inputs import Run
from imubayes.selection.decision import SCALE_LIMIT, Selection
from imubayes.selection.enumerate import enumerate_models
from imubayes.selection.mixture import Candidates
from imubayes.selection.predictive import by_dwell
from imubayes.selection.verdicts import EQUAL, Costs, TermVerdict, Voices

if TYPE_CHECKING:
    from imubayes.selection.sindy import Sparse

WIDTHS = 3.0 ** (np.arange(-4, 5) / 2.0)
"""Factors on every prior sd, from a ninth to nine; every other one is 1/9, 1/3, 1, 3, 9."""

MANY, MORE = 18, 20
"""Candidates beyond which every other width is taken, and beyond which only 1/3, 1 and 3 are."""

OPINION = HyperG(3.0)
"""The g-prior that is asked: the one of Liang et al. (JASA 2008) whose shrinkage is uniform, g/(1 + g)."""

LARGEST_G = 20
"""Most candidates for the g-prior: it takes 5 s for 2^20 models."""

DEPENDENT = 1e-9
"""A column of which less is left beside those before it, relative to its norm, depends on them."""


@dataclass(frozen=True, slots=True, eq=False)
class Sensitivity:
    """Inclusion of the candidates under other priors.

    Attributes
    ----------
    names : candidates, p of them.
    widths : (w,) factors on every prior sd: nine up to 18 candidates, five up to 20, three beyond.
    inclusion : (w, p) at each width.
    g_prior : (p,) inclusion under the hyper-g prior; NaN where a column depends on others, which a g-prior
        cannot have, and for all of more than 20 candidates.
    left_out : candidates that the g-prior could not have, because they depend on others.
    swing : names of the candidates whose verdict or place in the model changes between the widths 1/3 to 3.
    """

    names: tuple[str, ...]
    widths: FloatArray
    inclusion: FloatArray
    g_prior: FloatArray
    left_out: tuple[str, ...]
    swing: tuple[str, ...]


def sensitivity(
    factor: Factor,
    sd: FloatArray,
    candidates: Sequence[str],
    *,
    known: Sequence[str] = (),
    needs: Sequence[tuple[str, str]] = (),
    costs: Costs = EQUAL,
    widths: Sequence[float] = (),
) -> Sensitivity:
    """Weigh every submodel under wider and narrower priors, and under a g-prior, as the decision does.

    Parameters
    ----------
    factor : of the columns that the test excites.
    sd : (p,) prior sd of each of them; inf for a flat prior on a column that is no candidate.
    candidates : columns in question; the others are in every model, under their priors.
    known : columns whose prior comes from elsewhere, such as errors of the bench: their width stays.
    needs : (child, parent): models that hold a child hold its parent.
    costs : give the thresholds between which a verdict changes.
    widths : factors on every prior sd; by default as many as do not take long.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> X = rng.normal(size=(50, 3))
    >>> s = Summary.from_arrays(X, 2.0 * X[:, 0] + rng.normal(size=50), ("a", "b", "c"))
    >>> told = sensitivity(s.factor, np.ones(3), ("a", "b"))
    >>> told.inclusion.shape, bool(told.g_prior[0] > 0.99), told.swing
    ((9, 2), True, ('b',))
    """
    flat = [name for name, width in zip(factor.names, sd, strict=True) if np.isinf(width)]
    always = [name for name in factor.names if name not in candidates and name not in flat]
    few = len(candidates) <= MORE  # of more, integrating the noise scale would take too long
    affordable = WIDTHS if len(candidates) <= MANY else WIDTHS[::2] if few else WIDTHS[2:-2:2]
    factors, scale = np.array(widths) if len(widths) else affordable, None if few else noise_scale(factor, sd)
    fixed = np.isin(factor.names, known)
    weighed = [
        enumerate_models(
            Summary(factor),
            ScalePrior((np.where(fixed, 1.0, width) * sd)[np.isfinite(sd)]),
            forced=flat,
            always=always,
            scale_limit=SCALE_LIMIT,
            scale=scale,
            needs=needs,
            coefficients=False,
        )
        for width in factors.tolist()
    ]
    where = [factor.names.index(name) for name in candidates]
    inclusion = np.array([models.inclusion[where] for models in weighed])
    g_prior, left_out = _under_g(factor, sd, candidates, needs)
    return Sensitivity(
        names=tuple(candidates),
        widths=factors,
        inclusion=inclusion,
        g_prior=g_prior,
        left_out=left_out,
        swing=_swinging(candidates, inclusion[usual(factors)], costs),
    )


def of_decision(selection: Selection) -> Sensitivity:
    """What the decision has found at its own widths, 1/3, 1 and 3: all there is where candidates are many."""
    names = selection.models.candidates.names
    inclusion = np.array([told for _, told in selection.by_width])
    return Sensitivity(
        names=names,
        widths=np.array([width for width, _ in selection.by_width]),
        inclusion=inclusion,
        g_prior=np.full(len(names), np.nan),
        left_out=(),
        swing=_swinging(names, inclusion, selection.costs),
    )


def usual(widths: FloatArray) -> NDArray[np.bool_]:
    """Which widths (w,) a prior may well be off by: those from 1/3 to 3."""
    return np.abs(np.log(widths)) < math.log(3.0) + 1e-9


def _swinging(names: Sequence[str], inclusion: FloatArray, costs: Costs) -> tuple[str, ...]:
    """Names of the candidates whose inclusion (w, p) crosses a threshold of the verdict or of keeping."""
    thresholds = np.array([costs.not_needed, costs.keep, costs.needed])
    level = np.searchsorted(thresholds, inclusion, side="right")
    return tuple(name for name, levels in zip(names, level.T, strict=True) if np.ptp(levels))


def _under_g(
    factor: Factor, sd: FloatArray, candidates: Sequence[str], needs: Sequence[tuple[str, str]]
) -> tuple[FloatArray, tuple[str, ...]]:
    """Inclusion (p,) of the candidates under the g-prior, and the names of those that it cannot have.

    The other columns are flat, beside rows that stand for their priors at the estimated noise.
    """
    proper = ~np.isin(factor.names, candidates) & np.isfinite(sd)
    rows = np.where(proper, noise_scale(factor, sd) / sd, 0.0)
    held = Factor(factor.names, with_prior_rows(factor.R, rows), factor.n + int(proper.sum()), factor.log_det)
    names = (*(name for name in factor.names if name not in candidates), *candidates)
    R = reorder(held, names).R
    free = np.abs(np.diag(R)[:-1]) > DEPENDENT * np.linalg.norm(R[:, :-1], axis=0)
    kept = tuple(name for name, told in zip(names, free, strict=True) if told)
    left_out = tuple(name for name in candidates if name not in kept)
    told: dict[str, float] = {}
    if any(name in candidates for name in kept) and factor.n > len(kept) + 1 and len(candidates) <= LARGEST_G:
        forced = [name for name in kept if name not in candidates]
        weighed = Summary(reorder(held, kept))
        models = enumerate_models(weighed, OPINION, forced=forced, needs=needs, coefficients=False)
        told = dict(zip(kept, models.inclusion.tolist(), strict=True))
    return np.array([told.get(name, np.nan) for name in candidates]), left_out


Mounts = Mapping[str, tuple[FloatArray, NDArray[np.int64]]]
"""Of runs with several mounts: time (n,), s, and number of the mount of each row."""


def mounts_of(runs: Iterable[Run]) -> Mounts:
    """When runs are in which of their mounts."""
    return {run.name: (run.inputs.t, run.inputs.mount) for run in runs if run.inputs.mount is not None}


MOVED = 4.0
"""Change of a coefficient without a part of the test, in sds of what chance allows, that chance is not."""

FAR = 8.0
"""Sds from zero from which a sparse regression that is worth asking keeps a term."""

CLEAR = 5.0
"""Sds from zero from which a term is needed where the library was found wanting."""

SURE = ("needed", "not needed")
"""Verdicts that may be objected to."""

NEAR = 2.0
"""Sds from zero below which it does not."""

SELDOM, ALWAYS = 0.05, 0.95
"""Share of resampled campaigns below which regressions object to a term, and above which to its absence."""


def parts_of(pieces: Sequence[Pieces], mounts: Mounts) -> tuple[list[Pieces], tuple[str, ...]]:
    """Dwells put together to what is left out: mounts of a run, where it has several, else the run."""
    parts, names = list[Pieces](), list[str]()
    for blocks in pieces:
        if blocks.kept:
            parts.append(blocks)
            continue
        t, number = mounts.get(blocks.run, (np.zeros(1), np.zeros(1, dtype=np.int64)))
        middle = 0.5 * (blocks.start + blocks.stop)
        of = number[np.clip(np.searchsorted(t, middle), 0, len(number) - 1)]
        parts.append(joined(blocks, of))
        mounted = [f"mount {m} of run {blocks.run}" for m in np.unique(of).tolist()]
        names += mounted if len(mounted) > 1 else [f"run {blocks.run}"]
    return parts, tuple(names)


class LeftOut(NamedTuple):
    """How far coefficients move without each part of a test, (q, p), in sds of what chance allows."""

    parts: tuple[str, ...]
    columns: tuple[str, ...]
    change: FloatArray


def without_parts(f: Factor, sd: FloatArray, pieces: Sequence[Pieces], mounts: Mounts) -> LeftOut | None:
    """Leave out each mount of a run, or each run, in turn; None where there is nothing beside it.

    Without a part the posterior's variance is larger, and the mean moves by as much: under the model the
    square of the change is the difference of the variances.

    The factor f is of all rows over p columns, whose prior sds are `sd`; the pieces are dwells of the runs
    that are left out, and what always stays.
    """
    joint, parts = parts_of(pieces, mounts)
    if len(parts) < 2:
        return None
    scale = algebra.noise_scale(f, sd)
    held = by_dwell(joint, Candidates((), f.names, sd, f.R, f.n, f.log_det), scale)
    mean, variance = _told(held.whole, scale)
    others = [_told(T, scale) for T in held.without]
    change = np.array([other - mean for other, _ in others])
    chance = np.array([more - variance for _, more in others])
    told = chance > LEAST * variance
    moves = np.divide(change, np.sqrt(np.abs(chance)), out=np.zeros_like(change), where=told)
    return LeftOut(parts, f.names, moves)


LEAST = 1e-6
"""Share of a variance by which it must rise without a part for the part to say anything."""


def _told(T: FloatArray, scale: float) -> tuple[FloatArray, FloatArray]:
    inverse = algebra.invert_triangular(T[:-1, :-1])
    return inverse @ T[:-1, -1], np.sum((scale * inverse) ** 2, axis=1)


def combined(
    selection: Selection, left_out: LeftOut | None, sparse: Sequence[Sparse], *, doubtful: bool = False
) -> Selection:
    """Decision in which every family has its say, beside the evidence; the same where a test has no parts.

    Of a library that by itself was found wanting (`doubtful`) a term must be farther from zero.
    """
    if left_out is None:
        return selection
    place = {name: k for k, name in enumerate(left_out.columns)}
    # share of the resampled campaigns in which regressions keep a column, on average over these
    names = sparse[0].names if sparse else ()
    frequency = {
        name: float(np.mean([regression.inclusion[name] for regression in sparse])) for name in names
    }
    terms = tuple(
        _heard(term, left_out, place[carrier], frequency.get(carrier, math.nan), doubtful=doubtful)
        if carrier in place and term.verdict != "untested"
        else term
        for term, carrier in zip(selection.terms, selection.carriers, strict=True)
    )
    return replace(selection, terms=terms)


def _heard(term: TermVerdict, out: LeftOut, place: int, frequency: float, *, doubtful: bool) -> TermVerdict:
    change, verdict = out.change[:, place], term.verdict
    worst = int(np.argmax(np.abs(change)))
    voices = Voices(verdict, out.parts[worst], float(change[worst]), frequency)
    pull = abs(term.full_mean) / term.full_sd if term.full_sd > 0.0 else math.inf
    moved = f"without {voices.part} it moves by {abs(voices.change):.1f} sd of what chance allows"
    kept = f"sparse regressions keep it in {100 * frequency:.0f} % of resampled campaigns"
    weak = f"at {pull:.1f} sd from zero it may be what the library lacks"
    objections = {
        moved: abs(voices.change) > MOVED,
        kept: frequency < SELDOM and pull > FAR
        if verdict == "needed"
        else frequency > ALWAYS and pull < NEAR,
        weak: verdict == "needed" and doubtful and pull < CLEAR,
    }
    said = [text for text, holds in objections.items() if holds]
    if verdict not in SURE or not said:
        return replace(term, voices=voices)
    reason = f"{verdict} by the evidence ({term.reason}), but {'; '.join(said)}"
    return replace(term, verdict="undecided", reason=reason, voices=voices)
