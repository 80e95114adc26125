"""Which rung of the ladder was taken, what it gave up, and what the next one would change, in words."""

from __future__ import annotations

from typing import TYPE_CHECKING

from imubayes.campaign.fidelity import rung_of
from imubayes.reporting.chain_words import sentence
from imubayes.reporting.result.entries import RungChoice
from imubayes.reporting.result.values import published
from imubayes.reporting.rounding import duration

if TYPE_CHECKING:
    from imubayes.campaign.fidelity import Choice

NOT_ASKED = (
    "Left out for the sake of time: the residual checks, the other methods, and the search for what the"
    " library lacks."
)
"""What no rung does, and a run without budget does."""


def choice_sentences(choice: Choice | None) -> tuple[str, ...]:
    """Say which rung was taken and why, what it gave up, and what the next one would change.

    Examples
    --------
    >>> from imubayes.campaign.fidelity import Choice
    >>> given = ("sparse", "a budget of 1 s", 0.4, 0.5, (), "plug-in", 0.9, (0.1, 0.3), "neighbours")
    >>> choice_sentences(Choice(*given, budget=1.0))[0]
    'Method: whitened factor, sparse regression along its path, the best that fits a budget of 1 s (0.4 s).'
    """
    if choice is None:
        return ()
    rung = rung_of(choice.rung)
    taken = f"Method: {rung.title}{_why(choice)}."
    gave_up = f"It {rung.leaves_out}" if rung.leaves_out else ""
    return tuple(text for text in (taken, gave_up, *_climbed(choice), _next(choice), NOT_ASKED) if text)


def _why(choice: Choice) -> str:
    """Why this rung was taken, and whether it is what was asked for."""
    took = duration(choice.seconds)
    if choice.accuracy is not None:
        missed = f"the last that there is: {choice.asked} was not reached ({took})"
        return f", reached {choice.asked} ({took})" if choice.met else f", {missed}"
    if choice.budget is None:
        return f", as asked ({took})"
    if choice.foreseen > choice.budget:
        return f", the cheapest: none fits {choice.asked} (it took {took})"
    if not choice.met:
        return f", the best that was foreseen to fit {choice.asked}; it took longer, {took}"
    return f", the best that fits {choice.asked} ({took})"


def _climbed(choice: Choice) -> tuple[str, ...]:
    """What the last step changed, where rungs were climbed."""
    if len(choice.climbed) < 2:
        return ()
    name, coefficients, inclusions = choice.climbed[-1]
    below = choice.climbed[-2][0]
    return (
        f"The step from {below} to {name} changed coefficients by up to {coefficients:.2g} posterior sd and"
        f" inclusions by up to {inclusions:.2g}.",
    )


def _next(choice: Choice) -> str:
    if choice.next_rung is None:
        return sentence(choice.next_reason[:1].upper() + choice.next_reason[1:])
    coefficients, inclusions = choice.next_change
    return (
        f"The next rung ({rung_of(choice.next_rung).title}) would take about {duration(choice.next_seconds)}"
        f" and change coefficients by up to about {coefficients:.1g} posterior sd and inclusions by about"
        f" {inclusions:.1g} (foreseen by {choice.next_reason})."
    )


def published_choice(choice: Choice | None) -> RungChoice | None:
    """Publish the same."""
    return choice and published(
        RungChoice,
        choice,
        foreseen_seconds=choice.foreseen,
        climbed=[
            {"rung": name, "change_sd": change, "change_inclusion": inclusion}
            for name, change, inclusion in choice.climbed
        ],
        next=choice.next_rung
        and {
            "rung": choice.next_rung,
            "seconds": choice.next_seconds,
            "change_sd": choice.next_change[0],
            "change_inclusion": choice.next_change[1],
            "foreseen_by": choice.next_reason,
        },
    )
