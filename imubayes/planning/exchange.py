"""The best test within a time, before it is run: plans, and moves that make them better.

The covariance of what will be known does not depend on what the sensor will say, so a plan can be weighed
before its first reading: `worth` of its steps. The search starts from several plans and improves each by
moves: another setting in a slot, another order, another share of the time. What it finds is a local optimum,
and never worse than any plan it starts from.

Fedorov's exchange with correlated rows. Where w of the rows X that a signal has in a run change by d (w, c),
for other settings in a slot or two, the information changes by ``U' J U`` with ``U = [a; d]``, a being these
rows of P X and ``J = [[0, 1], [1, P_w]]``; P is the inverse covariance of the rows, P_w that of these w.
Signals of several components add up. A slot left out takes ``a' P_w^-1 a`` with it. So all changes of a slot
are weighed at once, by updates of low rank; what they promise is then computed afresh, by orthogonal
transformations, before it is believed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from imubayes.algebra import FloatArray
from imubayes.errors import InputError
from imubayes.planning import (
    Menu,
    PlanProblem,
    Signal,
    Step,
    Steps,
    added,
    duration,
    pauses,
    root,
    runs_of,
    settings_of,
    size_of,
    whitening,
    worth,
)
from imubayes.work import Progress, part_of, silent

SEEDS = 3
"""Plans that are improved: the best of those that the search could start from."""

DIGITS = 6
"""Digits of a worth that count: beyond them plans are as good as each other, and differ by rounding."""

GAIN = 10.0**-DIGITS
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
"""Rounds through all moves at most."""

USUAL_ROUNDS = 8
"""Of five to ten that are usual: what somebody who waits is told to expect."""

ROUNDING = 1e-9
"""Share of a row's weight that is left where no other row tells what it tells."""


@dataclass(frozen=True, slots=True)
class ValuedPlan:
    """A plan and its worth: the size of what it leaves to know."""

    steps: Steps
    worth: float

    def beats(self, other: ValuedPlan) -> bool:
        """Whether it is better than another plan."""
        return self.worth < (1.0 - GAIN) * other.worth


def even_plan(problem: PlanProblem, menu: int) -> Steps:
    """Every setting of one run, in the order of its procedure, each for the same time.

    It is an `InputError` if the limit leaves no time for that, beyond what is lost at the ends of dwells.
    """
    offer = problem.menus[menu]
    steps = [Step(menu, setting, 1.0) for setting in range(len(offer))]
    each = (problem.limit - offer.setup - sum(pauses(offer, steps))) / len(steps)
    if each <= offer.lost:
        raise InputError(
            f"run '{offer.run}': {len(steps)} settings take longer than {problem.limit:g} s to go through,"
            " without a second of record: raise the time, or offer fewer settings"
        )
    return tuple(step._replace(dwell=each) for step in steps)


def best_plan(problem: PlanProblem, starts: Sequence[Steps] = (), tell: Progress = silent) -> ValuedPlan:
    """Find the best plan within the time; `tell` is told how far the search is.

    It is an `InputError` if the time is not enough for one dwell.

    Examples
    --------
    The line with the surest slope is measured at its ends.

    >>> from imubayes.planning import Menu, Signal
    >>> from imubayes.sensors.noise import Noise
    >>> x = np.linspace(-1.0, 1.0, 5)
    >>> X = np.column_stack((np.ones(5), x))
    >>> line = Signal(X, Noise(1.0, 0.0, 0.0))
    >>> bench = Menu("line", (line,), np.zeros(5, dtype=int), (1.0,))
    >>> found = best_plan(PlanProblem((bench,), 1e-3 * np.eye(2), "rms", np.array([[0.0, 1.0]]), 4.0))
    >>> sorted(step.setting for step in found.steps)
    [0, 0, 4, 4]
    """
    if not additions(problem, (), problem.limit):
        raise InputError(
            f"{problem.limit:g} s are not enough for one dwell with its handling: raise the time of the plan,"
            " or offer shorter dwells"
        )
    tell("plans to start from", 0.0)
    usual = [filled(replace(problem, aim="D"), ()).steps] if len(problem.G) > 1 else []
    spread = [_spread(problem, k) for k, menu in enumerate(problem.menus) if menu.dwells]
    plans = [filled(problem, start) for start in dict.fromkeys(((), *usual, *spread, *starts))]
    promising = [plans[k] for k in _ranked([plan.worth for plan in plans])[:SEEDS]]
    count = len(promising)
    better = [
        improved(problem, plan, part_of(tell, k, count, f"{k + 1} of {count} plans improved, "))
        for k, plan in enumerate(promising)
    ]
    return better[_ranked([plan.worth for plan in better])[0]]


def following(problem: PlanProblem, most: int) -> tuple[tuple[Step, float, float], ...]:
    """Best first dwells, each by itself: (step, its time in s, worth), the largest gain in its time first."""
    now = worth(problem, ())
    gains = [(step, cost, worth(problem, (step,))) for step, cost in additions(problem, (), math.inf)]
    rates = [(np.log(value) - np.log(now)) / cost for _, cost, value in gains]
    return tuple(gains[k] for k in _ranked(rates)[:most])


