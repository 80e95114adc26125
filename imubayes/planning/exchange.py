"""The best test within a time, before it is run: plans, and moves that make them better.

The covariance of what will be known does not depend on what the sensor will say, so a plan can be weighed
before its first reading: `worth` of its steps. The search starts from several plans and improves each by
moves: another setting in a slot, another order, another share of the time. What it finds is a local optimum,
and never worse than any plan it starts from.

Fedorov's exchange with correlated rows. Where the rows X of a run change by ``e d'`` (another setting in
slot i: e is the i-th unit vector; slots i and j swapped: e has a 1 and a -1 there), the information changes
by ``U J U'`` with ``U = [a d]``, ``a = X' P e`` and ``J = [[0, 1], [1, e' P e]]``, P being the inverse
covariance of the rows. A slot i left out takes ``a a' / P_ii`` with it. So all changes of a slot are weighed
at once, by updates of rank 2; what they promise is then computed afresh, by orthogonal transformations,
before it is believed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.errors import InputError
from imubayes.planning.menu import (
    Aim,
    Menu,
    PlanProblem,
    Step,
    Steps,
    duration,
    pauses,
    root,
    runs_of,
    whitened,
    whitening,
    worth,
)

SEEDS = 3
"""Plans that are improved: the best of those that the search could start from."""

GAIN = 1e-6
"""Relative gain below which a plan is no better."""

SHORTLIST = 4
"""Candidates that promise most, of which the worth is computed afresh."""

DROPPED = 6
"""Dwells that tell least, which are tried to be left out."""

TOGETHER = (2, 3, 6)
"""How many of them are tried to be left out at once: a longer dwell or another mount may need their time."""

SETTLED = 1e-3
"""Relative gain of a round through all moves below which other mounts are tried, and then the search ends."""

ROUNDS = 30
"""Rounds through all moves at most; five to ten are usual."""

ROUNDING = 1e-9
"""Share of a row's weight that is left where no other row tells what it tells."""


@dataclass(frozen=True, slots=True)
class ValuedPlan:
    """A plan and its worth."""

    steps: Steps
    worth: float

    def beats(self, other: ValuedPlan) -> bool:
        """Whether it is better than another plan."""
        return self.worth < (1.0 - GAIN) * other.worth


Move = Callable[[PlanProblem, ValuedPlan], ValuedPlan]


def even_plan(problem: PlanProblem, menu: int) -> Steps:
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


