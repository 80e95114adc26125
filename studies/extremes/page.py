"""The report on the extremes: one page and its numbers."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import imubayes
from imubayes import reporting
from imubayes.reporting.provenance import versions
from imubayes.reporting.result.file import json_text
from studies.command import settings, settings_text
from studies.extremes.figures import digits_panel
from studies.extremes.measure import QUANTITIES

if TYPE_CHECKING:
    from imubayes.reporting.canvas import Panel
    from studies.extremes.measure import Extremes, Outcome, Told

TITLE = "How many digits are right at the extremes?"

ORDINARY = 1e10
"""Condition number up to which a full-rank problem is promised digits."""

STACKED = "rows"
"""Family whose long records are copies of a short one."""

HEADS = ("least sq.", "sd", "averaged", "sd", "evidence", "inclusion")
"""`QUANTITIES` in a terminal's 80 columns."""


@dataclass(frozen=True, slots=True)
class Row:
    """A case's line of a table: its name and its numbers as texts."""

    name: str
    cells: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """One family of the page: name, anchor, heat map, and a row a case."""

    title: str
    anchor: str
    panel: Panel
    rows: tuple[Row, ...]


def write_extremes(found: Extremes, folder: Path) -> tuple[Path, ...]:
    """Write ``report.html`` and ``result.json`` into a folder."""
    report, values = folder / "report.html", folder / "result.json"
    report.write_text(extremes_html(found), encoding="utf-8")
    values.write_text(extremes_json(found), encoding="utf-8")
    return report, values


def extremes_html(found: Extremes) -> str:
    """Text of the report."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    folders = FileSystemLoader((Path(__file__).parent, Path(reporting.__file__).parent))
    page = Environment(loader=folders, autoescape=True, undefined=StrictUndefined).get_template(
        "page.html.j2"
    )
    return page.render(
        study=found.study,
        answer=extremes_answer(found),
        sections=tuple(_sections(found)),
        quantities=QUANTITIES,
        refused=tuple(_refusals(found)),
        seconds=f"{found.seconds:.0f}",
        versions=versions(),
        title=TITLE,
        command=found.study.command,
        settings=settings_text(found.study),
    )


def extremes_answer(found: Extremes) -> tuple[str, ...]:
    """Say whether any answer was wrong in silence, and how many digits ordinary problems keep."""
    told = [one for outcome in found.outcomes for one in outcome.told.values()]
    answered = [one for one in told if not math.isnan(one.correct)]
    silent = sum(one.silent for one in answered)
    lost = sum(one.correct == -math.inf for one in answered)
    return (
        f"{_none(silent)} of {len(answered)} answers claims more digits than are right, and"
        f" {_none(lost).lower()} is NaN or infinite.",
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
            f"{len(refused)} problems are refused at least in part, with a message that names the columns"
            " or says what is wrong."
        )


def _range(outcomes: Iterable[Outcome]) -> str:
    """How many rows these problems had, in words."""
    own = [one.rows for one in outcomes if one.family != STACKED]
    rows = [one.rows for one in outcomes]
    if not own or max(rows) == max(own):
        return f"{min(rows):,} to {max(rows):,} rows"
    return f"{min(rows):,} to {max(own):,} rows, and up to {max(rows):,} of a short record stacked on itself"


def _least(outcomes: Iterable[Outcome], name: str) -> int:
    return math.floor(max(min(one.told[name].correct for one in outcomes), 0.0))


def _sections(found: Extremes) -> Iterable[Section]:
    families = dict.fromkeys(one.family for one in found.outcomes)
    for k, family in enumerate(families):
        mine = [one for one in found.outcomes if one.family == family]
        rows = tuple(Row(one.label, _cells(one)) for one in mine)
        yield Section(family, f"family-{k}", digits_panel(mine, f"x{k}"), rows)


def _cells(one: Outcome) -> tuple[str, ...]:
    condition = f"{one.condition:.0e}" if math.isfinite(one.condition) else "∞"
    return (condition, *(_cell(told) for told in one.told.values()))


def _cell(told: Told) -> str:
    if math.isnan(told.correct):
        return "refused"
    correct = "none" if told.correct == -math.inf else f"{told.correct:.1f}"
    return f"{correct} ({told.stated:.0f})"


def _refusals(found: Extremes) -> Iterable[tuple[str, str]]:
    for one in found.outcomes:
        for message in one.refused:
            yield f"{one.family}, {one.label}", message


def extremes_json(found: Extremes) -> str:
    """Text of ``result.json``: correct and stated digits of every case; null where it refused."""
    study = found.study
    document = {
        "imubayes": imubayes.__version__,
        "study": TITLE,
        "seed": study.seed,
        "answer": extremes_answer(found),
        "cases": [_record(one) for one in found.outcomes],
        "seconds": found.seconds,
        "provenance": {
            "command": study.command,
            "settings": settings(study),
            "versions": versions(),
        },
    }
    return json_text(document)


def _record(one: Outcome) -> dict[str, Any]:
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


def terminal_extremes(found: Extremes) -> str:
    """Lines for a terminal: the answer, and the fewest correct digits of each family."""
    lines = [f"{'fewest digits':18}" + "".join(f"{name:>10}" for name in HEADS)]
    for family in dict.fromkeys(one.family for one in found.outcomes):
        mine = [one for one in found.outcomes if one.family == family]
        lines.append(f"{family:18}" + "".join(f"{_fewest(mine, name):>10}" for name in QUANTITIES))
    return "\n".join((*extremes_answer(found), "", *lines))


def _fewest(outcomes: Iterable[Outcome], name: str) -> str:
    known = [one.told[name].correct for one in outcomes if not math.isnan(one.told[name].correct)]
    return f"{min(known):.1f}" if known else "refused"
