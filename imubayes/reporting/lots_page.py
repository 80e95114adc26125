"""The report of a class-level study: one page and its numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from imubayes.population.needs import (
    NEEDED,
    NOT_NEEDED,
    UNTOLD,
    WOULD_MATTER,
    answers_in,
    of_class,
    terms_in,
    terms_of,
)
from imubayes.reporting.lots_figures import (
    class_matrix,
    needed_matrix,
    order_panel,
    population_panel,
    scene_matrix,
)
from imubayes.reporting.lots_headline import headline, simulated, status
from imubayes.reporting.lots_results import lots_json
from imubayes.reporting.lots_sentences import (
    SIMULATED,
    basic_sentences,
    check_sentences,
    class_sentences,
    lots_answer,
    own_scene_sentences,
    scene_sentences,
)
from imubayes.reporting.lots_words import (
    amid,
    budget,
    class_name,
    counts,
    scene_name,
    slug,
)
from imubayes.reporting.results import versions
from imubayes.reporting.rounding import (
    OUTPUT_SI,
    OUTPUT_UNIT,
    duration,
    measured,
    per_unit,
    percent,
    percents,
    pretty,
    ranged,
    share,
    share_range,
)
from imubayes.sensors.catalogue import prior_sd
from imubayes.sensors.equations.standards import symbols

if TYPE_CHECKING:
    from imubayes.population.lots import ClassFound, Coverage, LotResult
    from imubayes.population.scenes import MissionFound, MissionTerm
    from imubayes.reporting.canvas import Panel
    from imubayes.sensors.terms import Kind


@dataclass(frozen=True, slots=True)
class Row:
    """A line of a table: its anchor (if anything leads there), name, where that leads, and numbers."""

    anchor: str
    name: str
    leads: str
    cells: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class SceneView:
    """A scene over the classes, or within one.

    Attributes
    ----------
    anchor, title : of the scene.
    terms : of the study's budget, in words.
    said : sentences made from the numbers.
    panel : matrix of terms by class; None within a class.
    rows : of the table of its terms; empty over the classes.
    """

    anchor: str
    title: str
    terms: str
    said: tuple[str, ...]
    panel: Panel | None
    rows: tuple[Row, ...]


@dataclass(frozen=True, slots=True, eq=False)
class ClassView:
    """A class's page."""

    anchor: str
    title: str
    told: str
    said: tuple[str, ...]
    rows: tuple[Row, ...]
    panels: tuple[Panel, ...]
    scenes: tuple[SceneView, ...]


def write_lots(result: LotResult, folder: Path) -> tuple[Path, ...]:
    """Write ``report.html`` and ``result.json`` into a folder."""
    report, values = folder / "report.html", folder / "result.json"
    report.write_text(lots_html(result), encoding="utf-8")
    values.write_text(lots_json(result), encoding="utf-8")
    return report, values


