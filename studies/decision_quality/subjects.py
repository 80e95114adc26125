"""Simulated sensors whose truth is known, and the runs that test them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.inference.prior import class_sd
from imubayes.rig.bench import true_inputs
from imubayes.rig.checks import OutputLevels, beyond
from imubayes.rig.inputs import Run
from imubayes.rig.plans import Plan
from imubayes.rig.rotations import centrifuge, rate_table
from imubayes.rig.simulate import simulate, synthesise
from imubayes.rig.tumbles import tumble
from imubayes.sensors.catalogue import SensorClass, classes, coupled
from imubayes.sensors.noise import Noise, noise_prior
from imubayes.sensors.terms import Kind, Library, library
from imubayes.units import STANDARD_GRAVITY
from studies.decision_quality.faults import INPUT, LARGE, NOISE, OUTPUT, POWER, Signal, bench_errors

PARTIAL = 5
"""Of so many accelerometers one has no centrifuge: what |f| = g hides is then inseparable."""

DWELL, SAMPLES = 30.0, 1.0
"""s of each dwell, and samples per second."""

LARGEST_LEVEL = 20.0
"""g, of the centrifuge; less where the class measures less."""

LARGEST_RATE = math.radians(300.0)
"""rad/s, of the rate table; less where the class measures less."""

LEVELS = (0.05, 0.1, 0.25, 0.5, 0.75, 1.0)
"""Shares of the largest level."""

RATES = (0.0, 1.0 / 30.0, 1.0 / 6.0, 1.0 / 3.0, 0.5, 0.75, 1.0)
"""Shares of the largest rate, each both ways."""


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """A simulated sensor, by its number among its kind.

    `truth` are all coefficients of the library by name, SI, many of them zero; `noise` is that of every run,
    `plans` are what the rig says that it does, and `seed` is that of the noise in the runs.
    """

    number: int
    sensor: SensorClass
    library: Library
    truth: Mapping[str, float]
    noise: Noise
    plans: tuple[Plan, ...]
    seed: tuple[int, ...]

    @property
    def sigma(self) -> float:
        """Sd of a sample's white noise, SI."""
        return self.noise.N * math.sqrt(SAMPLES)

    @property
    def largest(self) -> float:
        """Largest size of the input along the sensor's own axis, SI."""
        return max(float(np.abs(self.own(plan)).max()) for plan in self.plans)

    def own(self, plan: Plan | Run) -> FloatArray:
        """Input (n,) along the sensor's own axis, SI."""
        return plan.inputs.channels.get(self.library.own, np.zeros(len(plan.inputs)))


def subject(lib: Library, number: int, seed: int, among: Sequence[str] = ()) -> Subject:
    """Draw a sensor.

    Classes of the catalogue (those `among` its ids, if there are any) take turns. A share of the terms,
    uniform over sensors (the beta-binomial model prior), is not zero; their sizes are normal with the class's
    typical magnitudes, and N, B and K log-normal over the class. What a lever arm ties counts as one term.

    Examples
    --------
    >>> from imubayes.sensors.terms import library
    >>> one = subject(library("accelerometer"), 4, seed=1)
    >>> one.sensor.id, [plan.name for plan in one.plans]
    ('quartz_flexure_servo', ['tumble'])
    """
    entries = [entry for entry in classes(lib.kind) if not among or entry.id in among]
    sensor = entries[number % len(entries)]
    place = (seed, get_args(Kind).index(lib.kind), number)
    rng = np.random.default_rng([*place, 0])
    lib, sd = coupled(lib, sensor), class_sd(sensor, lib)
    inside = rng.random(len(sd)) < rng.random()
    sizes = np.where(inside, sd * rng.standard_normal(len(sd)), 0.0)
    sizes = sizes[[lib.names.index(name) for name in lib.carriers]]
    return Subject(
        number=number,
        sensor=sensor,
        library=lib,
        truth=dict(zip(lib.names, sizes.tolist(), strict=True)),
        noise=Noise(*(m * math.exp(s * rng.standard_normal()) for m, s in noise_prior(sensor).values())),
        plans=_plans(sensor, number),
        seed=(*place, 1),
    )


