"""A study file becomes a `Study`: from checked tables to the values that the method works on."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from imubayes.campaign import SensorSpec, Study
from imubayes.config.run_tables import noise_rule, run_spec
from imubayes.config.shapes import (
    HeaderTable,
    LibraryTable,
    Place,
    SensorTable,
    StudyFile,
    hint,
    quantity,
    shaped,
)
from imubayes.errors import StudyError
from imubayes.rig.inputs import Run, TriadRun
from imubayes.rig.runs import FREE_TUMBLE, RunSpec
from imubayes.rig.simulate import library_of
from imubayes.sensors.catalogue import SensorClass, sensor
from imubayes.sensors.noise import NoiseRule
from imubayes.sensors.terms import Kind, Library, library
from imubayes.study import runs_of


def read_study(path: Path) -> Study:
    """Read and check a study file.

    Parameters
    ----------
    path : of the TOML file; paths in it are relative to it.

    Raises
    ------
    StudyError : naming the file and the key, what was expected, what came, and what to do.
    """
    text = _content(path)
    place = Place(str(path))
    tables = shaped(StudyFile, _parsed(text, str(path)), place)
    header = shaped(HeaderTable, tables.study, place.at("study"))
    if not tables.sensor:
        raise place.at("sensor").error("there is none: expected at least one [[sensor]] table")
    sensors = tuple(_sensor(raw, path, place.at("sensor").at(k)) for k, raw in enumerate(tables.sensor))
    _unique([one.id for one in sensors], "id", place.at("sensor"))
    return Study(header.title or path.stem, header.seed, sensors, path, text)


def read_runs(path: Path | str, sensor: str = "") -> tuple[Run | TriadRun, ...]:
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


def _sensor(raw: object, path: Path, place: Place) -> SensorSpec:
    table = shaped(SensorTable, raw, place)
    if table.kind == "imu":
        raise place.at("kind").error(
            "'imu' cannot be characterised in one piece yet: expected accelerometer or gyroscope; "
            "list the accelerometer and the gyroscope as two [[sensor]] tables"
        )
    if not table.run:
        raise place.at("run").error("there is none: expected at least one [[sensor.run]] table")
    with place.at("class").blamed():
        sensor_class = None if table.class_ is None else sensor(table.class_, kind=table.kind)
    lib = _candidates(table.kind, table.library, place.at("library"))
    runs = tuple(_runs(table, table.kind, path, place))
    _check_runs(runs, sensor_class, place)
    truth = _truth(table.truth, table.kind, place.at("truth"))
    if truth and not any(run.simulate for run in runs):
        raise place.at("truth").error(
            "no run is simulated: expected a [sensor.run.simulate] table, or no truth"
        )
    prior = _prior(table.prior, lib, place.at("prior"))
    return SensorSpec(table.id, table.kind, sensor_class, lib, runs, truth, prior)


def _runs(table: SensorTable, kind: Kind, path: Path, place: Place) -> Iterator[RunSpec]:
    """Read the runs of a sensor; a run without a noise rule has the sensor's."""
    usual = noise_rule(table.noise, kind, place.at("noise"))
    for k, raw in enumerate(table.run):
        run = run_spec(raw, kind, path.parent, place.at("run").at(k))
        if isinstance(raw, dict) and "noise" not in raw:
            # the static log that the others lean on cannot lean on itself
            run = replace(run, noise=NoiseRule() if usual.like == run.name else usual)
        yield run


def _candidates(kind: Kind, raw: object, place: Place) -> Library:
    options = shaped(LibraryTable, raw, place)
    with place.blamed():
        return library(kind, **asdict(options))


def _truth(raw: dict[str, Any], kind: Kind, place: Place) -> dict[str, float]:
    """Coefficients of simulated runs; they may go beyond the library, to see what a missing term does."""
    truth = {}
    for name, text in raw.items():
        with place.at(name).blamed():
            (term,) = library_of(kind, [name]).terms
        truth[name] = quantity(text, term.unit, place.at(name))
    return truth


def _prior(raw: dict[str, Any], lib: Library, place: Place) -> dict[str, float]:
    """Prior sds that take the place of the class's."""
    terms = {term.name: term for term in lib.terms}
    for name in raw:
        if name not in terms:
            raise place.at(name).error(f"is not a term of the library: {hint(name, list(terms))}")
    return {
        name: quantity(text, terms[name].unit, place.at(name), positive=True) for name, text in raw.items()
    }


def _check_runs(runs: tuple[RunSpec, ...], sensor_class: SensorClass | None, place: Place) -> None:
    _unique([run.name for run in runs], "name", place.at("run"))
    for k, run in enumerate(runs):
        here = place.at("run").at(k)
        _check_noise(run, runs, here.at("noise"))
        if run.simulate is not None and sensor_class is None:
            raise here.at("simulate").error(f"needs the noise of a class: expected the key {place.key}.class")
        if (run.procedure == FREE_TUMBLE) != (runs[0].procedure == FREE_TUMBLE):
            raise here.at("procedure").error(
                f"'{run.procedure}' beside '{runs[0].procedure}': a free tumble tests three components "
                "at once, the other procedures one; expected two [[sensor]] tables"
            )


def _check_noise(run: RunSpec, runs: tuple[RunSpec, ...], place: Place) -> None:
    """Refuse a noise like that of a run which is not there, or which itself is like another."""
    like, by_name = run.noise.like, {other.name: other for other in runs}
    if like is None:
        return
    if like not in by_name:
        raise place.error(f"no run is called '{like}': {hint(like, list(by_name))}")
    if by_name[like].noise.like is not None:
        raise place.error(
            f"run '{like}' takes its noise from a run too: expected one with a noise of its own"
        )


def _unique(names: list[str], key: str, place: Place) -> None:
    for k, name in enumerate(names):
        if name in names[:k]:
            first = place.at(names.index(name)).key
            raise place.at(k).at(key).error(f"'{name}' is the {key} of {first} already: expected another")
