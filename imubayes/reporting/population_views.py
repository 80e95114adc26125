"""What the report shows of units of a class: findings, a table, a figure."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from imubayes.reporting.population_figures import units_panel
from imubayes.reporting.population_words import (
    MARKS,
    changes,
    class_answer,
    class_sentences,
    shown,
    turn_on_text,
    unit_text,
    whole,
)
from imubayes.reporting.rounding import Measured, measured, per_unit, percent, percents, pretty

if TYPE_CHECKING:
    from imubayes.campaign.study import StudyResult
    from imubayes.reporting.canvas import Panel
    from imubayes.selection.class_needs import ClassInCommon, TermInClass

MOST_PANELS = 8
"""Terms that are drawn."""


@dataclass(frozen=True, slots=True)
class TermInCommonRow:
    """One term as it is printed.

    Attributes
    ----------
    parameter : its name.
    together : whether it stands for all axes of a triad.
    mark, style, verdict, reason : whether the class needs it; empty where the axes of a triad differ in that.
    units : how many need it, of how many.
    share : of those that answer, with its interval.
    mean : with its sd; None for all axes together.
    unit, turn_on : spreads.
    printed : unit of the numbers.
    common : share of the turn-on's variance that all units have in common; empty where nothing changes.
    error : sd of one session.
    """

    parameter: str
    together: bool
    mark: str
    style: str
    verdict: str
    reason: str
    units: str
    share: str
    mean: Measured | None
    unit: str
    turn_on: str
    printed: str
    common: str
    error: Measured


@dataclass(frozen=True, slots=True)
class ClassView:
    """The section on the units of one class.

    Attributes
    ----------
    title : class and kind.
    anchor : of the section.
    answer : for the top of the page.
    sentences : the findings.
    rows, left_out : of the table, and how many parameters are in result.json only.
    panels : terms.
    repeated : whether units were tested in several sessions.
    """

    title: str
    anchor: str
    answer: str
    sentences: tuple[str, ...]
    rows: tuple[TermInCommonRow, ...]
    left_out: int
    panels: tuple[Panel, ...]
    repeated: bool


def class_views(result: StudyResult) -> tuple[ClassView, ...]:
    """Prepare what the units of each class have in common; nothing where a study has few of a class."""
    return tuple(_view(found, k) for k, found in enumerate(result.classes))


def _view(found: ClassInCommon, k: int) -> ClassView:
    terms = shown(found)
    drawn = [term for term in whole(found) if term in terms][:MOST_PANELS]
    return ClassView(
        title=f"{found.class_id}, {found.kind}s",
        anchor=f"class-{k + 1}",
        answer=_signs(class_answer(found)),
        sentences=tuple(_signs(text) for text in class_sentences(found)),
        rows=tuple(_row(term, found) for term in terms),
        left_out=len(found.terms) - len(terms),
        panels=tuple(units_panel(first, _parts(first, terms), f"u{k}x{n}") for n, first in enumerate(drawn)),
        repeated=sum(bool(name) for name in found.sessions) > 1,
    )


def _parts(first: TermInClass, terms: tuple[TermInClass, ...]) -> tuple[TermInClass, ...]:
    """A term by component: what stands for all of them is left out."""
    alike = tuple(term for term in terms if term.term == first.term)
    return alike[1:] if len(alike) > 1 and not alike[0].component else alike


def _row(term: TermInClass, found: ClassInCommon) -> TermInCommonRow:
    printed, spreads = term.parameter.printed, term.spreads
    unit = per_unit(printed, term.parameter.unit)
    together = not term.component and len(found.components) > 1 and len(term.units) > len(found.units)
    need = term.need
    mark, style = MARKS[need.verdict]
    answers = {part.need.verdict for part in found.terms if part.term == term.term and part is not term}
    mixed = together and len(answers) > 1
    return TermInCommonRow(
        parameter=term.parameter.name,
        together=together,
        mark="" if mixed else mark,
        style="" if mixed else style,
        verdict="" if mixed else need.verdict,
        reason=need.reason,
        units=f"{need.answers.get('needed', 0)} of {sum(need.answers.values())}",
        share=f"{100.0 * need.share.low:.0f} to {percent(need.share.high)}",
        mean=None if together else measured(spreads.mean.value / unit, spreads.mean_sd / unit, printed),
        unit=_signs(unit_text(term).removesuffix(f" {printed}")),
        turn_on=_signs(turn_on_text(term).removesuffix(f" {printed}")),
        printed=printed,
        common=percents(spreads.common_share) if changes(term) else "",
        error=measured(math.hypot(spreads.noise, spreads.alias) / unit, 0.0, printed),
    )


def _signs(text: str) -> str:
    """ASCII with the real signs, for the page; a hyphen within a word stays."""
    return re.sub(r"(?<![\w-])-(?=\d)", "−", pretty(text).replace("+-", "±"))