def runs_of(one: Subject, treatment: str = "") -> tuple[Run, ...]:
    """Test a sensor, under a treatment with its fault; the noise is the same whenever it is tested."""
    rng, lot = np.random.default_rng(one.seed), np.random.default_rng([*one.seed, 1])
    errors = bench_errors(one.plans, treatment, lot)
    truth = {**one.truth, **_lacking(one, treatment, lot)}
    moved = [replace(plan, inputs=true_inputs(plan, errors)) for plan in one.plans]
    applied = [_felt(one, plan, treatment, lot) for plan in moved]
    said, silent = [plan.inputs for plan in one.plans], Noise(0.0, 0.0, 0.0)
    runs = simulate(one.sensor, applied, seed=0, truth=truth, noise=silent, said=said)
    top = max(float(np.abs(run.output).max()) for run in runs)
    outputs = [
        _output(_signal(one, plan, run.output, top), one.noise, treatment, rng, lot)
        for run, plan in zip(runs, one.plans, strict=True)
    ]
    return tuple(replace(run, output=output) for run, output in zip(runs, outputs, strict=True))


def as_read(run: Run) -> Run:
    """Run as it is read from a file: without samples at the end of the sensor's range."""
    out = beyond(run.output, OutputLevels().add(run.output).rails())
    return replace(run, inputs=run.inputs.kept(~out), output=run.output[~out]) if out.any() else run


def _lacking(one: Subject, treatment: str, rng: np.random.Generator) -> dict[str, float]:
    """Coefficients, SI by name, of what the response has and no candidate is.

    The power is the one after the library's, of the class's size, or `LARGE` at the largest input.
    """
    if treatment != POWER:
        return {}
    order = 1 + max(int(name[1:]) for name in one.library.names if name[1:].isdigit())
    more, name = library(one.library.kind, powers=order, asymmetry=-1), f"b{order}"
    usual = float(class_sd(one.sensor, more)[more.names.index(name)])
    least = LARGE * one.sigma / one.largest**order
    return {name: max(usual, least) * float(rng.choice([-1.0, 1.0]))}


def _signal(one: Subject, plan: Plan, values: FloatArray, top: float = 0.0) -> Signal:
    return Signal(values, plan.inputs.t, one.own(plan), one.sigma, one.largest, top)


def _felt(one: Subject, plan: Plan, treatment: str, lot: np.random.Generator) -> Plan:
    """Plan whose input along the sensor's own axis has gone through the fault."""
    if treatment not in INPUT:
        return plan
    felt = INPUT[treatment](_signal(one, plan, one.own(plan)), lot)
    channels = {**plan.inputs.channels, one.library.own: felt}
    return replace(plan, inputs=replace(plan.inputs, channels=channels))


def _output(
    response: Signal, noise: Noise, treatment: str, rng: np.random.Generator, lot: np.random.Generator
) -> FloatArray:
    """Response and noise of a run, as they leave the sensor."""
    known, dt = deepcopy(rng), 1.0 / SAMPLES
    drawn = synthesise(noise, response.t, dt, rng)
    if treatment in NOISE:
        white = synthesise(Noise(noise.N, 0.0, 0.0), response.t, dt, known)
        drawn += NOISE[treatment](replace(response, values=white), lot) - white
    whole = replace(response, values=response.values + drawn)
    return OUTPUT[treatment](whole, lot) if treatment in OUTPUT else whole.values


def walked(one: Subject) -> float:
    """Mean of the noise's random walk over all samples of a sensor's runs, SI, whatever the treatment."""
    rng, walks = np.random.default_rng(one.seed), list[FloatArray]()
    for plan in one.plans:
        known = deepcopy(rng)
        drawn = (synthesise(noise, plan.inputs.t, 1.0 / SAMPLES, lot)
                 for noise, lot in ((one.noise, rng), (replace(one.noise, K=0.0), known)))  # fmt: skip
        walks.append(np.subtract(*drawn))
    return float(np.concatenate(walks).mean())


def _plans(sensor: SensorClass, number: int) -> tuple[Plan, ...]:
    """Tumble and centrifuge of an accelerometer; rate steps in nine mounts, and tumble, of a gyroscope."""
    if sensor.kind == "accelerometer":
        around = tumble(angles=24, planes=3, dwell=DWELL, rate=SAMPLES)
        largest = min(sensor.full_scale / STANDARD_GRAVITY, LARGEST_LEVEL)
        whirl = centrifuge([share * largest for share in LEVELS], dwell=DWELL, rate=SAMPLES)
        return (around,) if number % PARTIAL == PARTIAL - 1 else (around, whirl)
    largest = min(sensor.full_scale, LARGEST_RATE)
    speeds = [*(share * largest for share in RATES), *(-share * largest for share in RATES[1:])]
    still = tumble(angles=12, planes=3, dwell=DWELL, rate=SAMPLES)
    return rate_table(speeds, dwell=DWELL, rate=SAMPLES), still
