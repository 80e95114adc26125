"""A study as its file says, and what comes of it: the values that the stages of `study` exchange."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from imubayes.inference.residuals import ResidualCheck
from imubayes.inference.summary import RunSummary
from imubayes.planning.observability import Observability
from imubayes.rig.runs import RunSpec
from imubayes.selection.decision import Selection
from imubayes.sensors.catalogue import SensorClass
from imubayes.sensors.terms import Kind, Library

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class SensorSpec:
    """A sensor of a study, before its runs are read.

    Attributes
    ----------
    id : as in the study.
    kind : accelerometer or gyroscope.
    sensor_class : of the catalogue; None where the study names none.
    library : candidate terms.
    runs : the runs, in the study's order.
    truth : coefficients in SI by name, for simulated runs; empty draws them from the class.
    prior : prior sds in SI by name that take the place of the class's.
    """

    id: str
    kind: Kind
    sensor_class: SensorClass | None
    library: Library
    runs: tuple[RunSpec, ...]
    truth: Mapping[str, float]
    prior: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class Study:
    """A study, as its file says.

    Attributes
    ----------
    title, seed : of the study.
    sensors : what is tested.
    path : the study's file.
    text : the file's content, for the report.
    """

    title: str
    seed: int
    sensors: tuple[SensorSpec, ...]
    path: Path
    text: str


@dataclass(frozen=True, slots=True, eq=False)
class SensorCheck:
    """What the runs of a component can tell, before anything is fitted."""

    id: str
    library: Library
    observability: Observability


@dataclass(frozen=True, slots=True, eq=False)
class SensorResult:
    """What a study says of one component.

    Attributes
    ----------
    id : sensor's id; ``<sensor>.<component>`` for a component of a triad.
    kind, class_id : of the component; the class is empty where the study names none.
    samples : rows used.
    runs : noise, ranges and source of each run.
    selection : verdicts and models.
    checks : residual checks by run.
    draws : (m, p) exact posterior draws of the coefficients (zero where a draw's model has no such term).
    prior_draws : (m, p) draws of the prior, in the same form.
    prior_source : in words, where the priors come from.
    seconds : compute time.
    calibration : for a reference-free triad, the component's row of the compensation; else None.
    """

    id: str
    kind: Kind
    class_id: str
    samples: int
    runs: tuple[RunSummary, ...]
    selection: Selection
    checks: tuple[ResidualCheck, ...]
    draws: FloatArray
    prior_draws: FloatArray
    prior_source: str
    seconds: float
    calibration: Mapping[str, object] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class StudyResult:
    """Results of a study: one entry per component."""

    study: Study
    sensors: tuple[SensorResult, ...]
