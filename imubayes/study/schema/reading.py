"""A study file becomes a `Study`: from checked tables to the values that the method works on.

The JSON Schema of a study file is made of the same tables: editors complete and check studies with it, and
docs/ is made of it.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import TypeAdapter
from pydantic.dataclasses import is_pydantic_dataclass

import imubayes.study.schema.plan_tables as plan_tables
import imubayes.study.schema.scene_tables as scene_tables
import imubayes.study.schema.shapes as shapes
import imubayes.study.schema.tables as tables
import imubayes.study.schema.unit_tables as unit_tables
from imubayes.campaign import Sampling, SensorSpec, Study
from imubayes.campaign.preparation import runs_of
from imubayes.errors import StudyError
from imubayes.planning.offers import PlanStudy
from imubayes.population import FleetStudy
from imubayes.population.lots import LotStudy
from imubayes.rig.inputs import Run
from imubayes.rig.reference import KINDS, OFFSET
from imubayes.selection.noise_choice import NoiseQuestion
from imubayes.selection.verdicts import Costs
from imubayes.sensors.terms import Kind
from imubayes.study.schema.plan_tables import plan_study
from imubayes.study.schema.scene_tables import appendix, scenes_of
from imubayes.study.schema.sensor_tables import ESTIMATE, headed, sensor_spec
from imubayes.study.schema.shapes import Place, arguments, hint, holds, shaped, unique
from imubayes.study.schema.tables import NOISE, SAMPLING, DecisionTable, StudyFile
from imubayes.study.schema.unit_tables import fleet_study, lot_study
from imubayes.units import factor, quantities

ASKED = "?"
"""Value of a key that 'imubayes init' could not guess, and that is to be filled in."""

AnyStudy = Study | LotStudy | FleetStudy
"""What a study file becomes."""


@dataclass(frozen=True, slots=True)
class Form:
    """A kind of study whose file has a table of its own in place of ``[[sensor]]``, and why it has none.

    `read` makes a study of the tables, the file and its text; `beside` its own table others may stand.
    """

    what: str
    why: str
    read: Callable[[StudyFile, Place, str], AnyStudy]
    beside: tuple[str, ...] = ()


FORMS: Mapping[str, Form] = {
    "lots": Form("a class-level study", "draws the units of its own classes", lot_study, ("scene",)),
    "fleet": Form("a study of a fleet", "describes its one kind of sensor itself", fleet_study),
}
"""Kinds of study by their table; a file with none of them is a study of sensors."""

OF_THE_TOOL: Mapping[str, str] = {"quality": "decision_quality", "extremes": "extremes", "speed": "speed"}
"""Studies about the tool, which no file describes, by the table that they once had: modules of `studies`."""

SENSORS = "sensor"
"""The kind of study that has the others' tables."""

OF_SENSORS = (SENSORS, "sampling", "decision", "noise", "appendix", "scene", "plan")
"""Tables of a study of sensors."""


def read(path: Path) -> tuple[str, AnyStudy]:
    """Read and check a study file of any kind, a key of `FORMS`, or `SENSORS`; give both.

    Raises
    ------
    StudyError : naming the file and the key, what was expected, what came, and what to do.
    """
    tables, place, text = _tables(path)
    kind = kind_of(tables, place)
    return kind, FORMS[kind].read(tables, place, text) if kind in FORMS else _study(tables, place, text)


def kind_of(tables: StudyFile, place: Place) -> str:
    """Kind of a study by its tables."""
    kinds = [key for key in FORMS if getattr(tables, key) is not None]
    if len(kinds) > 1:
        both = " and ".join(f"[{key}] ({FORMS[key].what})" for key in kinds)
        raise place.error(f"holds {both}: a file is one study, expected a file for each")
    for kind in kinds:
        for key in OF_SENSORS:
            if getattr(tables, key) and key not in FORMS[kind].beside:
                raise place.at(key).error(f"{FORMS[kind].what} {FORMS[kind].why}: leave it out")
    return kinds[0] if kinds else SENSORS


