"""The report on speed: one page and its numbers."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import imubayes
from imubayes import reporting
from imubayes.reporting.result.file import json_text
from imubayes.reporting.rounding import duration, times
from studies.command import settings, settings_text
from studies.speed.figures import contest_panel, law_panel
from studies.speed.words import exponent_text, law_note, speed_answer, wrong

if TYPE_CHECKING:
    from imubayes.reporting.canvas import Panel
    from studies.speed.growth import Law
    from studies.speed.measure import Found, Place, Speed


TITLE = "How fast is it?"


@dataclass(frozen=True, slots=True)
class Row:
    """An entrant's line of a table: its name, its numbers as texts, and what a reader should know."""

    name: str
    cells: tuple[str, ...]
    remark: str


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """One contest of the page."""

    anchor: str
    found: Found
    rows: tuple[Row, ...]
    panel: Panel


def write_speed(speed: Speed, folder: Path) -> tuple[Path, ...]:
    """Write ``report.html`` and ``result.json`` into a folder."""
    report, values = folder / "report.html", folder / "result.json"
    report.write_text(speed_html(speed), encoding="utf-8")
    values.write_text(speed_json(speed), encoding="utf-8")
    return report, values


def speed_html(speed: Speed) -> str:
    """Text of the report; names that come from the study file are escaped."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    folders = FileSystemLoader((Path(__file__).parent, Path(reporting.__file__).parent))
    page = Environment(loader=folders, autoescape=True, undefined=StrictUndefined).get_template(
        "page.html.j2"
    )
    return page.render(
        study=speed.study,
        answer=speed_answer(speed),
        sections=tuple(
            Section(f"contest-{k}", found, _rows(found), contest_panel(found, f"c{k}"))
            for k, found in enumerate(speed.contests)
        ),
        laws=tuple(_law_row(law) for law in speed.laws),
        panels=tuple(law_panel(law, f"l{k}") for k, law in enumerate(speed.laws)),
        machine=speed.machine,
        took=duration(speed.seconds),
        version=imubayes.__version__,
        title=TITLE,
        command=speed.study.command,
        settings=settings_text(speed.study),
    )


def _rows(found: Found) -> tuple[Row, ...]:
    return tuple(Row(place.name, _cells(found, place), _remark(found, place)) for place in found.places)


def _cells(found: Found, place: Place) -> tuple[str, ...]:
    if not place.seconds:
        return ("", "", "", "")
    middle, longest = float(np.median(place.seconds)), max(place.seconds)
    return (
        duration(place.fastest),
        f"{duration(middle)} to {duration(longest)}",
        times(found.ratio(place)),
        ""
        if math.isnan(place.error)
        else f"{place.error:.1e}"
        if 0.0 < place.error < 1e-3
        else f"{place.error:.2g}",
    )


def _remark(found: Found, place: Place) -> str:
    if place.absent:
        return f"left out: {place.absent}"
    return "; ".join(part for part in ("wrong" if wrong(found, place) else "", place.remark) if part)


def _law_row(law: Law) -> Row:
    name = f"{law.ladder.title[:1].upper()}{law.ladder.title[1:]}"
    ends = f"{law.sizes[0]:,.0f} to {law.sizes[-1]:,.0f} {law.ladder.quantity}"
    cells = (ends, f"{duration(law.fastest[0])} to {duration(law.fastest[-1])}", exponent_text(law))
    return Row(name, cells, law_note(law))


def speed_json(speed: Speed) -> str:
    """Text of ``result.json``: every time, in s; what is not finite becomes null."""
    study = speed.study
    document = {
        "imubayes": imubayes.__version__,
        "study": TITLE,
        "seed": study.seed,
        "repeats": study.repeats,
        "answer": speed_answer(speed),
        "machine": asdict(speed.machine),
        "contests": [asdict(found) for found in speed.contests],
        "growth": [_law_values(law) for law in speed.laws],
        "seconds": speed.seconds,
        "provenance": {
            "command": study.command,
            "settings": settings(study),
        },
    }
    return json_text(document)


def _law_values(law: Law) -> dict[str, object]:
    return {
        "of": law.ladder.quantity,
        "work": law.ladder.title,
        "sizes": law.sizes.tolist(),
        "seconds": law.seconds.tolist(),
        "exponent": law.exponent,
        "sd": law.sd,
        "expected": law.ladder.expected,
        "fitted_to": law.sizes[law.used].tolist(),
    }


def terminal_speed(speed: Speed) -> str:
    """Lines for a terminal: every contest's times and errors, and the exponents."""
    lines: list[str] = []
    for found in speed.contests:
        lines += ["", f"{found.title}", f"  {'':34} {'shortest':>9} {'x ours':>8} {'error':>9}"]
        for row in _rows(found):
            shortest, _, ratio, error = row.cells
            lines.append(f"  {row.name:34} {shortest:>9} {ratio:>8} {error:>9}  {row.remark}".rstrip())
    lines += [
        "",
        *(f"{row.name}: {row.cells[0]}, exponent {row.cells[2]}" for row in map(_law_row, speed.laws)),
    ]
    return "\n".join(lines).lstrip("\n")
