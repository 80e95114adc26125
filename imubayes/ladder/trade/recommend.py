"""The front of time and error, and the cheapest rung on the ladder that is good enough."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from imubayes.campaign.fidelity import RungName
from imubayes.ladder.trade.record import Place
from imubayes.ladder.trade.score import INTERVAL, Score

ACCURATE = 0.1
"""Posterior sd by which no coefficient may be off: a tenth widens an error bar by half a percent."""

FLOORS = 2.0
"""Monte Carlo errors within which two answers are the same."""

SURE = 0.1
"""Difference of an inclusion that is too large."""


def allowed(floor: float) -> float:
    """Error in posterior sd that is good enough where Monte Carlo errors are this large."""
    return max(ACCURATE, FLOORS * floor)


def front(places: Sequence[Place], floor: float) -> tuple[RungName, ...]:
    """Rungs that no other beats in time without being worse; errors below the floor are all the same.

    The error is that of the worst coefficient, by which rungs are recommended.

    Parameters
    ----------
    places : from the cheapest rung.
    floor : largest Monte Carlo error of a difference.
    """
    kept, lowest = list[RungName](), float("inf")
    for one in sorted(places, key=lambda place: place.whole_seconds):
        error = max(one.largest, floor)
        if error < lowest:
            kept.append(one.rung)
            lowest = error
    return tuple(kept)


def faults(place: Place, score: Score | None, floor: float) -> tuple[str, ...]:
    """Why a rung is not good enough, in words; empty if it is.

    Parameters
    ----------
    place, score : of the rung on the study's own data, and on simulated repeats where it answered any.
    floor : largest Monte Carlo error of a difference.
    """
    return tuple(_faults(place, score, floor))


def _faults(place: Place, score: Score | None, floor: float) -> Iterator[str]:
    if place.largest > allowed(floor):
        yield f"a coefficient is off by {place.largest:.2g} posterior sd"
    if place.inclusion > SURE:
        yield f"an inclusion is off by {place.inclusion:.2g}"
    if score is not None and score.coverage.share.high < INTERVAL:
        yield f"its 90 % intervals hold only {score.coverage.share.value:.0%} of the truths"


def recommended(places: Sequence[Place], scores: Sequence[Score], best: RungName, floor: float) -> RungName:
    """The cheapest rung without faults; the best where there is none."""
    by_rung = {one.rung: one for one in scores}
    for place in sorted(places, key=lambda one: one.whole_seconds):
        if not faults(place, by_rung.get(place.rung), floor):
            return place.rung
    return best
