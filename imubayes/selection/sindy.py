"""Sparse regression: what pysindy's optimizers choose on the triangular factor, in detectable effects.

The *detectable effect* of a term is the posterior sd of its coefficient under the full library, with the
physical prior of every coefficient: the unit in which one threshold suits every term. It is what the noise
leaves unknown of the term when nothing else is assumed to be zero: a coefficient of 3 effects is 3 sd from
zero, whatever its unit, the drive of the test or its likeness to other columns. The sd of a term on its own,
``1/|x_j|``, would not do: it calls a term detectable that a likeness to others hides. The prior keeps the
effect of a term in an exact null direction finite (without it least squares has none) and changes nothing
where the data speak.

With the rows of the prior stacked under the data's, the inverse of the scaled triangular factor has rows of
length one, so that nothing in it is badly scaled. They take the place of the ridge of pysindy's optimizers:
one strength for all coefficients would shrink the strong ones so far that their neighbours fill the gap.

The supports on the path of each optimizer (see `optimizers`) are taken, and the evidence chooses on it.

Campaigns are resampled by dwells, drawn with replacement or split into halves, by run. Dwells are whitened,
so that they are independent given the coefficients; single rows of coloured noise are not, and drawing them
singly would take their common drift for something that many rows confirm. Each run keeps its number of
dwells: a campaign without its centrifuge would be another campaign.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import BoolArray, FloatArray
from imubayes.algebra import factor as algebra
from imubayes.algebra.factor import Factor
from imubayes.inference.dwells import Pieces, few_rows

EVEN = 1e-9
"""Log evidences that differ by less are equal: a term that was not excited changes them by rounding."""


@dataclass(frozen=True, slots=True, eq=False)
class Effects:
    """Least squares on the candidates, all other columns integrated out.

    Attributes
    ----------
    names : p candidates that the rows excite.
    R : (p + 1, p + 1) triangular factor, rows of the prior included: a unit is one effect of a column, and
        one sd of the noise of a row.
    prior : (p,) rows of the prior, effect over prior sd.
    unit : (p,) detectable effects, SI.
    """

    names: tuple[str, ...]
    R: FloatArray
    prior: FloatArray
    unit: FloatArray


def effects_of(f: Factor, sd: FloatArray, candidates: Sequence[str], scale: float) -> Effects:
    """Bring the candidates to detectable effects.

    Parameters
    ----------
    f : of the whitened rows; columns that are not candidates are in every model.
    sd : (p,) prior sds of all its columns, SI.
    candidates : among its columns; one that is zero in every row is left out.
    scale : of the noise.

    Examples
    --------
    >>> f = algebra.factor_of(np.diag([100.0, 1.0]), np.array([300.0, 0.0]), ("strong", "weak"))
    >>> e = effects_of(f, np.array([10.0, 10.0]), f.names, 1.0)
    >>> e.unit.round(4).tolist()
    [0.01, 0.995]
    >>> refitted(e, np.array([[True, False]])).round(2).tolist()
    [[300.0, 0.0]]
    """
    excited = dict(zip(f.names, f.column_norms > 0.0, strict=True))
    prior_sd = dict(zip(f.names, sd.tolist(), strict=True))
    names = tuple(name for name in candidates if excited[name])
    always = tuple(name for name in f.names if name not in candidates)
    order = (*always, *names)
    rows = np.array([scale / prior_sd[name] for name in order])
    R = algebra.with_prior_rows(algebra.reorder(f, order).R, rows)[len(always) :, len(always) :] / scale
    unit = np.linalg.norm(algebra.invert_triangular(R[:-1, :-1]), axis=1)
    R = np.ascontiguousarray(R * np.append(unit, 1.0))
    return Effects(names, R, unit * rows[len(always) :] / scale, unit)


def log_evidence(e: Effects, supports: BoolArray) -> FloatArray:
    """Log marginal likelihood (m,) of each support (m, p), up to a constant; the noise scale is known."""
    from imubayes.selection.kernels import solutions

    *_, left, log_det = solutions(e.R, supports)
    return np.sum(supports * np.log(e.prior), axis=1) - 0.5 * left - log_det


def refitted(e: Effects, supports: BoolArray) -> FloatArray:
    """Coefficients (m, p) of each support, in effects: least squares on data and prior, zero outside."""
    from imubayes.selection.kernels import solutions

    return solutions(e.R, supports)[0]


def on_path(optimizer: str, e: Effects, strength: FloatArray) -> BoolArray:
    """Supports (m, p) that an optimizer visits at the places (m,) of its path (see `Sparse.strength`)."""
    from imubayes.selection.optimizers import PATHS

    return np.ascontiguousarray(PATHS[optimizer](e.R[:-1, :-1], e.R[:-1, -1], strength))


def best_of(supports: BoolArray, score: FloatArray) -> int:
    """Index of the best score; of equal ones, of the smallest support, in the middle of where it stands."""
    even = np.flatnonzero(score >= score.max() - EVEN)
    count = supports[even].sum(axis=1)
    smallest = even[count == count.min()]
    return int(smallest[len(smallest) // 2])


OPTIMIZERS = ("stlsq", "sr3", "ssr", "frols")
"""Optimizers of pysindy, by the name that a report gives them."""

BY_THRESHOLD = frozenset({"stlsq", "sr3"})
"""Optimizers that go over thresholds; the others go over numbers of terms."""


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
    optimizers: Sequence[str] = OPTIMIZERS,
) -> tuple[Sparse, ...]:
    """STLSQ, SR3 and SSR of pysindy, and FROLS, each with its path, its ensemble and its stable terms.

    The optimizers run on the triangular factor in detectable effects, with
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


