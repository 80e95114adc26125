"""Simulated sensors whose truth is known, and the runs that test them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np

from imubayes.inference.prior import class_sd
from imubayes.rig.bench import true_inputs
from imubayes.rig.inputs import Run
from imubayes.rig.plans import Plan
from imubayes.rig.reference import KINDS, errors_of
from imubayes.rig.rotations import centrifuge, rate_table
from imubayes.rig.simulate import simulate
from imubayes.rig.tumbles import tumble
from imubayes.sensors.catalogue import SensorClass, classes, coupled
from imubayes.sensors.noise import Noise, noise_prior
from imubayes.sensors.terms import Kind, Library
from imubayes.units import STANDARD_GRAVITY

PARTIAL = 5
"""Of so many accelerometers one has no centrifuge: what |f| = g hides is then inseparable."""

DWELL, SAMPLES = 30.0, 1.0
"""s of each dwell, and samples per second."""

LARGEST_LEVEL = 20.0
"""g, of the centrifuge; less where the class measures less."""

LARGEST_RATE = math.radians(300.0)
"""rad/s, of the rate table; less where the class measures less."""

LEVELS = (0.05, 0.25, 1.0)
"""Shares of the largest level."""

RATES = (0.0, 1.0 / 30.0, 1.0 / 6.0, 0.5, 1.0)
"""Shares of the largest rate, each both ways."""

ZEROS: Mapping[Kind, tuple[str, ...]] = {
    "accelerometer": ("plane_zero",),
    "gyroscope": ("plane_zero", "fixture"),
}
"""Errors of the reference that are there but not modelled, where a study asks for them: the zero of the table
in each plane of a tumble; where a rate table tests a gyroscope, the turn of the case in each mount."""


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """A simulated sensor.

    Attributes
    ----------
    number : of the sensor among its kind.
    sensor : its class.
    library : candidate terms.
    truth : every coefficient of the library by name, SI; many are zero.
    noise : of every run.
    plans : what the rig says that it does.
    errors : of the reference, SI by name; they act only where they are asked for.
    seed : of the noise in the runs.
    """

    number: int
    sensor: SensorClass
    library: Library
    truth: Mapping[str, float]
    noise: Noise
    plans: tuple[Plan, ...]
    errors: Mapping[str, float]
    seed: tuple[int, ...]


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
    plans = _plans(sensor, number)
    return Subject(
        number=number,
        sensor=sensor,
        library=lib,
        truth=dict(zip(lib.names, sizes.tolist(), strict=True)),
        noise=Noise(*(m * math.exp(s * rng.standard_normal()) for m, s in noise_prior(sensor))),
        plans=plans,
        errors=_errors(lib.kind, plans, rng),
        seed=(*place, 1),
    )


def runs_of(one: Subject, *, misplaced: bool = False) -> tuple[Run, ...]:
    """Test a sensor; the noise is the same whenever it is tested.

    Parameters
    ----------
    one : the sensor.
    misplaced : whether the reference has its errors, of which the runs say nothing.
    """
    errors = one.errors if misplaced else {}
    applied = [replace(plan, inputs=true_inputs(plan, errors)) for plan in one.plans]
    runs = simulate(
        one.sensor, applied, seed=np.random.default_rng(one.seed), truth=one.truth, noise=one.noise
    )
    return tuple(replace(run, inputs=plan.inputs) for run, plan in zip(runs, one.plans, strict=True))


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


def _errors(kind: Kind, plans: tuple[Plan, ...], rng: np.random.Generator) -> dict[str, float]:
    """Errors of the reference: normal, with what the catalogue holds for typical."""
    sizes = {name: KINDS[name].default or 0.0 for name in ZEROS[kind]}
    return {error.name: rng.normal(0.0, sizes[error.kind]) for error in errors_of(plans, sizes)}
