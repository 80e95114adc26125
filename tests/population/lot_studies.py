"""Small class-level studies, shared by tests."""

from pathlib import Path

import numpy as np
from recorded_scenes import recorded

from imubayes.campaign import Mission, SensorSpec
from imubayes.population import Record
from imubayes.population.lots import LotStudy
from imubayes.rig.recordings import RunSpec
from imubayes.scenes.propagation import Budget
from imubayes.sensors.catalogue import coupled, sensor
from imubayes.sensors.terms import library

TUMBLE = RunSpec(
    "tumble", "tumble", simulate={"profile": "tumble", "angles": 12, "planes": 3, "dwell": 20.0, "rate": 0.5}
)
WHIRL = RunSpec(
    "centrifuge",
    "centrifuge",
    simulate={"profile": "centrifuge", "levels": [1.0, 5.0, 20.0], "dwell": 20.0, "rate": 0.5},
)


def shaken(name: str = "shaken", *, still: bool = False):
    """A minute along all axes; at rest, f_z = g alone."""
    t = np.arange(0.0, 60.0, 0.1)
    wave = np.column_stack([np.sin((k + 1.0) * t + k) for k in range(3)])
    up = np.array([0.0, 0.0, 9.8])
    return recorded(name, t, up + (0.0 if still else 8.0) * wave, (0.0 if still else 0.5) * wave)


def small(**options) -> LotStudy:
    """Two classes of accelerometers, two units of each, few terms."""
    lib = library("accelerometer", powers=2, asymmetry=-1)
    entries = (sensor(name, kind="accelerometer") for name in ("mems_tactical", "quartz_flexure_servo"))
    bench = {"plane_zero": 1e-5, "gravity": 1e-5, "turn_on": 1e-4}
    asked = {
        "title": "small",
        "seed": 5,
        "kind": "accelerometer",
        "specs": tuple(
            SensorSpec(one.id, one.kind, one, coupled(lib, one), (TUMBLE, WHIRL), {}, reference=bench)
            for one in entries
        ),
        "units": 2,
        "library": lib,
        "missions": (Mission("shaken", shaken(), Budget("output", 1e-3)),),
        "basic": True,
        "processes": 1,
        "path": Path("small.toml"),
        "text": "",
    }
    return LotStudy(**{**asked, **options})


def record(theta: np.ndarray, **given) -> Record:
    """A unit whose test says the truth to one sd, and that it needs every term."""
    p, ones = len(theta), np.ones(len(theta))
    known = {
        "mean": theta,
        "sd": ones,
        "full_mean": theta,
        "full_sd": ones,
        "inclusion": ones,
        "truth": theta,
    }
    usual = {"number": 0, "name": "any", "verdicts": ("needed",) * p, "noise": (1e-4, 0.0, 0.0), "samples": 1}
    whole = {**usual, **known, **given}
    return Record(**{"R": told(whole["full_mean"], whole["full_sd"]), **whole})


def told(mean: np.ndarray, sd: np.ndarray) -> np.ndarray:
    """Factor of a test that says so of each term, whatever the others are."""
    R = np.diag(np.append(1.0 / sd, 1.0))
    R[:-1, -1] = mean / sd
    return R
