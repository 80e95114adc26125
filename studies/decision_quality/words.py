"""How good the decision is, in words made from the scores."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise
from typing import TYPE_CHECKING

from imubayes.inference import Share
from imubayes.reporting.method_views import called
from imubayes.reporting.rounding import NARROW, percent, percents
from imubayes.selection.verdicts import listed
from studies.decision_quality.questions import OPEN
from studies.decision_quality.scores import EDGES
from studies.decision_quality.trials import DECISION, MODELLED, OWN, STRONG, TRUSTED

if TYPE_CHECKING:
    from studies.decision_quality.measure import Quality
    from studies.decision_quality.questions import Interval
    from studies.decision_quality.scores import MethodScore, Scores

ALLOWED = 0.02
"""Share of the zero terms that a good decision calls needed, whatever is wrong with the test."""

PULL = 1.5
"""Largest rms pull of what has a verdict, sd, likewise."""

MORE_OPEN = 0.05
"""Share by which it may leave more terms open than evidence that trusts the bench, where that is right."""


def quality_answer(quality: Quality) -> tuple[str, ...]:
    """First paragraph of the report, by sentence."""
    first = quality.scores
    return (_errors(first), *targets(quality), _left_open(first), _cheapest(first))


def _errors(told: Scores) -> str:
    said = told.verdicts
    return (
        f"Over {told.sensors} simulated sensors the verdict called {rate(said.false_keeps)} of the "
        f"{told.zero:,} terms that are zero needed, and {rate(said.false_drops)} of the "
        f"{said.false_drops.of:,} terms above {STRONG:.0f} sd not needed."
    )


def _left_open(told: Scores) -> str:
    """Say what the verdicts leave open, and what they cost beside methods that may do the same."""
    said, own = told.verdicts, told.methods[0].opened
    best = min(rivals(told), key=lambda score: score.opened.value)
    apart = best.opened_excess
    return (
        f"It leaves {percent(said.left.value)} of the terms open ({percent(said.left_strong.value)} of those "
        f"above {STRONG:.0f} sd). Counted as {OPEN:g} of a wrong term each, that and its errors come to "
        f"{own.value:.2f} a sensor. Of the other methods, given the same option, {called(best.method)} is "
        f"best with {best.opened.value:.2f} (difference {apart.value:.2f}, 95{NARROW}%: {apart.low:.2f} to "
        f"{apart.high:.2f}); to leave everything open costs {told.nothing.value:.2f}."
    )


def targets(quality: Quality) -> Iterator[str]:
    """Say by numbers whether each of what is asked of the decision is met.

    Above all under the treatments, of each of which the worst says whether all are.
    """
    own = {one.treatment: one.of(DECISION) for one in quality.treated}
    wrong = {name: one.false_keeps.value for name, one in own.items()}
    yield (
        f"At most {percent(ALLOWED)} of the zero terms called needed under each of {len(own)} treatments: "
        f"{_each(wrong, ALLOWED, percent)}."
    )
    pulls = {name: one.rms for name, one in own.items()}
    yield (
        f"Pulls of what has a verdict of at most {PULL:g} rms under each: "
        f"{_each(pulls, PULL, lambda rms: f'{rms:.2f}')}."
    )
    told, alone = own[MODELLED], quality.treated[0].of(TRUSTED)
    yield (
        f"As modelled, at most {percent(MORE_OPEN)} more terms left open than by evidence that trusts the "
        f"bench: {_met(told.left.events <= (1.0 + MORE_OPEN) * alone.left.events)}, {told.left.events} "
        f"against {alone.left.events}."
    )
    missed = told.false_drops
    yield (
        f"None of the {missed.of:,} above {STRONG:.0f} sd called not needed there: "
        f"{_met(not missed.events)}, {missed.events}."
    )


def _met(yes: bool) -> str:
    return "yes" if yes else "no"


def _each(found: Mapping[str, float], most: float, written: Callable[[float], str]) -> str:
    """Whether no treatment has more than `most`: those that have, or the one that comes nearest."""
    known = {name: value for name, value in found.items() if not math.isnan(value)}
    over = {name: value for name, value in known.items() if value > most}
    if over:
        return "no, " + listed(f"{written(value)} under {name}" for name, value in over.items())
    worst = max(known, key=lambda name: known[name])
    return f"yes, most under {worst}, {written(known[worst])}"


def rivals(told: Scores) -> tuple[MethodScore, ...]:
    """Scores of the methods that the decision is held against."""
    return tuple(score for score in told.methods if score.method not in OWN)


def _cheapest(told: Scores) -> str:
    """Say which methods cost more than the decision, and which do not."""
    own, others = told.methods[0].cost, sorted(rivals(told), key=lambda score: score.cost.value)
    cheaper = [score for score in others if score.excess.value <= 0.0]
    if cheaper:
        names = listed(f"{called(score.method)} ({score.cost.value:.2f})" for score in cheaper)
        return f"Made to choose, its {own.value:.2f} wrong terms a sensor are not the fewest: {names}."
    tied = [called(score.method) for score in others if score.excess.low <= 0.0]
    least = f"Made to choose, it is wrong in {own.value:.2f} terms a sensor, the fewest of all methods"
    second = f"the next, {called(others[0].method)}, has {others[0].cost.value:.2f}"
    doubt = f", and the interval of the difference to {listed(tied)} holds zero" if tied else ""
    return f"{least}; {second}{doubt}."


def rate(found: Interval) -> str:
    r"""Rate with its interval, in a sentence.

    Examples
    --------
    >>> from studies.decision_quality.questions import Interval
    >>> rate(Interval(0.0123, 0.008, 0.019))
    '1.2\xa0% (95\xa0%: 0.8 to 1.9)'
    """
    return shares(found).replace("(", f"(95{NARROW}%: ")


def shares(found: Interval) -> str:
    """Rate with its interval, in a table; nothing where nothing was counted."""
    return percents(Share(found.value, found.low, found.high))


def bins() -> tuple[str, ...]:
    """Names of the bins of effect over noise.

    Examples
    --------
    >>> bins()
    ('below 1', '1 to 2', '2 to 4', '4 to 8', 'above 8')
    """
    edges = [f"{edge:g}" for edge in EDGES[1:-1]]
    middle = (f"{low} to {high}" for low, high in pairwise(edges))
    return (f"below {edges[0]}", *middle, f"above {edges[-1]}")
