"""What a scene requires of a component, in words made from the numbers."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

from imubayes.reporting.rounding import (
    OUTPUT_SI,
    OUTPUT_UNIT,
    TIMES,
    below,
    duration,
    measured,
    per_unit,
    share,
)
from imubayes.scenes.relevance import QUADRANTS
from imubayes.selection.verdicts import listed
from imubayes.units import counted

if TYPE_CHECKING:
    from imubayes.scenes.relevance import Relevance, TermRelevance
    from imubayes.sensors.terms import Kind

MOST_NAMES = 6
"""Terms that a sentence names."""

MOST_CULPRITS = 3
"""Terms that are named for what the calibration does not know of them."""

UNITS = {"attitude": "deg", "velocity": "m/s", "position": "m"}
"""Unit in which each budget is printed, but the output's, which the kind decides."""


def printed_unit(found: Relevance) -> tuple[str, float]:
    """Unit of a relevance's budget as people use it, and its size in SI."""
    return budget_unit(found.budget.quantity, found.kind)


def budget_unit(quantity: str, kind: Kind) -> tuple[str, float]:
    """Unit of a budget as people use it, and its size in SI.

    Examples
    --------
    >>> budget_unit("velocity", "gyroscope")
    ('m/s', 1.0)
    """
    if quantity == "output":
        return OUTPUT_UNIT[kind], per_unit(OUTPUT_UNIT[kind], OUTPUT_SI[kind])
    unit = UNITS[quantity]
    return unit, math.radians(1.0) if unit == "deg" else 1.0


def amount(found: Relevance, value: float) -> str:
    """Size of an error in the unit of the budget, two digits."""
    unit, size = printed_unit(found)
    return str(measured(value / size, 0.0, unit))


def limit(found: Relevance, value: float) -> str:
    """Upper limit of an error in the unit of the budget, rounded up."""
    unit, size = printed_unit(found)
    return str(below(value / size, unit))


def scene_sentences(found: Relevance, sensor: str) -> tuple[str, ...]:
    """Say what a scene requires: the model, what is left, what could still matter; units in ASCII."""
    sentences = (_opening(found, sensor), _costs(found), _idle(found), _open(found), _noise(found))
    return tuple(text for text in sentences if text)


def _opening(found: Relevance, sensor: str) -> str:
    what = "rms error of the output" if found.budget.quantity == "output" else found.budget.quantity
    where = (
        f"{sensor} in {found.scene} ({duration(found.duration)}, budget {amount(found, found.budget.limit)}"
        f" of {what})"
    )
    if found.met:
        return f"{where}: {_enough(found)}."
    return (
        f"{where}: no model of this library stays within the budget with 95 %, for the calibration leaves up"
        f" to {limit(found, found.calibrated[1])} with every term kept, most of it in {_unknown(found)}."
        f" What is left out would stay within it: {_enough(found)}. Calibrate better, or with a test that"
        " sees more."
    )


def _unknown(found: Relevance) -> str:
    """Terms whose uncertainty costs most: at least half of what the worst one costs."""
    ranked = sorted(found.terms, key=lambda term: -term.unknown)
    worst = [term.name for term in ranked if term.unknown >= 0.5 * ranked[0].unknown]
    return listed(worst[:MOST_CULPRITS])


def _enough(found: Relevance) -> str:
    count = len(found.model)
    if not count:
        return "no term needs to be modelled"
    be = "is" if count == 1 else "are"
    return f"{count} of {counted(len(found.terms), 'term')}, {_named(found.model)}, {be} enough"


def _costs(found: Relevance) -> str:
    left = f"What is left stays below {limit(found, found.left[1])} with 95 %"
    whole = f"without any compensation it would be {amount(found, found.uncompensated[0])}"
    if not found.model:
        return f"{left}."
    rest = len(found.terms) - len(found.model)
    others = f"leaving out the other {rest} costs {amount(found, found.left_out[0])}, " if rest else ""
    return f"{left}; {others}{whole}."


def _idle(found: Relevance) -> str:
    """Terms that are there and cost next to nothing."""
    idle = [term for term in found.terms if term.quadrant == QUADRANTS[1]]
    if not idle:
        return ""
    most = max(idle, key=lambda term: term.share[2])
    verb, takes = ("is", "takes") if len(idle) == 1 else ("are", "each take")
    names = _named(term.name for term in idle)
    return f"{names} {verb} there and {takes} {_at_most(most)} of the budget."


def _at_most(term: TermRelevance) -> str:
    text = share(term.share[2])
    return text if text.startswith("below") else f"up to {text}"


def _open(found: Relevance) -> str:
    """Terms that the tests have not shown, and that could still cost what counts."""
    could = sorted((t for t in found.terms if t.quadrant == QUADRANTS[2]), key=lambda t: -t.possible)
    if not could:
        return ""
    are = "is" if len(could) == 1 else "are"
    worst = could[0]
    each = "it could" if len(could) == 1 else f"the worst, {worst.name}, could"
    return (
        f"{_named(t.name for t in could)} {are} not shown to be there, nor to be small enough: {each} take"
        f" {share(worst.possible)}{' the' if worst.possible >= TIMES else ' of the'} budget."
    )


def _noise(found: Relevance) -> str:
    total = math.hypot(*found.noise)
    if total == 0.0:
        return ""
    more = " more than the whole budget, whatever is modelled" if total > found.budget.limit else ""
    return f"Noise comes to {amount(found, total)} (one sd){',' if more else ''}{more}."


def _named(names: Iterable[str]) -> str:
    every = list(names)
    more = f" and {len(every) - MOST_NAMES} more"
    if len(every) > MOST_NAMES:
        return ", ".join(every[:MOST_NAMES]) + more
    return listed(every)