def _ranked(values: ArrayLike) -> list[int]:
    """Places of values, the smallest first; those that are alike in the digits that count stay in order."""
    mantissa, exponent = np.frexp(values)
    return np.argsort(np.ldexp(np.round(mantissa, DIGITS), exponent), kind="stable").tolist()


def _spread(problem: PlanProblem, menu: int) -> Steps:
    """As many settings of one run as fit into the time, evenly over all of them, for the shortest time."""
    offer = problem.menus[menu]
    dwell = min(offer.dwells)
    for count in range(len(offer), 0, -1):
        settings = np.unique(np.linspace(0, len(offer) - 1, count).astype(int)).tolist()
        steps = tuple(Step(menu, setting, dwell) for setting in settings)
        if duration(problem, steps) <= problem.limit:
            return steps
    return ()


def improved(problem: PlanProblem, plan: ValuedPlan, tell: Progress = silent) -> ValuedPlan:
    """Improve a plan until no move makes it better."""
    for done in range(ROUNDS):
        before = plan
        for k, move in enumerate(MOVES):
            tell(f"round {done + 1}", min((done + k / len(MOVES)) / USUAL_ROUNDS, 1.0))
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
        tried = [{slot: int(setting)} for setting in others]
        plan = _best_change(problem, plan, step.menu, tried)
    return plan


def order_changed(problem: PlanProblem, plan: ValuedPlan) -> ValuedPlan:
    """Swap the settings of slots of one mount where that helps against drift."""
    for slot in range(len(plan.steps)):
        here = plan.steps[slot]
        mount = _mount(problem, here)
        others = [k for k, step in enumerate(plan.steps) if step != here and _mount(problem, step) == mount]
        swaps = [{slot: plan.steps[k].setting, k: here.setting} for k in others]
        plan = _best_change(problem, plan, here.menu, swaps)
    return plan


def _best_change(
    problem: PlanProblem, plan: ValuedPlan, menu: int, changes: Sequence[Mapping[int, int]]
) -> ValuedPlan:
    """Plan with other settings in slots of one run: of those that promise most the first that is better."""
    if not changes:
        return plan
    promised = _promised(problem, plan.steps, menu, changes)
    best = _ranked(promised)[:SHORTLIST]
    for k in (k for k in best if promised[k] < (1.0 - GAIN) * plan.worth):
        steps = tuple(
            Step(step.menu, changes[k].get(slot, step.setting), step.dwell)
            for slot, step in enumerate(plan.steps)
        )
        other = ValuedPlan(steps, worth(problem, steps))
        if other.beats(plan):
            return other
    return plan


def time_moved(problem: PlanProblem, plan: ValuedPlan) -> ValuedPlan:
    """Leave out dwells that tell little, and spend their time where it gains most."""
    least = _ranked(_promised_without(problem, plan.steps))
    alone = [[slot] for slot in least[:DROPPED]]
    together = [least[:count] for count in TOGETHER if count < len(least)]
    left = (tuple(s for k, s in enumerate(plan.steps) if k not in out) for out in (*alone, *together))
    return _first_better(problem, plan, left)


def dwells_changed(problem: PlanProblem, plan: ValuedPlan) -> ValuedPlan:
    """Give a dwell another time, and leave others out, or add some, for it."""
    order = _ranked(_promised_without(problem, plan.steps))
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
        least = _ranked(_promised_without(problem, steps))
        slot = next(k for k in least if steps[k] is not kept)
        steps = (*steps[:slot], *steps[slot + 1 :])
    return steps


def mounts_changed(problem: PlanProblem, plan: ValuedPlan) -> ValuedPlan:
    """Leave a mount out, and spend its time anew."""
    mounts = dict.fromkeys(_mount(problem, step) for step in plan.steps)
    left = (tuple(s for s in plan.steps if _mount(problem, s) != block) for block in mounts)
    return _first_better(problem, plan, left)


def _first_better(problem: PlanProblem, plan: ValuedPlan, starts: Iterable[Steps]) -> ValuedPlan:
    """The first start that beats a plan when its time is filled; else that plan."""
    filled_up = (filled(problem, steps) for steps in starts)
    return next((proposal for proposal in filled_up if proposal.beats(plan)), plan)


MOVES = (settings_changed, time_moved, dwells_changed, order_changed)


def additions(problem: PlanProblem, steps: Steps, left: float) -> list[tuple[Step, float]]:
    """Dwells that the time is left for, and what each costs in s."""
    possible = list[tuple[Step, float]]()
    runs, mounts = {step.menu for step in steps}, {_mount(problem, step) for step in steps}
    for k, menu in enumerate(problem.menus):
        for mount in np.unique(menu.mount).tolist():
            settings = np.flatnonzero(menu.mount == mount).tolist()
            fresh = menu.remount * ((k, mount) not in mounts) + menu.setup * (k not in runs)
            for dwell in menu.dwells:
                cost = menu.settle + fresh + dwell
                if cost <= left:
                    possible += [(Step(k, setting, dwell), cost) for setting in settings]
    return possible


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
    G = problem.G @ S
    now, cost = float(size_of(problem.aim, G @ G.T)), np.array([cost for _, cost in candidates])
    promised = _promised_additions(problem, steps, S, [step for step, _ in candidates])
    best, rate = None, 0.0
    for k in _ranked((np.log(promised) - np.log(now)) / cost)[:SHORTLIST]:
        more = with_step(problem, steps, candidates[k][0])
        value = worth(problem, more)
        gain = float(np.log(now / value) / cost[k])
        if best is None or gain > (1.0 + GAIN) * rate:
            best, rate = ValuedPlan(more, value), gain
    return best


