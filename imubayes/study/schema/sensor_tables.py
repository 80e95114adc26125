"""One ``[[sensor]]`` table becomes a `SensorSpec`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from imubayes.campaign.study import SensorSpec
from imubayes.rig.recordings import FERRARIS, FREE_TUMBLE, RunSpec
from imubayes.rig.reference import KINDS, for_sensor
from imubayes.rig.reference import Kind as BenchError
from imubayes.rig.simulate import library_of
from imubayes.sensors.catalogue import coupled, sensor
from imubayes.sensors.catalogue_file import read_catalogue
from imubayes.sensors.noise import NoiseRule
from imubayes.sensors.sensor_class import SensorClass
from imubayes.sensors.terms import Kind, Library, library
from imubayes.study.schema.imu_tables import KINDS_OF_IMU, check_imu, half, truths_of, without_component
from imubayes.study.schema.run_tables import located, noise_rule, run_spec
from imubayes.study.schema.shapes import Place, hint, quantity, shaped, shown, unique
from imubayes.study.schema.tables import LibraryTable, SensorTable

LEANS_ON = {FREE_TUMBLE: ("gravity",), FERRARIS: ("gravity", "fixture")}
"""Errors of the reference that runs of several components in one case can allow for."""


def own_classes(file: str | None, folder: Path, place: Place) -> tuple[SensorClass, ...]:
    """Read the classes of a study's own catalogue; none where it names no file.

    Parameters
    ----------
    file : as the study names it.
    folder : of the study's file.
    place : of the key, for errors.

    Raises
    ------
    StudyError : naming the file, the class and the key.
    """
    with place.blamed():
        return () if file is None else read_catalogue(located(file, folder))


def sensor_spec(
    raw: object, folder: Path, place: Place, *, catalogue: Sequence[SensorClass] = ()
) -> SensorSpec:
    """Check one sensor of a study.

    Parameters
    ----------
    raw : the table.
    folder : of the study's file.
    place : of the table, for errors.
    catalogue : classes of the study's own.

    Raises
    ------
    StudyError : naming the key.
    """
    table = shaped(SensorTable, raw, place)
    if not table.run:
        raise place.at("run").error("there is none: expected at least one [[sensor.run]] table")
    _check_session(table, place)
    if table.kind != "imu":
        return _of_kind(table, table.kind, folder, place, catalogue)
    check_imu(table, place)
    halves = (_of_kind(table, kind, folder, place, catalogue) for kind in KINDS_OF_IMU)
    accelerometer, gyroscope = halves
    return replace(accelerometer, gyroscope=gyroscope)


def _of_kind(
    table: SensorTable, kind: Kind, folder: Path, place: Place, catalogue: Sequence[SensorClass]
) -> SensorSpec:
    """What a sensor's table says of its components of one kind; a whole IMU has both."""
    imu = table.kind == "imu"
    name, there = half(table.class_, kind, place.at("class"), imu=imu)
    if isinstance(name, dict):
        raise there.error(f"expected the id of a class, came {shown(name)}")
    with there.blamed():
        sensor_class = None if name is None else sensor(name, kind=kind, catalogue=catalogue)
    technology = sensor_class.technology if sensor_class else ""
    lib = _candidates(kind, technology, *half(table.library, kind, place.at("library"), imu=imu))
    runs = tuple(_runs(table, kind, folder, place))
    _check_runs(runs, sensor_class, place)
    _check_robust(table, runs, place.at("robust"))
    prior, there = half(table.prior, kind, place.at("prior"), imu=imu)
    prior = _prior(prior, lib, there)
    truth = truths_of(table.truth, kind) if imu else table.truth
    truth = _truth(truth, kind, runs, place.at("truth"))
    if sensor_class is not None:
        lib, prior = _tied(coupled(lib, sensor_class), prior, truth)
    return SensorSpec(
        table.id,
        kind,
        sensor_class,
        lib,
        runs,
        truth,
        prior,
        _reference(_halves(table, kind, place.at("reference")), kind, runs, place.at("reference")),
        table.robust,
        table.unit or "",
        table.session or "",
        bench_drawn=_bench_drawn(table, runs, place.at("bench")),
    )


def _halves(table: SensorTable, kind: Kind, place: Place) -> dict[str, Any]:
    """Entries of ``reference`` for a kind; one that speaks of the other kind alone is left out."""
    entries = {
        name: half(value, kind, place.at(name), imu=table.kind == "imu")[0]
        for name, value in table.reference.items()
    }
    return {name: value for name, value in entries.items() if value != {}}


def _bench_drawn(table: SensorTable, runs: Sequence[RunSpec], place: Place) -> bool:
    """Whether simulated runs are on a bench with errors."""
    if table.bench == "exact":
        return False
    if not any(run.simulate for run in runs) or not table.reference:
        raise place.error(
            "errors are drawn from [sensor.reference] for simulated runs: expected both, or bench left out"
        )
    return True


