"""The smallest model that predicts as well as the whole posterior: a summary of it, not a posterior.

The posterior's mean theta predicts ``S theta`` over the inputs of a scene, and a model of few terms predicts
best with the projection of that onto its own columns (the decoupled sparse summary of Hahn and Carvalho, JASA
2015). What it loses adds to the posterior's own uncertainty in squares, so a model that loses no more than
that uncertainty is at most a factor of sqrt(2) worse than all terms together.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from imubayes.algebra import factor as algebra
from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import Factor
from imubayes.inference.linear import CHUNK, Linear
from imubayes.selection.decision import Selection, posterior_draws

WALKED = 20
"""Up to so many terms every subset is looked at; beyond, the weakest term leaves one by one."""

DRAWS = 4000
"""Posterior draws behind the predictive uncertainty, which is then known to 1 %."""

TIE = 1e-8
"""Row under each unit column, so that columns that are alike share what they explain; it costs 1e-16."""


@dataclass(frozen=True, slots=True, eq=False)
class Reduced:
    """Smallest model whose predictions stay within a budget.

    Attributes
    ----------
    terms : what it keeps, strongest first.
    coefficients : (k,) of these, projected, SI.
    budget : rms that may be lost, SI of the output.
    lost : rms that is lost beside the posterior mean of all terms, SI.
    path : for 0, 1, ... terms: (terms, rms that is lost in SI).
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
            for a in range(0, len(run), CHUNK):
                # an average stands for all of its samples
                part = run.columns(a, min(a + CHUNK, len(run))) * np.sqrt(run.counts[a : a + CHUNK])[:, None]
                yield from (part[i:j] for i, j in algebra.row_blocks(len(part)))

    names = rows[0].names
    R = np.pad(algebra.triangular(parts(), len(names)), (0, 1))
    return Factor(names, R, sum(run.samples for run in rows))


def reduced(
    selection: Selection, design: Factor, *, rng: np.random.Generator, budget: float | None = None
) -> Reduced:
    """Find the smallest model whose predictions over some inputs stay close to the posterior mean's.

    Parameters
    ----------
    selection : the decision on a component.
    design : of the test's inputs (`design_factor`) or of a scene's, over at least the columns in question.
    rng : for the draws behind the default budget.
    budget : rms of the output that may be lost, SI; by default the posterior's own predictive uncertainty:
        the rms over these inputs of the output error that its spread in the coefficients causes.
    """
    models = selection.models
    names = models.candidates.names
    S = algebra.reorder(design, names).R[:-1, :-1] / math.sqrt(design.n)
    mean = models.mean[[models.names.index(name) for name in names]]
    if budget is None:
        budget = _uncertainty(selection, S, rng)
    subsets = subsets_by_size(S, mean)
    losses = [loss for _, loss in subsets]
    k = next(k for k, loss in enumerate(losses) if loss <= budget)
    kept = subsets[k][0]
    coefficients = project(S, mean, kept)
    order = np.argsort(-np.abs(coefficients) * np.linalg.norm(S[:, kept], axis=0), kind="stable")
    local = dict(zip(selection.columns, (t.name for t in selection.terms), strict=True))
    return Reduced(
        terms=tuple(local[names[kept[j]]] for j in order),
        coefficients=coefficients[order],
        budget=budget,
        lost=losses[k],
        path=tuple((tuple(local[names[j]] for j in inside), loss) for inside, loss in subsets),
    )


def subsets_by_size(S: FloatArray, theta: FloatArray) -> list[tuple[list[int], float]]:
    """Best subset of each size 0 ... p, and what its projection of ``S theta`` loses.

    Parameters
    ----------
    S : (p, p) upper triangular.
    theta : (p,) coefficients.

    Examples
    --------
    >>> subsets_by_size(np.diag([3.0, 1.0]), np.ones(2))
    [([], 3.1622776601683795), ([0], 1.0), ([0, 1], 0.0)]
    """
    p = len(theta)
    found = _all_subsets(S, theta) if p <= WALKED else _eliminated(S, theta)
    return [*found, (list(range(p)), 0.0)]


def project(S: FloatArray, theta: FloatArray, kept: Sequence[int]) -> FloatArray:
    """Coefficients (k,) of the columns `kept` that come closest to ``S theta``."""
    if len(kept) in (0, len(theta)):
        return theta[list(kept)]
    T, size = _unit_columns(S, theta, kept)
    return algebra.solve_triangular(T[:-1, :-1], T[:-1, -1]) / size


def _uncertainty(selection: Selection, S: FloatArray, rng: np.random.Generator) -> float:
    """Rms of the error of the output that the posterior's spread in the coefficients causes."""
    drawn = posterior_draws(selection, DRAWS, rng)
    drawn = drawn[:, [selection.columns.index(name) for name in selection.models.candidates.names]]
    return float(np.linalg.norm(S @ (drawn - drawn.mean(axis=0)).T) / math.sqrt(DRAWS))


def _all_subsets(S: FloatArray, theta: FloatArray) -> Iterator[tuple[list[int], float]]:
    """Best subset of each size but the last, from the tree over all of them."""
    from imubayes.selection.kernels import walk

    p = len(theta)
    rss, _ = walk(np.pad(np.column_stack((S, S @ theta)), ((0, 1), (0, 0))))
    size = np.bitwise_count(np.arange(1 << p))
    for k in range(p):
        where = np.flatnonzero(size == k)
        best = int(where[np.argmin(rss[where])])
        yield [j for j in range(p) if best >> j & 1], math.sqrt(rss[best])


def _eliminated(S: FloatArray, theta: FloatArray) -> list[tuple[list[int], float]]:
    """Subset of each size but the last: each time the column goes that is missed least."""
    kept = list(range(len(theta)))
    found: list[tuple[list[int], float]] = []
    while kept:
        T, _ = _unit_columns(S, theta, kept)
        inverse = algebra.invert_triangular(T[:-1, :-1])
        missed = np.abs(inverse @ T[:-1, -1]) / np.linalg.norm(inverse, axis=1)
        kept = kept[: (weakest := int(np.argmin(missed)))] + kept[weakest + 1 :]
        found.append((kept, _lost(S, theta, kept)))
    return found[::-1]


def _lost(S: FloatArray, theta: FloatArray, kept: Sequence[int]) -> float:
    full = np.zeros(len(theta))
    full[list(kept)] = project(S, theta, kept)
    return float(np.linalg.norm(S @ (theta - full)))


def _unit_columns(S: FloatArray, theta: FloatArray, kept: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    """Factor of the columns `kept`, each scaled to length 1, beside ``S theta``; and what they were long."""
    size = np.linalg.norm(S[:, kept], axis=0)
    size = np.where(size > 0.0, size, 1.0)
    rows = np.column_stack((S[:, kept] / size, S @ theta))
    R = algebra.triangular((rows,), len(kept) + 1)
    return algebra.with_prior_rows(R, np.full(len(kept), TIE)), size
