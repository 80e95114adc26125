"""How good the decision is, in words made from the scores."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING

from imubayes.inference.intervals import Share
from imubayes.reporting.method_views import called
from imubayes.reporting.rounding import NARROW, percent, percents
from imubayes.selection.verdicts import listed
from studies.decision_quality.questions import OPEN
from studies.decision_quality.scores import EDGES
from studies.decision_quality.trials import DECISION, MODELLED, STRONG, SURE

if TYPE_CHECKING:
    from studies.decision_quality.measure import Quality
    from studies.decision_quality.questions import Interval
    from studies.decision_quality.scores import MethodScore, Scores

ALLOWED = 0.02
"""Share of false keeps, and of false drops among strong effects, that a good decision stays within."""


def quality_answer(quality: Quality) -> tuple[str, ...]:
    """First paragraph of the report, by sentence."""
    first = next(one for one in quality.overall if one.treatment == MODELLED)
    return (
        _errors(first),
        claim(first.verdicts.false_keeps, "of the zero terms called needed"),
        claim(first.verdicts.false_drops, f"above {STRONG:.0f} sd called not needed"),
        left_open(first),
        _cheapest(first),
        _forced(first),
    )


def _errors(told: Scores) -> str:
    said = told.verdicts
    return (
        f"Over {told.sensors} simulated sensors the verdict called {rate(said.false_keeps)} of the "
        f"{told.zero:,} terms that are zero needed, and {rate(said.false_drops)} of the "
        f"{said.false_drops.of:,} terms above {STRONG:.0f} sd not needed."
    )


def left_open(told: Scores) -> str:
    """Say what the verdicts leave open, and what they cost beside methods that may do the same."""
    said, own = told.verdicts, told.methods[0].opened
    best = min(rivals(told), key=lambda score: score.opened.value)
    apart = best.opened_excess
    return (
        f"It leaves {percent(said.left.value)} of the terms open ({percent(said.left_strong.value)} of those "
        f"above {STRONG:.0f} sd). Counted as {OPEN:g} of a wrong term each, that and its errors come to "
        f"{own.value:.2f} a sensor. Of the other methods, given the same option, {called(best.method)} is "
        f"best with {best.opened.value:.2f} (difference {apart.value:.2f}, 95{NARROW}%: {apart.low:.2f} to "
        f"{apart.high:.2f}); to leave everything open costs {said.nothing.value:.2f}."
    )


def _forced(told: Scores) -> str:
    """Say what a forced choice keeps too much, and which costs would mend it."""
    careful = (one for one in told.careful if one.false_keeps.value <= ALLOWED)
    dear = next(careful, told.careful[-1])
    return (
        "That choice, inclusion of one half or more, keeps "
        f"{rate(told.methods[0].false_keeps)} of the zero terms: where most others are in, the prior gives a "
        f"term that the test cannot see more than one half. If a false keep costs {dear.ratio:g} times a "
        f"false drop, it keeps {rate(dear.false_keeps)}."
    )


def claim(found: Interval, what: str) -> str:
    """Say whether a share of errors stays within what is allowed, as far as the interval tells.

    Examples
    --------
    >>> from studies.decision_quality.questions import Interval
    >>> claim(Interval(0.01, 0.004, 0.018), "false keeps").replace(NARROW, " ")
    'At most 2.0 % false keeps: yes.'
    >>> claim(Interval(0.015, 0.004, 0.03), "false keeps").replace(NARROW, " ")
    'At most 2.0 % false keeps: yes, but the interval reaches 3.0 %.'
    """
    asked = f"At most {percent(ALLOWED)} {what}"
    if not found.value <= ALLOWED:
        return f"{asked}: no, {percent(found.value)}."
    return (
        f"{asked}: yes."
        if found.high <= ALLOWED
        else f"{asked}: yes, but the interval reaches {percent(found.high)}."
    )


def rivals(told: Scores) -> tuple[MethodScore, ...]:
    """Scores of the methods that the decision is held against."""
    return tuple(score for score in told.methods if score.method not in (DECISION, SURE))


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


def wrong_models(quality: Quality) -> Iterator[str]:
    """Say what each wrong treatment does to the decision, a sentence each."""
    for told in quality.overall:
        if told.treatment != MODELLED:
            own, best = told.methods[0], min(rivals(told), key=lambda score: score.cost.value)
            said = told.verdicts
            yield (
                f"With {told.treatment}, it calls {rate(said.false_keeps)} of the zero terms needed, "
                f"{rate(said.false_drops)} above {STRONG:.0f} sd not needed. Made to choose, it is wrong in "
                f"{own.cost.value:.2f} terms a sensor, {called(best.method)} in {best.cost.value:.2f}."
            )


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