def _promised_additions(problem: PlanProblem, steps: Steps, S: FloatArray, new: Sequence[Step]) -> FloatArray:
    """Worth with each of the steps, as if its noise had nothing to do with that of the others."""
    G, promised = problem.G @ S, np.empty(len(new))
    for k in {step.menu for step in new}:
        where = np.flatnonzero([step.menu == k for step in new])
        few = [step for step in new if step.menu == k]
        part = tuple(step for step in steps if step.menu == k)
        made = [added(signal, problem.menus[k], part, few) for signal in problem.menus[k].signals]
        told = zip(problem.menus[k].signals, made, strict=True)
        seen = np.concatenate([signal.seen(rows, S) for signal, (rows, _) in told], axis=1)
        noise = np.concatenate([variance for _, variance in made], axis=1)
        K = seen @ np.swapaxes(seen, 1, 2)
        K += noise[:, :, None] * np.eye(noise.shape[1])
        promised[where] = size_of(problem.aim, G @ G.T - _within(K, seen @ G.T))
    return promised


def _within(K: FloatArray, moved: FloatArray) -> FloatArray:
    """``moved' K^-1 moved`` (k, g, g) of matrices (k, w, w) and (k, w, g)."""
    return np.swapaxes(moved, 1, 2) @ np.linalg.solve(K, moved)


def _promised(
    problem: PlanProblem, steps: Steps, menu: int, changes: Sequence[Mapping[int, int]]
) -> FloatArray:
    """Worth (k,) where slots of one run have other settings (see the module)."""
    offer, run = problem.menus[menu], [k for k, step in enumerate(steps) if step.menu == menu]
    part, S = tuple(steps[k] for k in run), root(problem, steps)
    now = settings_of(part)
    new = np.tile(now, (len(changes), 1))
    for settings, change in zip(new, changes, strict=True):
        settings[np.searchsorted(run, list(change))] = list(change.values())
    U, K = list[FloatArray](), list[FloatArray]()
    for signal in offer.signals:
        (P, told), (was, will) = _weighed(offer, signal, part), map(signal.places, (now, new))
        changed = will != was
        width = int(changed.sum(axis=1).max(initial=0))
        rows = np.argsort(~changed, axis=1, kind="stable")[:, :width]
        d = signal.X[np.take_along_axis(will, rows, axis=1)] - signal.X[was[rows]]
        U.append(signal.seen(np.concatenate((told[rows], d), axis=1), S))
        unit = np.broadcast_to(np.eye(width), (len(new), width, width))
        K.append(np.block([[-P[rows[:, :, None], rows[:, None, :]], unit], [unit, np.zeros_like(unit)]]))
    table, G = np.concatenate(U, axis=1), problem.G @ S
    whole, done = table @ np.swapaxes(table, 1, 2), 0
    for J in K:
        inside = slice(done, done := done + J.shape[1])
        whole[:, inside, inside] += J
    return size_of(problem.aim, G @ G.T - _within(whole, table @ G.T))


@lru_cache(maxsize=8)
def _weighed(menu: Menu, signal: Signal, part: Steps) -> tuple[FloatArray, FloatArray]:
    """Inverse covariance P (n, n) of a signal's rows in a run, and these times it (n, s)."""
    W = whitening(menu, signal, part)
    P = W.T @ W
    return P, P @ signal.X[signal.places(settings_of(part))]


def _promised_without(problem: PlanProblem, steps: Steps) -> FloatArray:
    """Worth (n,) without each of the steps, the others keeping their times."""
    S = root(problem, steps)
    G, worths = problem.G @ S, list[FloatArray]()
    for k, part in runs_of(steps):
        seen = list[FloatArray]()
        for signal in problem.menus[k].signals:
            (P, told), rows = _weighed(problem.menus[k], signal, part), signal.rows_at(len(part))
            strength = np.sqrt(np.diag(P))[rows]
            seen.append(signal.seen(told[rows], S) / strength[:, :, None])
        a = np.concatenate(seen, axis=1)
        values, turn = np.linalg.eigh(np.eye(a.shape[1]) - a @ np.swapaxes(a, 1, 2))
        moved = np.swapaxes(turn, 1, 2) @ a @ G.T / np.sqrt(np.maximum(values, ROUNDING))[:, :, None]
        worths.append(size_of(problem.aim, G @ G.T + np.swapaxes(moved, 1, 2) @ moved))
    return np.concatenate([np.empty(0), *worths])


def _mount(problem: PlanProblem, step: Step) -> tuple[int, int]:
    return step.menu, int(problem.menus[step.menu].mount[step.setting])
