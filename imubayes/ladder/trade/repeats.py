"""Simulated repeats, whose truth is known: sensors after the same tests, and what the rungs get right."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from imubayes.algebra.arrays import BoolArray, FloatArray
from imubayes.inference.intervals import SIDE, Share, frequency
from imubayes.inference.mcmc.ensembles import Limits
from imubayes.ladder import RungName
from imubayes.ladder.problem import Problem, ground_of
from imubayes.ladder.rungs import stand
from imubayes.ladder.trade.components import Subject, unit_of
from imubayes.ladder.trade.measurement import Measured, measured_of
from imubayes.population.agreement import LARGE, SMALL
from imubayes.progress import silent
from imubayes.rig.bench import true_inputs
from imubayes.rig.inputs import Run, Source
from imubayes.rig.reference import OFFSET
from imubayes.rig.simulate import drawn_errors, synthesise
from imubayes.scenes.relevance import Exposure, Relevance, weigh
from imubayes.scenes.smallest import Knowledge
from imubayes.selection.verdicts import TENTH, Costs
from imubayes.sensors.noise import Noise
from imubayes.sensors.terms import columns

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
    limits = replace(limits, seed=int(rungs_rng.integers(2**32)))
    ground = ground_of(problem, rungs_rng, silent, limits)
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
    errors = drawn_errors(problem.runs, reference, rng)

    def again(run: Run, noise: Noise) -> Run:
        moved = true_inputs(run, errors) if errors else run.inputs
        output = synthesise(noise, moved.t, moved.interval, rng)
        output += columns(lib, moved.channels, len(moved), said=run.inputs.channels) @ theta
        output += moved.channels.get(lib.own, 0.0) + errors.get(f"{OFFSET}.{run.name}", 0.0)
        return replace(run, output=output, source=SIMULATED, stream=None)

    pairs = zip(problem.runs, noises, strict=True)
    return replace(problem, runs=tuple(again(run, Noise(*noise)) for run, noise in pairs))


INTERVAL = 0.9
"""Share of the truths that an interval is meant to hold."""

Exposed = Mapping[str, Mapping[str, Exposure]]
"""What each scene makes of a component's terms: by component, by scene."""


class Rate(NamedTuple):
    """How often something happened, out of how many, with the 90 % interval of its share."""

    events: int
    of: int
    share: Share


@dataclass(frozen=True, slots=True)
class Score:
    """One rung over simulated repeats.

    Attributes
    ----------
    rung : by name.
    repeats : that it answered.
    coverage : of its 90 % intervals under the full library, over the terms that the test tells.
    error : rms of its full-library coefficients against the truth there, in posterior sd of the best rung
        that answered the same repeat: about 1 for a right method.
    false_needed : "needed", of terms that are zero, or below `SMALL`.
    false_not_needed : "not needed", of terms above a tenth of the prior sd.
    missed_large : left out of the model, of terms above `LARGE`.
    cost : of both false verdicts a sensor, as the study weighs them.
    scene_terms : terms a scene by which the model that it requires is another than by the truth, on average;
        NaN without scenes.
    """

    rung: RungName
    repeats: int
    coverage: Rate
    error: float
    false_needed: Rate
    false_not_needed: Rate
    missed_large: Rate
    cost: float
    scene_terms: float


def score(rung: RungName, repeats: Sequence[Repeat], costs: Costs, exposed: Exposed) -> Score | None:
    """Score a rung over the repeats that it answered; None where there are none."""
    pairs = [(one, found) for one in repeats for found in one.answers if found.rung == rung]
    if not pairs:
        return None
    off, told, size, held, kept, above, needed, not_needed = map(
        np.concatenate, zip(*(_terms(one, found) for one, found in pairs), strict=True)
    )
    false_needed, false_not_needed = _rate(needed, size < SMALL), _rate(not_needed, above)
    cost = costs.false_keep * false_needed.events + costs.false_drop * false_not_needed.events
    other = [terms for one, found in pairs for terms in _other_terms(exposed[one.subject], one, found)]
    return Score(
        rung=rung,
        repeats=len(pairs),
        coverage=_rate(held, told),
        error=float(np.sqrt(np.mean(off[told] ** 2))) if told.any() else float("nan"),
        false_needed=false_needed,
        false_not_needed=false_not_needed,
        missed_large=_rate(~kept, told & (size > LARGE)),
        cost=cost / len(pairs),
        scene_terms=float(np.mean(other)) if other else float("nan"),
    )


def _terms(one: Repeat, found: Measured) -> tuple[np.ndarray, ...]:
    """Every term (p,) of a repeat, as a rung sees it.

    Returns
    -------
    difference from the truth over the best rung's sd; whether the test tells it; size of the truth in sd of
    the best; whether the interval holds the truth; whether the model has it; whether the truth is above a
    tenth of the prior sd; whether the verdict is "needed"; and "not needed".
    """
    best, off, verdicts = one.answers[-1], found.full_mean - one.truth, np.array(found.verdicts)
    return (
        off / best.full_sd,
        best.resolved,
        np.abs(one.truth) / best.full_sd,
        np.abs(off) <= SIDE * found.full_sd,
        np.isin(found.names, found.model),
        np.abs(one.truth) > TENTH * found.prior_sd,
        verdicts == "needed",
        verdicts == "not needed",
    )


def _rate(happened: BoolArray, where: BoolArray) -> Rate:
    events, of = int(np.sum(happened & where)), int(np.sum(where))
    return Rate(events, of, frequency(events, of))


def _other_terms(exposed: Mapping[str, Exposure], one: Repeat, found: Measured) -> list[int]:
    """By how many terms the model that each scene requires is another than by the truth."""
    truth = Knowledge(one.truth[None, :], (one.truth != 0.0).astype(float), np.abs(one.truth))
    said, true = required(exposed, found), {name: weigh(seen, truth) for name, seen in exposed.items()}
    return [len(set(said[name].model) ^ set(true[name].model)) for name in exposed]


def required(exposed: Mapping[str, Exposure], found: Measured) -> dict[str, Relevance]:
    """What every scene requires of a component, by what a rung knows of it."""
    knowledge = Knowledge(found.draws, found.inclusion, found.limit95)
    return {name: weigh(seen, knowledge) for name, seen in exposed.items()}
