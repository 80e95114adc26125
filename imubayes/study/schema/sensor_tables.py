"""One ``[[sensor]]`` table becomes a `SensorSpec`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from imubayes.campaign import SensorSpec
from imubayes.rig.bench import EARTH, KINDS, OFFSET, for_sensor
from imubayes.rig.bench import Kind as BenchError
from imubayes.rig.recordings import CASES, FERRARIS, FREE_TUMBLE, RunSpec
from imubayes.rig.simulate import library_of
from imubayes.sensors import SensorClass
from imubayes.sensors.catalogue import coupled, sensor
from imubayes.sensors.catalogue_file import read_catalogue
from imubayes.sensors.imu import COMPONENTS, kind_of
from imubayes.sensors.noise import NoiseRule
from imubayes.sensors.terms import Kind, Library, library
from imubayes.study.schema.run_tables import located, noise_rule, run_spec
from imubayes.study.schema.shapes import Place, arguments, hint, quantity, shaped, shown, unique
from imubayes.study.schema.tables import LIBRARY, HeaderTable, SensorTable, StudyFile

KINDS_OF_IMU: tuple[Kind, Kind] = ("accelerometer", "gyroscope")

LEANS_ON = {FREE_TUMBLE: ("gravity",), FERRARIS: ("gravity", "fixture")}
"""Errors of the reference that runs of several components in one case can allow for."""

LEANS_ON_A_TABLE = ("rate_scale", EARTH)
"""The same of gyroscopes on a table whose rate is all that is known."""

ESTIMATE = "estimate"
"""In place of the sd of an error that comes anew with each mount: the data are to tell it."""

SEEN_BY_HAND: dict[Kind, dict[str, Any]] = {
    "accelerometer": {"powers": 1, "asymmetry": -1},
    "gyroscope": {"powers": 1, "asymmetry": -1, "set": "extended"},
}
"""Candidates of a test in the hand unless the study asks for others: 1 g and slow turns tell no power from
bias and scale, whose error bars it would widen; the rates at rest tell g-sensitivity."""


def headed(
    tables: StudyFile, place: Place, text: str, exact: str = ""
) -> tuple[dict[str, Any], HeaderTable, Sequence[SensorClass]]:
    """What every study begins with, its header and its own classes; `exact` names one without a method."""
    here, path = place.at("study"), Path(place.file)
    header = shaped(HeaderTable, tables.study, here)
    about = {"title": header.title or path.stem, "seed": header.seed, "path": path, "text": text}
    if exact and header.method not in ("auto", "exact", "plug-in"):
        raise here.at("method").error(f"{exact} is exact: leave it out")
    if header.catalogue is None:
        return about, header, ()
    with here.at("catalogue").blamed():
        return about, header, read_catalogue(located(header.catalogue, here))


def sensors_of(tables: Sequence[object], place: Place, own: Sequence[SensorClass]) -> tuple[SensorSpec, ...]:
    """Check all sensors of a study, which may have classes of its own."""
    sensors = tuple(sensor_spec(raw, place.at(k), own) for k, raw in enumerate(tables))
    unique([spec.id for spec in sensors], "id", place)
    _check_sessions(sensors, place)
    return sensors


def _check_sessions(sensors: Sequence[SensorSpec], place: Place) -> None:
    """Refuse sessions of one unit that are the same, or that do not have the same parameters."""
    first: dict[str, int] = {}
    seen: dict[tuple[str, str], int] = {}
    for k, spec in enumerate(sensors):
        if not spec.unit:
            continue
        earlier = sensors[first.setdefault(spec.unit, k)]
        if (spec.kind, spec.library) != (earlier.kind, earlier.library):
            raise place.at(k, "unit").error(
                f"'{spec.unit}' is the unit of sensor '{earlier.id}' too, with another kind or library: "
                "expected the same, so that the sessions have the same parameters"
            )
        if (other := seen.setdefault((spec.unit, spec.session), k)) != k:
            raise place.at(k, "session").error(
                f"'{spec.session}' of unit '{spec.unit}' is {place.at(other).key} already: expected another"
            )


def sensor_spec(raw: object, place: Place, own: Sequence[SensorClass]) -> SensorSpec:
    """Check one sensor of a study."""
    table = shaped(SensorTable, raw, place)
    if not table.run:
        raise place.at("run").error("there is none: expected at least one [[sensor.run]] table")
    if (table.unit is None) != (table.session is None):
        given, missing = ("session", "unit") if table.unit is None else ("unit", "session")
        raise place.at(missing).error(
            f"the key is missing: beside {given} it says which sensors are one unit; give both or neither"
        )
    if table.kind != "imu":
        return _of_kind(table, table.kind, place, own)
    _check_imu(table, place)
    first, second = (_of_kind(table, kind, place, own) for kind in KINDS_OF_IMU)
    return replace(first, gyroscope=second)


def _of_kind(table: SensorTable, kind: Kind, place: Place, own: Sequence[SensorClass]) -> SensorSpec:
    """What a sensor's table says of its components of one kind; a whole IMU has both."""
    imu = table.kind == "imu"
    name, there = _half(table.class_, kind, place.at("class"), imu=imu)
    if not isinstance(name, str | None):
        raise there.error(f"expected the id of a class, came {shown(name)}")
    with there.blamed():
        sensor_class = None if name is None else sensor(name, kind=kind, catalogue=own)
    runs = tuple(_runs(table, kind, place))
    lib = _library(table, kind, runs[0], sensor_class.technology if sensor_class else "", place.at("library"))
    _check_runs(runs, sensor_class, place)
    if table.robust and runs[0].procedure == FERRARIS:
        raise place.at("robust").error(
            "is not known for positions and turns, of which each is there once: leave it out"
        )
    prior, there = _half(table.prior, kind, place.at("prior"), imu=imu)
    prior = _prior(prior, lib, there)
    truth = table.truth
    if imu:
        truth = {name: size for name, size in _flat(truth).items() if kind_of(name.partition(".")[0]) == kind}
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
        robust=table.robust,
        unit=table.unit or "",
        session=table.session or "",
        accept_prior_conflict=table.accept_prior_conflict,
        **_bench(table, kind, runs, place, imu=imu),
    )


