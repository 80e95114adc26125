"""Speed against accuracy: every rung of the ladder on a study's own data, and on simulated repeats of it.

The table of a trade has every rung in time, memory and error. What follows from it: the front of time and
error, and the cheapest rung that is good enough.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from imubayes.errors import InputError
from imubayes.inference.mcmc.ensembles import Limits
from imubayes.ladder import CostLaw, RungName, Size
from imubayes.ladder.costs import Machine, calibrate, foreseen, machine
from imubayes.ladder.problem import size_of
from imubayes.ladder.trade.components import (
    DEFAULT,
    INTERVAL,
    Repeat,
    Score,
    Trade,
    afforded,
    answered,
    drawn,
    required,
    score,
)
from imubayes.ladder.trade.measurement import Measured, best_of, difference, measured
from imubayes.scenes.relevance import Exposure, exposure
from imubayes.work import Progress, shared, silent

Timed = TypeVar("Timed")

HALF = 0.5
"""Share of the time for the study's own data; the rest is for repeats of it."""

UNSOLVED = 1e6
"""Posterior sd from which a coefficient is no longer off, but has no solution."""

CHAINS, SHORTEST = 0.3, 1.0
"""Share of the time that is left that a chain may take, and s that it has at least."""

CROWDED = 1.5
"""Times as long as alone that a rung takes beside others, which share memory, and with data to simulate."""

MADE_AGAIN = 4.0
"""Times as long as from its file that a rung takes on a repeat whose rows are simulated at each pass."""

START, START_POOL = 3.0, 5.0
"""s that a new process takes for its imports, and until the processes that share the repeats have started."""

LONGER = 3.0
"""Times the seconds that chains took on the study's own data, after which those of a repeat end."""

BEGUN = 0.04
"""Share of the usual steps on every row, about a hundred, that are made before the time is looked at."""

ACCURATE = 0.1
"""Posterior sd by which no coefficient may be off: a tenth widens an error bar by half a percent."""

FLOORS = 2.0
"""Monte Carlo errors within which two answers are the same."""

SURE = 0.1
"""Difference of an inclusion that is too large."""


@dataclass(frozen=True, slots=True, eq=False)
class Standing:
    """Rungs measured on a component, from the cheapest, held against the best; and others, with why not."""

    subject: str
    measured: tuple[Measured, ...]
    skipped: tuple[tuple[RungName, str], ...] = ()

    @property
    def best(self) -> RungName:
        """The rung that the others are held against."""
        return best_of(self.measured).rung

    @property
    def floor(self) -> tuple[float, float]:
        """Largest and rms Monte Carlo error of a difference of two answers like the best rung's.

        Over the tested terms, in posterior sd: smaller differences mean nothing.
        """
        best = best_of(self.measured)
        # a difference of two answers has the errors of both
        errors = math.sqrt(2.0) * best.monte_carlo[best.tested]
        return float(errors.max(initial=0.0)), float(np.sqrt(np.mean(errors**2))) if errors.size else 0.0


@dataclass(frozen=True, slots=True)
class RungTotals:
    """A rung over all components that it was measured on.

    Wall time, also until the chains have reached what was asked of them, and processor time are medians over
    the `components`, memory (bytes) is the largest. Differences from the best rung are the largest (and the
    rms) over terms and components, coefficients in posterior sd; `verdicts` counts those that differ,
    `scene_share` is the largest change of a share of a scene's budget, `scene_terms` by how many terms the
    models that the scenes require differ. `monte_carlo` is the rms error of its own coefficients, `foreseen`
    what it says that the next one would change, at most, in posterior sd.
    """

    rung: RungName
    seconds: float
    whole_seconds: float
    processor_seconds: float
    memory: float
    largest: float
    rms: float
    inclusion: float
    verdicts: int
    scene_share: float
    scene_terms: int
    monte_carlo: float
    foreseen: float
    components: int


@dataclass(frozen=True, slots=True, eq=False)
class Traded:
    """What was measured, component by component and on simulated repeats, and what follows from it.

    Times belong to the machine as it was before the first of them; all of it took `seconds`.
    """

    trade: Trade
    standings: tuple[Standing, ...]
    scores: tuple[Score, ...]
    machine: Machine
    seconds: float

    @property
    def places(self) -> tuple[RungTotals, ...]:
        """Rung by rung, from the cheapest."""
        return totals(self.standings, self.trade.rungs)

    @property
    def best(self) -> RungName:
        """The highest rung that others were held against."""
        return self.trade.rungs[max(self.trade.rungs.index(standing.best) for standing in self.standings)]

    @property
    def floor(self) -> tuple[float, float]:
        """That of the components, the largest of each."""
        largest, rms = zip(*(standing.floor for standing in self.standings), strict=True)
        return max(largest), max(rms)

    @property
    def front(self) -> tuple[RungName, ...]:
        """Rungs that no other beats in time and error together, from the cheapest."""
        return front(self.places, self.floor[0])

    @property
    def recommended(self) -> RungName:
        """The cheapest rung that is good enough."""
        return recommended(self.places, self.scores, self.best, self.floor[0])

    def place(self, rung: RungName) -> RungTotals | None:
        """The rung's place; None where it was not measured."""
        return next((total for total in self.places if total.rung == rung), None)

    def score(self, rung: RungName) -> Score | None:
        """The rung's score; None where it answered no repeat."""
        return next((scored for scored in self.scores if scored.rung == rung), None)

    @property
    def dear(self) -> tuple[RungName, ...]:
        """Rungs that no simulated repeat could afford, where any was asked for."""
        if not self.trade.repeats:
            return ()
        return tuple(rung for rung in self.trade.rungs if self.score(rung) is None)


