"""Small problems for every rung, shared by tests."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import made
import numpy as np

from imubayes.campaign import SensorSpec
from imubayes.ladder.problem import Ground, Problem, ground_of, problem_of
from imubayes.rig.recordings import RunSpec
from imubayes.rig.simulate import simulate_runs, synthesise
from imubayes.sensors.catalogue import sensor
from imubayes.sensors.noise import Noise, NoiseRule
from imubayes.sensors.terms import library
from imubayes.work import silent

TRUTH = {"b0": 0.015, "b1": 3e-4, "m_j": 3.5e-4}


def problem(
    *, seed: int = 1, rule: NoiseRule | None = None, reference: dict | None = None, **options
) -> Problem:
    """A tumble of a tactical accelerometer: bias, scale, quadratic and cross terms."""
    profile = {"profile": "tumble", "angles": 12, "planes": 3, "dwell": 10.0, "rate": 4.0} | options
    run = RunSpec("tumble", "tumble", simulate=profile, noise=rule or NoiseRule())
    entry = sensor("mems_tactical", kind="accelerometer")
    lib = library("accelerometer", powers=2, asymmetry=-1)
    spec = SensorSpec("<ACC>", "accelerometer", entry, lib, (run,), TRUTH, reference=reference or {})
    runs, _ = simulate_runs(spec.runs, entry, lib, truth=TRUTH, rng=np.random.default_rng(seed))
    return problem_of(spec, runs)


def in_memory_and_streamed(folder: Path, n: int = 9000) -> tuple[Problem, Problem]:
    """The same recording twice: its rows in memory, and read a part at a time.

    Twelve positions with gaps between them, drift beside white noise, and a bias, scale and misalignment.
    """
    rng, interval = np.random.default_rng(5), 0.1
    noise = Noise(6e-4, 4e-4, 3e-6)
    t = interval * np.arange(n) + 5.0 * (np.arange(n) * 12 // n)
    angle = 2.0 * np.pi / 12.0 * (np.arange(n) * 12 // n)
    f_i, f_j = 9.8 * np.cos(angle), 9.8 * np.sin(angle)
    output = f_i + 0.015 + 3e-4 * f_i + 3.5e-4 * f_j + synthesise(noise, t, interval, rng)
    table = {"t [s]": t, "f_i [m/s^2]": f_i, "f_j [m/s^2]": f_j, "output [m/s^2]": output}
    run = made.written(table, folder, "tumble")
    spec = replace(problem().spec, runs=(run,), truth={})
    whole, part = (problem_of(spec, [one]) for one in made.both_ways(run, 2048))
    return whole, part


def ground(one: Problem, seed: int = 2) -> Ground:
    """Ground of a problem on which no rung has been."""
    return ground_of(one, np.random.default_rng(seed), silent, None)
