"""The rungs of the ladder as functions with one interface, and the way up: a problem in, an answer out.

A budget of time takes the best rung that fits; an accuracy climbs until the answer no longer changes.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import replace

from imubayes.errors import ConvergenceError, InputError
from imubayes.inference.summary import Summary
from imubayes.ladder import (
    AT_ONCE,
    CHAINED,
    NAMES,
    NEEDS_ROWS,
    Choice,
    CostLaw,
    RungName,
    rung_of,
    rungs_for,
)
from imubayes.ladder.averaged import averaged, plug_in
from imubayes.ladder.costs import foreseen, within
from imubayes.ladder.foresight import foresee
from imubayes.ladder.problem import Answer, Ground, Posterior, change, decided, prepared, size_of
from imubayes.ladder.regression import means, sparse
from imubayes.ladder.sampled import collapsed, full, raw
from imubayes.units import counted

DECIDING: Mapping[str, Callable[[Ground], Answer]] = dict(zip(AT_ONCE, (means, sparse), strict=True))
"""What decides on its way."""

POSTERIORS: Mapping[RungName, Callable[[Ground], Posterior]] = {
    "plug-in": plug_in,
    "averaged": averaged,
    "collapsed": collapsed,
    "full": full,
    "raw": raw,
}
"""Rungs that say what the noise is, over which any component is decided."""

LARGE = 2_000_000
"""Rows beyond which the noise is sampled only if asked: every draw that is averaged over whitens them all."""

WIDE = 30_000
"""Matrix entries that a draw of the noise adds up, runs times squared columns: more take minutes."""


def chosen_method(wanted: str, summary: Summary, *, spread: bool = False) -> tuple[RungName, str]:
    """Rung that a study asks for by `Method`, and the reason in words.

    `spread` tells whether how far bench and library are off is estimated, too.

    Examples
    --------
    >>> import numpy as np
    >>> chosen_method("exact", Summary.from_arrays(np.eye(2), np.ones(2), ("a", "b")))
    ('plug-in', 'the method exact was asked for')
    """
    if wanted != "auto":
        return rung_of("plug-in" if wanted == "exact" else wanted).name, f"the method {wanted} was asked for"
    estimated = [run.name for run in summary.runs if run.steering]
    if not estimated:
        return "plug-in", "the noise of every run is given, so that the exact posterior is the whole answer"
    if summary.factor.n > LARGE:
        return "plug-in", (
            f"{summary.factor.n:,} samples fix the noise, and sampling it would whiten them all again and"
            " again; ask for the method collapsed to average over it all the same"
        )
    columns = len(summary.names)
    if len(estimated) * columns**2 > WIDE:
        return "plug-in", (
            f"to sample the noise of {counted(len(estimated), 'run')} beside {columns} columns takes minutes;"
            " ask for the method collapsed to average over it all the same"
        )
    if spread:
        return "averaged", (
            "how far the bench and the library are off is told by the same data: draws of the noise are"
            " weighed with draws of that"
        )
    several = "s" if len(estimated) > 1 else ""
    return "collapsed", (
        f"the noise of run{several} {', '.join(estimated)} is estimated from the same data: its uncertainty"
        " is sampled, and the coefficients are exact at each draw"
    )


def posterior_by(wanted: str, ground: Ground) -> tuple[Posterior, str]:
    """Posterior of the noise by a method, and why by that one; plug-in where chains cannot be run.

    Raises
    ------
    InputError : if the method decides on its way, and so takes one component with known inputs.
    """
    ready = prepared(ground)
    rung, reason = chosen_method(wanted, ready.summary, spread=bool(ready.spreads))
    if rung in AT_ONCE:
        raise InputError(
            f"sensor '{ground.problem.spec.id}': the method {rung} takes runs of one component with known"
            f" inputs, and these are of several: expected one of {', '.join(POSTERIORS)}"
        )
    try:
        return POSTERIORS[rung](ground), reason
    except ConvergenceError as unfinished:
        return plug_in(ground), f"the noise, held at its estimate, cannot be sampled: {unfinished}"


def by_method(wanted: str, ground: Ground) -> tuple[Answer, str]:
    """Answer of a method, and why by that one."""
    if wanted in AT_ONCE and ground.problem.case is None:
        return DECIDING[wanted](ground), f"the method {wanted} was asked for"
    found, reason = posterior_by(wanted, ground)
    return decided(ground, found), reason


def provisional(wanted: str, ground: Ground) -> Answer | None:
    """Answer at the estimated noise, where a method goes on with chains; None where it does not."""
    if wanted in AT_ONCE:
        return None
    ready = prepared(ground)
    rung, _ = chosen_method(wanted, ready.summary, spread=bool(ready.spreads))
    return decided(ground, plug_in(ground)) if rung in CHAINED else None


def stand(rung: RungName, ground: Ground) -> Answer:
    """Answer of one rung on a ground that others may have been on before: what they share is not done again.

    The seconds are those that the rung takes alone.

    Raises
    ------
    InputError : if there is no such rung, or the runs cannot be used.
    """
    name = rung_of(rung).name
    shares = {"means": (), "raw": ("factor", "full")}.get(rung, ("factor", rung))
    done = sum(ground.shared[part][1] for part in shares if part in ground.shared)
    start = time.perf_counter()
    found = DECIDING[name](ground) if name in AT_ONCE else decided(ground, POSTERIORS[name](ground))
    return replace(found, seconds=time.perf_counter() - start + done)


def by_budget(ground: Ground, budget: float, law: CostLaw) -> tuple[Answer, Choice]:
    """Answer of the best rung that fits into a budget, straight away, without the rungs below it.

    Parameters
    ----------
    ground : of one component, or of a case, whose linearisation is on the budget too.
    budget : s. Chains end in time, whether they have converged or not.
    law : what the rungs take on this machine (see `imubayes.ladder.costs.calibrate`).
    """
    start, size = time.perf_counter() - _spent(ground), size_of(ground.problem)
    left = max(budget - _spent(ground), 0.0)
    rung = within(left, size, law)
    spare = max(left - 0.5 * foreseen(rung, size, law), 0.5 * left)  # for what is beside the chains
    ground = replace(ground, limits=replace(ground.limits, time_limit=min(ground.limits.time_limit, spare)))
    try:
        found = stand(rung, ground)
    except ConvergenceError:  # where chains cannot be run, the best rung without
        found = stand("averaged", ground)
    choice = _choice(ground, found, law, f"a budget of {budget:g} s", start)
    return found, replace(choice, budget=budget)


def by_accuracy(ground: Ground, accuracy: float, law: CostLaw) -> tuple[Answer, Choice]:
    """Climb until a rung changes no coefficient by more than `accuracy` against the one before.

    Parameters
    ----------
    ground : of one component, or of a case.
    accuracy : in posterior sd, of averaged and full-library coefficients alike.
    law : what the rungs take on this machine.
    """
    start = time.perf_counter() - _spent(ground)
    first, *above = rungs_for(size_of(ground.problem))
    found = stand(first, ground)
    steps: list[tuple[RungName, float, float]] = [(found.rung, 0.0, 0.0)]
    for name in above:
        try:
            below, found = found, stand(name, ground)
        except ConvergenceError:  # and so it is with the rungs above
            break
        steps.append((name, *change(below, found)))
        if steps[-1][1] <= accuracy:
            break
    asked = f"an accuracy of {accuracy:g} posterior sd"
    return found, replace(_choice(ground, found, law, asked, start), climbed=tuple(steps), accuracy=accuracy)


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
    beyond = NAMES[NAMES.index(found.rung) + 1 :]
    no_more = f"{beyond[0]} is no choice here: {NEEDS_ROWS}" if beyond else "there is no better rung"
    ahead, why = foresee(ground, found) if above else ((0.0, 0.0), no_more)
    return Choice(
        rung=found.rung,
        asked=asked,
        seconds=time.perf_counter() - start,
        foreseen=_spent(ground) + foreseen(found.rung, size, law),
        climbed=(),
        next_rung=above[0] if above else None,
        next_seconds=foreseen(above[0], size, law) if above else 0.0,
        next_change=ahead,
        next_reason=why,
    )


def _spent(ground: Ground) -> float:
    """Seconds that a case took before any rung."""
    return ground.shared["factor"][1] if ground.problem.case else 0.0
