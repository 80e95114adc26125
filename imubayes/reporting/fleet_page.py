"""The report of a fleet: one page, its numbers, and the lines of a terminal."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import imubayes
from imubayes.population.tally import VERDICTS
from imubayes.reporting.fleet_figures import fleet_population_panel, verdict_panel
from imubayes.reporting.fleet_words import fleet_answer, noise_range, plain, pull_value
from imubayes.reporting.lots_words import class_name
from imubayes.reporting.quality_page import finite
from imubayes.reporting.results import versions
from imubayes.reporting.rounding import measured, per_unit, percent, percents, pretty, ranged
from imubayes.sensors.equations.standards import symbols
from imubayes.units import counted

if TYPE_CHECKING:
    from rich.console import Group

    from imubayes.population.fleet import FleetResult


@dataclass(frozen=True, slots=True)
class Row:
    """A line of a table: its name and its cells as texts."""

    name: str
    cells: tuple[str, ...]


def write_fleet(result: FleetResult, folder: Path) -> tuple[Path, ...]:
    """Write ``report.html`` and ``result.json`` into a folder."""
    report, values = folder / "report.html", folder / "result.json"
    report.write_text(fleet_html(result), encoding="utf-8")
    values.write_text(fleet_json(result), encoding="utf-8")
    return report, values


def fleet_html(result: FleetResult) -> str:
    """Text of the report; names that come from the study and its files are escaped."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    page = Environment(
        loader=PackageLoader("imubayes", "reporting"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    ).get_template("fleet.html.j2")
    study, answer = result.study, result.answer
    return page.render(
        study=study,
        title=f"{class_name(study.sensor_class)} {study.spec.kind}s",
        answer=fleet_answer(result),
        panels=(verdict_panel(result, "v"), fleet_population_panel(result, "p")),
        populations=tuple(_population_rows(result)),
        verdicts=VERDICTS,
        counts=tuple(_count_rows(result)),
        worst=tuple(_worst_rows(result)),
        limit=f"{answer.limit:.1f}",
        noise=tuple(
            Row(name, (noise_range(found, study.spec.library, k),))
            for k, (name, found) in enumerate(zip("NBK", answer.noise, strict=True))
        ),
        broken=answer.broken,
        samples=f"{answer.samples:,}",
        done=_done(result),
        versions=versions(),
        command=f"imubayes run {study.path}",
    )


def _population_rows(result: FleetResult) -> Iterator[Row]:
    """Population of each term, with the truth where the units are simulated."""
    simulated, spelt = result.study.simulated, symbols(result.study.spec.library)
    for term, one in zip(result.study.spec.library.terms, result.answer.terms, strict=True):
        size = per_unit(term.printed, term.unit)
        truth = [(_number(value / size),) if simulated else () for value in (one.true_mean, one.true_spread)]
        cells = (
            spelt[term.name],
            ranged(one.mean, size=size),
            *truth[0],
            ranged(one.spread, size=size),
            *truth[1],
            pretty(term.printed),
            percents(one.needed),
            percent(one.open),
        )
        yield Row(one.name, cells)


def _number(value: float) -> str:
    return plain(measured(value, 0.0))


def _count_rows(result: FleetResult) -> Iterator[Row]:
    for j, name in enumerate(result.study.spec.library.names):
        yield Row(name, tuple(f"{count:,}" if count else "" for count in result.answer.counts[:, j].tolist()))


def _worst_rows(result: FleetResult) -> Iterator[Row]:
    for one in result.answer.worst:
        value = pull_value(one, result.study.spec.library)
        yield Row(
            one.unit, (one.term, value, f"{one.pull:+.1f}".replace("-", "−"), "yes" if one.outlier else "")
        )


def _done(result: FleetResult) -> str:
    """Who did the work, and how long it took."""
    kept = (
        f"; {counted(result.resumed, 'unit')} {'was' if result.resumed == 1 else 'were'} there already"
        if result.resumed
        else ""
    )
    return f"{result.engine}, {result.seconds:.0f} s{kept}"


def fleet_json(result: FleetResult) -> str:
    """Text of ``result.json``: SI; what is not finite becomes null."""
    study, answer = result.study, result.answer
    document = {
        "imubayes": imubayes.__version__,
        "study": study.title,
        "seed": study.seed,
        "answer": fleet_answer(result),
        "fleet": {
            "kind": study.spec.kind,
            "class": study.sensor_class.id,
            "units": len(study.units),
            "read": answer.units,
            "samples": answer.samples,
            "terms": [_term_entry(result, j) for j in range(len(answer.terms))],
            "order": asdict(answer.order),
            "noise": {name: asdict(found) for name, found in zip("NBK", answer.noise, strict=True)},
            "outliers": answer.outliers,
            "limit": answer.limit,
            "worst": [asdict(one) for one in answer.worst],
            "broken": [asdict(one) for one in answer.broken],
        },
        "engine": result.engine,
        "resumed": result.resumed,
        "seconds": result.seconds,
        "provenance": {
            "study_file": str(study.path),
            "study_text": study.text,
            "command": f"imubayes run {study.path}",
            "versions": versions(),
        },
    }
    return json.dumps(finite(document), indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def _term_entry(result: FleetResult, j: int) -> dict[str, Any]:
    term, counts = result.study.spec.library.terms[j], result.answer.counts[:, j].tolist()
    found = asdict(result.answer.terms[j])
    return {
        **found,
        "symbol": symbols(result.study.spec.library)[term.name],
        "unit": term.unit,
        "verdicts": dict(zip(VERDICTS, counts, strict=True)),
    }


def terminal_fleet(result: FleetResult) -> Group:
    """The answer and the population, for a console."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False)
    for name in ("term", "mean", "spread", "needed", "open"):
        table.add_column(name, justify="left" if name == "term" else "right")
    for term, one in zip(result.study.spec.library.terms, result.answer.terms, strict=True):
        size = per_unit(term.printed, term.unit)
        mean, spread = (
            measured(x.value / size, _half(x.low / size, x.high / size), term.printed)
            for x in (one.mean, one.spread)
        )
        table.add_row(one.name, str(mean), str(spread), percent(one.needed.value), percent(one.open))
    return Group(*(Text(text) for text in fleet_answer(result)), "", table, _done(result))


def _half(low: float, high: float) -> float:
    """Sd of a normal whose 90 % interval is as wide."""
    return (high - low) / (2.0 * 1.6448536269514722) if math.isfinite(high - low) else math.nan
