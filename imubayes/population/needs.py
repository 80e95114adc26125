"""What a class needs, of itself and in a scene: one rule for all that is said, drawn and counted of it.

*Needed* is what the tests of the units show, and *not needed* too. Where the tests of half of the units or
more leave a term open (they cannot tell it, or leave it undecided), the class has no answer: *cannot tell*.
What such a term takes of a scene's budget is then what the catalogue says of its size; where that counts, it
*would matter*.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from imubayes.inference.intervals import Share, frequency
from imubayes.population.records import Record
from imubayes.population.scenes import MissionFound, MissionTerm
from imubayes.population.terms import PopulationTerm
from imubayes.scenes.relevance import MATTERS
from imubayes.sensors.sensor_class import SensorClass

NEEDED, NOT_NEEDED, UNTOLD, WOULD_MATTER = "needed", "not needed", "cannot tell", "would matter"

HALF = 0.5
"""Share of the units from which a class is said to be as they are."""

TIE = 1e-9
"""Rounding of shares that are sums of counts over units."""


@dataclass(frozen=True, slots=True, eq=False)
class ClassFound:
    """What the units of a class say of it.

    Attributes
    ----------
    sensor_class : which.
    units : one by one.
    terms : of the population.
    order : number of needed terms a unit, median and 90 % range over units.
    missions : by scene.
    """

    sensor_class: SensorClass
    units: tuple[Record, ...]
    terms: tuple[PopulationTerm, ...]
    order: Share
    missions: tuple[MissionFound, ...]


def of_class(term: PopulationTerm) -> str:
    """Whether a class needs a term: what most of the units say whose tests tell, if half of them or more do.

    Returns
    -------
    ``needed``, ``not needed`` or ``cannot tell``.
    """
    if term.open >= HALF:
        return UNTOLD
    return NEEDED if term.needed.value + TIE >= HALF * (1.0 - term.open) else NOT_NEEDED


def in_scene(term: PopulationTerm, found: MissionTerm) -> str:
    """Whether a scene requires a term of a class.

    It is needed where the class needs it and the smallest model of half of the units or more has it. A term
    that the tests do not show would matter if these models have it all the same, or if it takes
    `relevance.MATTERS` of the budget or more: by the sizes that the catalogue gives it.

    Returns
    -------
    ``needed``, ``not needed``, ``cannot tell`` or ``would matter``: of the last two the tests cannot tell.
    """
    told, wanted = of_class(term), found.required >= HALF
    if told == NEEDED:
        return NEEDED if wanted else NOT_NEEDED
    if wanted or (told == UNTOLD and found.share.value >= MATTERS):
        return WOULD_MATTER
    return told


def terms_of(found: ClassFound, answer: str) -> tuple[str, ...]:
    """Terms of which a class has this answer."""
    return tuple(term.name for term in found.terms if of_class(term) == answer)


def terms_in(found: ClassFound, scene: MissionFound, answer: str) -> tuple[str, ...]:
    """Terms of which a class has this answer in a scene."""
    return tuple(name for name, told in answers_in(found, scene) if told == answer)


def answers_in(found: ClassFound, scene: MissionFound) -> Iterator[tuple[str, str]]:
    """Every term with a class's answer in a scene."""
    for term, one in zip(found.terms, scene.terms, strict=True):
        yield term.name, in_scene(term, one)


def could_change(term: PopulationTerm, units: int) -> bool:
    """Whether the answer of a class could be another one with as many other units of its lot.

    It could where the 90 % interval of a share of units that it rests on reaches across one half.
    """
    hidden, needed = round(term.open * units), round(term.needed.value * units)
    unseen, told = frequency(hidden, units), units - hidden
    if of_class(term) == UNTOLD:
        return unseen.low < HALF
    most = max(needed, told - needed)
    return unseen.high >= HALF or frequency(most, told).low < HALF
