"""The whole trade: every rung on the study's own data, then on simulated repeats, and what follows."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence

import numpy as np

from imubayes.campaign.fidelity import NEEDS_ROWS, CostLaw, RungName, rungs_for
from imubayes.errors import InputError
from imubayes.inference.mcmc.ensembles import Limits
from imubayes.ladder.costs import calibrate
from imubayes.ladder.problem import size_of
from imubayes.ladder.trade.afford import CROWDED, HALF, beforehand, chain_limit, counts, dear
from imubayes.ladder.trade.again import Repeat, repeat, sensors
from imubayes.ladder.trade.alone import Measured, measured
from imubayes.ladder.trade.differ import best_of, difference, knowledge_of, scene_needs, tested
from imubayes.ladder.trade.machine import machine
from imubayes.ladder.trade.plan import DEFAULT, Subject, Trade
from imubayes.ladder.trade.recommend import front, recommended
from imubayes.ladder.trade.record import Place, Standing, Traded, places
from imubayes.ladder.trade.score import Score, score
from imubayes.population.processes import Progress, shared
from imubayes.scenes.relevance import Exposure, exposure

Exposed = Mapping[str, Mapping[str, Exposure]]
"""What each scene makes of a component's terms: by component, by scene."""

START_POOL = 5.0
"""s until the processes that share the repeats have started."""

LONGER = 3.0
"""Times the seconds that chains took on the study's own data, after which those of a repeat end."""


def measure(trade: Trade, *, progress: Progress = lambda message: None) -> Traded:
    """Measure the rungs.

    Parameters
    ----------
    trade : what is asked (see `imubayes.ladder.trade.subjects`).
    progress : is told what goes on.

    Raises
    ------
    InputError : if a component's runs cannot be used, or the time is too short for any rung.
    """
    start, here = time.perf_counter(), machine()
    law = calibrate(progress)
    progress("scenes")
    exposed = {one.name: _exposed(trade, one) for one in trade.subjects}
    share = HALF if trade.repeats else 1.0
    standings = _standings(trade, exposed, start + share * trade.limit, law, progress)
    found = places(standings, trade.rungs)
    again = _repeats(trade, standings, found, start + trade.limit, progress)
    best = _highest(standings, trade.rungs)
    floor = max(one.floor[0] for one in standings), max(one.floor[1] for one in standings)
    scores = _scores(trade, again, exposed)
    return Traded(
        trade=trade,
        standings=standings,
        places=found,
        best=best,
        floor=floor,
        front=front(found, floor[0]),
        recommended=recommended(found, scores, best, floor[0]),
        scores=scores,
        dear=dear(trade.rungs, {one.rung: one.repeats for one in scores}) if _repeated(trade) else (),
        machine=here,
        seconds=time.perf_counter() - start,
    )


def _repeated(trade: Trade) -> bool:
    """Whether simulated repeats are asked for, and any component's tests can be repeated."""
    return trade.repeats > 0 and any(one.repeatable for one in trade.subjects)


def _highest(standings: Sequence[Standing], rungs: Sequence[RungName]) -> RungName:
    """The highest rung that others were held against."""
    return rungs[max(rungs.index(one.best) for one in standings)]


def _exposed(trade: Trade, subject: Subject) -> Mapping[str, Exposure]:
    """What the scenes make of a component's terms; a budget of the output is only for its own kind."""
    lib = subject.problem.library
    return {
        m.name: exposure(m.scene, lib, m.budget, axis=m.axis)
        for m in trade.missions
        if m.kind in (None, subject.problem.spec.kind)
    }


def _standings(
    trade: Trade, exposed: Exposed, deadline: float, law: CostLaw, progress: Progress
) -> tuple[Standing, ...]:
    """Measure one component after the other, as long as the time reaches for all rungs up to the default."""
    found: list[Standing] = []
    for k, subject in enumerate(trade.subjects):
        size = size_of(subject.problem)
        least = sum(beforehand(rung, size, law) for rung in _up_to_usual(trade.rungs))
        if found and least > deadline - time.perf_counter():
            break
        found.append(_standing(trade, k, exposed[subject.name], deadline, law, progress))
    return tuple(found)


