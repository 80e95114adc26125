"""Small fleets, shared by tests."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np

from imubayes.campaign import SensorSpec
from imubayes.population import FleetStudy, parts_of, simulate_unit, simulated_units
from imubayes.rig.recordings import RunSpec, write_run
from imubayes.sensors.catalogue import sensor
from imubayes.sensors.lots import draw_lot
from imubayes.sensors.terms import library
from imubayes.study.schema import read
from imubayes.work import Engine, as_done

CLASS = sensor("mems_tactical", kind="accelerometer")

TUMBLE = RunSpec(
    "tumble", "tumble", simulate={"profile": "tumble", "angles": 12, "planes": 1, "dwell": 10.0, "rate": 0.5}
)
"""Twelve positions, five samples each: a unit takes some 30 ms."""

STUDY = """
[study]
seed = 3
[fleet]
kind = "accelerometer"
class = "mems_tactical"
units = "units/*"
part = 3
[fleet.library]
powers = 1
asymmetry = -1
[[fleet.run]]
name = "tumble"
procedure = "tumble"
file = "tumble.csv"
"""
"""Study of units in folders."""


def fleet(units: int = 8, **options) -> FleetStudy:
    """Simulated units of one class with 15 terms; parts of 3."""
    lib = library("accelerometer", powers=1, asymmetry=-1)
    spec = SensorSpec("fleet", "accelerometer", CLASS, lib, (TUMBLE,), {})
    asked = {
        "title": "small fleet",
        "seed": 5,
        "spec": spec,
        "sensor_class": CLASS,
        "units": simulated_units(CLASS.id, units),
        "part": 3,
        "processes": 1,
        "path": Path("fleet.toml"),
        "text": "units",
    }
    return FleetStudy(**{**asked, **options})


def here(jobs: list[int] | None = None) -> Engine:
    """Engine of this process; keeps a list of how many jobs it was given."""

    def do(work, given: Sequence):
        if jobs is not None:
            jobs.append(len(given))
        return as_done(work, given, 1)

    return "this process", do


def backwards() -> Engine:
    """Engine that does the last job first."""

    def do(work, given: Sequence):
        return ((k, work(*given[k])) for k in reversed(range(len(given))))

    return "this process, from the end", do


def interrupt() -> None:
    """What a person does who stops a study."""
    raise KeyboardInterrupt


def after(parts: int, act: Callable[[], None] = interrupt) -> Callable[..., None]:
    """Progress that acts when so many parts are told of."""
    told = count(1)

    def progress(message: str, share: float | None = None, /) -> None:
        if next(told) == parts:
            act()

    return progress


def recorded(
    folder: Path, names: Sequence[str] = ("A1", "A2", "A3", "A4", "A5"), run: RunSpec = TUMBLE
) -> FleetStudy:
    """Write the runs of some units as files, a folder for each, and a study of them."""
    study = fleet(len(names), spec=replace(fleet().spec, runs=(run,)))
    lot = draw_lot(CLASS, study.spec.library, len(names), np.random.default_rng(8))
    for k, name in enumerate(names):
        (folder / "units" / name).mkdir(parents=True)
        spec = replace(study.spec, truth=lot.truth(k))
        (made,) = simulate_unit(spec, lot, k, np.random.default_rng(k))
        write_run(made, folder / "units" / name / "tumble.csv", kind="accelerometer")
    path = folder / "fleet.toml"
    path.write_text(STUDY, encoding="utf-8")
    return read(path)[1]


def first_part(study: FleetStudy):
    """First part of a simulated fleet."""
    lot = draw_lot(CLASS, study.spec.library, len(study.units), np.random.default_rng([study.seed, 0]))
    return parts_of(study, lot)[0]