def read_study(path: Path) -> Study:
    """Read and check a study of sensors from a TOML file; paths in it are relative to it."""
    return _study(*_of_sensors(path))


def _of_sensors(path: Path) -> tuple[StudyFile, Place, str]:
    tables, place, text = _tables(path)
    if form := FORMS.get(kind := kind_of(tables, place)):
        raise place.at(kind).error(f"{form.what} has no [[sensor]] and {form.why}: 'imubayes run' it")
    return tables, place, text


def _study(tables: StudyFile, place: Place, text: str) -> Study:
    if tables.plan is not None and not any(raw.get("run") for raw in tables.sensor):
        raise place.at("plan").error("nothing has been run yet: 'imubayes plan' it")
    about, header, own = headed(tables, place, text)
    if not tables.sensor:
        raise place.at("sensor").error("there is none: expected at least one [[sensor]] table")
    sampling = Sampling(header.method, **arguments(SAMPLING, tables.sampling, place.at("sampling")))
    decision = shaped(DecisionTable, tables.decision, place.at("decision"))
    noise = NoiseQuestion(**arguments(NOISE, tables.noise, place.at("noise")))
    here, there = place.at("sensor"), place.at("appendix")
    sensors = tuple(sensor_spec(raw, here.at(k), own) for k, raw in enumerate(tables.sensor))
    unique([one.id for one in sensors], "id", here)
    _check_sessions(sensors, here)
    kinds: set[Kind] = {part.kind for one in sensors for part in one.halves}
    return Study(
        **about,
        sensors=sensors,
        sampling=sampling,
        appendices=tuple(appendix(raw, there.at(k)) for k, raw in enumerate(tables.appendix)),
        costs=Costs(decision.false_keep, decision.false_drop),
        hierarchical=decision.hierarchy,
        compare=decision.compare,
        scenes=scenes_of(tables.scene, place.at("scene"), header.seed, kinds),
        noise=noise,
    )


def read_plan(path: Path) -> PlanStudy | LotStudy:
    """Read and check a study with a plan to make, or a class-level one; errors are those of `read_study`."""
    tables, place, text = _tables(path)
    if kind_of(tables, place) == "lots":
        return lot_study(tables, place, text)
    return plan_study(*_of_sensors(path))


