"""A small result of every kind that has a page: the page, its file of numbers, its lines in a terminal."""

import contextlib
import json
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from fleets_found import fleet_result
from lots_found import lot_library, lot_result
from plan_studies import SMALL
from populations_found import class_found
from results_found import (
    APPENDIX,
    judged_result,
    recovered,
    repeatability,
    sampled_result,
    sensor_result,
    study_result,
)
from rich.console import RenderableType
from scenes_found import a_case, a_relevance
from trades_found import traded

from imubayes.campaign import Mission
from imubayes.inference import Share
from imubayes.planning.hours import HoursFound, hours
from imubayes.planning.proposal import Proposal, propose
from imubayes.population.lots import LotResult
from imubayes.reporting.blocks import Page, page_html
from imubayes.reporting.comparison import side_by_side
from imubayes.reporting.document import report_page
from imubayes.reporting.fleet_page import fleet_json, fleet_page
from imubayes.reporting.hours_page import hours_json, hours_page
from imubayes.reporting.lots_page import lots_json, lots_page
from imubayes.reporting.plan_page import plan_json, plan_page
from imubayes.reporting.result.file import json_text
from imubayes.reporting.results import result_json
from imubayes.reporting.trade_page import trade_json, trade_page
from imubayes.scenes.trajectories import generated, scene_named
from imubayes.study import StudyResult
from imubayes.study.schema import read_plan


@dataclass(frozen=True, slots=True)
class Made:
    """A page, the text of its ``result.json``, and its lines in a terminal."""

    html: str
    values: str
    terminal: RenderableType


@cache
def made(kind: str, name: str = "A-1") -> Made:
    """Make a page of a kind, with a name wherever a name comes from a file."""
    return KINDS[kind](name)


def _study(found: StudyResult) -> Made:
    return _made(report_page(found), result_json(found))


def _made(page: Page, values: str) -> Made:
    return Made(page_html(page), values, page)


def _sensors(name: str) -> Made:
    """An accelerometer with every other method, a misfit and a scene, and a gyroscope beside it."""
    first = judged_result(name, runs=(name, "b"), misfit=name, column=name)
    votes, misfit = first.panel.votes, replace(first.misfit, text=f"The residuals of {name} hold more.")
    told = (replace(votes.disagreements[0], text=f"one keeps {name}"),)
    panel = replace(first.panel, votes=replace(votes, disagreements=told))
    first = replace(first, panel=panel, misfit=misfit)
    other = sensor_result(f"{name}-2", lib=lot_library(), runs=("rates",))
    scene = replace(a_relevance(), scene=name)
    found = replace(study_result(first, other, title=name), scenes=((first.id, scene),))
    met = generated(scene_named("quadrotor"), np.random.default_rng(1), duration=60.0)
    mission = Mission(name, met, scene.budget)
    return _study(replace(found, study=replace(found.study, scenes=(mission,))))


def _chains(name: str) -> Made:
    """A sampled accelerometer with errors of the bench and distrusted dwells, sessions and an appendix."""
    sensor = sampled_result(name, runs=(name,))
    extras = tuple(replace(one, extra=replace(one.extra, text=f"error of {name}")) for one in sensor.extras)
    sensor = replace(sensor, extras=extras, method_reason=f"it was asked of {name}")
    found = study_result(sensor, title=name)
    table = replace(APPENDIX, title=name, note=name, command=name, header=(name, "b"))
    sessions = (repeatability("b0"), repeatability("b1", exceeds=False))
    return _study(replace(found, study=replace(found.study, appendices=(table,)), sessions=sessions))


def _cases(name: str) -> Made:
    """Two triads with what their cases recover, and what the units of a class have in common."""
    pooled = {"b0": 1.0, "b0p": 0.97, "b3": 0.01, "c_jk": 0.86}
    first = replace(sensor_result(runs=("hand",)), pooled=pooled, recovered=(recovered(),))
    sensors = (replace(first, id=f"{name}{k}.a{axis}") for k in range(2) for axis in "xyz")
    found = replace(study_result(*sensors, title=name), classes=(class_found(),))
    return _study(replace(found, case_scenes=((f"{name}0", a_case(f"{name}0", name)),)))


def _lots(name: str) -> Made:
    found = lot_result(title=name)
    return _made(lots_page(found), lots_json(found))


def _fleet(name: str) -> Made:
    found = fleet_result(name)
    broken = tuple(replace(one, name=name, error=f"{name}: is no number") for one in found.broken)
    found = replace(found, broken=broken)
    return _made(fleet_page(found), fleet_json(found))


