"""What a trade measures: components of a study, the rungs that are held against each other, and the time."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from imubayes.campaign.preparation import runs_of
from imubayes.campaign.study import Mission, SensorSpec, Study
from imubayes.errors import InputError, hint
from imubayes.ladder import NAMES, RungName, rung_of
from imubayes.ladder.costs import cores
from imubayes.ladder.problem import Problem, problem_of
from imubayes.population.lots import LotStudy, lot_of
from imubayes.population.records import simulate_unit
from imubayes.sensors.lots import Lot

DEFAULT: RungName = "collapsed"
"""What a run takes that is not asked for a budget."""

REPEATS = 20
"""Simulated repeats of a study, where none are asked for."""

LIMIT = 300.0
"""s; time of a trade, where none is asked for."""

ESS = 1000.0
"""Effective sample size that chains are asked for, where the study does not say."""

FREE = "free tumbles and whole IMUs have one method, and no ladder"


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """A component that the rungs answer for.

    Attributes
    ----------
    name : of the sensor, or of the class that it is a unit of.
    problem : that it poses.
    lot : that the unit is of; None for a sensor of a study, whose repeats are drawn from its posterior.
    """

    name: str
    problem: Problem
    lot: Lot | None = None

    @property
    def repeatable(self) -> bool:
        """Whether its tests can be simulated again: runs that are read a part at a time are too long."""
        return not any(run.streamed for run in self.problem.runs)


@dataclass(frozen=True, slots=True, eq=False)
class Trade:
    """What is measured.

    Attributes
    ----------
    title, seed, path, text : of the study.
    subjects : that the rungs answer for, in the order in which time is spent on them.
    missions : scenes that the answers are held against.
    rungs : from the cheapest to the best.
    repeats : simulated sensors that every rung that can be afforded answers for, too.
    limit : s, of all.
    ess : effective sample size asked of chains.
    processes : that share the repeats.
    left_out : components that no rung answers for, each with the reason.
    only : sensors or classes that were asked for by name; none for all.

    Raises
    ------
    InputError : if the number of repeats is negative.
    """

    title: str
    seed: int
    path: Path
    text: str
    subjects: tuple[Subject, ...]
    missions: tuple[Mission, ...] = ()
    rungs: tuple[RungName, ...] = NAMES
    repeats: int = REPEATS
    limit: float = LIMIT
    ess: float = ESS
    processes: int = 1
    left_out: tuple[tuple[str, str], ...] = ()
    only: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.repeats < 0:
            raise InputError(f"{self.repeats} repeats: expected 0 (none) or more, such as {REPEATS}")


def rungs_of(asked: Sequence[str]) -> tuple[RungName, ...]:
    """Rungs by name, in the order of the ladder.

    Raises
    ------
    InputError : if one is not known, or there are fewer than two.

    Examples
    --------
    >>> rungs_of(["plug-in", "means"])
    ('means', 'plug-in')
    """
    wanted = {rung_of(name.strip()).name for name in asked}
    if len(wanted) < 2:
        raise InputError(f"rungs '{', '.join(asked)}': expected two or more of {', '.join(NAMES)}")
    return tuple(name for name in NAMES if name in wanted)


def of_study(study: Study, only: Collection[str] = ()) -> Trade:
    """Trade of a study's sensors, those that are named or all.

    Raises
    ------
    InputError : if a sensor is not in the study, or none has runs with known inputs.
    """
    _check_named(only, [spec.id for spec in study.sensors], "sensor")
    subjects: list[Subject] = []
    left_out: list[tuple[str, str]] = []
    for k, spec in enumerate(study.sensors):
        if only and spec.id not in only:
            continue
        runs = runs_of(spec, study.seed, k)
        if not all(run.known for run in runs):
            left_out.append((spec.id, FREE))
            continue
        problem = problem_of(spec, runs, costs=study.costs, hierarchical=study.hierarchical)
        subjects.append(Subject(spec.id, problem))
    if not subjects:
        raise InputError(f"{study.path}: {FREE}: a trade needs a single component with known inputs")
    one = _trade(study, subjects, study.scenes, only)
    return replace(one, ess=study.sampling.ess or ESS, left_out=tuple(left_out))


def of_lots(study: LotStudy, only: Collection[str] = (), repeats: int = REPEATS) -> Trade:
    """Trade of one unit of each class of a class-level study, those that are named or all.

    Further units of each lot are the repeats, so that lots are drawn as large as `repeats` asks.

    Raises
    ------
    InputError : if a class is not in the study.
    """
    _check_named(only, [entry.id for entry in study.classes], "class")
    chosen = [k for k, entry in enumerate(study.classes) if not only or entry.id in only]
    larger = replace(study, units=1 + math.ceil(repeats / len(chosen)))
    subjects = []
    for k in chosen:
        lot, rng = lot_of(larger, k), np.random.default_rng([study.seed, k, 1, 0, 0])
        problem = unit_of(lot, 0, study.specs[k], rng)
        subjects.append(Subject(lot.sensor_class.id, problem, lot))
    return _trade(study, subjects, study.missions, only)


def _trade(
    study: Study | LotStudy, subjects: Sequence[Subject], missions: Sequence[Mission], only: Collection[str]
) -> Trade:
    given = study.title, study.seed, study.path, study.text, tuple(subjects), tuple(missions)
    return Trade(*given, processes=cores(), only=tuple(only))


def unit_of(lot: Lot, number: int, spec: SensorSpec, rng: np.random.Generator) -> Problem:
    """Problem of one unit of a lot after its campaign, on a bench with errors; `spec` is of any unit."""
    own = replace(spec, truth=lot.truth(number))
    return problem_of(own, simulate_unit(own, lot, number, rng))


def _check_named(only: Collection[str], known: Sequence[str], what: str) -> None:
    for name in only:
        if name not in known:
            raise InputError(f"no {what} of the study is called '{name}': {hint(name, known)}")