def _runs(table: SensorTable, kind: Kind, folder: Path, place: Place) -> Iterator[RunSpec]:
    """Read the runs of a sensor; a run without a noise rule has the sensor's."""
    imu = table.kind == "imu"
    noise, there = half(table.noise, kind, place.at("noise"), imu=imu)
    usual = noise_rule(noise, kind, there)
    for k, raw in enumerate(table.run):
        here = place.at("run").at(k)
        own, _ = half(raw.get("noise"), kind, here.at("noise"), imu=imu)
        run = run_spec(raw | {"noise": own} if imu else raw, kind, folder, here, imu=imu)
        if isinstance(raw, dict) and "noise" not in raw:
            # the static log that the others lean on cannot lean on itself
            run = replace(run, noise=NoiseRule() if usual.like == run.name else usual)
        yield run


def _candidates(kind: Kind, technology: str, raw: object, place: Place) -> Library:
    options = shaped(LibraryTable, raw, place)
    with place.blamed():
        return library(kind, **asdict(options), technology=technology)


def _truth(raw: dict[str, Any], kind: Kind, runs: Sequence[RunSpec], place: Place) -> dict[str, float]:
    """Coefficients of simulated runs; they may go beyond the library, to see what a missing term does."""
    truth = {}
    for name, text in raw.items():
        with place.at(name).blamed():
            (term,) = library_of(kind, [without_component(name)]).terms
        truth[name] = quantity(text, term.unit, place.at(name))
    if truth and not any(run.simulate for run in runs):
        raise place.error("no run is simulated: expected a [sensor.run.simulate] table, or no truth")
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


def _tied(lib: Library, prior: dict[str, float], truth: dict[str, float]) -> tuple[Library, dict[str, float]]:
    """Leave out ties that the study contradicts; a prior sd that it states of one term holds for both."""

    def simulated(term: str) -> dict[str, float]:
        return {key.rpartition(".")[0]: x for key, x in truth.items() if without_component(key) == term}

    ties = tuple(
        (name, leader)
        for name, leader in lib.ties
        if prior.get(name, prior.get(leader)) == prior.get(leader, prior.get(name))
        and simulated(name) == simulated(leader)
    )
    both = {one: prior[other] for name, leader in ties
            for one, other in ((name, leader), (leader, name)) if other in prior}  # fmt: skip
    return replace(lib, ties=ties), {**both, **prior}


def _reference(raw: dict[str, Any], kind: Kind, runs: Sequence[RunSpec], place: Place) -> dict[str, float]:
    """Sds of the errors of the test bench that are allowed for."""
    allowed = LEANS_ON.get(runs[0].procedure)
    wanted = {name: value for name, value in raw.items() if value is not False}
    for name in raw:
        if name not in KINDS:
            raise place.at(name).error(f"is no error of a test bench: {hint(name, list(KINDS))}")
        if allowed and name in wanted and name not in allowed:
            raise place.at(name).error(
                f"a {runs[0].procedure} run leans on nothing but {' and '.join(allowed)}: leave it out"
            )
    return {
        name: _uncertainty(value, for_sensor(KINDS[name], kind), place.at(name))
        for name, value in wanted.items()
    }


def _uncertainty(value: object, error: BenchError, place: Place) -> float:
    """Sd of an error of the bench: its own, or with ``true`` the catalogue's."""
    usual = f'a quantity such as "1 {error.printed}"'
    if value is True:
        if error.default is None:
            raise place.error(f"the catalogue has no usual size of it: expected {usual}, came true")
        return error.default
    if not isinstance(value, str):
        raise place.error(f"expected true, false or {usual}, came {shown(value)}")
    return quantity(value, error.unit, place, positive=True)


def _check_robust(table: SensorTable, runs: Sequence[RunSpec], place: Place) -> None:
    if table.robust and runs[0].procedure == FREE_TUMBLE:
        raise place.error(
            "a free tumble has no dwells that could be contaminated: its positions are found where it rests; "
            "leave it out"
        )


def _check_session(table: SensorTable, place: Place) -> None:
    if (table.unit is None) != (table.session is None):
        given, missing = ("session", "unit") if table.unit is None else ("unit", "session")
        raise place.at(missing).error(
            f"the key is missing: beside {given} it says which sensors are one unit; give both or neither"
        )


def _check_runs(runs: tuple[RunSpec, ...], sensor_class: SensorClass | None, place: Place) -> None:
    unique([run.name for run in runs], "name", place.at("run"))
    for k, run in enumerate(runs):
        here = place.at("run").at(k)
        _check_noise(run, runs, here.at("noise"))
        if run.simulate is not None and sensor_class is None:
            raise here.at("simulate").error(f"needs the noise of a class: expected the key {place.key}.class")
        if FERRARIS in (run.procedure, runs[0].procedure) and run.procedure != runs[0].procedure:
            raise here.at("procedure").error(
                f"'{run.procedure}' beside '{runs[0].procedure}': expected all runs of an IMU to be of one"
            )
        if (run.procedure == FREE_TUMBLE) != (runs[0].procedure == FREE_TUMBLE):
            raise here.at("procedure").error(
                f"'{run.procedure}' beside '{runs[0].procedure}': a free tumble tests components in one case "
                "by gravity alone, the other procedures by known inputs; expected two [[sensor]] tables"
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
