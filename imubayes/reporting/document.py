"""The report: one HTML file that opens offline, and all results written at once or not at all."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from markupsafe import Markup

from imubayes.errors import InputError
from imubayes.reporting.blocks import Block, Page, Prose, Section, answer, link, repeat
from imubayes.reporting.case_views import MOST_DRAWN, CaseView, case_section, case_views, cases_section
from imubayes.reporting.case_words import held_together
from imubayes.reporting.data_views import appendix_section, data_section
from imubayes.reporting.html import page_html
from imubayes.reporting.noise_views import glance_table, process_answers
from imubayes.reporting.population_views import class_section, class_title, class_words, is_repeated
from imubayes.reporting.posterior import write_posterior
from imubayes.reporting.results import command, result_json
from imubayes.reporting.rounding import pretty
from imubayes.reporting.session_views import session_section, session_sentence
from imubayes.reporting.views import (
    MANY,
    Shown,
    is_doubtful,
    overview,
    sensor_answer,
    sensor_section,
    shown_sensors,
)

if TYPE_CHECKING:
    from imubayes.campaign.study import StudyResult


def write_results(result: StudyResult, out: Path) -> tuple[Path, ...]:
    """Write ``report.html``, ``result.json`` and ``posterior.nc``.

    They are written beside `out` first and moved when all are complete, so nothing half-written is ever
    seen; earlier results in `out` are replaced, other files there are left alone.

    Parameters
    ----------
    out : folder, created with its parents.

    Returns
    -------
    paths of the files.

    Raises
    ------
    InputError : if the folder cannot be written.
    """
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{out.name}-", dir=out.parent) as folder:
            parts = _parts(result, Path(folder))
            out.mkdir(exist_ok=True)
            return tuple(part.replace(out / part.name) for part in parts)
    except OSError as problem:
        raise InputError(
            f"{out}: the results cannot be written there ({problem.strerror or problem}): "
            "expected a folder that can be written; choose another with --out"
        ) from None


def _parts(result: StudyResult, folder: Path) -> tuple[Path, ...]:
    """Write every file into a folder of its own; only then is the first one moved."""
    report, values, draws = folder / "report.html", folder / "result.json", folder / "posterior.nc"
    report.write_text(report_html(result), encoding="utf-8")
    values.write_text(result_json(result), encoding="utf-8")
    write_posterior(result, draws)
    return report, values, draws


def report_html(result: StudyResult) -> str:
    """Text of the report; names that come from files are escaped."""
    return page_html(report_page(result))


def report_page(result: StudyResult) -> Page:
    """Page of a study of sensors."""
    study, sensors, cases = result.study, shown_sensors(result), case_views(result)
    few = len(sensors) <= MANY
    which = "does this sensor" if len(sensors) == 1 else "do these components"
    classes = [class_section(found, k) for k, found in enumerate(result.classes)]
    sessions = session_section(result)
    return Page(
        study.title,
        f"Which terms of the generalized model {which} need, and how sure is that?",
        first=[*_answers(result, sensors, cases)],
        blocks=[
            *_overview(result),
            *classes,
            *([sessions] if sessions else []),
            *_cases(cases),
            *([] if few else [_drawn_note(sensors)]),
            *(
                sensor_section(one, answered=not few or _is_apart(one), listed=len(sensors) <= 2)
                for one in sensors
            ),
            *([appendix_section(study.appendices)] if study.appendices else []),
            data_section(result),
            repeat(command(study), study.text, f"Seed {study.seed}."),
        ],
    )


def _is_apart(one: Shown) -> bool:
    """Whether the first screen has a component's noise, and its section the rest of its answer."""
    return one.about_noise and not is_doubtful(one.sensor)


def _answers(result: StudyResult, sensors: Sequence[Shown], cases: Sequence[CaseView]) -> Iterator[Block]:
    """First screen: what each case, component and class needs."""
    if len(cases) <= MOST_DRAWN:
        yield from (answer(view.answer) for view in cases)
    for one in sensors if len(sensors) <= MANY else ():
        told = [*process_answers(one.sensor)]
        own = [] if _is_apart(one) else [sensor_answer(one)]
        yield from (*told, *own) if one.about_noise else (*own, *told)
    for found in result.classes:
        yield answer([f"{class_title(found)}.", class_words(found)])
    if len(cases) > MOST_DRAWN:
        yield Prose(" ".join(held_together(cases)), "answer")
    if result.sessions and not any(map(is_repeated, result.classes)):
        yield Prose(pretty(session_sentence(result.sessions)), "answer")


def _overview(result: StudyResult) -> Iterator[Block]:
    """Noise and verdicts of all components side by side."""
    if sum(bool(sensor.processes) for sensor in result.sensors) > 1:
        yield glance_table(result.sensors)
    if len(result.sensors) > 1:
        yield overview(result.sensors)


def _cases(cases: Sequence[CaseView]) -> Iterator[Section]:
    if len(cases) <= MOST_DRAWN:
        yield from map(case_section, cases)
    elif any(view.rows for view in cases):
        yield cases_section(cases)


def _drawn_note(sensors: Sequence[Shown]) -> Prose:
    """Say of which of many components figures are drawn."""
    drawn = [link(one.sensor.id, one.anchor) for one in sensors if one.figures]
    said = Markup("Figures are drawn of {} of the {} components, those whose rows fit worst: {}.")
    return Prose(said.format(len(drawn), len(sensors), Markup(", ").join(drawn)), "note")