def _library(table: SensorTable, kind: Kind, run: RunSpec, technology: str, place: Place) -> Library:
    """Candidates of a kind: in the hand those that it can tell, unless the study asks for others."""
    imu = table.kind == "imu"
    seen = SEEN_BY_HAND["accelerometer" if run.turntable else kind]  # no force is known there
    usual = {"technology": technology, **(seen if run.procedure in LEANS_ON else {})}
    asked, there = _half(table.library, kind, place, imu=imu)
    asked = arguments(LIBRARY, asked, there)
    with there.blamed():
        lib = library(kind, **{**usual, **asked})
    if (imu or run.procedure in CASES) and (second := lib.on("gT")):
        raise place.error(
            f"has {second[0]}, and a case of several components has no second thermometer:"
            " leave out gradient_of"
        )
    return lib


def _bench(
    table: SensorTable, kind: Kind, runs: Sequence[RunSpec], place: Place, *, imu: bool
) -> dict[str, Any]:
    """Errors of the bench of a kind, without those that speak of the other kind alone."""
    here = place.at("reference")
    halves = {name: _half(entry, kind, here, imu=imu)[0] for name, entry in table.reference.items()}
    entries = {name: value for name, value in halves.items() if value != {}}
    reference = _reference(entries, kind, runs, here, imu=imu)
    if table.bench == "drawn" and not (any(run.simulate for run in runs) and table.reference):
        raise place.at("bench").error(
            "errors are drawn from [sensor.reference] for simulated runs: expected both, or bench left out"
        )
    return {
        "reference": reference,
        "bench_drawn": table.bench == "drawn",
        "estimated": frozenset(name for name, value in entries.items() if value == ESTIMATE),
        "bench_stated": bool(entries) or table.bench is not None,
    }


def _runs(table: SensorTable, kind: Kind, place: Place) -> Iterator[RunSpec]:
    """Read the runs of a sensor; a run without a noise rule has the sensor's."""
    imu = table.kind == "imu"
    noise, there = _half(table.noise, kind, place.at("noise"), imu=imu)
    usual = noise_rule(noise, kind, there)
    for k, raw in enumerate(table.run):
        here = place.at("run").at(k)
        noise, _ = _half(raw.get("noise"), kind, here, imu=imu)
        run = run_spec(raw | {"noise": noise} if imu else raw, kind, here, imu=imu)
        if "noise" not in raw:
            # the static log that the others lean on cannot lean on itself
            run = replace(run, noise=NoiseRule() if usual.like == run.name else usual)
        yield run


def _truth(raw: dict[str, Any], kind: Kind, runs: Sequence[RunSpec], place: Place) -> dict[str, float]:
    truth = {}
    for name, text in raw.items():
        with place.at(name).blamed():
            (term,) = library_of(kind, [_without_component(name)]).terms
        truth[name] = quantity(text, term.unit, place.at(name))
    if truth and not any(run.simulate for run in runs):
        raise place.error("no run is simulated: expected a [sensor.run.simulate] table, or no truth")
    return truth


