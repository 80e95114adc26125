"""The best test within a time, before it is run.

The covariance of what will be known does not depend on what the sensor will say, so a plan can be weighed
before its first reading: `worth` of its steps. The search starts from several plans and improves each (see
`imubayes.planning.exchange`); what it finds is a local optimum, and never worse than any plan it starts from.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from imubayes.errors import InputError
from imubayes.planning.candidates import Aim, Problem, Step, Steps, duration, pauses, worth
from imubayes.planning.exchange import Found, additions, filled, improved, with_step

SEEDS = 3
"""Plans that are improved: the best of those that the search could start from."""

__all__ = ["best_plan", "even_plan", "following"]


def even_plan(problem: Problem, menu: int) -> Steps:
    """Every setting of one run, in the order of its procedure, each for the same time.

    Raises
    ------
    InputError : if the limit leaves no time for that.
    """
    one = problem.menus[menu]
    steps = [Step(menu, setting, 1.0) for setting in range(len(one.X))]
    left = problem.limit - one.handling.setup - sum(pauses(one, steps))
    if left <= 0.0:
        raise InputError(
            f"run '{one.run}': {len(steps)} settings take longer than {problem.limit:g} s to go through,"
            " without a second of record: raise the time, or offer fewer settings"
        )
    return tuple(Step(menu, setting, left / len(steps)) for setting in range(len(one.X)))


def best_plan(problem: Problem, starts: Sequence[Steps] = ()) -> Found:
    """Find the best plan within the time.

    Parameters
    ----------
    problem : candidates, aim and time.
    starts : plans to start from beside the usual ones.

    Returns
    -------
    plan, and the size of what it leaves to know.

    Raises
    ------
    InputError : if the time is not enough for one dwell.

    Examples
    --------
    The line with the surest slope is measured at its ends.

    >>> from imubayes.planning.candidates import Handling, Menu
    >>> from imubayes.sensors.noise import Noise
    >>> x = np.linspace(-1.0, 1.0, 5)
    >>> X = np.column_stack((np.ones(5), x))
    >>> bench = Menu("line", X, np.zeros(5, dtype=int), (1.0,), Handling(0.0), Noise(1.0, 0.0, 0.0))
    >>> found = best_plan(Problem((bench,), 1e-3 * np.eye(2), Aim("rms", np.array([[0.0, 1.0]])), 4.0))
    >>> sorted(step.setting for step in found.steps)
    [0, 0, 4, 4]
    """
    if not additions(problem, (), problem.limit):
        raise InputError(
            f"{problem.limit:g} s are not enough for one dwell with its handling: raise the time of the plan,"
            " or offer shorter dwells"
        )
    broad = replace(problem, aim=Aim("D", problem.aim.G))
    usual = [filled(broad, ()).steps] if len(problem.aim.G) > 1 else []
    spread = [_spread(problem, k) for k, menu in enumerate(problem.menus) if menu.dwells]
    plans = [filled(problem, start) for start in dict.fromkeys(((), *usual, *spread, *starts))]
    promising = sorted(plans, key=lambda one: one.worth)[:SEEDS]
    return min((improved(problem, plan) for plan in promising), key=lambda one: one.worth)


def following(problem: Problem, steps: Steps, most: int) -> tuple[tuple[Step, float, float], ...]:
    """Best next dwells after some steps, each by itself.

    Returns
    -------
    (step, its time in s, worth with it), the largest gain in its time first.
    """
    now = worth(problem, steps)
    found = [
        (step, cost, worth(problem, with_step(problem, steps, step)))
        for step, cost in additions(problem, steps, math.inf)
    ]
    return tuple(sorted(found, key=lambda one: (np.log(one[2]) - np.log(now)) / one[1])[:most])


def _spread(problem: Problem, menu: int) -> Steps:
    """As many settings of one run as fit into the time, evenly over all of them, for the shortest time."""
    one = problem.menus[menu]
    dwell = min(one.dwells)
    for count in range(len(one.X), 0, -1):
        settings = np.unique(np.linspace(0, len(one.X) - 1, count).astype(int)).tolist()
        steps = tuple(Step(menu, setting, dwell) for setting in settings)
        if duration(problem, steps) <= problem.limit:
            return steps
    return ()
