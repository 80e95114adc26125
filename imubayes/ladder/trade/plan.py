"""What is traded: components, the rungs that are held against each other, and the time for it."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from imubayes.campaign.fidelity import LADDER, RungName, rung_of
from imubayes.campaign.study import Mission
from imubayes.errors import InputError
from imubayes.ladder.problem import Problem
from imubayes.sensors.lots import Lot

NAMES: tuple[RungName, ...] = tuple(rung.name for rung in LADDER)
"""From the cheapest to the best."""

DEFAULT: RungName = "collapsed"
"""What a run takes that is not asked for a budget."""

FEWEST = 5
"""Simulated repeats that are worth a rate."""

REPEATS = 20
"""Simulated repeats of a study, where none are asked for."""

LIMIT = 300.0
"""s; time of a trade, where none is asked for."""

ESS = 1000.0
"""Effective sample size that chains are asked for, where the study does not say."""


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
        return all(run.stream is None for run in self.problem.runs)


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


def cores() -> int:
    """Processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