def _up_to_usual(rungs: tuple[RungName, ...]) -> tuple[RungName, ...]:
    """Rungs up to the default, or all where it is not among them."""
    return rungs[: rungs.index(DEFAULT) + 1] if DEFAULT in rungs else rungs


def _standing(
    trade: Trade,
    k: int,
    exposed: Mapping[str, Exposure],
    deadline: float,
    law: CostLaw,
    progress: Progress,
) -> Standing:
    subject, size = trade.subjects[k], size_of(trade.subjects[k].problem)
    found: list[Measured] = []
    skipped: list[tuple[RungName, str]] = []
    for place, rung in enumerate(trade.rungs):
        if rung not in rungs_for(size):
            skipped.append((rung, NEEDS_ROWS))
            continue
        left, expected = deadline - time.perf_counter(), beforehand(rung, size, law)
        if found and expected > left:
            skipped.append((rung, f"it takes about {expected:.0f} s, and {max(left, 0.0):.0f} s were left"))
            continue
        progress(f"{subject.name}: {rung}")
        limits = Limits(ess=trade.ess, time_limit=chain_limit(left))
        one = measured(subject.problem, rung, limits, (trade.seed, k, place))
        if one is None:
            skipped.append((rung, "its process ended: is memory short?"))
        else:
            found.append(one)
    if not found:
        raise InputError(f"sensor '{subject.name}': no rung came to an end: is memory short?")
    return standing_of(subject.name, found, exposed, skipped)


def standing_of(
    name: str,
    found: Sequence[Measured],
    exposed: Mapping[str, Exposure],
    skipped: Sequence[tuple[RungName, str]] = (),
) -> Standing:
    """Hold the rungs on one component against the best of them.

    Parameters
    ----------
    name : of the component.
    found : the rungs, from the cheapest.
    exposed : what each scene makes of its terms.
    skipped : rungs that were not measured.
    """
    best = best_of([one.told for one in found])
    needs = {one.told.rung: scene_needs(exposed, knowledge_of(one.told)) for one in found}
    # a difference of two answers has the errors of both
    errors = math.sqrt(2.0) * best.monte_carlo[tested(best)]
    return Standing(
        subject=name,
        measured=tuple(found),
        differences=tuple(
            difference(one.told, best, needs[one.told.rung], needs[best.rung]) for one in found
        ),
        best=best.rung,
        floor=(float(errors.max(initial=0.0)), float(np.sqrt(np.mean(errors**2))) if errors.size else 0.0),
        skipped=tuple(skipped),
    )


def _repeats(
    trade: Trade,
    standings: Sequence[Standing],
    found: Sequence[Place],
    deadline: float,
    progress: Progress,
) -> tuple[Repeat, ...]:
    """Simulate sensors, and let every rung answer that the rest of the time affords."""
    told = {one.subject: next(m.told for m in one.measured if m.told.rung == one.best) for one in standings}
    subjects = [s for s in trade.subjects if s.repeatable and (s.lot is not None or s.name in told)]
    if not subjects:
        return ()
    seconds: dict[RungName, float] = {one.rung: one.seconds for one in found}
    left = deadline - time.perf_counter() - START_POOL
    afforded = counts(seconds, trade.repeats, left / CROWDED, trade.processes)
    most = max(afforded.values(), default=0)
    drawn = sensors(subjects, [told.get(one.name) for one in subjects], most)
    longest = LONGER * max((m.told.chain_seconds for one in standings for m in one.measured), default=1.0)
    jobs = [
        (
            one,
            tuple(rung for rung, count in afforded.items() if count > k),
            Limits(ess=trade.ess, time_limit=max(longest, 1.0)),
            (trade.seed, 10_000 + k),
        )
        for k, one in enumerate(drawn)
    ]
    if not jobs:
        return ()
    return tuple(shared(repeat, jobs, trade.processes, things="repeats", progress=progress))


def _scores(trade: Trade, again: Sequence[Repeat], exposed: Exposed) -> tuple[Score, ...]:
    """Score every rung that answered repeats."""
    costs = trade.subjects[0].problem.costs
    each = (score(rung, again, costs, exposed) for rung in trade.rungs)
    return tuple(one for one in each if one is not None)