def measure(trade: Trade, *, progress: Progress = silent) -> Traded:
    """Measure the rungs.

    Raises
    ------
    InputError : if a component's runs cannot be used, or the time is too short for any rung.
    """
    start, here = time.perf_counter(), machine()
    law = calibrate(progress)
    progress("scenes")
    exposed = {
        subject.name: {
            m.name: exposure(m.scene, subject.problem.library, m.budget, axis=m.axis)
            for m in trade.missions
            if m.kind in (None, subject.problem.spec.kind)  # a budget of the output is only for its own kind
        }
        for subject in trade.subjects
    }
    share = HALF if trade.repeats else 1.0
    usual = trade.rungs[: trade.rungs.index(DEFAULT) + 1] if DEFAULT in trade.rungs else trade.rungs
    standings: list[Standing] = []
    for k, subject in enumerate(trade.subjects):
        size, deadline = size_of(subject.problem), start + share * trade.limit
        least = sum(_least_seconds(rung, size, law) for rung in usual)
        if standings and least > deadline - time.perf_counter():
            break  # the time does not reach for all rungs up to the default
        standings.append(_standing(trade, k, exposed[subject.name], deadline, law, progress))
    again = _repeats(trade, standings, start + trade.limit, progress)
    costs = trade.subjects[0].problem.costs
    scores = tuple(scored for rung in trade.rungs if (scored := score(rung, again, costs, exposed)))
    return Traded(trade, tuple(standings), scores, here, time.perf_counter() - start)


def _least_seconds(rung: RungName, size: Size, law: CostLaw) -> float:
    """Seconds that a rung takes at least, chains cut short.

    Chains on every row end when their time is up, but for their first steps; around them they take what two
    rungs of chains do.
    """
    if rung == "raw":
        return START + 2.0 * foreseen("full", size, law) + BEGUN * foreseen("raw", size, law)
    return START + foreseen(rung, size, law)


def _standing(
    trade: Trade, k: int, exposed: Mapping[str, Exposure], deadline: float, law: CostLaw, progress: Progress
) -> Standing:
    subject, size = trade.subjects[k], size_of(trade.subjects[k].problem)
    trials: list[Measured] = []
    skipped: list[tuple[RungName, str]] = []
    for place, rung in enumerate(trade.rungs):
        left, expected = deadline - time.perf_counter(), _least_seconds(rung, size, law)
        if trials and expected > left:
            skipped.append((rung, f"it takes about {expected:.0f} s, and {max(left, 0.0):.0f} s were left"))
        else:
            done = (HALF if trade.repeats else 1.0) - left / trade.limit
            progress(f"{subject.name}: {rung}", min(max(done, 0.0), 1.0))
            limits = Limits(ess=trade.ess, time_limit=max(SHORTEST, CHAINS * left))
            trial = measured(subject.problem, rung, limits, (trade.seed, k, place))
            if trial is None:
                skipped.append((rung, "its process ended: is memory short?"))
            else:
                trials.append(trial)
    if not trials:
        raise InputError(f"sensor '{subject.name}': no rung came to an end: is memory short?")
    return standing_of(subject.name, trials, exposed, skipped)


def standing_of(
    name: str,
    trials: Sequence[Measured],
    exposed: Mapping[str, Exposure],
    skipped: Sequence[tuple[RungName, str]] = (),
) -> Standing:
    """Hold the rungs on one component against the best of them."""
    best = best_of(trials)
    needs = {trial.rung: required(exposed, trial) for trial in trials}
    apart = [difference(trial, best, needs[trial.rung], needs[best.rung]) for trial in trials]
    held = tuple(replace(trial, difference=off) for trial, off in zip(trials, apart, strict=True))
    return Standing(name, held, tuple(skipped))


