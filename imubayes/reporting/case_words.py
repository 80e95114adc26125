"""What compensation recovers, and what a kind of component needs, in words."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from scipy.stats import binomtest

from imubayes.reporting.rounding import pretty
from imubayes.selection.verdicts import listed

if TYPE_CHECKING:
    from imubayes.reporting.case_views import CaseView, PooledRow, PooledTable, RecoveredRow

WITHIN = math.erf(math.sqrt(2.0))
"""Share of normal errors within 2 sd."""

CHANCE = 1e-3
"""Probability from which chance explains how many lie there: errors of one fit are not independent."""

QUANTITIES = {
    "gravity": "length of the force in a still, from local g",
    "rest": "rate in a still",
    "closure": "up carried through a turn, from up in the next still",
    "turn": "angle of a known turn",
}

SHORT = {
    "gravity": "Length of the force in the stills, from local g",
    "rest": "Rates in the stills",
    "closure": "Up carried through the turns",
    "turn": "Angles of the known turns",
}

UNITS = {
    "gravity": ("mg", "m/s^2"),
    "rest": ("deg/s", "rad/s"),
    "closure": ("deg", "rad"),
    "turn": ("deg", "rad"),
}
"""Printed unit and SI unit of each quantity."""


def recovered_sentence(row: RecoveredRow) -> str:
    """Say what the length of gravity is before and after compensation, beside what the posterior predicts."""
    after, before, fresh, flown = map(_amount, (row.after, row.before, row.fresh, row.flown))
    inside = f"{row.inside} of {row.of} lie within 2 sd of that{held(row.inside, row.of)}"
    if row.fitted is None:
        predicted = "The fit has a coefficient for each;"
        predicted += f" the posterior predicts {fresh} for new ones: {inside}."
    else:
        predicted = f"The posterior predicts {_amount(row.fitted)} for them: {inside};"
        predicted += f" new ones would be off by {fresh}."
    kept = "" if after == flown else f" The kept terms alone leave {flown}."
    return (
        f"The force in the {row.count} stills of {row.run} is off local gravity by {before} rms raw, and by"
        f" {after} compensated. {predicted}{kept}"
    )


def held(inside: int, of: int) -> str:
    """Say how many of `of` errors should lie within 2 sd where chance does not explain how many do.

    Examples
    --------
    >>> held(444, 504), held(480, 504)
    (' (481 expected: they are larger than predicted)', '')
    >>> held(500, 504)
    ' (481 expected: they are smaller than predicted)'
    """
    if binomtest(inside, of, WITHIN).pvalue >= CHANCE:
        return ""
    size = "larger" if inside < WITHIN * of else "smaller"
    return f" ({WITHIN * of:.0f} expected: they are {size} than predicted)"


def held_together(views: Sequence[CaseView]) -> tuple[str, ...]:
    """Say of each known quantity how many errors of all cases lie within 2 sd of what is predicted."""
    rows = [row for view in views for row in view.rows]
    told = []
    for kind in dict.fromkeys(row.kind for row in rows):
        alike = [row for row in rows if row.kind == kind]
        inside, of = sum(row.inside for row in alike), sum(row.of for row in alike)
        verdict = held(inside, of) or ", as many as there should be"
        told.append(f"{SHORT[kind]}: {inside} of {of} lie within 2 sd of what is predicted{verdict}.")
    return tuple(told)


def case_answer(name: str, rows: Sequence[RecoveredRow], tables: Sequence[PooledTable]) -> tuple[str, ...]:
    """First paragraph on a case by sentence: what its kinds need, and what compensation recovers."""
    needs = [text for table in tables if (text := _need(table))]
    opening = f"{name} as a whole: {'; '.join(needs)}." if needs else f"{name} as a whole."
    return (opening, *(_change(row) for row in rows))


def _need(table: PooledTable) -> str:
    """Say what all components of a kind need, and what some need beside it."""
    needed = [row.term for row in table.rows if row.verdict == "needed"]
    more = " also" if needed else ""
    also = "; ".join(
        f"{listed(names)} {'needs' if len(names) == 1 else 'need'}{more} {listed(terms)}"
        for terms, names in table.also.items()
    )
    all_of_them = f"its {table.kind}s need {listed(needed)}" if needed else ""
    return "; ".join(text for text in (all_of_them, also) if text)


def _change(row: RecoveredRow) -> str:
    before, after, predicted = (_amount(size) for size in (row.before, row.after, row.fitted or row.fresh))
    whose = "" if row.fitted else " for new ones"
    return (
        f"{SHORT[row.kind]}: {before} rms raw, {after} compensated;"
        f" the posterior predicts {predicted}{whose}."
    )


def pooled_sentence(kind: str, components: Sequence[str], rows: Sequence[PooledRow]) -> str:
    """Say which terms a kind needs that not every one of its components shows."""
    named = {word: [row.term for row in rows if row.verdict == word] for word in _WORDS}
    parts = [f"{_WORDS[word][len(names) > 1]} {listed(names)}" for word, names in named.items() if names]
    text = f"In one model for {listed(components)}: {'; '.join(parts)}."
    alone = [row.term for row in rows if row.verdict == "needed" and set(row.verdicts) != {"needed"}]
    if alone:
        text += f" Not every {kind} shows {listed(alone)} by itself."
    return text


_WORDS = {
    "needed": ("needed is", "needed are"),
    "not needed": ("not needed is", "not needed are"),
    "undecided": ("undecided is", "undecided are"),
    "cannot tell": ("this test cannot tell of", "this test cannot tell of"),
}


def _amount(size: object) -> str:
    return pretty(str(size)).replace(" °", "°")
