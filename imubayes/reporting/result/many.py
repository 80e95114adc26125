"""The published results of many units: of lots of classes, and of a fleet; SI."""

from __future__ import annotations

from pydantic.dataclasses import dataclass

from imubayes.reporting.result.entries import Check, Fleet, Interval, Noise, Provenance
from imubayes.reporting.result.values import PUBLISHED, Count, Kind, Names, Number, Numbers


@dataclass(frozen=True, kw_only=True, config=PUBLISHED)
class ClassTermInScene:
    """What a term does in a scene, over the units of a class."""

    name: str
    rms: Number
    share_of_budget: Number
    share_range: Numbers
    required: Number
    true_share_of_budget: Number
    answer: str


@dataclass(frozen=True, kw_only=True, config=PUBLISHED)
class ClassInScene:
    """A class in a scene, with the keys of a component's: `sensor` is the class, `model` what it needs."""

    name: str
    sensor: str
    model: Names
    would_matter: Names
    cannot_tell: Names
    terms: tuple[ClassTermInScene, ...]
    order: Interval
    within: Number
    noise_share_of_budget: Number
    basic_share_of_budget: Number


@dataclass(frozen=True, kw_only=True, config=PUBLISHED)
class ClassTerm:
    """A term over the units of a class."""

    name: str
    needed: Interval
    open: Number
    mean: Interval
    spread: Interval
    true_mean: Number
    true_spread: Number
    answer: str


@dataclass(frozen=True, kw_only=True, config=PUBLISHED)
class Unit:
    """A simulated unit: coefficients in the order of the terms."""

    number: Count
    truth: Numbers
    mean: Numbers
    sd: Numbers
    inclusion: Numbers
    full_mean: Numbers
    full_sd: Numbers
    verdicts: Names
    noise: Noise


@dataclass(frozen=True, kw_only=True, config=PUBLISHED)
class Class:
    """A class of a lot study; `order` counts the needed terms of a unit."""

    id: str
    order: Interval
    needed: Names
    not_needed: Names
    cannot_tell: Names
    terms: tuple[ClassTerm, ...]
    units: tuple[Unit, ...]


@dataclass(frozen=True, kw_only=True, config=PUBLISHED)
class Lots:
    """Lots of simulated units, one of each class."""

    kind: Kind
    units: Count
    terms: Names
    classes: tuple[Class, ...]
    check: Check


@dataclass(frozen=True, kw_only=True, config=PUBLISHED)
class LotsResult:
    """Result of a class-level study."""

    imubayes: str
    study: str
    seed: Count
    answer: Names
    status: str
    simulated: str
    scenes: tuple[ClassInScene, ...]
    lots: Lots
    provenance: Provenance


@dataclass(frozen=True, kw_only=True, config=PUBLISHED)
class FleetResult:
    """Result of a study of a fleet."""

    imubayes: str
    study: str
    seed: Count
    answer: Names
    fleet: Fleet
    engine: str
    resumed: Count
    seconds: Number
    provenance: Provenance
