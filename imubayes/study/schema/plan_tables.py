"""The ``[plan]`` table becomes a `PlanStudy`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any, Literal

import numpy as np

from imubayes.campaign import Mission, SensorSpec
from imubayes.campaign.preparation import libraries_of
from imubayes.inference.stills import FEWEST_IN_WINDOW, SHORTEST, WINDOW
from imubayes.planning import Menu
from imubayes.planning.offers import PlanStudy, named
from imubayes.rig.recordings import CASES, FREE_TUMBLE
from imubayes.sensors import SensorClass
from imubayes.study.schema.scene_tables import scenes_of
from imubayes.study.schema.sensor_tables import headed, sensor_spec
from imubayes.study.schema.shapes import Names, Place, Several, Table, Text, hint, holds, key, shape, shaped
from imubayes.study.schema.tables import StudyFile
from imubayes.units import Count, Hertz, Pause, Seconds

PLANNED = ("tumble", "rate-table", "centrifuge", "free-tumble")
"""Procedures whose dwells have constant inputs, and stills in the hand."""

LOST = {False: 0.3, True: 0.85}
"""Share of the window that a still loses at its ends; gyroscopes (True) see a turn begin earlier."""

IN_PLANE = ("table_zero", "plane_zero")
"""Errors that need a whole plane of a tumble, of which a plan may take a few positions."""


@shape
class OfferTable:
    """``[[plan.run]]``."""

    name: Text = key("of the run", "tumble")
    procedure: Text = key(
        "`tumble`, `rate-table` or `centrifuge`: dwells with constant inputs; `free-tumble`: stills in the"
        " hand",
        "tumble",
    )
    candidates: Table = key(
        "what could be set, as the procedure's `simulate` without its times", {"angles": 24, "planes": 3}
    )
    dwell: Annotated[tuple[Seconds, ...], Several] = key("that a dwell may take", ["60 s", "180 s"])
    rate: Hertz = key("of the samples", "1 Hz", "10 Hz")
    settle: Pause = key("before every dwell", "10 s", "5 s")
    mount: Pause = key("more of it for another mount", "5 min", "0 s")
    setup: Pause = key("once, if the run is made at all", "30 min", "0 s")


@shape
class PlanTable:
    """``[plan]``."""

    time: Seconds = key("for all of it, handling included", "4 h")
    aim: Literal["worst", "D", "scene"] = key(
        "what to make small: `worst`, the worst-determined needed term (over what the scene needs of it, or"
        " else over its prior sd); `D`, the volume of what is left open of them; `scene`, the error that is"
        " left open in the `[[scene]]`",
        "scene",
        "worst",
    )
    needed: Names = key(
        "terms that the aim is about; of a case `ax.b0` is one, and `b0` that of all components",
        ["b0", "b1"],
        [],
        "what the candidates can tell",
    )
    even: Text | None = key(
        "the run that the plan is held against: all its positions in order, evenly, in the same time",
        "tumble",
        None,
        "the first",
    )
    units: Count = key("simulated to check the prediction", 1000, 200)
    run: Annotated[list[Table], holds(OfferTable, many="list")] = key(
        "what could be done: one `[[plan.run]]` for each",
        [{"name": "tumble", "procedure": "tumble", "candidates": {"angles": 24}, "dwell": ["1 min"]}],
        list,
        "needed",
    )


def plan_study(tables: StudyFile, place: Place, text: str) -> PlanStudy:
    """Check a study with a plan to make."""
    here = place.at("plan")
    if tables.plan is None:
        raise here.error("the table is missing: it says what could be done, and in what time")
    table = shaped(PlanTable, tables.plan, here)
    about, header, own = headed(tables, place, text)
    if len(tables.sensor) != 1:
        raise place.at("sensor").error(
            f"a plan is for one sensor: expected one table, came {len(tables.sensor)}"
        )
    offers = [shaped(OfferTable, raw, here.at("run", k)) for k, raw in enumerate(table.run)]
    spec = _with_offers(tables.sensor[0], offers, own, place)
    done, needed = len(spec.runs) - len(offers), _needed(table.needed, spec, here.at("needed"))
    names = [offer.name for offer in offers]
    if table.even is not None and table.even not in names:
        raise here.at("even").error(f"'{table.even}' is no run of the plan: {hint(table.even, names)}")
    return PlanStudy(
        **about,
        spec=_of_runs(spec, slice(done)),
        offered=_of_runs(spec, slice(done, None)),
        offers=tuple(_menu(offer, imu=spec.gyroscope is not None) for offer in offers),
        time=table.time,
        aim=table.aim,
        needed=needed,
        even=names.index(table.even) if table.even else 0,
        units=table.units,
        mission=_mission(tables, table, spec, header.seed, place),
    )


def _menu(offer: OfferTable, *, imu: bool) -> Menu:
    """Times of a run that could be made; stills in the hand lose some at their ends."""
    lost = WINDOW * LOST[imu] if offer.procedure == FREE_TUMBLE else 0.0
    times = offer.settle, offer.mount, offer.setup, lost
    return Menu(offer.name, (), np.zeros(0, dtype=np.int64), offer.dwell, 1.0 / offer.rate, *times)


def _of_runs(spec: SensorSpec, which: slice) -> SensorSpec:
    """What is asked of a sensor in some of its runs: those that are done, or those that are offered."""
    beside = spec.gyroscope and _of_runs(spec.gyroscope, which)
    return replace(spec, runs=spec.runs[which], gyroscope=beside)


def _with_offers(
    raw: Mapping[str, Any], offers: Sequence[OfferTable], own: Sequence[SensorClass], place: Place
) -> SensorSpec:
    """Check the sensor with what is offered as further runs: they are checked alike."""
    here, runs, called = place.at("plan", "run"), list(raw.get("run", [])), dict[str, str]()
    if not offers:
        raise here.error("there is none: expected at least one [[plan.run]] table")
    for k, offer in enumerate(offers):
        _check_offer(offer, raw, here.at(k))
        called[f"sensor[0].run[{len(runs)}]"] = f"plan.run[{k}]"
        called[f"plan.run[{k}].simulate"] = f"plan.run[{k}].candidates"
        runs.append({"name": offer.name, "procedure": offer.procedure, "simulate": offer.candidates})
    there = replace(place, called=called).at("sensor", 0)
    spec = sensor_spec({**raw, "run": runs}, there, own)
    for kind in IN_PLANE:
        if kind in spec.reference:
            raise there.at("reference", kind).error(
                "needs whole planes, of which a plan may take a few positions: give fixture, which holds it"
            )
    return spec


def _check_offer(offer: OfferTable, sensor: Mapping[str, Any], place: Place) -> None:
    """Refuse what cannot be planned; a test in the hand whose stills would not be found."""
    if offer.procedure not in PLANNED:
        raise place.at("procedure").error(
            f"'{offer.procedure}' cannot be planned: expected {' or '.join(PLANNED)}, whose dwells have"
            " constant inputs"
        )
    if not offer.dwell:
        raise place.at("dwell").error('expected one time or more, such as ["60 s"]')
    for name in ("dwell", "rate", "settle", "ramp", "steps"):
        if name in offer.candidates:
            raise place.at("candidates", name).error("is for a run, not its candidates: leave it out")
    if offer.procedure != FREE_TUMBLE:
        return
    if sensor.get("kind") == "gyroscope":
        raise place.at("procedure").error(
            'is planned with accelerometers: expected kind = "accelerometer" or "imu", or another procedure'
        )
    if min(offer.dwell) < WINDOW + SHORTEST:
        raise place.at("dwell").error(
            f"a still of {SHORTEST:g} s is told from motion by a window of {WINDOW:g} s beside it:"
            f" expected {WINDOW + SHORTEST:g} s or more, came {min(offer.dwell):g} s"
        )
    if not offer.settle > 0.0:
        raise place.at("settle").error('is the time of a turn: expected more than 0 s, such as "2 s"')
    if offer.rate * WINDOW < FEWEST_IN_WINDOW:
        raise place.at("rate").error(
            f"is too slow to tell stills from turns: expected {FEWEST_IN_WINDOW / WINDOW:g} Hz or more"
        )


def _needed(asked: tuple[str, ...], spec: SensorSpec, place: Place) -> tuple[str, ...]:
    """Columns that are asked for: of a case, a term without a component is meant of all that have it."""
    known = {named(part, name): name for part, lib in libraries_of(spec).items() for name in lib.names}
    for k, wish in enumerate(asked):
        if wish not in known and wish not in known.values():
            raise place.at(k).error(f"'{wish}' is not a term of the library: {hint(wish, list(known))}")
    return tuple(column for wish in asked for column, name in known.items() if wish in (name, column))


def _mission(
    tables: StudyFile, table: PlanTable, spec: SensorSpec, seed: int, place: Place
) -> Mission | None:
    here, aim = place.at("scene"), place.at("plan", "aim")
    if spec.gyroscope or spec.runs[0].procedure in CASES:
        if tables.scene or table.aim == "scene":
            raise (here if tables.scene else aim).error(
                "a plan for several components is made for their terms: leave it out"
            )
        return None
    missions = scenes_of(tables.scene, here, seed, {spec.kind})
    if len(missions) > 1:
        raise here.error(f"a plan is for one scene: expected one table, came {len(missions)}")
    if table.aim == "scene" and not missions:
        raise aim.error("'scene' needs a [[scene]] with its budget: add one, or choose worst or D")
    return missions[0] if missions else None
