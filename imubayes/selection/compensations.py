"""Coefficients to compensate with: of all tested terms, of those needed, or of the basic triad.

A smaller model has the posterior of all tested terms projected on the terms that it keeps, over the inputs of
the test, so that what is left out is taken up where it can be. Each predicts every position (a still, a
mount, a piece of a log whose inputs change) from all others; the one with the smallest error is what is
exported. A walk of the noise is left out of account there: without the position that it begins with, b0
would be a bias of nowhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import factor as algebra
from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import noise_scale, posterior_root
from imubayes.inference.case import Apart, apart
from imubayes.inference.drift import Drift
from imubayes.inference.dwells import Pieces, always, dwells_of
from imubayes.inference.linear import Linear, averages
from imubayes.inference.prior import ScalePrior
from imubayes.inference.summary import Summary
from imubayes.inference.whitened import pieces_of
from imubayes.selection.decision import Selection
from imubayes.selection.mixture import Candidates
from imubayes.selection.predictive import by_dwell
from imubayes.selection.reduced import design_factor, project
from imubayes.selection.verdicts import LIKELY, TermVerdict

BASIC = ("b0", "b1", "m_j", "m_k")
"""Terms of the basic triad."""

FEWEST = 3
"""Positions without which none is left out."""

ALIKE = 1e-3
"""Change of a column between dwells, as a share of its largest size, below which they are one position."""


@dataclass(frozen=True, slots=True, eq=False)
class Compensation:
    """Coefficients of one model.

    Attributes
    ----------
    model : ``full``, ``needed`` or ``basic``.
    terms : k names.
    mean : (k,) SI.
    covariance : (k, k).
    held_out : rms error of the output on average over a position that is predicted from all others, SI.
    positions : how many.
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
    summary, prior, rows : the problem.
    selection : the decision on the component.
    parts : indices of its own runs, where others take part in the factor.
    drift : of its bias, which is then the mean over the record.
    """
    tested = [k for k, term in enumerate(selection.terms) if term.verdict != "untested"]
    columns = [selection.carriers[k] for k in tested]
    alone = apart(summary, prior.sd, rows, parts or range(len(rows)), columns)
    named = [selection.terms[k] for k in tested]
    dwells = [replace(dwells_of(part).means, stream=None) for part in alone.rows]
    first = [_positions(part) for part in dwells]
    if sum(map(len, first)) < FEWEST or len(set(columns)) < len(columns):
        return ()
    names = alone.summary.names
    own = [names.index(column) for column in columns]
    mean, root = _of_record(alone, drift)
    without = _left_out(alone, first)
    means = [averages(part, edges) for part, edges in zip(dwells, first, strict=True)]
    X, y = np.concatenate([part.X for part in means]), np.concatenate([part.y for part in means])
    S = design_factor(alone.rows).R[:-1, own]
    found = []
    for model, kept in _models(named).items():
        P = np.column_stack([project(S, unit, kept) for unit in np.eye(len(own))])
        used = without.copy()
        used[:, own] = 0.0
        used[:, [own[k] for k in kept]] = without[:, own] @ P.T
        error = y - np.sum(X * used, axis=1)
        half = P @ root[own]
        found.append(
            Compensation(
                model,
                tuple(named[k].name for k in kept),
                P @ mean[own],
                half @ half.T,
                float(np.sqrt(np.mean(error**2))),
                len(y),
            )
        )
    return tuple(sorted(found, key=lambda one: one.held_out))


def _models(terms: Sequence[TermVerdict]) -> dict[str, list[int]]:
    """Places of the terms that each model keeps."""
    every = {
        "needed": needed_terms(terms),
        "full": [term.name for term in terms],
        "basic": [term.name for term in terms if term.name in BASIC],
    }
    return {name: [k for k, term in enumerate(terms) if term.name in kept] for name, kept in every.items()}


def needed_terms(terms: Sequence[TermVerdict]) -> list[str]:
    """Names of the terms that the data resolve and ask for, and the first of each group that they can't."""
    kept = [
        term.name
        for term in terms
        if term.verdict == "needed" or (term.verdict == "undecided" and term.inclusion >= LIKELY)
    ]
    for term in terms:
        alone = not set(term.confounded_with) & set(kept)
        if term.verdict == "inseparable" and term.inclusion >= LIKELY and alone:
            kept.append(term.name)
    return kept


def _of_record(alone: Apart, drift: Drift | None) -> tuple[FloatArray, FloatArray]:
    """Mean (p,) of the columns, with b0 on average over the record, and root (p, q) of their covariance."""
    f, sd = alone.summary.factor, alone.sd
    mean, root = posterior_root(f, sd, noise_scale(f, sd))
    if drift is not None:
        place = f.names.index(drift.names[drift.own])
        mean = mean.copy()
        mean[place] = drift.full[1, 0]
        slope = drift.slope[0, [drift.names.index(name) for name in f.names]]
        root = np.column_stack((root, np.zeros(len(mean))))
        root[place] -= slope @ root
        root[place, -1] = np.linalg.norm(drift.root[0])
    return mean, root


def _positions(dwells: Linear) -> NDArray[np.int64]:
    """First of the dwells of each position: a log at rest is one, however many pieces it is cut to."""
    X = dwells.X
    reach = np.abs(X).max(axis=0)
    moved = np.abs(np.diff(X, axis=0)) > ALIKE * reach
    return np.flatnonzero(np.append(True, moved.any(axis=1)))


def _left_out(alone: Apart, first: Sequence[NDArray[np.int64]]) -> FloatArray:
    """Posterior means (q, p) of all columns without each of the positions."""
    f, sd = alone.summary.factor, alone.sd
    both = zip(zip(alone.rows, alone.summary.runs, strict=True), first, strict=True)
    pieces = [_joined(pieces_of(part, replace(run.noise, K=0.0)), edges) for (part, run), edges in both]
    known = [] if alone.known is None else [always(alone.known)]
    every = Candidates((), f.names, sd, f.R, f.n, f.log_det)
    held = by_dwell([*pieces, *known], every, noise_scale(f, sd))
    return np.array([algebra.solve_triangular(T[:-1, :-1], T[:-1, -1]) for T in held.without])


def _joined(pieces: Pieces, first: NDArray[np.int64]) -> Pieces:
    """Pieces from each of `first` to the next as one."""
    width = pieces.R.shape[1]
    R = [algebra.triangular((part.reshape(-1, width),), width) for part in np.split(pieces.R, first[1:])]
    rows, log_det = (np.add.reduceat(values, first) for values in (pieces.rows, pieces.log_det))
    ends = np.append(first[1:], len(pieces)) - 1
    return replace(
        pieces, start=pieces.start[first], stop=pieces.stop[ends], rows=rows, R=np.array(R), log_det=log_det
    )