def best_plan(problem: PlanProblem, starts: Sequence[Steps] = ()) -> ValuedPlan:
    """Find the best plan within the time.

    Returns
    -------
    plan, and the size of what it leaves to know.

    Raises
    ------
    InputError : if the time is not enough for one dwell.

    Examples
    --------
    The line with the surest slope is measured at its ends.

    >>> from imubayes.planning.menu import Handling, Menu
    >>> from imubayes.sensors.noise import Noise
    >>> x = np.linspace(-1.0, 1.0, 5)
    >>> X = np.column_stack((np.ones(5), x))
    >>> bench = Menu("line", X, np.zeros(5, dtype=int), (1.0,), Handling(0.0), Noise(1.0, 0.0, 0.0))
    >>> found = best_plan(PlanProblem((bench,), 1e-3 * np.eye(2), Aim("rms", np.array([[0.0, 1.0]])), 4.0))
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


def following(problem: PlanProblem, steps: Steps, most: int) -> tuple[tuple[Step, float, float], ...]:
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


def _spread(problem: PlanProblem, menu: int) -> Steps:
    """As many settings of one run as fit into the time, evenly over all of them, for the shortest time."""
    one = problem.menus[menu]
    dwell = min(one.dwells)
    for count in range(len(one.X), 0, -1):
        settings = np.unique(np.linspace(0, len(one.X) - 1, count).astype(int)).tolist()
        steps = tuple(Step(menu, setting, dwell) for setting in settings)
        if duration(problem, steps) <= problem.limit:
            return steps
    return ()


def improved(problem: PlanProblem, plan: ValuedPlan) -> ValuedPlan:
    """Improve a plan until no move makes it better."""
    for _ in range(ROUNDS):
        before = plan
        for move in MOVES:
            plan = move(problem, plan)
        if plan.worth > (1.0 - SETTLED) * before.worth:
            other = mounts_changed(problem, plan)
            if other is plan:
                break
            plan = other
    return plan


def filled(problem: PlanProblem, steps: Steps) -> ValuedPlan:
    """Add dwells, the one that gains most in its time first, until the time is over."""
    plan = ValuedPlan(steps, worth(problem, steps))
    while (more := _best_addition(problem, plan.steps)) is not None:
        plan = more
    return plan


def settings_changed(problem: PlanProblem, plan: ValuedPlan) -> ValuedPlan:
    """Go through the slots, and take the best setting of the same mount in each."""
    for slot, step in enumerate(plan.steps):
        menu = problem.menus[step.menu]
        others = np.flatnonzero(menu.mount == menu.mount[step.setting])
        E = np.zeros((len(plan.steps), len(others)))
        E[slot] = 1.0
        promised = _promised(problem, plan.steps, slot, E, menu.X[others] - menu.X[step.setting])
        tried = (_replaced(plan.steps, {slot: int(others[k])}) for k in _promising(promised, plan.worth))
        plan = _first_better(problem, plan, tried)
    return plan


def order_changed(problem: PlanProblem, plan: ValuedPlan) -> ValuedPlan:
    """Swap the settings of slots of one mount where that helps against drift."""
    for slot in range(len(plan.steps)):
        here = plan.steps[slot]
        mount = _mount(problem, here)
        others = [k for k, step in enumerate(plan.steps) if step != here and _mount(problem, step) == mount]
        if not others:
            continue
        E = np.zeros((len(plan.steps), len(others)))
        E[slot], E[others, np.arange(len(others))] = 1.0, -1.0
        X = problem.menus[here.menu].X
        d = X[[plan.steps[k].setting for k in others]] - X[here.setting]
        chosen = [others[k] for k in _promising(_promised(problem, plan.steps, slot, E, d), plan.worth)]
        swaps = ({slot: plan.steps[k].setting, k: here.setting} for k in chosen)
        plan = _first_better(problem, plan, (_replaced(plan.steps, swap) for swap in swaps))
    return plan


def time_moved(problem: PlanProblem, plan: ValuedPlan) -> ValuedPlan:
    """Leave out dwells that tell little, and spend their time where it gains most."""
    least = np.argsort(_promised_without(problem, plan.steps)).tolist()
    alone = [[slot] for slot in least[:DROPPED]]
    together = [least[:count] for count in TOGETHER if count < len(least)]
    for out in (*alone, *together):
        better = filled(problem, tuple(s for k, s in enumerate(plan.steps) if k not in out))
        if better.beats(plan):
            return better
    return plan


def dwells_changed(problem: PlanProblem, plan: ValuedPlan) -> ValuedPlan:
    """Give a dwell another time, and leave others out, or add some, for it."""
    order = np.argsort(_promised_without(problem, plan.steps)).tolist()
    for slot in dict.fromkeys((*order[:DROPPED], *order[-DROPPED:])):
        old = plan.steps[slot]
        for dwell in problem.menus[old.menu].dwells:
            if dwell != old.dwell:
                new = Step(old.menu, old.setting, dwell)
                steps = _shortened(problem, (*plan.steps[:slot], new, *plan.steps[slot + 1 :]), new)
                better = filled(problem, steps)
                if duration(problem, steps) <= problem.limit and better.beats(plan):
                    return better
    return plan


def _shortened(problem: PlanProblem, steps: Steps, kept: Step) -> Steps:
    """Steps within the time, without those that tell least; but one is kept."""
    while duration(problem, steps) > problem.limit and len(steps) > 1:
        least = np.argsort(_promised_without(problem, steps)).tolist()
        slot = next(k for k in least if steps[k] is not kept)
        steps = (*steps[:slot], *steps[slot + 1 :])
    return steps


def mounts_changed(problem: PlanProblem, plan: ValuedPlan) -> ValuedPlan:
    """Leave a mount out, and spend its time anew."""
    for block in dict.fromkeys(_mount(problem, step) for step in plan.steps):
        better = filled(problem, tuple(s for s in plan.steps if _mount(problem, s) != block))
        if better.beats(plan):
            return better
    return plan


MOVES: tuple[Move, ...] = (settings_changed, time_moved, dwells_changed, order_changed)


def additions(problem: PlanProblem, steps: Steps, left: float) -> list[tuple[Step, float]]:
    """Dwells that the time is left for, and what each costs in s."""
    found = list[tuple[Step, float]]()
    runs, mounts = {step.menu for step in steps}, {_mount(problem, step) for step in steps}
    for k, menu in enumerate(problem.menus):
        handling = menu.handling
        for mount in np.unique(menu.mount).tolist():
            settings = np.flatnonzero(menu.mount == mount).tolist()
            fresh = handling.mount * ((k, mount) not in mounts) + handling.setup * (k not in runs)
            for dwell in menu.dwells:
                cost = handling.settle + fresh + dwell
                if cost <= left:
                    found += [(Step(k, setting, dwell), cost) for setting in settings]
    return found


def with_step(problem: PlanProblem, steps: Steps, new: Step) -> Steps:
    """Steps with one more: the last of its mount; a new mount is last in its run, a new run last of all."""
    mount = [k for k, step in enumerate(steps) if _mount(problem, step) == _mount(problem, new)]
    run = [k for k, step in enumerate(steps) if step.menu == new.menu]
    after = (mount or run or [len(steps) - 1])[-1] + 1
    return (*steps[:after], new, *steps[after:])


def _best_addition(problem: PlanProblem, steps: Steps) -> ValuedPlan | None:
    """Plan with one more dwell, the one that gains most in its time; None where no time is left."""
    candidates = additions(problem, steps, problem.limit - duration(problem, steps))
    if not candidates:
        return None
    S = root(problem, steps)
    G = problem.aim.G @ S
    now, cost = float(problem.aim.size(G @ G.T)), np.array([cost for _, cost in candidates])
    promised = _promised_additions(problem, S, [step for step, _ in candidates])
    best, rate = None, -np.inf
    for k in np.argsort((np.log(promised) - np.log(now)) / cost)[:SHORTLIST].tolist():
        more = with_step(problem, steps, candidates[k][0])
        value = worth(problem, more)
        if (gain := float(np.log(now / value) / cost[k])) > rate:
            best, rate = ValuedPlan(more, value), gain
    return best


def _promised_additions(problem: PlanProblem, S: FloatArray, new: Sequence[Step]) -> FloatArray:
    """Worth with each of the steps, as if its noise had nothing to do with that of the others: rank 1."""
    rows = np.array([problem.menus[s.menu].X[s.setting] for s in new])
    alone = {(k, dwell): _alone(problem.menus[k], dwell) for k, dwell in {(s.menu, s.dwell) for s in new}}
    noise = [alone[s.menu, s.dwell] for s in new]
    seen = rows @ S
    G = problem.aim.G @ S
    moved = seen @ G.T / np.sqrt(np.array(noise) + np.sum(seen**2, axis=1))[:, None]
    return problem.aim.size(G @ G.T - moved[:, :, None] * moved[:, None, :])


def _alone(menu: Menu, dwell: float) -> float:
    """Variance of a dwell's mean, given that of a dwell before it."""
    return float(whitening(menu, [Step(0, 0, dwell)] * 2)[1, 1] ** -2)


