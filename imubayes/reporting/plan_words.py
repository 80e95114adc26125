"""A plan in words: the answer, what stays open, and the dwells for a person at the bench."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING

import numpy as np

from imubayes.planning.candidates import starts
from imubayes.reporting.rounding import measured, per_unit
from imubayes.selection.verdicts import listed
from imubayes.units import counted

if TYPE_CHECKING:
    from imubayes.inference.observability import Confounded
    from imubayes.planning.candidates import Step
    from imubayes.planning.proposal import Outcome, Proposal

AIMS = {
    "worst": "the worst-determined of the needed terms",
    "D": "the volume of what is left open of the needed terms",
    "scene": "what the calibration leaves open in the scene",
}
"""What a plan makes small, in words."""

CALLED = {"even": "evenly", "same": "same equipment", "best": "best plan"}
"""Plans by their names in an outcome."""


@dataclass(frozen=True, slots=True)
class Mount:
    """Dwells in one mount.

    Attributes
    ----------
    run, mount : of the plan.
    todo : what comes before its first dwell, in words.
    rows : its dwells: number, when its record starts, what is set, and for how long.
    time : s, with handling.
    """

    run: str
    mount: str
    todo: str
    rows: tuple[tuple[str, ...], ...]
    time: float


def plan_answer(found: Proposal) -> tuple[str, ...]:
    """Sentences that say what the plan gains."""
    study, best = found.study, found.best
    term, ratio = found.worst(best)
    even_term, even_ratio = found.worst(found.even)
    of = f"of {'what the scene needs' if np.isfinite(found.need).any() else 'its prior sd'}"
    sentences = [
        f"{study.spec.id}: {counted(len(best.steps), 'dwell')} in {lasting(best.seconds)} leave {term} worst"
        f" known of {counted(len(found.needed), 'needed term')}, to {ratio:.2g} {of}.",
        f"Going evenly through '{study.offers[study.even].spec.name}' for {lasting(found.even.seconds)}"
        f" leaves {even_term} at {even_ratio:.2g}; the plan's worst sd is {_compared(ratio, even_ratio)}.",
    ]
    if len(study.offers) > 1:
        term, same = found.worst(found.same)
        sentences.append(
            f"The best plan with that run alone leaves {term} at {same:.2g}, {_compared(same, even_ratio)}."
        )
    return (*sentences, *_shares(found), checked(found))


def _compared(ratio: float, even: float) -> str:
    return f"{100.0 * abs(1.0 - ratio / even):.0f} % {'lower' if ratio <= even else 'higher'}"


def _shares(found: Proposal) -> Iterator[str]:
    if found.study.mission is not None:
        yield (
            f"What the calibration leaves open comes to {found.best.share:.2g} of the budget in"
            f" {found.study.mission.name}; evenly, to {found.even.share:.2g}."
        )


def checked(found: Proposal) -> str:
    """Sentence that holds the prediction for each plan against simulated units."""
    where = needed_places(found)
    ratios = [(o.simulated / o.sd)[where] for o in (found.best, found.even)]
    best, even = (f"{ratio.min():.2f} to {ratio.max():.2f}" for ratio in ratios)
    return (
        f"Over {found.study.units} simulated units the rms errors of the needed terms are {best} of what is"
        f" predicted for the plan, and {even} of what is predicted evenly."
    )


def needed_places(found: Proposal) -> list[int]:
    """Places of the needed terms in the library."""
    return [k for k, name in enumerate(found.study.spec.library.names) if name in found.needed]


def inseparable(found: Proposal, outcome: Outcome) -> tuple[str, ...]:
    """Sentences on what the data of a plan see only in combination, and what is left open of it."""
    return tuple(dict.fromkeys(_together(found, outcome, group) for group in outcome.seen.groups))


def _together(found: Proposal, outcome: Outcome, group: Confounded) -> str:
    """One combination, and what the priors of its terms, and what is known of the bench, leave of each."""
    terms = [name for name in group.terms if name in found.study.spec.library.names]
    left = listed([_left(found, outcome, name) for name in terms])
    if len(terms) == len(group.terms):
        why = f": {group.reason}" if group.reason else ""
        return (
            f"{listed(terms)} are seen only in combination{why}. Their priors leave {left}; {group.remedy}."
        )
    reason = f"{group.reason[:1].upper()}{group.reason[1:]}"
    return f"{reason}. What is known of the bench and of the terms leaves {left}; {group.remedy} further."


def _left(found: Proposal, outcome: Outcome, name: str) -> str:
    """Predicted sd of a term beside that of its prior, as the table has them."""
    k = found.study.spec.library.names.index(name)
    term = found.study.spec.library.terms[k]
    unit = per_unit(term.printed, term.unit)
    sd, prior = (
        str(measured(values[k] / unit, math.nan, term.printed)) for values in (outcome.sd, found.prior_sd)
    )
    return f"{name} an sd of {sd} (prior {prior})"


def mounts(found: Proposal, outcome: Outcome) -> tuple[Mount, ...]:
    """Dwells of a plan in order, mount by mount."""
    begin = starts(found.menus, outcome.steps).tolist()
    entries = list(zip(range(1, len(begin) + 1), begin, outcome.steps, strict=True))
    made, clock, last = list[Mount](), 0.0, -1
    for (offer, mount), part in groupby(entries, key=lambda one: _place(found, one[2])):
        dwells = list(part)
        rows = tuple(
            (str(number), at_clock(start), found.settings[offer][step.setting].at, lasting(step.dwell))
            for number, start, step in dwells
        )
        end = dwells[-1][1] + dwells[-1][2].dwell
        todo = _todo(found, offer, first=offer != last)
        made.append(Mount(found.study.offers[offer].spec.name, mount, todo, rows, end - clock))
        clock, last = end, offer
    return tuple(made)


def _place(found: Proposal, step: Step) -> tuple[int, str]:
    """Offer and mount of a step."""
    return step.menu, found.settings[step.menu][step.setting].mount


def _todo(found: Proposal, offer: int, *, first: bool) -> str:
    handling = found.study.offers[offer].handling
    parts = [f"set up {lasting(handling.setup)}"] if first and handling.setup else []
    parts += [f"mount {lasting(handling.mount)}"] if handling.mount else []
    parts += [f"settle {lasting(handling.settle)} before every dwell"] if handling.settle else []
    return ", ".join(parts)


def lasting(seconds: float) -> str:
    """Time in words.

    Examples
    --------
    >>> lasting(60.0), lasting(14340.0), lasting(0.5), lasting(176.6)
    ('1 min', '3 h 59 min', '0.5 s', '177 s')
    """
    if seconds < 60.0 or (seconds < 600.0 and seconds % 60.0):
        return f"{seconds:.3g} s"
    minutes = round(seconds / 60.0)
    hours, rest = divmod(minutes, 60)
    return " ".join(filter(None, (f"{hours} h" if hours else "", f"{rest} min" if rest or not hours else "")))


def at_clock(seconds: float) -> str:
    """Time since the start as on a clock.

    Examples
    --------
    >>> at_clock(3725.0)
    '1:02:05'
    """
    whole = round(seconds)
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"
