"""The report on a trade of speed for accuracy: one page, its numbers, and the table for a terminal."""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import imubayes
from imubayes.campaign.fidelity import rung_of
from imubayes.ladder.trade.plan import DEFAULT, NAMES
from imubayes.ladder.trade.recommend import allowed
from imubayes.reporting.quality_page import finite
from imubayes.reporting.rounding import duration
from imubayes.reporting.trade_figures import trade_panels
from imubayes.reporting.trade_words import bytes_text, error_text, rate_text, seconds_of, trade_answer

if TYPE_CHECKING:
    from rich.console import Group

    from imubayes.ladder.trade.alone import Measured
    from imubayes.ladder.trade.differ import Difference
    from imubayes.ladder.trade.record import Place, Standing, Traded
    from imubayes.ladder.trade.score import Score

HEADS = ("time", "processor", "memory", "off, rms", "largest", "Monte Carlo", "foresaw", "inclusion off",
         "other verdicts")  # fmt: skip

SCORE_HEADS = ("sensors", "90 % intervals hold", "error", "false needed", "false not needed", "missed",
               "cost a sensor")  # fmt: skip

SCENE_HEAD = "terms off a scene"

SCENE_HEADS = ("budgets off", "terms off")


@dataclass(frozen=True, slots=True)
class Row:
    """A line of a table: its name, and its numbers as texts."""

    name: str
    cells: tuple[str, ...]


def write_trade(found: Traded, folder: Path) -> tuple[Path, ...]:
    """Write ``report.html`` and ``result.json`` into a folder."""
    report, values = folder / "report.html", folder / "result.json"
    report.write_text(trade_html(found), encoding="utf-8")
    values.write_text(trade_json(found), encoding="utf-8")
    return report, values


