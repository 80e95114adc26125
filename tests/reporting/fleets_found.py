"""A small, complete result of a fleet, made by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from imubayes.campaign import SensorSpec
from imubayes.inference import Share
from imubayes.population import Broken, FleetStudy, Record, simulated_units
from imubayes.population.fleet import FleetResult, Pull
from imubayes.population.pooled import Pooled
from imubayes.population.spreads import InLot, PopulationTerm
from imubayes.sensors.catalogue import sensor
from imubayes.sensors.terms import library

BROKEN = Broken(7, "A<8>", "A8/tumble.csv, line 3: is no number")


def fleet_result(title: str = "Ten <b>units</b>", **options) -> FleetResult:
    """Ten units: bias and scale needed, the rest open; one unit could not be read."""
    entry = sensor("mems_tactical", kind="accelerometer")
    lib = library("accelerometer", powers=1, asymmetry=-1)
    p = len(lib.terms)
    study = FleetStudy(
        title=title,
        seed=3,
        spec=SensorSpec("fleet", "accelerometer", entry, lib, (), {}),
        sensor_class=entry,
        units=simulated_units("mems_tactical", 10),
        part=8,
        processes=2,
        path=Path("fleet.toml"),
        text="[fleet]",
    )
    counts = np.zeros((6, p), dtype=np.int64)
    counts[0, :2], counts[3, 2:] = 9, 9
    found = FleetResult(
        study=study,
        units=9,
        samples=1234,
        terms=tuple(_term(name, needed=j < 2) for j, name in enumerate(lib.names)),
        counts=counts,
        order=Share(2.0, 2.0, 2.0),
        noise=(Share(6e-4, 5e-4, 7e-4), Share(3e-4, 2e-4, 4e-4), Share(3e-6, 2e-6, 4e-6)),
        worst=(pull_of(1, 8.0), pull_of(2, -6.0), pull_of(3, 2.0)),
        farthest=tuple(_record(k, pull, p) for k, pull in ((1, 8.0), (2, -6.0), (3, 2.0))),
        outliers=2,
        limit=4.1,
        broken=(BROKEN,),
        engine="2 processes of this machine",
        seconds=12.0,
    )
    return replace(found, **options)


def _record(k: int, pull: float, p: int) -> tuple[Record, np.ndarray]:
    size = np.full(p, 1e-4)
    said = ("needed", "not needed", *["inseparable"] * (p - 2))
    inclusion, noise = np.linspace(1.0, 0.0, p), (6e-4, 3e-4, 3e-6)
    found = Record(
        k, f"u{k}", k * size, size, k * size, size, inclusion, said, noise, 120, np.eye(p + 1), size
    )
    pulls = np.linspace(-1.0, 1.0, p + 1)
    pulls[0 if k % 2 else -1] = pull
    return found, pulls


def _term(name: str, *, needed: bool) -> PopulationTerm:
    mean, spread = Share(1e-4, 5e-5, 2e-4), Share(3e-4, 2e-4, 5e-4)
    lot = InLot(12 * needed, 12 * (not needed), mean, spread, 1.1e-4, 2.9e-4)
    return PopulationTerm(name, 12, (lot,), Pooled(0.5, Share(0.4, 0.1, 0.8), 1e-3))


def pull_of(k: int, pull: float) -> Pull:
    return Pull(f"u{k}", "b0" if k % 2 else "N", 1e-3 * k, pull, abs(pull) > 4.1)
