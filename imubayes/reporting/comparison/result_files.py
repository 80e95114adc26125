"""Results of studies of sensors, as a comparison looks at them: terms by name, one noise for each run."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from imubayes.reporting.result.file import Written, read
from imubayes.reporting.result.sensors import SensorsResult

if TYPE_CHECKING:
    from imubayes.reporting.result.sensors import Kind, Scene, Sensor, Term


@dataclass(frozen=True, slots=True)
class NoiseEstimate:
    """One of N, B, K of a run: SI, and the sd of its logarithm; zero where it was given."""

    value: float
    log_sd: float


@dataclass(frozen=True, slots=True)
class ComponentFile:
    """A component in one result.

    Attributes
    ----------
    id, kind, class_id : of the component; the class is empty where there was none.
    terms : by name.
    noise : (run, letter) to its estimate.
    model : terms of the chosen model.
    """

    id: str
    kind: Kind
    class_id: str
    terms: Mapping[str, Term]
    noise: Mapping[tuple[str, str], NoiseEstimate]
    model: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class ResultFile:
    """One ``result.json`` of a study of sensors.

    Attributes
    ----------
    file : that it is in.
    components, scenes : in the file's order.
    seed : of the study, which decides the motion of a scene of the catalogue.
    """

    file: Written
    components: tuple[ComponentFile, ...]
    scenes: tuple[Scene, ...] = ()
    seed: int = 0


def sensors_of(file: Written) -> ResultFile:
    """Read the result of a study of sensors.

    Raises
    ------
    DataError : naming what is missing or wrong.
    """
    result = read(file, SensorsResult, "sensors")
    return ResultFile(file, tuple(map(_component, result.sensors)), result.scenes, result.seed)


def _component(sensor: Sensor) -> ComponentFile:
    terms = {term.name: term for term in sensor.terms}
    return ComponentFile(sensor.id, sensor.kind, sensor.class_ or "", terms, _noise(sensor), sensor.model)


def _noise(sensor: Sensor) -> dict[tuple[str, str], NoiseEstimate]:
    """Noise of every run: by the chains where it was sampled, else as it was estimated or given."""
    spreads = {run.name: run.noise_log_sd for run in sensor.runs}
    found = {
        (run, letter): NoiseEstimate(values[letter], spreads[run][letter] if run in spreads else math.nan)
        for run, values in sensor.noise.items()
        for letter in "NBK"
    }
    return found | {
        (run, letter): _of_draws(draws[letter]["mean"], draws[letter]["sd"])
        for run, draws in sensor.noise_posterior.items()
        for letter in "NBK"
    }


def _of_draws(mean: float, sd: float) -> NoiseEstimate:
    """Log-normal value of the same mean and sd."""
    return NoiseEstimate(mean, math.sqrt(math.log1p((sd / mean) ** 2)) if mean > 0.0 else math.nan)
