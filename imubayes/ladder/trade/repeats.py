"""Simulated repeats: sensors whose truth is known, after the same tests, and what the rungs say of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.campaign.fidelity import RungName
from imubayes.inference.linear import library_rows
from imubayes.inference.mcmc.ensembles import Limits
from imubayes.ladder.problem import Problem, ground_of
from imubayes.ladder.rungs import stand
from imubayes.ladder.trade.measurement import Measured, measured_of
from imubayes.ladder.trade.subjects import Subject, unit_of
from imubayes.rig.bench import true_inputs
from imubayes.rig.inputs import Run, Source
from imubayes.rig.reference import OFFSET, errors_of
from imubayes.rig.simulate import synthesise
from imubayes.sensors.noise import Noise

SIMULATED = Source(notes=("simulated: drawn from the posterior",))

FEWEST = 5
"""Simulated repeats that are worth a rate."""


@dataclass(frozen=True, slots=True, eq=False)
class Repeat:
    """A simulated sensor: whose tests it goes through, its truth, and what the rungs say of it.

    Attributes
    ----------
    subject : name of the component.
    number : of the draw, or of the unit of a lot.
    truth : (p,) coefficients, SI; of a unit of a lot its own.
    noises : N, B, K of each run; empty for a unit of a lot, which has its own.
    answers : of the rungs that were asked, from the cheapest.
    """

    subject: str
    number: int
    truth: FloatArray
    noises: tuple[tuple[float, float, float], ...] = ()
    answers: tuple[Measured, ...] = ()


def afforded(
    seconds: Mapping[RungName, float], repeats: int, left: float, processes: int
) -> dict[RungName, int]:
    """How many repeats each rung answers in the seconds that are left, the cheapest first.

    Examples
    --------
    >>> afforded({"means": 0.1, "averaged": 5.0, "raw": 100.0}, 20, 60.0, 2)
    {'means': 20, 'averaged': 20}
    """
    room, found = left * processes, dict[RungName, int]()
    for rung, each in seconds.items():
        most = min(repeats, int(room / max(each, 1e-9)))
        if most < min(FEWEST, repeats) or not most:
            break
        found[rung] = most
        room -= most * each
    return found


def drawn(subject: Subject, best: Measured | None, number: int) -> Repeat:
    """Draw a sensor: a further unit of a lot, or a draw of the component's posterior by its best rung."""
    if subject.lot is not None:
        return Repeat(subject.name, number + 1, subject.lot.theta[number + 1])
    if best is None:
        raise ValueError(f"component {subject.name} has no posterior to draw from")
    # draws far apart: those of a chain beside each other are alike
    k = number * 7919 % len(best.draws)
    noises = best.noises[k % len(best.noises)].tolist()
    return Repeat(subject.name, number, best.draws[k], tuple((N, B, K) for N, B, K in noises))


def answered(
    one: Repeat, subject: Subject, rungs: Iterable[RungName], limits: Limits, seed: tuple[int, ...]
) -> Repeat:
    """Simulate a sensor's tests, and let rungs answer, which share what they have in common."""
    rng, rungs_rng, kept = (np.random.default_rng([*seed, k]) for k in range(3))
    if subject.lot is not None:
        problem = unit_of(subject.lot, one.number, subject.problem.spec, rng)
    else:
        problem = simulated_again(subject.problem, one.truth, one.noises, rng)
    ground = ground_of(problem, rungs_rng, lambda message: None, limits)
    return replace(one, answers=tuple(measured_of(stand(name, ground), limits.ess, kept) for name in rungs))


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
    reference, lib = problem.spec.reference, problem.library
    known = errors_of(problem.runs, reference) if reference else ()
    errors = {error.name: float(rng.normal(0.0, reference[error.kind])) for error in known}

    def again(run: Run, noise: Noise) -> Run:
        moved = true_inputs(run, errors) if errors else run.inputs
        output = synthesise(noise, moved.t, moved.interval, rng)
        output += library_rows(replace(run, inputs=moved), lib) @ theta
        output += moved.channels.get(lib.own, 0.0) + errors.get(f"{OFFSET}.{run.name}", 0.0)
        return replace(run, output=output, source=SIMULATED, stream=None)

    pairs = zip(problem.runs, noises, strict=True)
    return replace(problem, runs=tuple(again(run, Noise(*noise)) for run, noise in pairs))
