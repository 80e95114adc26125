"""What a study of speed found, in words."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from imubayes.reporting.rounding import duration, times
from imubayes.reporting.trade_figures import error_text

if TYPE_CHECKING:
    from studies.speed.contests import Subject
    from studies.speed.growth import Law
    from studies.speed.measure import Found, Place, Speed

WRONG: dict[Subject, float] = {
    "least squares": 0.1,
    "one-sided": 0.1,
    "subsets": 0.01,
    "g-prior": 0.01,
    "enumeration": 0.01,
}
"""Errors from which on an answer is wrong: a tenth of a standard error, a hundredth of inclusion. Noise and
chains are random: there the errors stand beside each other."""

NEAR = 0.5
"""Posterior sd within which a rung is near the best one."""

LEAST_SLOPE = 0.05
"""Difference of an exponent from what is expected that is worth a word."""


def wrong(found: Found, place: Place) -> bool:
    """Whether an answer is too far off to count as a peer's."""
    return place.error > WRONG.get(found.subject, math.inf)


def speed_answer(speed: Speed) -> tuple[str, ...]:
    """The answer: the largest enumeration, a sentence a contest, in the order of the study, one a trade."""
    told = [sentence for found in speed.contests for sentence in _told(found)]
    return (*_enumerated(speed), *told, *trade_answer(speed))


def trade_answer(speed: Speed) -> tuple[str, ...]:
    """Of each trade which rung is near the best, and how near others come."""
    return tuple(_traded(found) for found in speed.contests if found.subject == "trade")


def _enumerated(speed: Speed) -> Iterator[str]:
    largest = max(
        (f for f in speed.contests if f.subject == "enumeration"), key=lambda f: f.size, default=None
    )
    if largest is not None:
        own, models = largest.places[0], 2**largest.size
        yield (
            f"{models:,} models (2^{largest.size}) are weighed in {duration(own.fastest)} where the noise is"
            f" known, {duration(own.fastest / models)} a model, and in {duration(largest.places[1].fastest)}"
            " with its scale integrated."
        )


def _told(found: Found) -> Iterator[str]:
    """The peers of a contest: the fastest that is right, and those that are not."""
    others = [p for p in found.places if not p.ours and p.seconds]
    if not others or found.subject == "trade":
        return
    right = sorted((p for p in others if not wrong(found, p)), key=lambda p: p.fastest)
    own = f"{found.title}: {duration(found.places[0].fastest)}"
    beside = ", ".join(f"{p.name} {duration(p.fastest)} ({_against(found, p)})" for p in right)
    off = ", ".join(p.name for p in others if wrong(found, p))
    yield "; ".join(part for part in (own, beside, f"wrong: {off}" if off else "") if part) + "."


def _traded(found: Found) -> str:
    ours = [place for place in found.places if place.ours]
    near = min((one for one in ours if one.error <= NEAR), key=lambda one: one.fastest)
    other = min((p for p in found.places if not p.ours and p.seconds), key=lambda one: one.error)
    full, after = ours[0], duration(near.fastest)
    if near is full:
        own = f"no rung is near {full.name}, which takes {after}"
    else:
        own = (
            f"{near.name} is within {error_text(near.error)} sd of {full.name} after {after}"
            f" ({duration(full.fastest)})"
        )
    nearest = f"{error_text(other.error)} sd after {duration(other.fastest)}"
    return f"{found.title}: {own}; of others {other.name} comes nearest: {nearest}."


def _against(found: Found, place: Place) -> str:
    ratio = found.ratio(place)
    if found.subject == "noise":
        return f"{times(ratio)} times ours, with {times(place.error / found.places[0].error)} times the error"
    return f"{times(ratio)} times ours"


def count_text(value: float) -> str:
    """Write a size in few characters.

    Examples
    --------
    >>> count_text(16), count_text(3e4), count_text(2**24)
    ('16', '30k', '17M')
    """
    for unit, name in ((1e6, "M"), (1e3, "k")):
        if value >= unit:
            return f"{times(value / unit)}{name}"
    return f"{value:g}"


def law_title(law: Law) -> str:
    """Say what the exponent is, with its error.

    Where it is fitted to three points, its error has one degree of freedom.
    """
    title = f"{law.ladder.title[:1].upper()}{law.ladder.title[1:]}"
    return f"{title}: {law.ladder.quantity}^({exponent_text(law)})"


def exponent_text(law: Law) -> str:
    """Write an exponent and its error with as many digits as the error has."""
    digits = 2 if law.sd < 0.095 else 1
    return f"{law.exponent:.{digits}f} ± {max(law.sd, 0.01):.{digits}f}"


def law_note(law: Law) -> str:
    """Say how the exponent compares with the count of operations, where it differs."""
    gap = law.exponent - law.ladder.expected
    if abs(gap) < max(2.0 * law.sd, LEAST_SLOPE):
        return "as the count of operations"
    return f"{'below' if gap < 0.0 else 'above'} the {law.ladder.expected:g} of the count of operations"
