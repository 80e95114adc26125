"""The whole measurement: every contest and every law, in turns, and the machine that it was made on."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from imubayes.ladder.costs import Machine, machine
from imubayes.work import Progress, silent
from studies.speed import campaigns, problems, trades
from studies.speed.contests import Contest, Ladder, Quantity, Self, SpeedStudy, Subject
from studies.speed.growth import Law, fitted
from studies.speed.peers import missing

CONTESTS: dict[Subject, Callable[[int, int], Contest]] = {
    "least squares": problems.least_squares,
    "one-sided": problems.one_sided,
    "subsets": problems.subsets,
    "g-prior": problems.g_prior,
    "enumeration": problems.enumeration,
    "noise": campaigns.noise,
    "posterior": campaigns.chains,
    "trade": trades.trade,
}

LADDERS: dict[Quantity, Callable[[tuple[int, ...], int], Iterator[Ladder]]] = {
    "rows": campaigns.rows_ladder,
    "terms": campaigns.terms_ladder,
    "models": campaigns.models_ladder,
    "runs": campaigns.runs_ladder,
    "units": campaigns.units_ladder,
}

LONG = 2.0
"""s; an entrant that takes longer is timed twice at most."""

WARM = 20.0
"""s; imports and compilation take less: a first turn that takes longer counts, and there is no other."""


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """How an entrant did.

    `seconds` are those of every turn, none where it could not take part, which `absent` says why; `error` is
    that of its last answer, NaN where nothing tells it.
    """

    name: str
    ours: bool
    remark: str
    seconds: tuple[float, ...]
    error: float
    absent: str

    @property
    def fastest(self) -> float:
        """Shortest time, s; NaN without any."""
        return min(self.seconds, default=math.nan)


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """What came of a contest: its subject, its words, and how everybody did."""

    subject: Subject
    size: int
    title: str
    error: str
    time: str
    places: tuple[Place, ...]

    def ratio(self, place: Place) -> float:
        """How many times longer it takes than the first entrant; NaN where it took no part."""
        return place.fastest / self.places[0].fastest


@dataclass(frozen=True, slots=True, eq=False)
class Speed:
    """What a study of speed found."""

    study: SpeedStudy
    contests: tuple[Found, ...]
    laws: tuple[Law, ...]
    machine: Machine
    seconds: float


def measure(study: SpeedStudy, *, progress: Progress = silent) -> Speed:
    """Measure how fast the method is, beside its peers, and how its time grows."""
    start, here = time.perf_counter(), machine()
    contests = tuple(
        held(CONTESTS[subject](size, study.seed), study.repeats, progress)
        for subject, sizes in study.contests.items()
        for size in sizes
    )
    laws = tuple(
        _climbed(ladder, study.repeats, progress)
        for quantity, sizes in study.growth.items()
        for ladder in (LADDERS[quantity](sizes, study.seed) if sizes else ())
    )
    return Speed(study, contests, laws, here, time.perf_counter() - start)


def held(contest: Contest, repeats: int, progress: Progress = silent) -> Found:
    """Let everybody solve the problem in turns, once before that counts: imports, compilation, memory.

    Everybody is timed so many times (`repeats`), who takes seconds less often; `progress` is told who is on.
    """
    absent = [missing(entrant.needs) for entrant in contest.entrants]
    seconds: list[list[float]] = [[] for _ in contest.entrants]
    answers: list[Any] = [None] * len(contest.entrants)
    for turn in range(-1, repeats):
        for k, entrant in enumerate(contest.entrants):
            if absent[k] or len(seconds[k]) >= _worth(seconds[k], repeats):
                continue
            progress(f"{contest.title}: {entrant.name}")
            answers[k], taken = _timed(entrant.solve)
            if turn >= 0 or taken > WARM:
                seconds[k].append(taken)
    places = tuple(
        Place(e.name, e.ours, e.remark, tuple(taken), math.nan if why else e.error(answer), why)
        for e, taken, answer, why in zip(contest.entrants, seconds, answers, absent, strict=True)
    )
    return Found(contest.subject, contest.size, contest.title, contest.error, contest.time, places)


def _worth(taken: list[float], repeats: int) -> int:
    """How often an entrant is timed, by the time that it took so far."""
    longest = max(taken, default=0.0)
    return repeats if longest <= LONG else min(2, repeats) if longest <= WARM else 1


def _timed(solve: Callable[[], Any]) -> tuple[Any, float]:
    """Answer and seconds; those that an entrant kept itself, where it did."""
    start = time.perf_counter()
    found = solve()
    taken = time.perf_counter() - start
    return (found.answer, found.seconds) if isinstance(found, Self) else (found, taken)


def _climbed(ladder: Ladder, repeats: int, progress: Progress) -> Law:
    """Time every size in turns; the first turn does not count."""
    seconds = np.empty((len(ladder.steps), repeats))
    for turn in range(-1, repeats):
        for k, (size, work) in enumerate(ladder.steps):
            progress(f"{ladder.title}: {size:,} {ladder.quantity}")
            _, taken = _timed(work)
            seconds[k, max(turn, 0)] = taken
    return fitted(ladder, seconds)