def _promised(problem: PlanProblem, steps: Steps, slot: int, E: FloatArray, d: FloatArray) -> FloatArray:
    """Worth (k,) where the rows of the run of a slot change by ``e d'`` (see the module).

    Parameters
    ----------
    E : (steps, k) directions e, zero outside of the run.
    d : (k, c) changes.
    """
    run = [k for k, step in enumerate(steps) if step.menu == steps[slot].menu]
    menu, part = problem.menus[steps[slot].menu], [steps[k] for k in run]
    W, S = whitening(menu, part), root(problem, steps)
    G, We = problem.aim.G @ S, W @ E[run]
    a = (We.T @ whitened(menu, part)) @ S
    U = np.stack((a, d @ S), axis=2)
    K = np.swapaxes(U, 1, 2) @ U
    K[:, 0, 0] -= np.sum(We**2, axis=0)
    K[:, 0, 1] += 1.0
    K[:, 1, 0] += 1.0
    moved = G @ U
    return problem.aim.size(G @ G.T - moved @ np.linalg.solve(K, np.swapaxes(moved, 1, 2)))


def _promised_without(problem: PlanProblem, steps: Steps) -> FloatArray:
    """Worth (n,) without each of the steps, the others keeping their times."""
    S = root(problem, steps)
    G, worths = problem.aim.G @ S, list[FloatArray]()
    for k, part in runs_of(steps):
        W = whitening(problem.menus[k], part)
        strength = np.sum(W**2, axis=0)
        a = (W.T @ whitened(problem.menus[k], part)) @ S
        kept = np.maximum(strength - np.sum(a**2, axis=1), ROUNDING * strength)
        moved = (a @ G.T) / np.sqrt(kept)[:, None]
        worths.append(problem.aim.size(G @ G.T + moved[:, :, None] * moved[:, None, :]))
    return np.concatenate([np.empty(0), *worths])


def _promising(promised: FloatArray, now: float) -> list[int]:
    """Numbers of the best few of those that promise to be better."""
    best = np.argsort(promised)[:SHORTLIST]
    return best[promised[best] < (1.0 - GAIN) * now].tolist()


def _replaced(steps: Steps, settings: Mapping[int, int]) -> Steps:
    """Steps with other settings in some slots."""
    return tuple(
        Step(step.menu, settings.get(slot, step.setting), step.dwell) for slot, step in enumerate(steps)
    )


def _mount(problem: PlanProblem, step: Step) -> tuple[int, int]:
    return step.menu, int(problem.menus[step.menu].mount[step.setting])


def _first_better(problem: PlanProblem, plan: ValuedPlan, candidates: Iterable[Steps]) -> ValuedPlan:
    for steps in candidates:
        other = ValuedPlan(steps, worth(problem, steps))
        if other.beats(plan):
            return other
    return plan
