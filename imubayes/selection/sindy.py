"""Sparse regression: what pysindy's optimizers choose on the triangular factor."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from imubayes.algebra import factor as algebra
from imubayes.algebra.arrays import BoolArray, FloatArray
from imubayes.algebra.factor import Factor
from imubayes.inference.dwells import Pieces
from imubayes.selection.effects import Effects, best_of, effects_of, log_evidence, refitted
from imubayes.selection.sparse_paths import BY_THRESHOLD, PATHS
from imubayes.selection.stability import (
    CUT,
    Counts,
    dwelled,
    false_bound,
    halves,
    resampled,
    with_replacement,
)


@dataclass(frozen=True, slots=True, eq=False)
class Sparse:
    """What one optimizer chooses.

    Attributes
    ----------
    optimizer : ``stlsq``, ``sr3``, ``ssr`` or ``frols``.
    names : candidate columns, p of them.
    model : the support chosen along the path.
    inclusion : share of the resampled campaigns whose chosen support has the term: a frequency, not a
        probability.
    strength : (m,) what the path goes over: the threshold in detectable effects (STLSQ, SR3), or the number
        of terms (SSR, FROLS).
    path : (m, p) coefficients in detectable effects; zero where a term is out.
    score : (m,) log evidence of each support, relative to the best.
    chosen : index of `model` on the path.
    stable : terms whose selection frequency over halves of the dwells is at least `cut`.
    cut : threshold of stability selection.
    false_bound : bound on the expected number of false terms among `stable`.
    """

    optimizer: str
    names: tuple[str, ...]
    model: tuple[str, ...]
    inclusion: Mapping[str, float]
    strength: FloatArray
    path: FloatArray
    score: FloatArray
    chosen: int
    stable: tuple[str, ...]
    cut: float
    false_bound: float


THRESHOLDS = np.geomspace(0.3, 300.0, 25)
"""Thresholds in detectable effects: from within the noise to beyond any term that is not obvious."""

REACH = 3
"""Steps of the path on either side of the choice that a resampled campaign goes over first."""

PAIRED = 4
"""Campaigns drawn for each pair of halves: both halves count."""


def sparse_regressions(
    factor: Factor,
    pieces: Sequence[Pieces],
    sd: FloatArray,
    candidates: tuple[str, ...],
    *,
    rng: np.random.Generator,
    resamples: int = 100,
    optimizers: Sequence[str] = tuple(PATHS),
) -> tuple[Sparse, ...]:
    """STLSQ, SR3, SSR and FROLS of pysindy, each with its path, its ensemble and its stable terms.

    The optimizers run on the triangular factor in detectable effects (see `imubayes.selection.effects`), with
    the columns that are not candidates integrated out. On each path the support with the largest marginal
    likelihood under the physical prior is chosen. The same is done on resampled campaigns, and on halves of
    the dwells (half as many: the two of a pair share no dwell).

    Parameters
    ----------
    factor : of the whitened rows, with columns that the test excites.
    pieces : dwells of the runs; they may have further columns, in any order.
    sd : (p,) prior sds of the factor's columns, SI.
    candidates : columns to choose from; none gives no regressions.
    rng : of the resampled campaigns.
    resamples : campaigns that are drawn. Without any, or with fewer than two dwells, the frequencies are NaN.
    optimizers : which of them.
    """
    scale = algebra.noise_scale(factor, sd)
    whole = effects_of(factor, sd, candidates, scale)
    if not whole.names:
        return ()
    walked = [_walk(name, whole, _strengths(name, len(whole.names))) for name in optimizers]
    drawn = halved = np.full((len(walked), len(candidates)), np.nan)
    if resamples > 0 and sum(len(p) for p in pieces) > 1:
        dwells = dwelled(pieces, factor.names)

        def frequency(draws: Iterable[Counts]) -> FloatArray:
            campaigns = (effects_of(resampled(dwells, c), sd, candidates, scale) for c in draws)
            return _selected(walked, campaigns, candidates)

        drawn = frequency(with_replacement(dwells.sizes, resamples, rng))
        halved = frequency(halves(dwells.sizes, max(1, resamples // PAIRED), rng))
    return tuple(
        _told(w, whole, candidates, often, half) for w, often, half in zip(walked, drawn, halved, strict=True)
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Walk:
    """A path with its choice (see `Sparse`): supports are (m, p)."""

    optimizer: str
    strength: FloatArray
    supports: BoolArray
    score: FloatArray
    chosen: int


def _strengths(optimizer: str, p: int) -> FloatArray:
    return THRESHOLDS if optimizer in BY_THRESHOLD else np.arange(p + 1.0)


def _walk(optimizer: str, e: Effects, strength: FloatArray) -> _Walk:
    supports = PATHS[optimizer](e.R[:-1, :-1], e.R[:-1, -1], strength)
    score = log_evidence(e, supports)
    return _Walk(optimizer, strength, supports, score - score.max(), best_of(supports, score))


def _walk_near(w: _Walk, e: Effects) -> _Walk:
    """Walk the path near another campaign's choice; all of it where the choice would be at an end."""
    p = len(e.names)
    if p == w.supports.shape[1]:
        first, last = max(0, w.chosen - REACH), min(len(w.strength) - 1, w.chosen + REACH)
        near = _walk(w.optimizer, e, w.strength[first : last + 1])
        if not (near.chosen == 0 < first or first + near.chosen == last < len(w.strength) - 1):
            return near
    return _walk(w.optimizer, e, _strengths(w.optimizer, p))


def _selected(walked: Sequence[_Walk], campaigns: Iterable[Effects], candidates: Sequence[str]) -> FloatArray:
    """Share (optimizers, candidates) of the campaigns whose chosen support has the term."""
    column = {name: j for j, name in enumerate(candidates)}
    counts, total = np.zeros((len(walked), len(candidates))), 0
    for e in campaigns:
        total += 1
        where = [column[name] for name in e.names]
        for i, w in enumerate(walked if where else ()):
            near = _walk_near(w, e)
            counts[i, where] += near.supports[near.chosen]
    return counts / total


def _told(w: _Walk, e: Effects, candidates: tuple[str, ...], drawn: FloatArray, halved: FloatArray) -> Sparse:
    where = [candidates.index(name) for name in e.names]
    path = np.zeros((len(w.strength), len(candidates)))
    path[:, where] = refitted(e, w.supports)
    return Sparse(
        optimizer=w.optimizer,
        names=candidates,
        model=tuple(name for name, inside in zip(e.names, w.supports[w.chosen], strict=True) if inside),
        inclusion=dict(zip(candidates, drawn.tolist(), strict=True)),
        strength=w.strength,
        path=path,
        score=w.score,
        chosen=w.chosen,
        stable=tuple(name for name, share in zip(candidates, halved, strict=True) if share >= CUT),
        cut=CUT,
        false_bound=false_bound(float(halved.sum()), len(candidates)),
    )
