"""Results of class-level studies, read back: of ``result.json`` what a comparison needs, checked."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from imubayes.inference.intervals import Share
from imubayes.reporting.comparison.pulls import normal_of
from imubayes.reporting.comparison.result_files import Written, checked, no_result, number
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
    """One ``result.json`` of a class-level study: as `result_files.ResultFile`, with classes by id."""

    path: Path
    sha256: str
    study: str
    version: str
    kind: Kind
    units: int
    classes: Mapping[str, ClassFile]


def lots_of(one: Written) -> LotFile:
    """Check the result of a class-level study.

    Raises
    ------
    DataError : naming what is missing or wrong.
    """
    with checked(one.path):
        raw = one.raw["lots"]
        kind = raw["kind"]
        if kind not in ("accelerometer", "gyroscope"):
            raise no_result(one.path, f"kind '{kind}'")
        units = int(raw["units"])
        classes = {str(each["id"]): _class(each, one.raw["scenes"], units) for each in raw["classes"]}
    return LotFile(one.path, one.sha256, one.study, one.version, kind, units, classes)


def _class(raw: Mapping[str, Any], scenes: list[Mapping[str, Any]], units: int) -> ClassFile:
    verdicts = list(zip(*(unit["verdicts"] for unit in raw["units"]), strict=True))
    return ClassFile(
        id=str(raw["id"]),
        order=share_of(raw["order"]),
        terms={
            str(term["name"]): _population(term, units, any(one != "untested" for one in verdicts[k]))
            for k, term in enumerate(raw["terms"])
        },
        scenes={str(one["name"]): _scene(one, units) for one in scenes if one["sensor"] == raw["id"]},
        noise=tuple(
            (number(u["noise"]["N"]), number(u["noise"]["B"]), number(u["noise"]["K"])) for u in raw["units"]
        ),
    )


def _population(raw: Mapping[str, Any], units: int, tested: bool) -> PopulationFile:
    share = share_of(raw["needed"])
    return PopulationFile(
        (round(share.value * units), units), share, share_of(raw["mean"]), share_of(raw["spread"]), tested
    )


def _scene(raw: Mapping[str, Any], units: int) -> LotSceneFile:
    terms = {str(term["name"]): term for term in raw["terms"]}
    return LotSceneFile(
        order=share_of(raw["order"]),
        within=number(raw["within"]),
        required={name: (round(number(t["required"]) * units), units) for name, t in terms.items()},
        shares={
            name: Share(number(t["share_of_budget"]), *map(number, t["share_range"]))
            for name, t in terms.items()
        },
    )


def share_of(raw: Mapping[str, Any]) -> Share:
    """Value with its interval."""
    return Share(number(raw["value"]), number(raw["low"]), number(raw["high"]))


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
