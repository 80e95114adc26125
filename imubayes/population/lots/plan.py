"""A class-level study as its file says: which classes, how many units, which test, which scenes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from imubayes.campaign.study import Mission
from imubayes.rig.runs import RunSpec
from imubayes.sensors.sensor_class import SensorClass
from imubayes.sensors.terms import Kind, Library


@dataclass(frozen=True, slots=True)
class Against:
    """The question which terms some classes need that others do not.

    Attributes
    ----------
    needed_by, not_by : ids of the classes.
    """

    needed_by: tuple[str, ...]
    not_by: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class LotStudy:
    """A class-level study.

    Attributes
    ----------
    title, seed : of the study.
    kind : of all its sensors.
    classes : of the catalogue, in the order of the report.
    units : simulated of each class.
    library : candidate terms, of every class.
    runs : the test campaign that each unit goes through, simulated.
    reference : sd in SI of each error of the test bench, by kind: drawn for each unit, and allowed for in its
        analysis.
    missions : scenes that the terms are held against.
    basic : whether the report asks what the twelve-parameter triad would cost.
    asks : what the report answers first: what each of the classes needs, what the scenes require, whether the
        triad is enough, or what some classes need and others do not.
    processes : that share the work.
    path, text : of the file.
    """

    title: str
    seed: int
    kind: Kind
    classes: tuple[SensorClass, ...]
    units: int
    library: Library
    runs: tuple[RunSpec, ...]
    reference: Mapping[str, float]
    missions: tuple[Mission, ...]
    basic: bool
    processes: int
    path: Path
    text: str
    asks: Literal["classes", "scenes", "triad"] | Against = "classes"
