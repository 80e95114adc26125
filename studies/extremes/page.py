"""The report on the extremes: one page and its numbers."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup

from imubayes.reporting.blocks import (
    Both,
    Figure,
    Page,
    Prose,
    Section,
    Table,
    answer,
    joined,
    parted,
    repeat,
    strong,
)
from imubayes.reporting.rounding import duration
from imubayes.units import counted
from studies.command import recorded
from studies.extremes.figures import digits_panel
from studies.extremes.measure import QUANTITIES

if TYPE_CHECKING:
    from studies.extremes.measure import Extremes, Outcome, Told

TITLE = "How many digits are right at the extremes?"

QUESTION = (
    "Problems driven to the ends of what doubles hold, held against exact arithmetic on the same doubles."
)

ORDINARY = 1e10
"""Condition number up to which a full-rank problem is promised digits."""

STACKED = "rows"
"""Family whose long records are copies of a short one."""

HEADS = ("least sq.", "sd", "averaged", "sd", "evidence", "inclusion")
"""`QUANTITIES` in a terminal's 80 columns."""

MAP = (
    "A column is a problem, a row a quantity; the number is how many digits are right, of the worst"
    " coefficient, from 0 (dark) to 15 (light). A dash: it refused to answer. An exclamation mark: the"
    " answer was no number. X are the columns, y the response."
)

COUNTED = (
    "The references take the very doubles of the product: inner products are exact, and everything after is"
    " done with 100 digits, in another way than the product does it (principal axes of each submodel's Gram"
    " matrix; the noise scale in half the steps).",
    Markup(
        "<em>Least squares</em> and <em>averaged</em>: digits of the worst coefficient, counted against the"
        " larger of its size and its sd. <em>Sd</em>: of its own size. <em>Log evidence</em>: of its size,"
        " or behind the point where it is below one. <em>Inclusion</em>: behind the point."
    ),
    Markup(
        "<em>Stated</em> digits come from the factor alone: what a few units of rounding of each column do"
        " to first order to the results, plus the error of the rule that integrates over the noise scale."
        " That rule is good to 1e-8, which is why averaged quantities state 7 or 8 digits at most where the"
        " noise is not known. With a prior of the g-family it integrates over g, to 1e-11."
    ),
    "Where the full library leaves less than 1e-14 of the response, the fit is exact as far as doubles can"
    " tell; the noise scale is then taken as that, and the reference takes it too.",
    "Fewer rows than columns that the prior explains exactly leave the noise scale open down to that floor:"
    " no digit is stated there (“prior fits”).",
    Markup(
        "<em>Long records</em> have up to 100,000 rows of their own, as arrays and, where the label says"
        " run, whitened as a recorded run is. Up to 4,096 rows of an array are factored with 64 bits of"
        " mantissa; of more rows and of runs the factor is refined where columns are nearly dependent. The"
        " white noise of these runs has unit variance, so that whitening itself rounds nothing; coloured"
        " noise is in <em>time stamps</em>."
    ),
    Markup(
        "The records beyond that, in <em>rows</em>, are a short one stacked on itself: the factor of"
        " 2<sup>k</sup> copies is known exactly."
    ),
    "A run that is read a part at a time takes the same steps; it is held against the run in memory by the"
    " tests, not here.",
)


def extremes_page(found: Extremes) -> Page:
    """Page of the report."""
    families = _families(found)
    said = f"It took {duration(found.seconds)}. Seed {found.study.seed}."
    first, rest = parted(extremes_answer(found))
    digits = {name: [t.correct for one in mine for t in one.told.values()] for name, mine in families.items()}
    worst = families[min(digits, key=lambda name: np.nanmin([*digits[name], math.inf]))]
    return Page(
        TITLE,
        QUESTION,
        first=(answer(first), Figure((digits_panel(worst, "first"),), MAP)),
        data="simulated",
        blocks=(
            Prose(" ".join(rest)),
            _digits(families),
            _refused(found),
            _every(families),
            Section("What was counted", (Prose(COUNTED, "list"),), "meaning"),
            repeat(found.study.command, "", said),
        ),
    )


def _digits(families: Mapping[str, list[Outcome]]) -> Section:
    panels = [digits_panel(mine, f"x{k}") for k, mine in enumerate(families.values())]
    rows = [(name, *(_fewest(mine, one) for one in QUANTITIES)) for name, mine in families.items()]
    table = Table("Fewest correct digits", ("fewest digits", *map(Both, QUANTITIES, HEADS)), rows)
    return Section("Correct digits", (table, Figure(panels, MAP)), "map", brief=True)


def _refused(found: Extremes) -> Section:
    messages = [
        joined(strong(f"{one.family}, {one.label}:"), f"{message}.")
        for one in found.outcomes
        for message in one.refused
    ]
    told = (Prose(messages or "Nothing.", "list"),)
    return Section("What is refused, in its words", told, "refused", listed="What is refused")


