"""The report of a study of sensors, one HTML file that opens offline."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from markupsafe import Markup

from imubayes.campaign import Appendix, SensorResult
from imubayes.inference.summary import RunSummary
from imubayes.reporting import first_screen
from imubayes.reporting.blocks import Both, Figure, Page, Prose, Section, Table, answer, link, repeat, strong
from imubayes.reporting.case_views import MOST_DRAWN, Cases, case_section, cases_of, cases_section
from imubayes.reporting.noise_views import about_noise, glance_table
from imubayes.reporting.population_views import class_section, session_section
from imubayes.reporting.results import command
from imubayes.reporting.rounding import duration, minus, pretty
from imubayes.reporting.rows import range_texts
from imubayes.reporting.scene_words import HISTORY_NOTE, history_figure
from imubayes.reporting.views import MANY, Shown, is_doubtful, sensor_section, shown_sensors
from imubayes.selection.verdicts import listed
from imubayes.sensors.terms import Kind
from imubayes.study import StudyResult

RUNS_HEAD = (
    "run", "procedure", "samples", "duration", "interval", Both("ranges", None), "checks and notes",
)  # fmt: skip


def report_page(result: StudyResult) -> Page:
    """Page of a study of sensors; of many components each unit has a page of its own."""
    study, sensors, cases = result.study, shown_sensors(result), cases_of(result)
    few, asked = len(sensors) <= MANY, [sensor for sensor in result.sensors if sensor.processes]
    which = "does this sensor" if len(sensors) == 1 else "do these components"
    classes = [class_section(grade, k) for k, grade in enumerate(result.classes)]
    sessions = session_section(result)
    met = [
        Section(mission.name, [history_figure(mission, f"met{k}")]) for k, mission in enumerate(study.scenes)
    ]
    return Page(
        study.title,
        f"Which terms of the generalized model {which} need, and how sure is that?",
        blocks=[
            *([glance_table(result.sensors)] if len(asked) > 1 else []),
            *classes,
            *([sessions] if sessions else []),
            *_cases(result, cases),
            *([] if few else [_units_section(result, sensors)]),
            *(sensor_section(view, listed=len(sensors) <= 2) for view in sensors if few),
            *([appendix_section(study.appendices)] if study.appendices else []),
            *([Section("The scenes", [Prose(HISTORY_NOTE, "note"), *met], "scenes")] if met else []),
            data_section(result),
            repeat(command(study), study.text, f"Seed {study.seed}."),
        ],
        **_opening(result, "first", first_screen.PICTURE_KEY),
    )


def _opening(result: StudyResult, key: str, legend: str | Markup) -> dict[str, Any]:
    """What a page on the components of a result opens with: answer, picture, status."""
    sensors = result.sensors
    noise = all(map(about_noise, sensors))
    return {
        "first": [
            answer([first_screen.first_answer(result)], doubtful=any(map(is_doubtful, sensors))),
            Figure(
                [first_screen.first_panel(sensors, key)],
                first_screen.NOISE_KEY if noise else legend,
                "verdicts",
            ),
        ],
        "counts": "" if noise else first_screen.counts_of(sensors),
        "data": first_screen.data_of(sensors),
        "fit": first_screen.fit_status(sensors),
    }


def _units_section(result: StudyResult, sensors: Sequence[Shown]) -> Section:
    """The page of each unit, and which components have figures there."""
    drawn = [link(shown.sensor.id, shown.anchor) for shown in sensors if shown.figures]
    said = Markup("Figures are drawn of {} of the {} components, those whose rows fit worst: {}.")
    note = said.format(len(drawn), len(sensors), Markup(", ").join(drawn))
    units: dict[str, list[Shown]] = {}
    for view in sensors:
        units.setdefault(view.sensor.id.rpartition(".")[0] or view.sensor.id, []).append(view)
    pages = [_unit_page(result, k, *unit) for k, unit in enumerate(units.items(), 1)]
    return Section("The units", [Prose(note, "note"), *pages], "units", brief=True)


def _unit_page(result: StudyResult, k: int, name: str, own: Sequence[Shown]) -> Page:
    """Page of one unit's components."""
    alone = replace(result, sensors=tuple(view.sensor for view in own), classes=())
    return Page(
        name,
        f"Which terms of the generalized model do the components of {name} need?",
        blocks=[sensor_section(view, listed=len(own) <= 2) for view in own],
        anchor=f"unit-{k}",
        **_opening(alone, f"unit{k}", first_screen.TILES),
    )


def _cases(result: StudyResult, cases: Cases) -> Iterator[Section]:
    if len(cases) <= MOST_DRAWN:
        for k, (name, sensors) in enumerate(cases.items(), 1):
            scenes = [scene for case, scene in result.case_scenes if case == name]
            yield case_section(name, f"case{k}", sensors, result.study.costs, scenes)
    elif any(components[0].recovered for components in cases.values()):
        yield cases_section(cases)


def data_section(result: StudyResult) -> Section:
    """Runs of every component, once where components share them, and the files they are read from."""
    sharing: dict[tuple[int, ...], list[SensorResult]] = {}
    for sensor in result.sensors:
        sharing.setdefault(tuple(map(id, sensor.runs)), []).append(sensor)
    parts = []
    for sensors in sharing.values():
        title = f"Runs of {listed([sensor.id for sensor in sensors])}"
        rows = [_run(run, sensors[0].kind) for run in sensors[0].runs]
        parts.append(Section(title, [Table(title, RUNS_HEAD, rows, "ttnnntw")], brief=True))
    files: dict[
        tuple[str, str], dict[tuple[str, str, str], None]
    ] = {}  # with the columns that all take of each
    for source in (run.source for sensor in result.sensors for run in sensor.runs):
        files.setdefault((source.file, source.sha256), {}).update(dict.fromkeys(source.columns))
    said = []
    for (file, sha256), columns in files.items():
        digest = Markup(', SHA-256 <code class="hash">{}</code>').format(sha256) if sha256 else ""
        taken = [f"{column} as {channel}{f' [{unit}]' if unit else ''}" for column, channel, unit in columns]
        said.append(strong(file) + digest + (Markup("<br>{}").format(", ".join(taken)) if taken else ""))
    return Section("The data", [*parts, Section("Files", [Prose(said)])], "runs", brief=True)


def _run(run: RunSummary, kind: Kind) -> tuple[str, ...]:
    each = range_texts(run, kind)
    ranges = [f"{name} {minus(low)} to {minus(high)} {pretty(unit)}" for name, low, high, unit in each]
    stills = f"{len(run.stills)} stills. " if run.stills else ""
    times = (duration(run.duration), duration(run.sampling or run.interval))
    notes = f"{stills}{'; '.join(run.source.notes) or 'nothing to note'}"
    return (run.name, run.procedure, f"{run.samples:,}", *times, Markup("<br>").join(ranges), notes)


def appendix_section(tables: Sequence[Appendix]) -> Section:
    """Tables measured elsewhere; a column of numbers, which may begin with a sign, stands on the right."""
    sections = []
    for appendix in tables:
        columns = [
            "n" if all(text.strip().lstrip("+-−<>~ ")[:1].isdigit() for text in cells) else "t"
            for cells in zip(*appendix.rows, strict=True)
        ]
        made = [Prose("Made by", "note"), Prose(appendix.command, "pre")] if appendix.command else []
        table = Table(appendix.title, appendix.header, appendix.rows, "".join(["t", *columns[1:]]))
        sections.append(Section(appendix.title, [Prose(appendix.note), table, *made]))
    return Section("Appendices", sections, "appendices")