def _trade(name: str) -> Made:
    found = traded(name=name)
    return _made(trade_page(found), trade_json(found))


def _named(name: str) -> str:
    """The small plan with a name wherever one comes from a file."""
    quoted = json.dumps(name)
    return (
        SMALL.replace('"Before the test"', quoted)
        .replace('"A"', quoted)
        .replace('name = "tumble"', f"name = {quoted}")
    )


@cache
def plan_found(name: str = "A-1") -> Proposal:
    """Times of a small plan."""
    return replace(propose(_asked("plan.toml", _named(name))), seconds=1.0)


def _plan(name: str) -> Made:
    found = plan_found(name)
    return _made(plan_page(found), plan_json(found))


HOURS = """
[study]
title = {name}
seed = 3
[lots]
kind = "gyroscope"
classes = ["mems_industrial", "fog_navigation"]
[lots.library]
powers = 2
asymmetry = 1
set = "extended"
[lots.reference]
rate_scale = true
fixture = "5 arcsec"
[[lots.run]]
name = "rates"
procedure = "rate-table"
simulate = {{ rates = ["10 deg/s", "-10 deg/s", "90 deg/s"], mounts = 6, dwell = "20 min", rate = "0.01 Hz" }}
[[scene]]
name = "quadrotor"
duration = "1 min"
budget = {{ attitude = "0.01 deg" }}
"""


def _asked(file: str, text: str) -> Any:
    with _in_a_folder():
        Path(file).write_text(text, encoding="utf-8")
        return read_plan(Path(file))


@cache
def hours_found(name: str = "A-1") -> HoursFound:
    """Hours that two classes need."""
    return replace(hours(_asked("hours.toml", HOURS.format(name=json.dumps(name)))), seconds=1.0)


def _hours(name: str) -> Made:
    found = hours_found(name)
    return _made(hours_page(found), hours_json(found))


def _compared(*texts: str) -> Made:
    """Results side by side, A and B by their file's name."""
    with _in_a_folder():
        files = [Path(f"{letter}.json") for letter in "ab"]
        for file, text in zip(files, texts, strict=True):
            file.write_text(text, encoding="utf-8")
        page, values = side_by_side(files)
    return _made(page, json_text(values))


def _compared_sensors(name: str) -> Made:
    """The second sensor has another id, another b2 by 50 sd, and no need of it in the scene."""
    texts = []
    for sensor_id, moved in (("A", 0.0), (name, 50.0)):
        sensor, scene = sensor_result(sensor_id), a_relevance()
        terms = tuple(
            replace(t, full_mean=t.full_mean + moved * t.full_sd, verdict="undecided" if moved else t.verdict)
            if t.name == "b2"
            else t
            for t in sensor.selection.terms
        )
        sensor = replace(sensor, selection=replace(sensor.selection, terms=terms))
        if moved:
            kept = (replace(t, kept=t.kept and t.name != "b2") for t in scene.terms)
            scene = replace(scene, model=("b0",), terms=tuple(kept))
        texts.append(result_json(replace(study_result(sensor, title=name), scenes=((sensor_id, scene),))))
    return _compared(*texts)


def _moved(found: LotResult) -> LotResult:
    """The first class with another mean of its first term, and with no need of any in its first scene."""
    first = found.classes[0]
    scene = first.missions[0]
    none = replace(scene, terms=tuple(replace(term, required=0.0) for term in scene.terms))
    first = replace(first, missions=(none, *first.missions[1:]))
    mean = Share(1e3, 0.9e3, 1.1e3)
    lots = tuple(replace(lot, mean=mean) for lot in first.terms[0].lots)
    terms = (replace(first.terms[0], lots=lots), *first.terms[1:])
    return replace(found, classes=(replace(first, terms=terms), *found.classes[1:]))


def _compared_lots(name: str) -> Made:
    found = lot_result(title=name)
    return _compared(lots_json(found), lots_json(_moved(found)))


def _compared_units(name: str) -> Made:
    unit = study_result(sensor_result(name, lib=lot_library()), title=name)
    return _compared(result_json(unit), lots_json(lot_result(title=name)))


@contextlib.contextmanager
def _in_a_folder():
    """Work in a folder of its own, so that a page names its files alike each time."""
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        yield


KINDS: dict[str, Callable[[str], Made]] = {
    "sensors": _sensors,
    "chains": _chains,
    "cases": _cases,
    "lots": _lots,
    "fleet": _fleet,
    "trade": _trade,
    "plan": _plan,
    "hours": _hours,
    "compared_sensors": _compared_sensors,
    "compared_lots": _compared_lots,
    "compared_units": _compared_units,
}
