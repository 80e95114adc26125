"""Whether other methods share the decision, over the units that they were asked about, and the truth.

They are held against it where it is sure, needed or not needed. By the truth, of all terms that the test
excites, a term kept is *false* where the posterior sd of the test is larger than the true coefficient, and
one left out is *missed* where that sd is far smaller; what is between may be either.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from imubayes.algebra.arrays import BoolArray, FloatArray
from imubayes.inference.intervals import Share, frequency
from imubayes.population.needs import NEEDED, NOT_NEEDED
from imubayes.population.records import Record

SMALL = 1.0
"""Posterior sd below which a coefficient is too small for the test, so that 'needed' is a false alarm."""

LARGE = 8.0
"""Posterior sd above which no method should leave a term out."""

DECISION = "evidence"
"""Method that is the decision itself."""


@dataclass(frozen=True, slots=True)
class Agreement:
    """One method over some units.

    Attributes
    ----------
    method : its name; that of the decision is `DECISION`.
    units : how many it was asked about.
    of : terms of units on which it has an answer, and the decision is sure.
    share : of these, those on which they agree.
    keeps, drops : how often it keeps what the decision drops, and drops what that keeps, by term.
    false, missed : how many terms it keeps that are in truth below `SMALL` sd of the test, and leaves out
        that are above `LARGE`; and how many such terms there are.
    """

    method: str
    units: int
    of: int
    share: Share
    keeps: Mapping[str, int]
    drops: Mapping[str, int]
    false: tuple[int, int]
    missed: tuple[int, int]


def agreements(units: Sequence[Record], names: tuple[str, ...]) -> tuple[Agreement, ...]:
    """Hold every method against the decision and the truth, over the units of simulated lots that have votes.

    `names` are the library's terms; without votes there is nothing.
    """
    asked = [unit for unit in units if unit.votes is not None]
    methods = dict.fromkeys(method for unit in asked if unit.votes for method in unit.votes.methods)
    size = np.array([np.abs(unit.truth) / unit.full_sd for unit in asked]).reshape(-1, len(names))
    # whether each keeps each term of each unit (n, p): 1 or 0, NaN where it says nothing
    told = {method: np.full((len(asked), len(names)), np.nan) for method in methods}
    for k, votes in enumerate(unit.votes for unit in asked if unit.votes):
        for method, keeps in zip(votes.methods, votes.keeps, strict=True):
            told[method][k, [names.index(term) for term in votes.terms]] = keeps
    verdicts = np.array([unit.verdicts for unit in asked]).reshape(-1, len(names))
    decided = np.where(verdicts == NEEDED, 1.0, np.where(verdicts == NOT_NEEDED, 0.0, np.nan))
    told[DECISION] = decided
    size[verdicts == "untested"] = np.nan
    return tuple(
        _agreement(method, names, answers, decided, size)
        for method, answers in told.items()
        if not np.isnan(answers).all()
    )


def _agreement(
    method: str, names: tuple[str, ...], answers: FloatArray, decided: FloatArray, size: FloatArray
) -> Agreement:
    both = ~np.isnan(answers) & ~np.isnan(decided)
    kept, same = answers == 1.0, both & (answers == decided)
    small, large = size < SMALL, size > LARGE
    of, alike = int(both.sum()), int(same.sum())
    return Agreement(
        method=method,
        units=int((~np.isnan(answers)).any(axis=1).sum()),
        of=of,
        share=frequency(alike, of),
        keeps=_by_term(both & ~same & kept, names),
        drops=_by_term(both & ~same & ~kept, names),
        false=(int((small & kept).sum()), int(small.sum())),
        missed=(int((large & (answers == 0.0)).sum()), int(large.sum())),
    )


def _by_term(where: BoolArray, names: tuple[str, ...]) -> dict[str, int]:
    counts = Counter(dict(zip(names, where.sum(axis=0).tolist(), strict=True)))
    return {name: count for name, count in counts.most_common() if count}
