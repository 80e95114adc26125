"""A study file becomes a `Study`: from checked tables to the values that the method works on."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from imubayes.campaign import Sampling, SensorSpec, Study
from imubayes.config.appendix_tables import appendix
from imubayes.config.extremes_tables import extremes_study
from imubayes.config.fleet_tables import fleet_study
from imubayes.config.lot_tables import lot_study
from imubayes.config.plan_tables import plan_study
from imubayes.config.quality_tables import quality_study
from imubayes.config.scene_tables import scenes_of
from imubayes.config.sensor_tables import own_classes, sensor_spec
from imubayes.config.shapes import (
    DecisionTable,
    HeaderTable,
    NoiseTable,
    Place,
    SamplingTable,
    StudyFile,
    hint,
    shaped,
    unique,
)
from imubayes.config.speed_tables import speed_study
from imubayes.errors import StudyError
from imubayes.extremes.plan import ExtremesStudy
from imubayes.fleet.plan import FleetStudy
from imubayes.lots.plan import LotStudy
from imubayes.offers import PlanStudy
from imubayes.preparation import AnyRun, runs_of
from imubayes.quality.trials import QualityStudy
from imubayes.selection.noise_found import NoiseQuestion
from imubayes.selection.verdicts import Costs
from imubayes.sensors.terms import Kind
from imubayes.speed.contests import SpeedStudy


def read_study(path: Path) -> Study:
    """Read and check a study file.

    Parameters
    ----------
    path : of the TOML file; paths in it are relative to it.

    Raises
    ------
    StudyError : naming the file and the key, what was expected, what came, and what to do.
    """
    text, tables = _tables(path)
    place = Place(str(path))
    if tables.quality is not None:
        raise place.at("quality").error("a study of how good the decision is has no runs: 'imubayes run' it")
    if tables.lots is not None:
        raise place.at("lots").error("a class-level study draws its own units: 'imubayes run' it")
    if tables.extremes is not None:
        raise place.at("extremes").error("a study of the extremes has no [[sensor]]: 'imubayes run' it")
    if tables.fleet is not None:
        raise place.at("fleet").error("a study of a fleet has no [[sensor]]: 'imubayes run' it")
    if tables.speed is not None:
        raise place.at("speed").error("a study of speed has no [[sensor]]: 'imubayes run' it")
    if tables.plan is not None and not any(raw.get("run") for raw in tables.sensor):
        raise place.at("plan").error("nothing has been run yet: 'imubayes plan' it")
    header = shaped(HeaderTable, tables.study, place.at("study"))
    if not tables.sensor:
        raise place.at("sensor").error("there is none: expected at least one [[sensor]] table")
    sampling = shaped(SamplingTable, tables.sampling, place.at("sampling"))
    decision = shaped(DecisionTable, tables.decision, place.at("decision"))
    noise = shaped(NoiseTable, tables.noise, place.at("noise"))
    here, there = place.at("sensor"), place.at("appendix")
    own = own_classes(header.catalogue, path.parent, place.at("study").at("catalogue"))
    sensors = tuple(
        sensor_spec(raw, path.parent, here.at(k), catalogue=own) for k, raw in enumerate(tables.sensor)
    )
    unique([one.id for one in sensors], "id", here)
    _check_sessions(sensors, here)
    return Study(
        header.title or path.stem,
        header.seed,
        sensors,
        path,
        text,
        Sampling(header.method, sampling.ess, sampling.time_limit),
        tuple(appendix(raw, path.parent, there.at(k)) for k, raw in enumerate(tables.appendix)),
        Costs(decision.false_keep, decision.false_drop),
        decision.hierarchy,
        decision.compare,
        scenes_of(tables.scene, path.parent, place.at("scene"), header.seed, _kinds(sensors)),
        NoiseQuestion(noise.identify, noise.candidates),
    )


def read_quality(path: Path) -> QualityStudy | None:
    """Read and check a study of how good the decision is; None where a study file is not one.

    Parameters
    ----------
    path : of the TOML file.

    Raises
    ------
    StudyError : as `read_study` does.
    """
    text, tables = _tables(path)
    return quality_study(tables, path, text) if tables.quality is not None else None


def read_lots(path: Path) -> LotStudy | None:
    """Read and check a class-level study; None where a study file is not one.

    Parameters
    ----------
    path : of the TOML file.

    Raises
    ------
    StudyError : as `read_study` does.
    """
    text, tables = _tables(path)
    return lot_study(tables, path, text) if tables.lots is not None else None


def read_extremes(path: Path) -> ExtremesStudy | None:
    """Read and check a study of the extremes; None where a study file is not one.

    Parameters
    ----------
    path : of the TOML file.

    Raises
    ------
    StudyError : as `read_study` does.
    """
    text, tables = _tables(path)
    return extremes_study(tables, path, text) if tables.extremes is not None else None


def read_fleet(path: Path) -> FleetStudy | None:
    """Read and check a study of a fleet; None where a study file is not one.

    Parameters
    ----------
    path : of the TOML file.

    Raises
    ------
    StudyError : as `read_study` does.
    """
    text, tables = _tables(path)
    return fleet_study(tables, path, text) if tables.fleet is not None else None


def read_speed(path: Path) -> SpeedStudy | None:
    """Read and check a study of speed; None where a study file is not one.

    Parameters
    ----------
    path : of the TOML file.

    Raises
    ------
    StudyError : as `read_study` does.
    """
    text, tables = _tables(path)
    return speed_study(tables, path, text) if tables.speed is not None else None


def read_plan(path: Path) -> PlanStudy:
    """Read and check a study with a plan to make.

    Parameters
    ----------
    path : of the TOML file.

    Raises
    ------
    StudyError : as `read_study` does.
    """
    text, tables = _tables(path)
    return plan_study(tables, path, text)


def read_runs(path: Path | str, sensor: str = "") -> tuple[AnyRun, ...]:
    """Read (or simulate) the runs of one sensor of a study file.

    Parameters
    ----------
    path : of the study.
    sensor : id; by default the study's first sensor.

    Raises
    ------
    StudyError : if the study has no such sensor, or cannot be read.
    DataError : if a run's file cannot be used.
    """
    study = read_study(Path(path))
    ids = [spec.id for spec in study.sensors]
    if sensor and sensor not in ids:
        raise StudyError(f"{path}: no sensor is called '{sensor}': {hint(sensor, ids)}")
    index = ids.index(sensor) if sensor else 0
    return runs_of(study.sensors[index], study.seed, index)


def _tables(path: Path) -> tuple[str, StudyFile]:
    """Text of a study file, and its tables, of which only the names are checked."""
    text = _content(path)
    return text, shaped(StudyFile, _parsed(text, str(path)), Place(str(path)))


def _content(path: Path) -> str:
    if path.is_dir():
        raise StudyError(f"{path}: is a directory: expected a study file such as {path / 'study.toml'}")
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise StudyError(f"{path}: there is no such file: expected a study (TOML)") from None
    except OSError as error:
        raise StudyError(f"{path}: cannot be read ({error.strerror}): check its permissions") from None
    except UnicodeDecodeError:
        raise StudyError(f"{path}: is not a text in UTF-8: expected a study (TOML)") from None


def _parsed(text: str, file: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        message = re.sub(r" \(at .*\)$", "", str(error))
        line = re.search(r"at line (\d+)", str(error))
        where = f"line {line[1]}" if line else f"line {text.count(chr(10)) + 1}"
        raise StudyError(f"{file}, {where}: is not TOML: {message[:1].lower()}{message[1:]}") from None


def _kinds(sensors: Sequence[SensorSpec]) -> set[Kind]:
    """Kinds of the components of all sensors."""
    return {part.kind for one in sensors for part in (one, one.gyroscope) if part}


def _check_sessions(sensors: Sequence[SensorSpec], place: Place) -> None:
    """Refuse sessions of one unit that are the same, or that do not have the same parameters."""
    first: dict[str, int] = {}
    seen: dict[tuple[str, str], int] = {}
    for k, one in enumerate(sensors):
        if not one.unit:
            continue
        earlier = sensors[first.setdefault(one.unit, k)]
        if (one.kind, one.library) != (earlier.kind, earlier.library):
            raise (
                place.at(k)
                .at("unit")
                .error(
                    f"'{one.unit}' is the unit of sensor '{earlier.id}' too, with another kind or library: "
                    "expected the same, so that the sessions have the same parameters"
                )
            )
        if (other := seen.setdefault((one.unit, one.session), k)) != k:
            raise (
                place.at(k)
                .at("session")
                .error(
                    f"'{one.session}' of unit '{one.unit}' is {place.at(other).key} already: expected another"
                )
            )