def _prior(raw: Any, lib: Library, place: Place) -> dict[str, float]:
    if not isinstance(raw, dict):
        raise place.error(f"expected a table of sds by term, came {shown(raw)}")
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
        return {key.rpartition(".")[0]: x for key, x in truth.items() if _without_component(key) == term}

    ties = tuple(
        (name, leader)
        for name, leader in lib.ties
        if prior.get(name, prior.get(leader)) == prior.get(leader, prior.get(name))
        and simulated(name) == simulated(leader)
    )
    both = {term: prior[other] for name, leader in ties
            for term, other in ((name, leader), (leader, name)) if other in prior}  # fmt: skip
    return replace(lib, ties=ties), {**both, **prior}


def _reference(
    raw: dict[str, Any], kind: Kind, runs: Sequence[RunSpec], place: Place, *, imu: bool
) -> dict[str, float]:
    allowed = LEANS_ON.get(runs[0].procedure)
    if runs[0].turntable:
        allowed, raw = LEANS_ON_A_TABLE, {EARTH: True, **raw}
    wanted = {name: value for name, value in raw.items() if value is not False}
    for name in raw:
        if name not in KINDS:
            raise place.at(name).error(f"is no error of a test bench: {hint(name, list(KINDS))}")
        if allowed and name in wanted and name not in allowed:
            raise place.at(name).error(
                f"a {runs[0].procedure} run leans on nothing but {' and '.join(allowed)}: leave it out"
            )
        if wanted.get(name) == ESTIMATE and (imu or allowed or KINDS[name].each != "mount"):
            raise place.at(name).error(
                f"{ESTIMATE!r} is for what differs from mount to mount of one component with known inputs"
                f" ({', '.join(name for name in KINDS if KINDS[name].each == 'mount')}): expected a quantity"
            )
    return {
        name: _uncertainty(value == ESTIMATE or value, for_sensor(KINDS[name], kind), place.at(name))
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


def _check_runs(runs: tuple[RunSpec, ...], sensor_class: SensorClass | None, place: Place) -> None:
    unique([run.name for run in runs], "name", place.at("run"))
    for k, run in enumerate(runs):
        here = place.at("run").at(k)
        like, by_name = run.noise.like, {other.name: other for other in runs}
        if like is not None and like not in by_name:
            raise here.at("noise").error(f"no run is called '{like}': {hint(like, list(by_name))}")
        if like is not None and by_name[like].noise.like is not None:
            raise here.at("noise").error(
                f"run '{like}' takes its noise from a run too: expected one with a noise of its own"
            )
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


def _half(value: Any, kind: Kind, place: Place, *, imu: bool) -> tuple[Any, Place]:
    """What a key says of one kind, and where: its own entry where an IMU's value is a table of both kinds.

    The entry is an empty table where a table of both kinds does not have it.
    """
    both = imu and isinstance(value, dict) and value.keys() <= set(KINDS_OF_IMU)
    return (value.get(kind, {}), place.at(kind)) if both else (value, place)


def _check_imu(table: SensorTable, place: Place) -> None:
    """Refuse what an IMU cannot have, and tables that do not say which kind they are for."""
    for name in _flat(table.truth):
        if name.partition(".")[0] not in COMPONENTS or "." not in name:
            raise place.at("truth", name).error(
                f"expected a component and its term, such as ax.b0; components are {', '.join(COMPONENTS)}"
            )
    for name in ("library", "prior"):
        for key in getattr(table, name):
            if key not in KINDS_OF_IMU:
                raise place.at(name, key).error(
                    f"unknown key: expected [sensor.{name}.accelerometer] and [sensor.{name}.gyroscope]; "
                    f"{hint(key, KINDS_OF_IMU)}"
                )
    if isinstance(table.class_, dict) and set(table.class_) != set(KINDS_OF_IMU):
        raise place.at("class").error("expected one class, or { accelerometer = ..., gyroscope = ... }")
    if isinstance(table.reference.get(OFFSET), str):
        raise place.at("reference", OFFSET).error(
            "accelerometers and gyroscopes have other units: expected"
            ' { accelerometer = "200 ug", gyroscope = "5 deg/h" }'
        )


def _without_component(name: str) -> str:
    """Term of a coefficient's name: ``b0`` of ``ax.b0`` and of ``b0``."""
    first, _, term = name.partition(".")
    return term if first in COMPONENTS else name


def _flat(raw: dict[str, Any]) -> dict[str, Any]:
    """Entries by component and term: TOML reads ``ax.b0 = ...`` as a table in a table."""
    flat: dict[str, Any] = {}
    for name, value in raw.items():
        inner = isinstance(value, dict)
        flat |= {f"{name}.{term}": size for term, size in value.items()} if inner else {name: value}
    return flat
