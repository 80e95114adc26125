"""Results of class-level studies, as a comparison looks at them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache

from imubayes.inference.intervals import Share
from imubayes.reporting.comparison.pulls import normal_of
from imubayes.reporting.result.file import Written, read
from imubayes.reporting.result.many import Class, ClassInScene, ClassTerm, LotsResult
from imubayes.reporting.rounding import per_unit
from imubayes.sensors.terms import HIGHEST_POWER, Kind, Term, library


@dataclass(frozen=True, slots=True)
class PopulationFile:
    """A term over the units of a class.

    Attributes
    ----------
    needed : count of the units in which it is needed, and of all.
    share : the same as a share with its 90 % interval.
    mean, spread : of the population, SI, with 90 % intervals.
    tested : whether the test excites it: otherwise the population is the prior's.
    """

    needed: tuple[int, int]
    share: Share
    mean: Share
    spread: Share
    tested: bool


@dataclass(frozen=True, slots=True)
class LotSceneFile:
    """A class in a scene.

    Attributes
    ----------
    order : number of terms of the smallest model: median and 90 % range over units.
    within : share of the units for which a model stays within the budget.
    required : by term, count of the units whose model has it, and of all.
    shares : by term, share of the budget: median and 90 % range over units.
    """

    order: Share
    within: float
    required: Mapping[str, tuple[int, int]]
    shares: Mapping[str, Share]


@dataclass(frozen=True, slots=True)
class ClassFile:
    """A class of a lot study.

    Attributes
    ----------
    id : of the class.
    order : number of needed terms: median and 90 % range over units.
    terms : by name.
    scenes : by name.
    noise : N, B, K of each unit, SI.
    """

    id: str
    order: Share
    terms: Mapping[str, PopulationFile]
    scenes: Mapping[str, LotSceneFile]
    noise: tuple[tuple[float, float, float], ...]


@dataclass(frozen=True, slots=True)
class LotFile:
    """One ``result.json`` of a class-level study, with classes by id."""

    file: Written
    kind: Kind
    units: int
    classes: Mapping[str, ClassFile]


def lots_of(file: Written) -> LotFile:
    """Read the result of a class-level study.

    Raises
    ------
    DataError : naming what is missing or wrong.
    """
    result = read(file, LotsResult, "classes")
    lots = result.lots
    classes = {one.id: _class(one, result.scenes, lots.units) for one in lots.classes}
    return LotFile(file, lots.kind, lots.units, classes)


def _class(one: Class, scenes: Iterable[ClassInScene], units: int) -> ClassFile:
    verdicts = list(zip(*(unit.verdicts for unit in one.units), strict=True))
    return ClassFile(
        id=one.id,
        order=Share(**one.order),
        terms={
            term.name: _population(term, units, any(verdict != "untested" for verdict in verdicts[k]))
            for k, term in enumerate(one.terms)
        },
        scenes={scene.name: _scene(scene, units) for scene in scenes if scene.sensor == one.id},
        noise=tuple((unit.noise["N"], unit.noise["B"], unit.noise["K"]) for unit in one.units),
    )


def _population(term: ClassTerm, units: int, tested: bool) -> PopulationFile:
    needed, mean, spread = (Share(**one) for one in (term.needed, term.mean, term.spread))
    return PopulationFile((round(needed.value * units), units), needed, mean, spread, tested)


def _scene(scene: ClassInScene, units: int) -> LotSceneFile:
    return LotSceneFile(
        order=Share(**scene.order),
        within=scene.within,
        required={term.name: (round(term.required * units), units) for term in scene.terms},
        shares={term.name: Share(term.share_of_budget, *term.share_range) for term in scene.terms},
    )


def unit_of_term(name: str, kind: Kind) -> tuple[str, float]:
    """Unit in which a term is printed, and its size in SI; no unit where the name is not known.

    Examples
    --------
    >>> unit_of_term("b1", "gyroscope"), unit_of_term("none", "gyroscope")
    (('ppm', 1e-06), ('', 1.0))
    """
    term = _every_term(kind).get(name)
    return (term.printed, per_unit(term.printed, term.unit)) if term else ("", 1.0)


@cache
def _every_term(kind: Kind) -> Mapping[str, Term]:
    """All terms that a library of this kind can have, by name."""
    plain = library(kind, powers=HIGHEST_POWER, asymmetry=HIGHEST_POWER, set="extended")
    whole = library(
        kind,
        powers=HIGHEST_POWER,
        asymmetry=HIGHEST_POWER,
        set="extended",
        temperature=HIGHEST_POWER,
        temperature_of=plain.names,
        rate_of=plain.names,
    )
    return {term.name: term for term in whole.terms}


def log_spread(found: Share) -> tuple[float, float]:
    """Logarithm of a spread, and the sd of it that its 90 % interval has; nan where it is not positive.

    Examples
    --------
    >>> value, sd = log_spread(Share(1.0, 0.5, 2.0))
    >>> value, round(sd, 3)
    (0.0, 0.421)
    """
    if not found.low > 0.0:
        return math.nan, math.nan
    return math.log(found.value), normal_of(math.log(found.low), math.log(found.high))