def lots_html(result: LotResult) -> str:
    """Text of the report; names that come from the study file are escaped."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    page = Environment(
        loader=PackageLoader("imubayes", "reporting"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    ).get_template("lots.html.j2")
    study = result.study
    return page.render(
        study=study,
        answer=lots_answer(result),
        status=status(result),
        simulated=simulated(result),
        caution=SIMULATED,
        names=tuple(class_name(one.sensor_class) for one in result.classes),
        orders=_orders(result),
        matrix=needed_matrix(result, "needed-matrix"),
        order=order_panel(result, "order-panel"),
        scenes=tuple(_scene_view(result, k) for k in range(len(study.missions))),
        classes=tuple(_class_view(result, k) for k in range(len(result.classes))),
        check=check_sentences(result),
        checked=_checked(result),
        basic=basic_sentences(result) if study.basic else (),
        basic_rows=tuple(_by_scene(result, "basic", lambda scene: share(scene.basic_share))),
        took=duration(result.seconds),
        unit=pretty(OUTPUT_UNIT[study.kind]),
        versions=versions(),
        command=f"imubayes run {study.path}",
    )


def _orders(result: LotResult) -> tuple[Row, ...]:
    """Sizes of the models, a class a column: what the test shows, and what each scene requires."""
    shown = Row("order-shown", "needed", "needed-terms", tuple(amid(one.order) for one in result.classes))
    return (shown, *_by_scene(result, "order", lambda scene: amid(scene.order)))


def _by_scene(result: LotResult, what: str, told: Callable[[MissionFound], str]) -> Iterator[Row]:
    """Tell something of each scene, a class a column."""
    for k, mission in enumerate(result.study.missions):
        cells = tuple(told(one.missions[k]) for one in result.classes)
        yield Row(slug(what, mission.name), scene_name(mission.name), slug("scene", mission.name), cells)


def _checked(result: LotResult) -> tuple[Row, ...]:
    """The answers against the simulated truth in numbers."""
    check = result.check
    cells, true = check.cells
    rows = [
        ("precision", f"{cells:,} cells", check.precision),
        ("recall", f"{true:,} required", check.recall),
        ("population mean", _counted(check.population_mean), check.population_mean.share),
        ("population spread", _counted(check.population_spread), check.population_spread.share),
    ]
    return tuple(
        Row(slug("check", name), name, "check", (count, percents(found))) for name, count, found in rows
    )


def _counted(found: Coverage) -> str:
    return f"{found.held:,} of {found.of:,} held"


def _scene_view(result: LotResult, k: int) -> SceneView:
    mission = result.study.missions[k]
    return SceneView(
        anchor=slug("scene", mission.name),
        title=scene_name(mission.name),
        terms=budget(mission, result.study.kind),
        said=scene_sentences(result, k),
        panel=scene_matrix(result, k, f"scene{k}"),
        rows=(),
    )


def _class_view(result: LotResult, k: int) -> ClassView:
    found, study = result.classes[k], result.study
    entry, name = found.sensor_class, class_name(found.sensor_class)
    panels = [population_panel(found, study.library, f"population{k}")]
    if found.missions:
        panels.append(class_matrix(found, f"class{k}"))
    return ClassView(
        anchor=slug("class", entry.id),
        title=f"{name[:1].upper()}{name[1:]}",
        told=f"{entry.technology}, {entry.grade} ({', '.join(entry.examples[:3])})",
        said=class_sentences(found, len(study.library.terms)),
        rows=tuple(_population_rows(result, found)),
        panels=tuple(panels),
        scenes=tuple(_own_scene(result, found, m) for m in range(len(found.missions))),
    )


def _population_rows(result: LotResult, found: ClassFound) -> list[Row]:
    rows, spelt = [], symbols(replace(result.study.library, technology=found.sensor_class.technology))
    for term, one in zip(result.study.library.terms, found.terms, strict=True):
        size = per_unit(term.printed, term.unit)
        typical = prior_sd(found.sensor_class, term)[0]
        cells = (
            spelt[term.name],
            ranged(one.mean, size=size),
            _plain(one.true_mean / size),
            ranged(one.spread, size=size),
            _plain(one.true_spread / size),
            pretty(term.printed),
            _plain(typical / size),
            percents(one.needed),
            percent(one.open),
            of_class(one),
        )
        rows.append(Row(slug("class", found.sensor_class.id, one.name), one.name, "needed-terms", cells))
    return rows


def _plain(value: float) -> str:
    return str(measured(value, 0.0)).replace("-", "−")


def _own_scene(result: LotResult, found: ClassFound, k: int) -> SceneView:
    """One scene on the page of a class."""
    mission, scene, kind = result.study.missions[k], found.missions[k], result.study.kind
    anchor = slug("class", found.sensor_class.id, scene.mission)
    return SceneView(
        anchor=anchor,
        title=scene_name(scene.mission),
        terms=budget(mission, kind),
        said=own_scene_sentences(found, scene),
        panel=None,
        rows=tuple(
            _scene_row(term, answer, mission.name, kind)
            for term, (_, answer) in zip(scene.terms, answers_in(found, scene), strict=True)
            if counts(term) or answer == WOULD_MATTER
        ),
    )


def _scene_row(term: MissionTerm, answer: str, scene: str, kind: Kind) -> Row:
    size = per_unit(OUTPUT_UNIT[kind], OUTPUT_SI[kind])
    cells = (
        _plain(term.rms / size),
        share_range(term.share),
        share(term.true_share),
        percent(term.required),
        answer,
    )
    return Row("", term.name, slug("scene", scene), cells)


def terminal_lots(result: LotResult) -> str:
    """Lines for a terminal: the answer, how many terms each class needs, and how well truths are met."""
    lines = [f"{'class':24} {'needed':>7} {'not needed':>11} {'cannot tell':>12} {'scenes with a need':>20}"]
    for one in result.classes:
        needs = sum(bool(terms_in(one, scene, NEEDED)) for scene in one.missions)
        counted = [len(terms_of(one, answer)) for answer in (NEEDED, NOT_NEEDED, UNTOLD)]
        lines.append(
            f"{class_name(one.sensor_class):24} {counted[0]:>7} {counted[1]:>11} {counted[2]:>12}"
            f" {f'{needs} of {len(one.missions)}':>20}"
        )
    lines += ["", "against the simulated truth"]
    lines += [f"{row.name:24} {row.cells[0]:>16} {row.cells[1]:>32}" for row in _checked(result)]
    said = (headline(result).text, status(result), simulated(result))
    return "\n".join((*said, "", *(one.text for one in lots_answer(result)[2:]), "", *lines))
