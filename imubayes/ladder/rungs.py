"""The rungs of the ladder as functions with one interface, and the way up: a problem in, an answer out.

A budget of time takes the best rung that fits; an accuracy climbs until the answer no longer changes.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from imubayes.campaign.fidelity import LADDER, NEEDS_ROWS, Choice, CostLaw, RungName, rung_of, rungs_for
from imubayes.errors import ConvergenceError
from imubayes.inference.mcmc.ensembles import Limits
from imubayes.ladder.averaged import averaged, plug_in
from imubayes.ladder.costs import foreseen, within
from imubayes.ladder.foresight import foresee
from imubayes.ladder.problem import Answer, Ground, Problem, Tell, change, ground_of, size_of
from imubayes.ladder.regression import means, sparse
from imubayes.ladder.sampled import collapsed, full, raw

RUNGS: Mapping[RungName, Callable[[Ground], Answer]] = {
    "means": means,
    "sparse": sparse,
    "plug-in": plug_in,
    "averaged": averaged,
    "collapsed": collapsed,
    "full": full,
    "raw": raw,
}
"""From the cheapest to the best."""

NAMES: tuple[RungName, ...] = tuple(rung.name for rung in LADDER)


def stand(rung: RungName, ground: Ground) -> Answer:
    """Answer of one rung on a ground that others may have been on before: what they share is not done again.

    The seconds are those that the rung takes alone.

    Raises
    ------
    InputError : if there is no such rung, or the runs cannot be used.
    """
    work = RUNGS[rung_of(rung).name]
    shares = {"means": (), "raw": ("factor", "full")}.get(rung, ("factor", rung))
    done = sum(ground.shared[name][1] for name in shares if name in ground.shared)
    start = time.perf_counter()
    found = work(ground)
    seconds = time.perf_counter() - start + done
    return replace(found, seconds=seconds, ready=ground.shared["factor"][0] if shares else None)


def by_budget(
    problem: Problem,
    budget: float,
    law: CostLaw,
    *,
    rng: np.random.Generator,
    tell: Tell = lambda message: None,
    limits: Limits | None = None,
) -> tuple[Answer, Choice]:
    """Answer of the best rung that fits into a budget, straight away, without the rungs below it.

    Parameters
    ----------
    problem : one component.
    budget : s. Chains end in time, whether they have converged or not.
    law : what the rungs take on this machine (see `imubayes.ladder.costs.calibrate`).
    rng : of whatever is drawn.
    tell : is told what goes on.
    limits : of chains, where a rung has any; by default those of a study.
    """
    start, size = time.perf_counter(), size_of(problem)
    rung = within(budget, size, law)
    ground = ground_of(problem, rng, tell, _ending(limits, budget, foreseen(rung, size, law)))
    try:
        found = stand(rung, ground)
    except ConvergenceError:  # where chains cannot be run, the best rung without
        found = stand("averaged", ground)
    choice = _choice(ground, found, law, f"a budget of {budget:g} s", start)
    return found, replace(choice, budget=budget)


def by_accuracy(
    problem: Problem,
    accuracy: float,
    law: CostLaw,
    *,
    rng: np.random.Generator,
    tell: Tell = lambda message: None,
    limits: Limits | None = None,
) -> tuple[Answer, Choice]:
    """Climb until a rung changes no coefficient by more than `accuracy` against the one before.

    Parameters
    ----------
    problem : one component.
    accuracy : in posterior sd, of averaged and full-library coefficients alike.
    law : what the rungs take on this machine.
    rng, tell, limits : as for `by_budget`.
    """
    start = time.perf_counter()
    ground = ground_of(problem, rng, tell, limits)
    found = stand(NAMES[0], ground)
    steps: list[tuple[RungName, float, float]] = [(found.rung, 0.0, 0.0)]
    for name in rungs_for(size_of(problem))[1:]:
        try:
            below, found = found, stand(name, ground)
        except ConvergenceError:  # and so it is with the rungs above
            break
        steps.append((name, *change(below, found)))
        if steps[-1][1] <= accuracy:
            break
    asked = f"an accuracy of {accuracy:g} posterior sd"
    return found, replace(_choice(ground, found, law, asked, start), climbed=tuple(steps), accuracy=accuracy)


def _ending(limits: Limits | None, budget: float, foreseen: float) -> Limits:
    """Limits under which chains leave half of the budget, or of what is foreseen, for what is beside them."""
    limits = limits or Limits()
    return replace(limits, time_limit=min(limits.time_limit, max(budget - 0.5 * foreseen, 0.5 * budget)))


def _choice(
    ground: Ground,
    found: Answer,
    law: CostLaw,
    asked: str,
    start: float,
) -> Choice:
    """What was taken, and what the next rung would change."""
    size = size_of(ground.problem)
    can = rungs_for(size)
    above = can[can.index(found.rung) + 1 :]
    ahead, why = foresee(ground, found) if above else ((0.0, 0.0), _top(found.rung))
    return Choice(
        rung=found.rung,
        asked=asked,
        seconds=time.perf_counter() - start,
        foreseen=foreseen(found.rung, size, law),
        climbed=(),
        next_rung=above[0] if above else None,
        next_seconds=foreseen(above[0], size, law) if above else 0.0,
        next_change=ahead,
        next_reason=why,
    )


def _top(rung: RungName) -> str:
    """Why there is no rung above."""
    above = NAMES[NAMES.index(rung) + 1 :]
    return f"{above[0]} is no choice here: {NEEDS_ROWS}" if above else "there is no better rung"