class _Walk(NamedTuple):
    """A path with its choice (see `Sparse`): supports are (m, p)."""

    optimizer: str
    strength: FloatArray
    supports: BoolArray
    score: FloatArray
    chosen: int


def _strengths(optimizer: str, p: int) -> FloatArray:
    return THRESHOLDS if optimizer in BY_THRESHOLD else np.arange(p + 1.0)


def _walk(optimizer: str, e: Effects, strength: FloatArray) -> _Walk:
    supports = on_path(optimizer, e, strength)
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


Counts = NDArray[np.int64]

CUT = 0.9
"""Selection frequency over halves from which a term is stable: the upper end of what Meinshausen and Buhlmann
(2010) recommend (0.6 to 0.9), since strong terms reach 1."""


class Dwelled(NamedTuple):
    """Whitened rows of all dwells, as few as hold all that the dwells say.

    Attributes
    ----------
    names : the p columns.
    rows : (m, p + 1).
    dwell : (m,) the dwell that a row belongs to.
    sizes : dwells of each run.
    known : (k, p + 1) rows that every campaign has.
    """

    names: tuple[str, ...]
    rows: FloatArray
    dwell: NDArray[np.int64]
    sizes: tuple[int, ...]
    known: FloatArray


def dwelled(pieces: Sequence[Pieces], names: tuple[str, ...]) -> Dwelled:
    """Bring the dwells of all runs to the named columns."""
    # factors (q, w, p + 1) over the named columns, of what is in every campaign and of what is drawn
    none = np.zeros((0, len(names) + 1, len(names) + 1))
    known, R = [none], list[FloatArray]()
    for p in pieces:
        (known if p.kept else R).append(p.R[:, :, [*(p.names.index(name) for name in names), -1]])
    rows, kept = few_rows(np.concatenate(R) if R else none)
    sizes = tuple(len(p) for p in pieces if not p.kept)
    always = np.concatenate([part.reshape(-1, len(names) + 1) for part in known])
    return Dwelled(names, rows[kept], np.nonzero(kept)[0], sizes, always)


def resampled(d: Dwelled, counts: Counts) -> Factor:
    """Factor of the dwells, each taken as often as `counts` says."""
    times = counts[d.dwell]
    taken = times > 0
    rows = np.concatenate((d.known, np.sqrt(times[taken])[:, None] * d.rows[taken]))
    width = len(d.names) + 1
    return Factor(d.names, algebra.triangular([rows] if len(rows) else [], width), len(rows))


def with_replacement(sizes: Sequence[int], draws: int, rng: np.random.Generator) -> Iterator[Counts]:
    """Counts of the dwells in campaigns that draw as many dwells of each run as it has.

    Examples
    --------
    >>> [int(c.sum()) for c in with_replacement((4, 3), 2, np.random.default_rng(1))]
    [7, 7]
    """
    for _ in range(draws):
        yield np.concatenate([rng.multinomial(q, np.full(q, 1.0 / q)) for q in sizes])


def halves(sizes: Sequence[int], pairs: int, rng: np.random.Generator) -> Iterator[Counts]:
    """Counts of the dwells in complementary halves, one after the other.

    Examples
    --------
    >>> a, b = halves((4, 3), 1, np.random.default_rng(1))
    >>> (a + b).tolist()
    [1, 1, 1, 1, 1, 1, 1]
    """
    for _ in range(pairs):
        first = np.concatenate([rng.permutation((np.arange(q) + rng.integers(2)) % 2) for q in sizes])
        yield first
        yield 1 - first


def false_bound(selected: float, p: int) -> float:
    """Bound on the expected number of false terms among the stable ones, ``q^2 / ((2 cut - 1) p)``.

    Of p candidates a half selects q on average. Meinshausen and Buhlmann (2010), theorem 1. With
    complementary halves it holds without assumption for terms that a half selects no more often than q/p, a
    random pick (Shah and Samworth 2013, theorem 1).

    Examples
    --------
    >>> round(false_bound(2.0, 20), 3)
    0.25
    """
    return selected**2 / ((2.0 * CUT - 1.0) * p)