def trade_html(found: Traded) -> str:
    """Text of the report; names that come from the study file are escaped."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    page = Environment(
        loader=PackageLoader("imubayes", "reporting"), autoescape=True, undefined=StrictUndefined
    ).get_template("trade.html.j2")
    scenes = (SCENE_HEAD,) if found.trade.missions else ()
    return page.render(
        trade=found.trade,
        what=_counted(len(found.standings)),
        answer=trade_answer(found),
        panels=trade_panels(found),
        best=found.best,
        ladder=tuple(rung_of(place.rung) for place in found.places),
        allowed=f"{allowed(found.floor[0]):.2g}",
        heads=(*HEADS, *(SCENE_HEADS if scenes else ())),
        rows=tuple(_row(place, bool(scenes)) for place in found.places),
        score_heads=(*SCORE_HEADS, *scenes),
        scores=tuple(_score_row(one, bool(scenes)) for one in found.scores),
        drawn=_drawn(found),
        components=tuple(_component_rows(found)),
        machine=found.machine,
        took=duration(found.seconds),
        version=imubayes.__version__,
        command=command(found),
    )


def command(found: Traded) -> str:
    """The command that made it.

    Only what is not the usual is said.
    """
    trade = found.trade
    parts = ["imubayes trade", shlex.quote(str(trade.path)), f"--repeats {trade.repeats}"]
    parts += [f"--only {shlex.quote(','.join(trade.only))}"] if trade.only else []
    parts += [f"--rungs {','.join(trade.rungs)}"] if trade.rungs != NAMES else []
    return " ".join([*parts, f'--limit "{trade.limit:g} s"'])


def _counted(components: int) -> str:
    return "component" if components == 1 else f"{components} components"


def _row(place: Place, scenes: bool) -> Row:
    name = f"{place.rung} (default)" if place.rung == DEFAULT else place.rung
    cells = (
        seconds_of(place),
        f"{place.processor_seconds:.2g} s",
        bytes_text(place.memory),
        error_text(place.rms),
        error_text(place.largest),
        error_text(place.monte_carlo),
        error_text(place.foreseen),
        error_text(place.inclusion),
        str(place.verdicts),
    )
    needs = (error_text(place.scene_share), str(place.scene_terms)) if scenes else ()
    return Row(name, (*cells, *needs))


def _score_row(one: Score, scenes: bool) -> Row:
    cells = (
        str(one.repeats),
        rate_text(one.coverage),
        error_text(one.error),
        f"{one.false_needed.events} of {one.false_needed.of}",
        f"{one.false_not_needed.events} of {one.false_not_needed.of}",
        f"{one.missed_large.events} of {one.missed_large.of}",
        f"{one.cost:.2f}",
    )
    return Row(one.rung, (*cells, f"{one.scene_terms:.1f}") if scenes else cells)


def _drawn(found: Traded) -> str:
    """Say where the simulated sensors come from."""
    if any(one.lot is not None for one in found.trade.subjects):
        return "The simulated sensors are further units of the lots, each on a bench with errors of its own."
    best = found.standings[0].best
    return (
        f"The simulated sensors have coefficients and noise that are drawn from the posterior of {best}, each"
        " by itself, and go through the same tests."
    )


def _component_rows(found: Traded) -> Iterator[Row]:
    for standing in found.standings:
        for one, apart in zip(standing.measured, standing.differences, strict=True):
            yield _component_row(standing, one, apart, scenes=bool(found.trade.missions))


def _component_row(standing: Standing, one: Measured, apart: Difference, *, scenes: bool) -> Row:
    verdicts = "; ".join(f"{name}: {said}, not {right}" for name, said, right in apart.verdicts)
    needs = "; ".join(f"{scene.scene}: {', '.join(scene.terms)}" for scene in apart.scenes if scene.terms)
    best = one.told.rung == standing.best
    cells = (
        one.told.rung,
        f"{one.seconds:.2g} s",
        "" if best else error_text(apart.rms),
        "" if best else error_text(apart.largest),
        "" if best else apart.worst,
        "" if best else error_text(apart.inclusion),
        "held against" if best else verdicts,
    )
    return Row(standing.subject, (*cells, needs) if scenes else cells)


def trade_json(found: Traded) -> str:
    """Text of ``result.json``: every number, SI; what is not finite becomes null."""
    trade = found.trade
    document = {
        "imubayes": imubayes.__version__,
        "study": trade.title,
        "seed": trade.seed,
        "limit": trade.limit,
        "repeats": trade.repeats,
        "answer": trade_answer(found),
        "recommended": found.recommended,
        "default": DEFAULT,
        "best": found.best,
        "front": found.front,
        "monte_carlo_floor": {"largest": found.floor[0], "rms": found.floor[1]},
        "good_enough": allowed(found.floor[0]),
        "rungs": [asdict(place) for place in found.places],
        "scores": [asdict(one) for one in found.scores],
        "components": [_standing_values(standing) for standing in found.standings],
        "machine": asdict(found.machine),
        "seconds": found.seconds,
        "provenance": {
            "study_file": str(trade.path),
            "study_text": trade.text,
            "command": command(found),
        },
    }
    return json.dumps(finite(document), indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def _standing_values(standing: Standing) -> dict[str, Any]:
    return {
        "id": standing.subject,
        "best": standing.best,
        "monte_carlo_floor": {"largest": standing.floor[0], "rms": standing.floor[1]},
        "skipped": dict(standing.skipped),
        "rungs": [
            _measured_values(one, apart)
            for one, apart in zip(standing.measured, standing.differences, strict=True)
        ],
    }


def _measured_values(one: Measured, apart: Difference) -> dict[str, Any]:
    told = one.told
    terms = zip(
        told.names, told.mean, told.full_mean, told.full_sd, told.inclusion, told.verdicts, strict=True
    )
    keys = ("name", "mean", "full_mean", "full_sd", "inclusion", "verdict")
    return {
        "rung": told.rung,
        "seconds": one.seconds,
        "seconds_to_what_was_asked": one.whole_seconds,
        "processor_seconds": one.processor_seconds,
        "memory": one.memory,
        "ess": told.ess,
        "foreseen_change_sd": one.foreseen[0],
        "foreseen_change_inclusion": one.foreseen[1],
        "difference": asdict(apart),
        "model": told.model,
        "terms": [dict(zip(keys, _plain(term), strict=True)) for term in terms],
    }


def _plain(term: tuple[Any, ...]) -> Iterator[Any]:
    return (value if isinstance(value, str) else float(value) for value in term)


def terminal_trade(found: Traded) -> Group:
    """Table and answer for a console of 80 columns."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False, padding=(0, 1), header_style="bold")
    heads = ("rung", "time", "memory", "off rms", "largest", "incl.", "verd.", "90 % holds", "cost")
    for k, head in enumerate(heads):
        table.add_column(head, justify="right" if k else "left", no_wrap=True)
    for place in found.places:
        score = found.score(place.rung)
        held = f"{score.coverage.share.value:.0%}" if score and score.coverage.of else ""
        table.add_row(
            place.rung,
            seconds_of(place).replace("about ", "~"),
            bytes_text(place.memory),
            error_text(place.rms),
            error_text(place.largest),
            error_text(place.inclusion),
            str(place.verdicts),
            held,
            f"{score.cost:.2f}" if score else "",
        )
    first, *rest = trade_answer(found)
    return Group(table, Text(), Text(first, style="bold"), *map(Text, rest))
