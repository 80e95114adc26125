"""The report on how good the decision is: one page and its numbers."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import imubayes
from imubayes import reporting
from imubayes.reporting.method_words import called
from imubayes.reporting.provenance import versions
from imubayes.reporting.result.file import json_text
from imubayes.reporting.rounding import duration, percent
from studies.command import settings, settings_text
from studies.decision_quality.figures import calibration_panel, cost_panel, drops_panel, ratio_panel
from studies.decision_quality.scores import CLIP, EDGES
from studies.decision_quality.subjects import PARTIAL
from studies.decision_quality.trials import MODELLED, SURE
from studies.decision_quality.words import (
    bins,
    left_open,
    quality_answer,
    shares,
    wrong_models,
)

if TYPE_CHECKING:
    from imubayes.reporting.canvas import Panel
    from studies.decision_quality.measure import Quality
    from studies.decision_quality.questions import Interval
    from studies.decision_quality.scores import MethodScore, Scores


TITLE = "How good is the decision?"


@dataclass(frozen=True, slots=True)
class Row:
    """A method's line of a table: its name and its numbers as texts."""

    name: str
    cells: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """One treatment of the page.

    Attributes
    ----------
    anchor, title, told : of the treatment.
    left_open : what the verdicts leave open, in words.
    rows : a method each.
    drops : shares dropped, a method each, by bin of effect over noise.
    careful : the decision at several ratios of costs.
    panels : figures.
    """

    anchor: str
    title: str
    told: Scores
    left_open: str
    rows: tuple[Row, ...]
    drops: tuple[Row, ...]
    careful: tuple[Row, ...]
    panels: tuple[Panel, ...]


def write_quality(quality: Quality, folder: Path) -> tuple[Path, ...]:
    """Write ``report.html`` and ``result.json`` into a folder."""
    report, values = folder / "report.html", folder / "result.json"
    report.write_text(quality_html(quality), encoding="utf-8")
    values.write_text(quality_json(quality), encoding="utf-8")
    return report, values


def quality_html(quality: Quality) -> str:
    """Text of the report; names that come from the study file are escaped."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    folders = FileSystemLoader((Path(__file__).parent, Path(reporting.__file__).parent))
    page = Environment(loader=folders, autoescape=True, undefined=StrictUndefined).get_template(
        "page.html.j2"
    )
    return page.render(
        study=quality.study,
        answer=quality_answer(quality),
        wrong=tuple(wrong_models(quality)),
        sections=tuple(_section(k, told) for k, told in enumerate(quality.overall)),
        kinds=_kind_rows(quality),
        bins=bins(),
        clip=CLIP,
        partial=PARTIAL,
        took=duration(quality.seconds),
        versions=versions(),
        title=TITLE,
        command=quality.study.command,
        settings=settings_text(quality.study),
    )


def _section(k: int, told: Scores) -> Section:
    paints = (drops_panel, cost_panel, ratio_panel, calibration_panel)
    panels = tuple(paint(told, f"q{k}n{n}") for n, paint in enumerate(paints))
    return Section(
        anchor=f"treatment-{k}",
        title=f"{told.treatment[:1].upper()}{told.treatment[1:]}",
        told=told,
        left_open=left_open(told),
        rows=tuple(Row(called(score.method), _cells(score)) for score in told.methods),
        drops=tuple(Row(called(s.method), tuple(shares(b) for b in s.false_drops)) for s in told.methods),
        careful=tuple(
            Row(
                f"{one.ratio:g}",
                (f"{one.threshold:.2f}", shares(one.false_keeps), shares(one.false_drops)),
            )
            for one in told.careful
        ),
        panels=panels,
    )


def _cells(score: MethodScore) -> tuple[str, ...]:
    return (
        shares(score.false_keeps),
        shares(score.false_drops[-1]),
        _number(score.cost),
        _number(score.excess) if score.method != "decision" else "",
        "" if score.method == SURE else _number(score.opened),
        "" if score.method == SURE else _number(score.brier, 3, "–"),
        "" if score.method == SURE else _number(score.log, 3, "–"),
    )


def _kind_rows(quality: Quality) -> tuple[Row, ...]:
    """The decision under each treatment by kind of sensor, terms singly and groups as one question."""
    return tuple(
        Row(
            f"{told.treatment}, {told.kind or 'both'}",
            (
                f"{told.sensors}",
                shares(own.false_keeps),
                shares(own.false_drops[-1]),
                f"{told.groups}",
                f"{own.group_keeps.events} of {own.group_keeps.of}",
                f"{own.group_drops.events} of {own.group_drops.of}",
                f"{own.group_cost.value:.2f}",
            ),
        )
        for told in quality.scores
        for own in told.methods[:1]
    )


def _number(found: Interval, digits: int = 2, between: str = " to ") -> str:
    if math.isnan(found.value):
        return ""
    value, low, high = (f"{x:.{digits}f}".replace("-", "−") for x in (found.value, found.low, found.high))
    return f"{value} ({low}{between}{high})"


def quality_json(quality: Quality) -> str:
    """Text of ``result.json``: scores with their intervals; what is not finite becomes null."""
    study = quality.study
    document = {
        "imubayes": imubayes.__version__,
        "study": TITLE,
        "seed": study.seed,
        "sensors_per_kind": study.sensors,
        "misspecified_per_kind": study.misspecified,
        "answer": quality_answer(quality),
        "effect_edges": EDGES[:-1],
        "scores": [asdict(told) for told in quality.scores],
        "seconds": quality.seconds,
        "provenance": {
            "command": study.command,
            "settings": settings(study),
            "versions": versions(),
        },
    }
    return json_text(document)


def terminal_quality(quality: Quality) -> str:
    """Lines for a terminal: the answer, and every method's rates as modelled."""
    told = next(one for one in quality.overall if one.treatment == MODELLED)
    lines = [f"{'method':22} {'false keeps':>12} {'drops > 8 sd':>13} {'cost':>7} {'Brier':>7} {'log':>7}"]
    lines += [
        f"{called(s.method):22} {percent(s.false_keeps.value):>12} {percent(s.false_drops[-1].value):>13} "
        f"{s.cost.value:7.2f} {s.brier.value:7.3f} {s.log.value:7.3f}".replace("nan", "  -")
        for s in told.methods
    ]
    return "\n".join((*quality_answer(quality), "", *lines))
