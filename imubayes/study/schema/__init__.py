"""Study files, the only place that knows TOML: they are read, and written of what is simulated or planned."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from imubayes.campaign import SensorSpec, Study, file_name
from imubayes.campaign.preparation import simulate_sensor
from imubayes.errors import Place, StudyError
from imubayes.planning import pauses, runs_of
from imubayes.progress import Progress, silent
from imubayes.rig.recordings import write_run
from imubayes.study.schema.reading import read, read_plan, read_runs, read_study
from imubayes.study.schema.run_tables import located

if TYPE_CHECKING:
    from imubayes.planning.proposal import Proposal

__all__ = ["read", "read_plan", "read_runs", "read_study", "record_study"]


PLANNED = "plan.toml"
"""Name of the study of the planned runs."""

TRUTH = "truth.json"
"""Coefficients of the simulated sensors, SI, by sensor and term."""


def record_study(study: Study, folder: Path, tell: Progress = silent) -> tuple[Path, ...]:
    """Simulate every simulated run of a study, and write what a recorded study would have; give the files.

    The folder exists; it gets a CSV for each simulated run, ``truth.json``, and a study under the name of the
    original one, in which these runs have a ``file`` in place of ``simulate``.
    """
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
            written = next(one for one in table["run"] if one["name"] == run.name)
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


def write_planned(found: Proposal, folder: Path) -> Path:
    """Write the best plan as a study with simulated runs, one line for each dwell, in a folder that exists.

    Runs that are done are named by their full paths.
    """
    tables = tomllib.loads(found.study.text)
    offers = tables.pop("plan")["run"]
    sensor = tables.pop("sensor")[0]
    _make_absolute(tables, Place(str(found.study.path)))
    _anchor(sensor, found.study.spec)
    lines = [*toml_lines(tables | {"sensor": [sensor]})]
    for offer, steps in runs_of(found.best.steps):
        table, rate = offers[offer], f"{found.study.offers[offer].rate:g} Hz"
        lines += ["\n[[sensor.run]]", *toml_lines({key: table[key] for key in ("name", "procedure")})]
        lines += ["\n[sensor.run.simulate]", *toml_lines(table["candidates"] | {"rate": rate}), "steps = ["]
        for step, pause in zip(steps, pauses(found.menus[offer], steps), strict=True):
            words = found.settings[offer][step.setting]
            lines.append(
                f'  {{ at = {step.setting}, pause = "{pause:.9g} s", dwell = "{step.dwell:.9g} s" }},'
                f"  # {', '.join(filter(None, (words.mount, words.at)))}"
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
        or (value and isinstance(value, list) and all(isinstance(one, dict) for one in value))
    }
    for key, value in table.items():
        if key not in deep:
            yield f"{_toml_key(key)} = {toml_value(value)}"
    for key, value in deep.items():
        inner = f"{path}.{_toml_key(key)}" if path else _toml_key(key)
        for one in value if isinstance(value, list) else [value]:
            yield f"\n[[{inner}]]" if isinstance(value, list) else f"\n[{inner}]"
            yield from toml_lines(one, inner)


def _toml_key(key: str) -> str:
    return key if re.fullmatch(r"[\w-]+", key, re.ASCII) else toml_value(key)


def toml_value(value: object) -> str:
    """Write a text, a number, a truth value or a list of them as TOML."""
    if isinstance(value, list):
        return f"[{', '.join(toml_value(one) for one in value)}]"
    # JSON writes texts, numbers and truth values as TOML does, but for the character DEL
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
