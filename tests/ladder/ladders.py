"""Small problems for every rung, shared by tests."""

from __future__ import annotations

import numpy as np

from imubayes.campaign import SensorSpec
from imubayes.ladder.problem import Ground, Problem, ground_of, problem_of
from imubayes.rig.runs import RunSpec, simulate_runs
from imubayes.sensors.catalogue import sensor
from imubayes.sensors.noise import NoiseRule
from imubayes.sensors.terms import library

TRUTH = {"b0": 0.015, "b1": 3e-4, "m_j": 3.5e-4}


def problem(*, seed: int = 1, rule: NoiseRule | None = None, **options) -> Problem:
    """A tumble of a tactical accelerometer: bias, scale, quadratic and cross terms."""
    profile = {"profile": "tumble", "angles": 12, "planes": 3, "dwell": 10.0, "rate": 4.0} | options
    run = RunSpec("tumble", "tumble", simulate=profile, noise=rule or NoiseRule())
    entry, lib = (
        sensor("mems_tactical", kind="accelerometer"),
        library("accelerometer", powers=2, asymmetry=-1),
    )
    spec = SensorSpec("unit", "accelerometer", entry, lib, (run,), TRUTH)
    runs, _ = simulate_runs(spec.runs, entry, lib, truth=TRUTH, rng=np.random.default_rng(seed))
    return problem_of(spec, runs)


def ground(one: Problem, seed: int = 2) -> Ground:
    """Ground of a problem on which no rung has been."""
    return ground_of(one, np.random.default_rng(seed), lambda message: None, None)