def totals(standings: Sequence[Standing], rungs: Sequence[RungName]) -> tuple[RungTotals, ...]:
    """Put the components together, rung by rung."""
    every = [trial for standing in standings for trial in standing.measured]
    places = []
    for rung in rungs:
        trials = [trial for trial in every if trial.rung == rung]
        if not trials:
            continue
        apart = [trial.difference for trial in trials]
        own = [float(np.sqrt(np.mean(trial.monte_carlo**2))) for trial in trials]
        scenes = [scene for difference in apart for scene in difference.scenes]
        place = RungTotals(
            rung=rung,
            seconds=float(np.median([trial.seconds for trial in trials])),
            whole_seconds=float(np.median([trial.whole_seconds for trial in trials])),
            processor_seconds=float(np.median([trial.processor_seconds for trial in trials])),
            memory=float(np.max([trial.memory for trial in trials])),
            largest=max(off.largest for off in apart),
            rms=float(np.sqrt(np.mean([off.rms**2 for off in apart]))),
            inclusion=max(off.inclusion for off in apart),
            verdicts=sum(len(off.verdicts) for off in apart),
            scene_share=max((scene.share for scene in scenes), default=0.0),
            scene_terms=sum(len(scene.terms) for scene in scenes),
            monte_carlo=float(np.sqrt(np.mean(np.square(own)))),
            foreseen=max(trial.foreseen[0] for trial in trials),
            components=len(trials),
        )
        places.append(place)
    return tuple(places)


def _repeats(
    trade: Trade, standings: Sequence[Standing], deadline: float, progress: Progress
) -> Sequence[Repeat]:
    """Simulate sensors, in turns over components, and let rungs answer that the rest of the time affords."""
    best = {standing.subject: best_of(standing.measured) for standing in standings}
    subjects = [s for s in trade.subjects if s.lot is not None or s.name in best]
    seconds: dict[RungName, float] = {total.rung: total.seconds for total in totals(standings, trade.rungs)}
    slower = MADE_AGAIN if any(run.stream for subject in subjects for run in subject.problem.runs) else 1.0
    left = (deadline - time.perf_counter() - START_POOL) / (CROWDED * slower)
    counts = afforded(seconds, trade.repeats, left, trade.processes)
    longest = LONGER * slower * max(m.chain_seconds for standing in standings for m in standing.measured)
    limits = Limits(ess=trade.ess, time_limit=max(longest, 1.0))
    jobs = []
    for k in range(max(counts.values(), default=0)):
        subject, asked = subjects[k % len(subjects)], tuple(rung for rung, n in counts.items() if n > k)
        repeat = drawn(subject, best.get(subject.name), k // len(subjects))
        jobs.append((repeat, subject, asked, limits, (trade.seed, 10_000 + k)))
    return shared(answered, jobs, trade.processes, things="repeats", progress=progress) if jobs else ()


def allowed(floor: float) -> float:
    """Error in posterior sd that is good enough where Monte Carlo errors are this large."""
    return max(ACCURATE, FLOORS * floor)


def front(rungs: Sequence[RungTotals], floor: float) -> tuple[RungName, ...]:
    """Rungs that no other beats in time without being worse; errors below the floor are all the same.

    The error is that of the worst coefficient, by which rungs are recommended; the floor is the largest Monte
    Carlo error of a difference.
    """
    kept = unbeaten(rungs, lambda place: place.whole_seconds, lambda place: max(place.largest, floor))
    return tuple(total.rung for total in kept)


def unbeaten(
    rungs: Iterable[Timed], seconds: Callable[[Timed], float], error: Callable[[Timed], float]
) -> list[Timed]:
    """Those whose error is smaller than that of all who are faster, from the fastest."""
    kept = list[Timed]()
    for rung in sorted(rungs, key=seconds):
        if error(rung) < (error(kept[-1]) if kept else math.inf):
            kept.append(rung)
    return kept


def faults(place: RungTotals, scored: Score | None, floor: float) -> Iterator[str]:
    """Why a rung is not good enough, on the data and on repeats, in words; nothing if it is."""
    if place.largest >= UNSOLVED:
        yield "its solution is singular"
    elif place.largest > allowed(floor):
        yield f"a coefficient is off by {place.largest:.2g} posterior sd"
    if place.inclusion > SURE:
        yield f"an inclusion is off by {place.inclusion:.2g}"
    if scored is not None and scored.coverage.share.high < INTERVAL:
        yield f"its 90 % intervals hold only {100.0 * scored.coverage.share.value:.0f} % of the truths"


def recommended(
    rungs: Sequence[RungTotals], scores: Sequence[Score], best: RungName, floor: float
) -> RungName:
    """The cheapest rung without faults; the best where there is none."""
    by_rung = {scored.rung: scored for scored in scores}
    for place in sorted(rungs, key=lambda total: total.whole_seconds):
        if not any(faults(place, by_rung.get(place.rung), floor)):
            return place.rung
    return best
