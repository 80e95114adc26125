"""Study files, the only place that knows TOML: they are read, and written of what is simulated or planned.

A run is waited for: what another kind of study needs is imported when one is read.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from imubayes.campaign import NoiseQuestion, Sampling, SensorSpec, Study, file_name
from imubayes.errors import Place, StudyError
from imubayes.selection.verdicts import Costs
from imubayes.sensors.terms import Kind
from imubayes.study.schema.run_tables import located
from imubayes.study.schema.sensor_tables import headed, sensors_of
from imubayes.study.schema.shapes import arguments, hint, shaped
from imubayes.study.schema.tables import NOISE, SAMPLING, DecisionTable, StudyFile
from imubayes.work import Progress, silent

if TYPE_CHECKING:
    from imubayes.planning.offers import PlanStudy
    from imubayes.planning.proposal import Proposal
    from imubayes.population import FleetStudy
    from imubayes.population.lots import LotStudy
    from imubayes.rig.inputs import Run

    AnyStudy = Study | LotStudy | FleetStudy

ASKED = "?"
"""Value of a key that 'imubayes init' could not guess, and that is to be filled in."""


@dataclass(frozen=True, slots=True)
class Form:
    """A kind of study whose file has a table of its own in place of ``[[sensor]]``, and why it has none.

    Beside its own table others may stand.
    """

    what: str
    why: str
    beside: tuple[str, ...] = ()


FORMS: Mapping[str, Form] = {
    "lots": Form("a class-level study", "draws the units of its own classes", ("scene",)),
    "fleet": Form("a study of a fleet", "describes its one kind of sensor itself"),
}
"""Kinds of study by their table; a file with none of them is a study of sensors."""

OF_THE_TOOL: Mapping[str, str] = {"quality": "decision_quality", "extremes": "extremes", "speed": "speed"}
"""Studies about the tool, which no file describes, by the table that they once had: modules of `studies`."""

SENSORS = "sensor"
"""The kind of study that has the others' tables."""

OF_SENSORS = (SENSORS, "sampling", "decision", "noise", "appendix", "scene", "plan")
"""Tables of a study of sensors."""

PLANNED = "plan.toml"
"""Name of the study of the planned runs."""

TRUTH = "truth.json"
"""Coefficients of the simulated sensors, SI, by sensor and term."""


def read(path: Path | str) -> tuple[str, AnyStudy]:
    """Read and check a study file of any kind, a key of `FORMS`, or `SENSORS`; give both.

    Raises
    ------
    StudyError : naming the file and the key, what was expected, what came, and what to do.
    """
    tables, place, text = _tables(path)
    kind = kind_of(tables, place)
    if kind == SENSORS:
        return kind, _study(tables, place, text)
    from imubayes.study.schema.unit_tables import fleet_study, lot_study

    return kind, (lot_study if kind == "lots" else fleet_study)(tables, place, text)


def kind_of(tables: StudyFile, place: Place) -> str:
    """Kind of a study by its tables."""
    kinds = [key for key in FORMS if getattr(tables, key) is not None]
    if len(kinds) > 1:
        both = " and ".join(f"[{key}] ({FORMS[key].what})" for key in kinds)
        raise place.error(f"holds {both}: a file is one study, expected a file for each")
    for kind in kinds:
        for key in OF_SENSORS:
            if getattr(tables, key) and key not in FORMS[kind].beside:
                why = FORMS[kind].why if key == SENSORS else "has no such table"
                raise place.at(key).error(f"{FORMS[kind].what} {why}: leave it out")
    return kinds[0] if kinds else SENSORS


def read_study(path: Path | str) -> Study:
    """Read and check a study of sensors from a TOML file; paths in it are relative to it."""
    return _study(*_of_sensors(path))


def _of_sensors(path: Path | str) -> tuple[StudyFile, Place, str]:
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
    sensors, scenes, appendices = sensors_of(tables.sensor, place.at("sensor"), own), (), ()
    if tables.scene or tables.appendix:
        from imubayes.study.schema.scene_tables import appendix, scenes_of

        kinds: set[Kind] = {part.kind for spec in sensors for part in spec.halves}
        there = place.at("appendix")
        appendices = tuple(appendix(raw, there.at(k)) for k, raw in enumerate(tables.appendix))
        scenes = scenes_of(tables.scene, place.at("scene"), header.seed, kinds)
    return Study(
        **about,
        sensors=sensors,
        sampling=sampling,
        appendices=appendices,
        costs=Costs(decision.false_keep, decision.false_drop),
        hierarchical=decision.hierarchy,
        compare=decision.compare,
        scenes=scenes,
        noise=noise,
    )


def read_plan(path: Path | str) -> PlanStudy | LotStudy:
    """Read and check a study with a plan to make, or a class-level one; errors are those of `read_study`."""
    from imubayes.study.schema.plan_tables import plan_study
    from imubayes.study.schema.unit_tables import lot_study

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
    from imubayes.campaign.preparation import runs_of

    study = read_study(path)
    ids = [spec.id for spec in study.sensors]
    if sensor and sensor not in ids:
        raise StudyError(f"{path}: no sensor is called '{sensor}': {hint(sensor, ids)}")
    index = ids.index(sensor) if sensor else 0
    return runs_of(study.sensors[index], study.seed, index)


def _tables(path: Path | str) -> tuple[StudyFile, Place, str]:
    """Tables of a study file, of which only the names are checked, and its text."""
    path = Path(path)
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
        for key, entry in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _asked(entry, place.at(key))


