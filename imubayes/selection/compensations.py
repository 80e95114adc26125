"""Models of fewer terms: coefficients to compensate with, and the smallest model that predicts as well.

Those to compensate with are of all tested terms, of those needed, or of the basic triad. A smaller model has
the posterior of all tested terms projected on the terms that it keeps, over the inputs of the test, so that
what is left out is taken up where it can be. Each predicts every position (a still, a mount, a piece of a log
whose inputs change) from all others; the one with the smallest error is what is exported. A walk of the noise
is left out of account there: without the position that it begins with, b0 would be a bias of nowhere.

The posterior's mean theta predicts ``S theta`` over the inputs of a scene, and a model of few terms predicts
best with the projection of that onto its own columns (the decoupled sparse summary of Hahn and Carvalho, JASA
2015). What it loses adds to the posterior's own uncertainty in squares, so a model that loses no more than
that uncertainty is at most a factor of sqrt(2) worse than all terms together. It is a summary, no posterior.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from imubayes.algebra import FloatArray, IntArray
from imubayes.algebra import factor as algebra
from imubayes.algebra.factor import Factor, noise_scale, posterior_root
from imubayes.inference.case import Apart, apart
from imubayes.inference.drift import Drift
from imubayes.inference.dwells import always, dwells_of, joined, pieces_of
from imubayes.inference.linear import Linear, averages
from imubayes.inference.prior import ScalePrior
from imubayes.inference.summary import Summary
from imubayes.selection.decision import Selection, posterior_draws
from imubayes.selection.mixture import Candidates
from imubayes.selection.predictive import by_dwell
from imubayes.selection.verdicts import LIKELY, TermVerdict
from imubayes.sensors.equations.basic import TERMS

FEWEST = 3
"""Positions without which none is left out."""

ALIKE = 1e-3
"""Change of a column between dwells, as a share of its largest size, below which they are one position."""


@dataclass(frozen=True, slots=True, eq=False)
class Compensation:
    """Coefficients of one model, ``full``, ``needed`` or ``basic``, with covariance (k, k), SI.

    `held_out` is the rms error of the output on average over a position that is predicted from all others.
    """

    model: str
    terms: tuple[str, ...]
    mean: FloatArray
    covariance: FloatArray
    held_out: float
    positions: int


def compensations(
    summary: Summary,
    prior: ScalePrior,
    rows: Sequence[Linear],
    selection: Selection,
    *,
    parts: Sequence[int] = (),
    drift: Drift | None = None,
) -> tuple[Compensation, ...]:
    """Models of a component that may be exported, the best predicting one first.

    Parameters
    ----------
    parts : indices of its own runs, where others take part in the factor.
    drift : of its bias, which is then the mean over the record.
    """
    tested = [k for k, term in enumerate(selection.terms) if term.verdict != "untested"]
    columns = [*dict.fromkeys(selection.carriers[k] for k in tested)]  # terms that are tied share one
    place = [columns.index(selection.carriers[k]) for k in tested]
    alone = apart(summary, prior.sd, rows, parts or range(len(rows)), columns)
    named = [selection.terms[k] for k in tested]
    dwells = [replace(dwells_of(part).means, stream=None) for part in alone.rows]
    first = [_positions(part) for part in dwells]
    if sum(map(len, first)) < FEWEST:
        return ()
    own = [alone.summary.names.index(column) for column in columns]
    mean, root = _of_record(alone, drift)
    without = _left_out(alone, first)
    means = [averages(part, edges) for part, edges in zip(dwells, first, strict=True)]
    X, y = np.concatenate([part.X for part in means]), np.concatenate([part.y for part in means])
    S = design_factor(alone.rows).R[:-1, own]
    found = []
    for model, terms in _models(named).items():
        kept = sorted({place[k] for k in terms})
        P = np.column_stack([project(S, unit, kept) for unit in np.eye(len(own))])
        used = without.copy()
        used[:, own] = 0.0
        used[:, [own[k] for k in kept]] = without[:, own] @ P.T
        held_out = float(np.sqrt(np.mean((y - np.sum(X * used, axis=1)) ** 2)))
        carried = [k for k, column in enumerate(place) if column in kept]
        at, names = [kept.index(place[k]) for k in carried], tuple(named[k].name for k in carried)
        half = P @ root[own]
        # tied terms take one number: a product may round equal rows differently
        theta, covariance = (P @ mean[own])[at], (half @ half.T)[np.ix_(at, at)]
        found.append(Compensation(model, names, theta, covariance, held_out, len(y)))
    return tuple(sorted(found, key=lambda compensation: compensation.held_out))


def _models(terms: Sequence[TermVerdict]) -> dict[str, list[int]]:
    """Places of the terms that each model keeps.

    Needed are those that the data resolve and ask for, and the first of each group that they can't resolve.
    """
    likely = [term for term in terms if term.inclusion >= LIKELY]
    needed = [t.name for t in terms if t.verdict == "needed"]
    needed += [t.name for t in likely if t.verdict == "undecided"]
    for term in likely:
        if term.verdict == "inseparable" and not {*term.confounded_with} & {*needed}:
            needed.append(term.name)
    every = {"needed": needed, "full": [term.name for term in terms], "basic": TERMS}
    return {name: [k for k, term in enumerate(terms) if term.name in kept] for name, kept in every.items()}


def _of_record(alone: Apart, drift: Drift | None) -> tuple[FloatArray, FloatArray]:
    """Mean (p,) of the columns, with b0 on average over the record, and root (p, q) of their covariance."""
    f, sd = alone.summary.factor, alone.sd
    mean, root = posterior_root(f, sd, noise_scale(f, sd))
    if drift is not None:
        place = f.names.index(drift.b0)
        mean = mean.copy()
        mean[place] = drift.full[1, 0]
        slope = drift.slope[0, [drift.names.index(name) for name in f.names]]
        root = np.column_stack((root, np.zeros(len(mean))))
        root[place] -= slope @ root
        root[place, -1] = np.linalg.norm(drift.root[0])
    return mean, root


def _positions(dwells: Linear) -> IntArray:
    """First of the dwells of each position: a log at rest is one, however many pieces it is cut to."""
    X = dwells.X
    reach = np.abs(X).max(axis=0)
    moved = np.abs(np.diff(X, axis=0)) > ALIKE * reach
    return np.flatnonzero(np.append(True, moved.any(axis=1)))


def _left_out(alone: Apart, first: Sequence[IntArray]) -> FloatArray:
    """Posterior means (q, p) of all columns without each of the positions."""
    f, sd = alone.summary.factor, alone.sd
    both = zip(zip(alone.rows, alone.summary.runs, strict=True), first, strict=True)
    pieces = []
    for (part, run), edges in both:
        blocks = pieces_of(part, replace(run.noise, K=0.0))
        pieces.append(joined(blocks, np.searchsorted(edges, np.arange(len(blocks)), side="right")))
    known = [] if alone.known is None else [always(alone.known)]
    every = Candidates((), f.names, sd, f.R, f.n, f.log_det)
    held = by_dwell([*pieces, *known], every, noise_scale(f, sd))
    return np.array([algebra.solve_triangular(T[:-1, :-1], T[:-1, -1]) for T in held.without])


WALKED = 20
"""Up to so many terms every subset is looked at; beyond, the weakest term leaves one by one."""

DRAWS = 4000
"""Posterior draws behind the predictive uncertainty, which is then known to 1 %."""

TIE = 1e-8
"""Row under each unit column, so that columns that are alike share what they explain; it costs 1e-16."""


@dataclass(frozen=True, slots=True, eq=False)
class Reduced:
    """Smallest model whose predictions stay within a budget, the rms of the output that may be lost, SI.

    Terms are strongest first, their coefficients (k,) projected; `lost` is against the posterior mean of all
    terms. The path has, for 0, 1, ... columns, which terms they carry and what is lost.
    """

    terms: tuple[str, ...]
    coefficients: FloatArray
    budget: float
    lost: float
    path: tuple[tuple[tuple[str, ...], float], ...]


def design_factor(rows: Sequence[Linear]) -> Factor:
    """Factor of the columns of runs as they are, not whitened, with a response of zero.

    ``norm(R theta) / sqrt(n)`` is the rms of what coefficients do to the output over these inputs.
    """

    def parts() -> Iterator[FloatArray]:
        for run in rows:
            # an average stands for all of its samples
            for a, b in algebra.row_blocks(len(run)):
                yield run.columns(a, b) * np.sqrt(run.counts[a:b])[:, None]

    names = rows[0].names
    R = np.pad(algebra.triangular(parts(), len(names)), (0, 1))
    return Factor(names, R, sum(run.samples for run in rows))


def reduced(selection: Selection, design: Factor, *, rng: np.random.Generator) -> Reduced:
    """Find the smallest model whose predictions over some inputs stay close to the posterior mean's.

    It may lose as much as the posterior is uncertain itself: the rms over these inputs of the output error
    that its spread in the coefficients causes, told from draws.

    Parameters
    ----------
    design : of the test's inputs (`design_factor`) or of a scene's, over at least the columns in question.
    """
    models = selection.models
    names = models.candidates.names
    S = algebra.reorder(design, names).R[:-1, :-1] / math.sqrt(design.n)
    mean = models.mean[[models.names.index(name) for name in names]]
    drawn = posterior_draws(selection, DRAWS, rng)[:, [selection.columns.index(name) for name in names]]
    budget = float(np.linalg.norm(S @ (drawn - drawn.mean(axis=0)).T) / math.sqrt(DRAWS))
    subsets = subsets_by_size(S, mean)
    losses = [loss for _, loss in subsets]
    k = next(k for k, loss in enumerate(losses) if loss <= budget)
    kept = subsets[k][0]
    coefficients = project(S, mean, kept)
    order = np.argsort(-np.abs(coefficients) * np.linalg.norm(S[:, kept], axis=0), kind="stable")
    # terms that are tied share a column, and its coefficient
    local: dict[str, list[str]] = {column: [] for column in selection.columns}
    for term, column in zip(selection.terms, selection.carriers, strict=True):
        local[column].append(term.name)
    told = [local[names[kept[j]]] for j in order]
    return Reduced(
        terms=tuple(chain.from_iterable(told)),
        coefficients=np.repeat(coefficients[order], [*map(len, told)]),
        budget=budget,
        lost=losses[k],
        path=tuple(
            (tuple(chain.from_iterable(local[names[j]] for j in inside)), loss) for inside, loss in subsets
        ),
    )


def subsets_by_size(S: FloatArray, theta: FloatArray) -> list[tuple[list[int], float]]:
    """Best subset of each size 0 ... p, and what its projection of ``S theta`` loses, S (p, p) triangular.

    Of columns that stand for each other as well, the first are kept.

    Examples
    --------
    >>> subsets_by_size(np.diag([3.0, 1.0]), np.ones(2))
    [([], 3.1622776601683795), ([0], 1.0), ([0, 1], 0.0)]
    """
    p = len(theta)
    if p > WALKED:
        return [*_eliminated(S, theta), (list(range(p)), 0.0)]
    from imubayes.selection.lanes import residuals

    rss = residuals(np.pad(np.column_stack((S, S @ theta)), ((0, 1), (0, 0))))
    size, found = np.bitwise_count(np.arange(1 << p)), list[tuple[list[int], float]]()
    losses = np.sqrt(rss)
    for k in range(p):
        where = np.flatnonzero(size == k)
        best = int(where[_least(losses[where], losses[0])[0]])
        found.append(([j for j in range(p) if best >> j & 1], float(losses[best])))
    return [*found, (list(range(p)), 0.0)]


def project(S: FloatArray, theta: FloatArray, kept: Sequence[int]) -> FloatArray:
    """Coefficients (k,) of the columns `kept` that come closest to ``S theta``."""
    if len(kept) in (0, len(theta)):
        return theta[list(kept)]
    T, size = _unit_columns(S, theta, kept)
    return algebra.solve_triangular(T[:-1, :-1], T[:-1, -1]) / size


def _eliminated(S: FloatArray, theta: FloatArray) -> list[tuple[list[int], float]]:
    """Subset of each size but the last: each time the column goes that is missed least."""
    kept, whole = list(range(len(theta))), float(np.linalg.norm(S @ theta))
    found: list[tuple[list[int], float]] = []
    while kept:
        T, _ = _unit_columns(S, theta, kept)
        inverse = algebra.invert_triangular(T[:-1, :-1])
        missed = np.abs(inverse @ T[:-1, -1]) / np.linalg.norm(inverse, axis=1)
        kept = kept[: (weakest := int(_least(missed, whole)[-1]))] + kept[weakest + 1 :]
        full = np.zeros(len(theta))
        full[kept] = project(S, theta, kept)
        found.append((kept, float(np.linalg.norm(S @ (theta - full)))))
    return found[::-1]


def _least(losses: FloatArray, whole: float) -> IntArray:
    """Where the least loss is, rounding aside: of `whole`, what is lost without any column."""
    return np.flatnonzero(losses <= losses.min() * (1 + 1e-9) + 1e-12 * whole)


def _unit_columns(S: FloatArray, theta: FloatArray, kept: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    """Factor of the columns `kept`, each scaled to length 1, beside ``S theta``; and what they were long."""
    size = np.linalg.norm(S[:, kept], axis=0)
    size = np.where(size > 0.0, size, 1.0)
    rows = np.column_stack((S[:, kept] / size, S @ theta))
    R = algebra.triangular((rows,), len(kept) + 1)
    return algebra.with_prior_rows(R, np.full(len(kept), TIE)), size
