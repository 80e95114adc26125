"""One rung in a process of its own: time, processor time and memory, without imports and compilation."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from functools import partial

import numpy as np

from imubayes.campaign.fidelity import RungName
from imubayes.campaign.study import SensorSpec
from imubayes.inference.mcmc.ensembles import Limits
from imubayes.ladder.answer import Answer
from imubayes.ladder.foresight import foresee
from imubayes.ladder.problem import Ground, Problem, ground_of, problem_of
from imubayes.ladder.rungs import stand
from imubayes.ladder.trade.memory import with_peak
from imubayes.ladder.trade.plan import NAMES
from imubayes.ladder.trade.told import Told, told_of
from imubayes.population.processes import Lost, elsewhere
from imubayes.rig.recordings import RunSpec
from imubayes.rig.simulate import simulate
from imubayes.rig.tumbles import tumble
from imubayes.sensors.catalogue import sensor
from imubayes.sensors.terms import library

TURNS, ENOUGH = 5, 2.0
"""Times that a rung is timed, and seconds of it from which it is timed no more: the fastest counts."""

BRIEF = Limits(ess=50.0, time_limit=0.3, seed=1)
"""Of chains that only warm up."""


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """A rung on one component.

    Attributes
    ----------
    told : what it says.
    seconds : wall time, the shortest.
    processor_seconds : of the same turn, over all threads.
    memory : bytes at the peak, beside what the process held before.
    foreseen : what the rung itself says that the next one would change: coefficients in posterior sd, and
        inclusions; NaN at the top.
    """

    told: Told
    seconds: float
    processor_seconds: float
    memory: float
    foreseen: tuple[float, float]

    @property
    def whole_seconds(self) -> float:
        """Wall time until the chains have reached what was asked of them: more than was spent, if short."""
        return self.seconds + (self.told.wanting - 1.0) * self.told.chain_seconds


def measured(problem: Problem, rung: RungName, limits: Limits, seed: tuple[int, ...]) -> Measured | None:
    """Measure a rung in a new process; None where the process did not survive it.

    Parameters
    ----------
    problem : of the component.
    rung : by name.
    limits : of chains.
    seed : of whatever is drawn; chains have one of their own from it.
    """
    found = elsewhere(here, problem, rung, limits, seed)
    return None if isinstance(found, Lost) else found


def here(problem: Problem, rung: RungName, limits: Limits, seed: tuple[int, ...]) -> Measured:
    """Measure a rung in this process, warmed up on a small problem; memory is that of the first turn."""
    _stood(warm_up(), rung, BRIEF, (0,))
    turn = partial(_timed, problem, rung, limits, seed)
    found, memory = with_peak(turn)
    turns = [found]
    while len(turns) < TURNS and sum(one.seconds for one in turns) < ENOUGH:
        turns.append(turn())
    fastest = min(turns, key=lambda one: one.seconds)
    ahead = _ahead(found.ground, found.answer)
    rng = np.random.default_rng([*seed, 1])
    told = told_of(found.answer, limits.ess, rng)
    return Measured(told, fastest.seconds, fastest.processor_seconds, memory, ahead)


@dataclass(frozen=True, slots=True, eq=False)
class _Turn:
    """What one turn gave, and took."""

    answer: Answer
    ground: Ground
    seconds: float
    processor_seconds: float


def _timed(problem: Problem, rung: RungName, limits: Limits, seed: tuple[int, ...]) -> _Turn:
    processor, start = time.process_time(), time.perf_counter()
    answer, ground = _stood(problem, rung, limits, seed)
    return _Turn(answer, ground, time.perf_counter() - start, time.process_time() - processor)


def _stood(problem: Problem, rung: RungName, limits: Limits, seed: tuple[int, ...]) -> tuple[Answer, Ground]:
    ground = ground_of(problem, np.random.default_rng(seed), _silent, limits)
    return stand(rung, ground), ground


def _ahead(ground: Ground, answer: Answer) -> tuple[float, float]:
    """What the rung foresees that the next one would change."""
    if answer.rung == NAMES[-1]:
        return math.nan, math.nan
    ahead = foresee(ground, answer)
    return ahead.coefficients, ahead.inclusions


def warm_up() -> Problem:
    """A problem so small that a rung's first turn on it is all imports and compilation."""
    entry, lib = (
        sensor("mems_tactical", kind="accelerometer"),
        library("accelerometer", powers=1, asymmetry=-1),
    )
    plan = tumble(angles=8, planes=2, dwell=2.0, rate=4.0)
    runs = simulate(entry, [plan], seed=1, truth={"b0": 0.01})
    specs = (RunSpec("tumble", "tumble"),)
    return problem_of(SensorSpec("warm-up", entry.kind, entry, lib, specs, {}), runs)


def _silent(message: str) -> None:
    """Say nothing: who waits is in another process."""
