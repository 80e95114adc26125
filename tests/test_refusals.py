"""What functions say of what they cannot take, to the letter (`tests/references/messages/calls.txt`).

What a study cannot ask for stands in the other files of that folder; a broken file of a run, beside those of
the terminal.
"""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from imu_units import drawn_imu
from recorded_scenes import recorded

from imubayes.algebra.factor import factor_of
from imubayes.cli import kinds
from imubayes.cli.console import Waiting
from imubayes.cli.kinds import RunOptions
from imubayes.errors import ImubayesError
from imubayes.planning import Menu, PlanProblem, Signal
from imubayes.planning.exchange import best_plan, even_plan
from imubayes.rig.bench import refuse_idle, true_inputs
from imubayes.rig.plans import Plan
from imubayes.rig.rotations import centrifuge, oscillation, rate_table, vibration
from imubayes.rig.sequences import Dwell, in_order, menu_of
from imubayes.rig.simulate import simulate, synthesise
from imubayes.rig.tumbles import positions, static, thermal, tumble
from imubayes.scenes.propagation import propagation
from imubayes.sensors.catalogue import sensor
from imubayes.sensors.equations import in_standard, standard
from imubayes.sensors.equations.basic import project
from imubayes.sensors.equations.ieee647 import slowest_rate
from imubayes.sensors.equations.mapping import alignment
from imubayes.sensors.imu import Component, forward, imu_of, signals, without_lever
from imubayes.sensors.imu_compensation import compensate, error_covariance
from imubayes.sensors.imu_range import input_range
from imubayes.sensors.noise import Noise
from imubayes.sensors.terms import Library, columns, library

STUDIES = Path(__file__).parents[1] / "studies"
ACC, GYRO = library("accelerometer"), library("gyroscope", temperature=1, gradient_of=("b0",))
TWO = Library("gyroscope", library("gyroscope").terms[:2])
TACTICAL = sensor("mems_tactical", kind="accelerometer")
NONE, G, QUIET = np.zeros(len(ACC.terms)), np.full(9, 9.8), Noise(0.0, 0.0, 0.0)
IMU, WITHIN = drawn_imu(9, set="extended", temperature=1), input_range([20.0, 30.0, 20.0], 5.0, dw=1.0)
BUDGET = RunOptions(Path("o"), {"budget": "5 s"})
STILL = signals([[1.0, 2.0, 3.0]])
SHORT = {"dwell": 2.0, "rate": 2.0}
TUMBLE, RAMPED = tumble(angles=24, **SHORT), centrifuge([1, 5, 20], ramp=True, settle=4.0, **SHORT)
LEVEL = centrifuge([5], mounts=3, **SHORT)


def at_rest(plan: Plan, **known: np.ndarray) -> Plan:
    """A plan whose file says nothing of the rate, or what is said here."""
    force = {name: values for name, values in plan.inputs.channels.items() if name[0] == "f"}
    return replace(plan, inputs=replace(plan.inputs, channels={**force, **known}))


def level(n: int, step: float, duration: float | None = None, rate: float = 0.0):
    """Record of a case that lies level and turns, if at all, about the vertical."""
    up = np.tile([0.0, 0.0, 1.0], (n, 1))
    return recorded("level", step * np.arange(n), 9.80665 * up, rate * up, duration=duration)


def problem(limit: float, **times: float) -> PlanProblem:
    """A plan of two settings, of which each tells one of two unknowns."""
    menu = Menu("bench", (Signal(np.eye(2), Noise(1.0, 0.0, 0.0)),), np.zeros(2, dtype=int), (1.0,), **times)
    return PlanProblem((menu,), np.eye(2), "worst", np.eye(2), limit)