def _every(families: Mapping[str, list[Outcome]]) -> Section:
    head = ("case", "condition", *QUANTITIES)
    tables = [
        Section(name, (Table(f"Digits of {name}", head, _rows(mine)),), f"family-{k}")
        for k, (name, mine) in enumerate(families.items())
    ]
    title = "Every case: correct digits, and in brackets how many were stated before any reference was known"
    return Section(title, tables, "cases", listed="Every case")


def _families(found: Extremes) -> Mapping[str, list[Outcome]]:
    families = dict.fromkeys(one.family for one in found.outcomes)
    return {name: [one for one in found.outcomes if one.family == name] for name in families}


def extremes_answer(found: Extremes) -> tuple[str, ...]:
    """Say whether any answer was wrong in silence, and how many digits ordinary problems keep."""
    told = [one for outcome in found.outcomes for one in outcome.told.values()]
    answered = [one for one in told if not math.isnan(one.correct)]
    silent = sum(one.silent for one in answered)
    lost = sum(one.correct == -math.inf for one in answered)
    return (
        f"{_none(silent)} of {len(answered)} answers {'claim' if silent > 1 else 'claims'} more digits than"
        f" are right, and {_none(lost).lower()} {'are' if lost > 1 else 'is'} NaN or infinite.",
        *_kept(found),
        f"{len(found.outcomes)} problems went to the ends of what doubles hold, each held against exact"
        " arithmetic on the same doubles.",
    )


def _none(count: int) -> str:
    return "None" if count == 0 else f"{count}"


def _kept(found: Extremes) -> Iterable[str]:
    promised = [
        one
        for one in found.outcomes
        if one.full_rank and one.condition <= ORDINARY and one.family != "noise 0"
    ]
    answered = [one for one in promised if not one.refused]
    if answered:
        least = [_least(answered, name) for name in ("least squares", "averaged")]
        yield (
            f"Where there is noise, independent columns up to a condition number of 1e10 keep at least"
            f" {min(least)} digits of every coefficient, and inclusion to 1e-{_least(answered, 'inclusion')}."
            f" They had {_range(answered)}."
        )
    left_out = len(promised) - len(answered)
    if left_out:
        yield (
            f"That leaves out {left_out} of {len(promised)} such problems, which were refused at least in"
            " part."
        )
    refused = [one for one in found.outcomes if one.refused]
    if refused:
        yield (
            f"{counted(len(refused), 'problem')} {'is' if len(refused) == 1 else 'are'} refused at least in"
            " part, with a message that names the columns or says what is wrong."
        )


def _range(outcomes: Iterable[Outcome]) -> str:
    """How many rows these problems had, in words."""
    own = [one.rows for one in outcomes if one.family != STACKED]
    rows = [one.rows for one in outcomes]
    if min(rows) == max(rows):
        return counted(rows[0], "row")
    if not own or max(rows) == max(own):
        return f"{min(rows):,} to {max(rows):,} rows"
    return f"{min(rows):,} to {max(own):,} rows, and up to {max(rows):,} of a short record stacked on itself"


def _least(outcomes: Iterable[Outcome], name: str) -> int:
    return math.floor(max(min(one.told[name].correct for one in outcomes), 0.0))


def _fewest(outcomes: Iterable[Outcome], name: str) -> str:
    known = [one.told[name].correct for one in outcomes if not math.isnan(one.told[name].correct)]
    worst = min(known, default=math.nan)
    return "refused" if math.isnan(worst) else f"{worst:.1f}" if math.isfinite(worst) else "no number"


def _rows(outcomes: Sequence[Outcome]) -> list[tuple[str, ...]]:
    conditions = [f"{one.condition:.0e}" if math.isfinite(one.condition) else "∞" for one in outcomes]
    return [
        (one.label, condition, *map(_cell, one.told.values()))
        for one, condition in zip(outcomes, conditions, strict=True)
    ]


def _cell(told: Told) -> str:
    if math.isnan(told.correct):
        return "refused"
    correct = "none" if told.correct == -math.inf else f"{told.correct:.1f}"
    return f"{correct} ({told.stated:.0f})"


def extremes_record(found: Extremes) -> dict[str, Any]:
    """Values of ``result.json``: correct and stated digits of every case; null where it refused."""
    return recorded(found, TITLE, extremes_answer(found), cases=[_case(one) for one in found.outcomes])


def _case(one: Outcome) -> dict[str, Any]:
    return {
        "family": one.family,
        "case": one.label,
        "condition": one.condition,
        "full_rank": one.full_rank,
        "rows": one.rows,
        "digits": {name: {"correct": t.correct, "stated": t.stated} for name, t in one.told.items()},
        "silent": one.silent,
        "lost": [name for name, told in one.told.items() if told.correct == -math.inf],
        "refused": one.refused,
    }