def read_runs(path: Path | str, sensor: str = "") -> tuple[Run, ...]:
    """Read (or simulate) the runs of a sensor of a study file by its id; by default of the first.

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


def _tables(path: Path) -> tuple[StudyFile, Place, str]:
    """Tables of a study file, of which only the names are checked, and its text."""
    if path.is_dir():
        raise StudyError(f"{path}: is a directory: expected a study file such as {path / 'study.toml'}")
    text, place = "", Place(str(path))
    try:
        text = path.read_text(encoding="utf-8")
        raw = tomllib.loads(text)
    except FileNotFoundError:
        raise StudyError(f"{path}: there is no such file: expected a study (TOML)") from None
    except OSError as error:
        raise StudyError(f"{path}: cannot be read ({error.strerror}): check its permissions") from None
    except UnicodeDecodeError:
        raise StudyError(f"{path}: is not a text in UTF-8: expected a study (TOML)") from None
    except tomllib.TOMLDecodeError as error:
        message = re.sub(r" \(at .*\)$", "", str(error))
        line = re.search(r"at line (\d+)", str(error))
        where = f"line {line[1]}" if line else f"line {text.count(chr(10)) + 1}"
        raise StudyError(f"{path}, {where}: is not TOML: {message[:1].lower()}{message[1:]}") from None
    if asked := [*_asked(raw, place)]:
        raise place.error(f'still to be filled in, in place of "{ASKED}": {", ".join(asked)}')
    for key in (key for key in OF_THE_TOOL if key in raw):
        command = f"python -m studies.{OF_THE_TOOL[key]}"
        raise place.at(key).error(f"this study needs no file: run '{command}' in the project's folder")
    return shaped(StudyFile, raw, place), place, text


def _asked(value: object, place: Place) -> Iterator[str]:
    """Keys that are still to be filled in."""
    if value == ASKED:
        yield place.key
    elif isinstance(value, dict | list):
        for key, one in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _asked(one, place.at(key))


def _check_sessions(sensors: Sequence[SensorSpec], place: Place) -> None:
    """Refuse sessions of one unit that are the same, or that do not have the same parameters."""
    first: dict[str, int] = {}
    seen: dict[tuple[str, str], int] = {}
    for k, one in enumerate(sensors):
        if not one.unit:
            continue
        earlier = sensors[first.setdefault(one.unit, k)]
        if (one.kind, one.library) != (earlier.kind, earlier.library):
            raise place.at(k, "unit").error(
                f"'{one.unit}' is the unit of sensor '{earlier.id}' too, with another kind or library: "
                "expected the same, so that the sessions have the same parameters"
            )
        if (other := seen.setdefault((one.unit, one.session), k)) != k:
            raise place.at(k, "session").error(
                f"'{one.session}' of unit '{one.unit}' is {place.at(other).key} already: expected another"
            )


_EACH = {
    "bench": "the same in all runs",
    "machine": "one for each procedure",
    "run": "another in each run",
    "mount": "another in each mount",
}
"""What a kind of error is one error of, in words."""


def _reference() -> type:
    """Shape of ``[sensor.reference]``: the kinds of errors, with the sizes that the catalogue has."""
    kinds, values = dict[str, Any](), dict[str, Any]()
    for kind in KINDS.values():
        text = quantities("like the output" if kind.name == OFFSET else kind.unit)
        ways = [text, {"type": "boolean"}, *([tables.by_kind(text)] if kind.name == OFFSET else [])]
        ways += [{"enum": [ESTIMATE]}] if kind.each == "mount" else []
        size = kind.default and f"{kind.default / factor(kind.printed, kind.unit):g} {kind.printed}"
        kinds[kind.name] = Annotated[Any, holds(*ways)]
        meaning = f"{kind.text}, {_EACH[kind.each]}"
        values[kind.name] = shapes.key(
            meaning, size or f"1 {kind.printed}", None, f'`"{size}"`' if size else "none"
        )
    made = {"__annotations__": kinds, "__doc__": "``[sensor.reference]``.", **values}
    return shapes.shape(type("ReferenceTable", (), made))


SHAPES: dict[str, Any] = {
    shape.__name__: shape
    for module in (tables, unit_tables, plan_tables, scene_tables)
    for shape in (*vars(module).values(), *tables.SIMULATED.values(), _reference())
    if isinstance(shape, type) and is_pydantic_dataclass(shape) and shape is not unit_tables.UnitsTable
}
"""Tables of a study file, by the name of their shape."""


def study_schema() -> dict[str, Any]:
    """JSON Schema of a study file; ``usual`` is a default in words, ``quantity (s)`` a text with a unit."""
    defined = {name: _tidy(TypeAdapter(shape).json_schema()) for name, shape in SHAPES.items()}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **defined.pop(tables.StudyFile.__name__),
        "$defs": defined,
    }


def _tidy(value: Any) -> Any:
    """Leave out what TOML has not (null), and what only repeats a key; refer to tables by their shapes."""
    if isinstance(value, list):
        return [_tidy(one) for one in value]
    if not isinstance(value, dict):
        return value
    if ways := [one for one in value.pop("anyOf", []) if one != {"type": "null"}]:
        value = {**value, "anyOf": ways} if len(ways) > 1 else {**ways[0], **value}
    if isinstance(value.get("table"), str):
        value["$ref"] = f"#/$defs/{value.pop('table')}"
    empty = "default" in value and value["default"] in (None, "", [], {})
    left_out = {"$defs", "default" if empty else "", "title" if isinstance(value.get("title"), str) else ""}
    return {key: _tidy(one) for key, one in value.items() if key not in left_out}