CALLS = {
    "a term, a class, a standard": [
        lambda: library("magnetometer"),
        lambda: sensor("mems_tactical", kind="imu"),
        lambda: standard("ieee952", kind="accelerometer"),
        lambda: in_standard("ieee952", TWO, np.zeros(2), np.ones(2)),
        lambda: alignment(-1.5, 0.0, 0.0),
        lambda: slowest_rate(1.0, 0.0),
        lambda: project(ACC, NONE, factor_of(np.eye(3), np.zeros(3), ("b0", "b1", "b2"))),
        lambda: project(ACC, NONE, factor_of(columns(ACC, {"f_i": G}, 9), np.zeros(9), ACC.names)),
    ],
    "an IMU": [
        lambda: Component(GYRO, np.zeros(len(GYRO.names))),
        lambda: imu_of({"ax": Component(Library("accelerometer", ()), np.zeros(2))}),
        lambda: imu_of({"bx": Component(ACC, NONE)}),
        lambda: imu_of({"gx": Component(ACC, NONE)}),
        lambda: imu_of({}, [[0.0, 0.0, 0.0]]),
        lambda: without_lever("ax", Component(ACC, NONE), [0.01, 0.0, 0.0]),
        lambda: signals([[0.0, 0.0, 1.0]], [[0.0, np.nan, 1.0]]),
        lambda: signals(np.zeros((2, 3)), T=[1.0]),
        lambda: compensate(IMU, forward(IMU, signals([[1.0, 2.0, 3.0], [1.0, 32.0, 3.0]])), WITHIN),
        lambda: compensate(IMU, replace(STILL, dw=np.array([[0.0, 9.0, 0.0]])), WITHIN),
        lambda: compensate(IMU, replace(STILL, T=np.array([340.0])), WITHIN),
        lambda: error_covariance(IMU, np.eye(3), STILL),
    ],
    "a procedure": [
        lambda: static(math.nan, 10.0),
        lambda: static(1.0, 1.0, latitude=0.5, north=(-2.0, 0.0, 0.0)),
        lambda: static(1.0, 1.0, latitude=0.5, north=(0.0, 1.0, math.inf)),
        lambda: tumble(angles=0),
        lambda: positions(6, latitude=math.nan),
        lambda: rate_table([math.inf]),
        lambda: centrifuge([1.0], mounts=0),
        lambda: oscillation([0.0]),
        lambda: vibration([1.0], band=(0.0, 100.0)),
        lambda: vibration([1.0], band=(20.0, math.inf)),
        lambda: thermal([-40.0]),
        lambda: thermal([math.nan]),
        lambda: thermal([300.0], ramp=0.0),
        lambda: thermal([300.0], dwell=-1.0),
        *(
            lambda steps=steps: in_order(menu_of(tumble, {"angles": 4, "planes": 1}), steps, rate=1.0)
            for steps in ([], [Dwell(4, 1.0)], [Dwell(-1, 1.0)], [Dwell(0, 1.0, -1.0)], [Dwell(0, 0.0)])
        ),
    ],
    "a simulation": [
        *(
            lambda name=name: simulate(TACTICAL, [static(1.0, 10.0)], seed=1, truth={name: 1.0})
            for name in ("b13", "g_i", "K2", "b0*T13", "")
        ),
        *(
            lambda t=t, step=step: synthesise(QUIET, np.array(t), step, np.random.default_rng(0))
            for t, step in (
                ([], 1.0),
                ([0.0, 0.0], 1.0),
                ([1.0, 0.0], 1.0),
                ([0.0, math.nan], 1.0),
                ([0.0], 0.0),
            )
        ),
    ],
    "an error of the bench": [
        lambda: true_inputs(TUMBLE, {"gravty": 1.0}),
        lambda: true_inputs(replace(TUMBLE, inputs=replace(TUMBLE.inputs, mount=None)), {"table_zero": 1e-5}),
        lambda: true_inputs(tumble(angles=2, planes=1, **SHORT), {"table_zero": 1e-5}),
        *(
            lambda name=name: true_inputs(at_rest(RAMPED), {name: 1e-5})
            for name in ("gravity", "radius", "arm_stretch", "rate_scale.centrifuge")
        ),
        lambda: refuse_idle([TUMBLE, rate_table([1.0], mounts=2, **SHORT)], ["gravity", "radius"]),
        lambda: refuse_idle([LEVEL], ["plane_zero"]),
        lambda: refuse_idle([TUMBLE], ["rate_scale"]),
        lambda: refuse_idle([TUMBLE, static(10.0, 1.0)], ["latency"]),
        lambda: refuse_idle([TUMBLE, at_rest(LEVEL)], ["radius"]),
        lambda: refuse_idle([TUMBLE, at_rest(LEVEL, w_i=np.zeros(len(LEVEL.inputs)))], ["radius"]),
    ],
    "a scene": [
        lambda: propagation("accelerometer", level(2, 1.0), [30_000.0]),
        lambda: propagation("accelerometer", level(2, 60.0), [60.0]),
        lambda: propagation("accelerometer", level(9, 1.0, rate=6.5), [9.0]),
        lambda: propagation("gyroscope", level(60, 1.0, 0.3), [0.3]),
    ],
    "a plan": [lambda: best_plan(problem(0.5)), lambda: even_plan(problem(4.6, settle=2.0, lost=0.3), 0)],
    "a command": [
        lambda: kinds.trade(STUDIES / "fleet.toml", [], [], Waiting(), repeats=0, limit=1.0),
        lambda: kinds.run(
            STUDIES / "quickstart.toml", kinds.RunOptions(Path("o"), scheduler="local"), Waiting()
        ),
        lambda: kinds.run(STUDIES / "accelerometer_grades.toml", BUDGET, Waiting()),
    ],
}
"""Calls by what they are of."""


def test_what_a_function_cannot_take_is_refused_in_these_words(golden):
    told = []
    for of, calls in CALLS.items():
        told.append(f"[{of}]\n")
        for call in calls:
            with pytest.raises(ImubayesError) as caught:
                call()
            terms = ", ".join(getattr(caught.value, "terms", ()))
            told.append(f"{type(caught.value).__name__}{f' of {terms}' if terms else ''}: {caught.value}\n")
    golden("messages/calls.txt", "".join(told).replace(f"{STUDIES}/", ""))