def record_study(study: Study, folder: Path, tell: Progress = silent) -> tuple[Path, ...]:
    """Simulate every simulated run of a study, and write what a recorded study would have; give the files.

    The folder exists; it gets a CSV for each simulated run, ``truth.json``, and a study under the name of the
    original one, in which these runs have a ``file`` in place of ``simulate``.
    """
    from imubayes.campaign.preparation import simulate_sensor
    from imubayes.rig.recordings import write_run

    tables, truths, files = tomllib.loads(study.text), {}, []
    several = len(study.sensors) > 1
    for k, (sensor, table) in enumerate(zip(study.sensors, tables["sensor"], strict=True)):
        tell(f"{sensor.id}, {k + 1} of {len(study.sensors)}", k / len(study.sensors))
        runs, truth = simulate_sensor(sensor, study.seed, k)
        if runs:
            truths[sensor.id] = dict(truth)
        prefix = f"{sensor.id}-" if several else ""
        for run in runs:
            path = folder / f"{file_name(prefix + run.name)}.csv"
            names = [path, *(path.with_stem(f"{path.stem}-{k}") for k in range(2, len(files) + 2))]
            files.append(next(name for name in names if name not in files))
            write_run(run, files[-1], kind=sensor.kind)
            written = next(run_table for run_table in table["run"] if run_table["name"] == run.name)
            del written["simulate"]
            written["file"] = files[-1].name
            if not run.known:
                written["gravity"] = f"{run.gravity!r} m/s^2"
        table.pop("truth", None)
        if table.get("bench") == "drawn":
            del table["bench"]
        _anchor(table, sensor)
    if not files:
        raise StudyError(f"{study.path}: no run is simulated: expected a [sensor.run.simulate] table")
    _make_absolute(tables, Place(str(study.path)))
    truth, toml = folder / TRUTH, folder / study.path.name
    truth.write_text(json.dumps(truths, indent=1) + "\n", encoding="utf-8")
    toml.write_text("\n".join(toml_lines(tables)).lstrip() + "\n", encoding="utf-8")
    return (*files, truth, toml)


def write_planned(proposal: Proposal, folder: Path) -> Path:
    """Write the best plan as a study with simulated runs, one line for each dwell, in a folder that exists.

    Runs that are done are named by their full paths; errors of equipment that it leaves aside are left out.
    """
    from imubayes.planning import pauses, runs_of

    tables = tomllib.loads(proposal.study.text)
    offers = tables.pop("plan")["run"]
    sensor = tables.pop("sensor")[0]
    _make_absolute(tables, Place(str(proposal.study.path)))
    _anchor(sensor, proposal.study.spec)
    for kind in sensor.get("reference", {}).keys() - set(proposal.shown):
        del sensor["reference"][kind]
    lines = [*toml_lines(tables | {"sensor": [sensor]})]
    for offer, steps in runs_of(proposal.best.steps):
        table, rate = offers[offer], f"{1.0 / proposal.menus[offer].interval:g} Hz"
        lines += ["\n[[sensor.run]]", *toml_lines({key: table[key] for key in ("name", "procedure")})]
        lines += ["\n[sensor.run.simulate]", *toml_lines(table["candidates"] | {"rate": rate}), "steps = ["]
        for step, pause in zip(steps, pauses(proposal.menus[offer], steps), strict=True):
            words = proposal.settings[offer][step.setting]
            lines.append(
                f'  {{ at = {step.setting}, pause = "{pause:.9g} s", dwell = "{step.dwell:.9g} s" }},'
                f"  # {', '.join(filter(None, words))}"
            )
        lines.append("]")
    file = folder / PLANNED
    file.write_text("\n".join(lines).lstrip() + "\n", encoding="utf-8")
    return file


def _make_absolute(tables: dict[str, Any], place: Place) -> None:
    """Make the paths absolute of files that are named beside the runs."""
    beside = [(table, "file") for table in (*tables.get("appendix", []), *tables.get("scene", []))]
    for table, key in (*beside, (tables.get("study", {}), "catalogue")):
        if key in table:
            table[key] = str(located(table[key], place).resolve())


def _anchor(table: dict[str, Any], sensor: SensorSpec) -> None:
    """Make the paths of recorded runs absolute."""
    for run, spec in zip(table.get("run", []), sensor.runs, strict=True):
        if spec.file is not None:
            run["file"] = str(spec.file.resolve())


def toml_lines(table: Mapping[str, Any], path: str = "") -> Iterator[str]:
    r"""Write tables, arrays of tables, texts, numbers and lists as TOML.

    Examples
    --------
    >>> list(toml_lines({"study": {"seed": 1}, "sensor": [{"id": "A"}]}))
    ['\n[study]', 'seed = 1', '\n[[sensor]]', 'id = "A"']
    """
    deep = {
        key: value
        for key, value in table.items()
        if isinstance(value, dict)
        or (value and isinstance(value, list) and all(isinstance(entry, dict) for entry in value))
    }
    for key, value in table.items():
        if key not in deep:
            yield f"{_toml_key(key)} = {toml_value(value)}"
    for key, value in deep.items():
        inner = f"{path}.{_toml_key(key)}" if path else _toml_key(key)
        for part in value if isinstance(value, list) else [value]:
            yield f"\n[[{inner}]]" if isinstance(value, list) else f"\n[{inner}]"
            yield from toml_lines(part, inner)


def _toml_key(key: str) -> str:
    return key if re.fullmatch(r"[\w-]+", key, re.ASCII) else toml_value(key)


def toml_value(value: object) -> str:
    """Write a text, a number, a truth value or a list of them as TOML."""
    if isinstance(value, list):
        return f"[{', '.join(toml_value(entry) for entry in value)}]"
    # JSON writes texts, numbers and truth values as TOML does, but for the character DEL
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
