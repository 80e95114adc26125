"""Simulated repeats: sensors whose truth is known, after the same tests, and what the rungs say of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.campaign.fidelity import RungName
from imubayes.inference.linear import library_rows
from imubayes.inference.mcmc.ensembles import Limits
from imubayes.ladder.problem import Problem, ground_of
from imubayes.ladder.rungs import stand
from imubayes.ladder.trade.plan import Subject
from imubayes.ladder.trade.subjects import unit
from imubayes.ladder.trade.told import Told, told_of
from imubayes.rig.bench import true_inputs
from imubayes.rig.inputs import Run, Source
from imubayes.rig.reference import OFFSET, errors_of
from imubayes.rig.simulate import synthesise
from imubayes.sensors.noise import Noise

SIMULATED = Source(notes=("simulated: drawn from the posterior",))


@dataclass(frozen=True, slots=True, eq=False)
class Repeat:
    """A simulated sensor: which component it repeats, its number, its truth, and what the rungs say of it.

    Attributes
    ----------
    subject : name of the component.
    truth : (p,) coefficients, SI.
    told : of the rungs that were asked, from the cheapest.
    """

    subject: str
    truth: FloatArray
    told: tuple[Told, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Sensor:
    """A sensor that is drawn: its subject, and its number.

    Attributes
    ----------
    subject : whose tests it goes through.
    number : of the draw, or of the unit of a lot.
    theta : (p,) coefficients that are drawn, SI; of a unit of a lot its own.
    noises : N, B, K of each run; empty for a unit of a lot, which has its own.
    """

    subject: Subject
    number: int
    theta: FloatArray
    noises: tuple[tuple[float, float, float], ...] = ()


def sensors(subjects: Sequence[Subject], found: Sequence[Told | None], count: int) -> tuple[Sensor, ...]:
    """Draw sensors: further units of lots, or draws of each component's posterior, in turns over components.

    Parameters
    ----------
    subjects : to be repeated.
    found : posterior of each, from which sensors of a study are drawn; None where it is a unit of a lot.
    count : of sensors.
    """
    return tuple(
        _sensor(subjects[k % len(subjects)], found[k % len(subjects)], k // len(subjects))
        for k in range(count)
    )


def _sensor(subject: Subject, found: Told | None, turn: int) -> Sensor:
    if subject.lot is not None:
        return Sensor(subject, turn + 1, subject.lot.theta[turn + 1])
    if found is None:
        raise ValueError(f"component {subject.name} has no posterior to draw from")
    # draws far apart: those of a chain beside each other are alike
    k = turn * 7919 % len(found.draws)
    noises = found.noises[k % len(found.noises)]
    return Sensor(subject, turn, found.draws[k], tuple((N, B, K) for N, B, K in noises.tolist()))


def repeat(one: Sensor, rungs: Iterable[RungName], limits: Limits, seed: tuple[int, ...]) -> Repeat:
    """Simulate a sensor's tests, and let rungs answer, which share what they have in common.

    Parameters
    ----------
    one : sensor.
    rungs : from the cheapest.
    limits : of chains.
    seed : of noise, errors of the bench, and whatever the rungs draw.
    """
    rng = np.random.default_rng([*seed, 0])
    ground = ground_of(_tested(one, rng), np.random.default_rng([*seed, 1]), lambda message: None, limits)
    kept = np.random.default_rng([*seed, 2])
    told = tuple(told_of(stand(name, ground), limits.ess, kept) for name in rungs)
    return Repeat(one.subject.name, one.theta, told)


def _tested(one: Sensor, rng: np.random.Generator) -> Problem:
    if one.subject.lot is not None:
        return unit(one.subject.lot, one.number, one.subject.problem.spec, rng).problem
    return simulated_again(one.subject.problem, one.theta, one.noises, rng)


def simulated_again(
    problem: Problem,
    theta: FloatArray,
    noises: Sequence[tuple[float, float, float]],
    rng: np.random.Generator,
) -> Problem:
    """Problem whose runs are simulated with the inputs of the given one.

    Parameters
    ----------
    problem : says the inputs, and how well the bench is known: its errors are drawn anew.
    theta : (p,) coefficients, SI.
    noises : N, B, K of each run, SI.
    rng : draws the errors of the bench and the noise.
    """
    reference = problem.spec.reference
    known = errors_of(problem.runs, reference) if reference else ()
    errors = {error.name: float(rng.normal(0.0, reference[error.kind])) for error in known}
    runs = tuple(
        _run_again(run, problem, theta, Noise(*noise), errors, rng)
        for run, noise in zip(problem.runs, noises, strict=True)
    )
    return replace(problem, runs=runs)


def _run_again(
    run: Run,
    problem: Problem,
    theta: FloatArray,
    noise: Noise,
    errors: dict[str, float],
    rng: np.random.Generator,
) -> Run:
    lib = problem.library
    moved = true_inputs(run, errors) if errors else run.inputs
    output = synthesise(noise, moved.t, moved.interval, rng)
    output += library_rows(replace(run, inputs=moved), lib) @ theta
    output += moved.channels.get(lib.own, 0.0) + errors.get(f"{OFFSET}.{run.name}", 0.0)
    return replace(run, output=output, source=SIMULATED, stream=None)
