"""A comparison of results for a terminal, as a page, and as numbers."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

import imubayes
from imubayes.reporting.comparison import (
    LEVEL,
    Comparison,
    ComponentComparison,
    NoiseComparison,
    Pull,
    TermComparison,
    differing,
)
from imubayes.reporting.quality_page import finite
from imubayes.reporting.result_files import Estimate, NoiseEstimate
from imubayes.reporting.results import versions
from imubayes.reporting.rounding import NOISE_SI, NOISE_UNITS, below, measured, per_unit, pretty
from imubayes.reporting.rows import MARKS
from imubayes.selection.verdicts import listed
from imubayes.sensors.terms import Kind

WHOLE = 2
"""Components of which a terminal gets every term; of more, only what differs."""

VAGUE = 0.5
"""sd of the logarithm from which noise is a limit rather than a value."""

ONE_SIDED = 1.645
"""Normal quantile of 95 %."""


@dataclass(frozen=True, slots=True)
class Line:
    """One result's line of a table.

    Attributes
    ----------
    name : of the term or noise; empty after a term's first line.
    label : of the result.
    value, inclusion, verdict : as text.
    pull : largest difference, as text, in the first line.
    beyond : whether it is beyond uncertainty.
    """

    name: str
    label: str
    value: str
    inclusion: str
    verdict: str
    pull: str
    beyond: bool


@dataclass(frozen=True, slots=True)
class Section:
    """A component of the page.

    Attributes
    ----------
    anchor, title : of the section.
    sentences : the finding.
    terms, noise : tables.
    """

    anchor: str
    title: str
    sentences: tuple[str, ...]
    terms: tuple[Line, ...]
    noise: tuple[Line, ...]


def write_comparison(found: Comparison, folder: Path) -> tuple[Path, ...]:
    """Write ``report.html`` and ``result.json`` into a folder."""
    report, values = folder / "report.html", folder / "result.json"
    report.write_text(comparison_html(found), encoding="utf-8")
    values.write_text(comparison_json(found), encoding="utf-8")
    return report, values


def comparison_html(found: Comparison) -> str:
    """Text of the page; names that come from files are escaped."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    page = Environment(
        loader=PackageLoader("imubayes", "reporting"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    page.filters["pretty"] = lambda text: pretty(text).replace("+-", "±").replace("-", "−")
    return page.get_template("comparison.html.j2").render(
        found=found,
        answer=_answer(found),
        sections=tuple(_section(k, one, found) for k, one in enumerate(found.components)),
        marks={verdict: mark[0] for verdict, mark in MARKS.items()},
        method=_method(found),
        versions=versions(),
        command=_command(found),
    )


def _command(found: Comparison) -> str:
    return f"imubayes compare {' '.join(str(result.path) for result in found.results)}"


def comparison_json(found: Comparison) -> str:
    """Text of ``result.json``, SI; what is not finite becomes null."""
    document = {
        "imubayes": imubayes.__version__,
        "results": [
            {"label": label, "file": str(one.path), "sha256": one.sha256, "study": one.study}
            for label, one in zip(found.labels, found.results, strict=True)
        ],
        "level": LEVEL,
        "comparisons": found.tests,
        "threshold": found.threshold,
        "components": [_component_record(one) for one in found.components],
        "alone": [{"result": label, "id": name} for label, name in found.alone],
    }
    return json.dumps(finite(document), indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def _component_record(one: ComponentComparison) -> dict[str, Any]:
    return {
        "ids": [member.id if member else None for member in one.members],
        "kind": one.kind,
        "matched_by": "order" if one.by_order else "id",
        "classes": [member.class_id or None if member else None for member in one.members],
        "models": [list(member.model) if member else None for member in one.members],
        "terms": [
            {
                "name": term.name,
                "unit": next(value.unit for value in term.values if value),
                "full_mean": [value.mean if value else None for value in term.values],
                "full_sd": [value.sd if value else None for value in term.values],
                "inclusion": [value.inclusion if value else None for value in term.values],
                "verdicts": [value.verdict if value else None for value in term.values],
                "verdicts_differ": term.verdicts_differ,
                **_pull_record(term.pull),
            }
            for term in one.terms
        ],
        "noise": [
            {
                "run": noise.run,
                "name": noise.letter,
                "value": [value.value if value else None for value in noise.values],
                "log_sd": [value.log_sd if value else None for value in noise.values],
                **_pull_record(noise.pull),
            }
            for noise in one.noise
        ],
    }


def _pull_record(pull: Pull | None) -> dict[str, Any]:
    if pull is None:
        return {"difference_over_sd": None, "between": None, "differs": None}
    return {"difference_over_sd": pull.size, "between": list(pull.pair), "differs": pull.beyond}


def terminal_comparison(found: Comparison) -> Group:
    """Lines for a terminal: what differs, and the terms side by side. It fits 80 columns."""
    parts: list[RenderableType] = [
        Text(_clean(f"{label}  {one.path} ({one.study})"))
        for label, one in zip(found.labels, found.results, strict=True)
    ]
    parts += [Text(), Text(_clean(" ".join(_answer(found))), style="bold"), Text()]
    whole = len(found.components) <= WHOLE
    for one in found.components:
        tested = [term for term in one.terms if not _is_untested(term)]
        shown = [term for term in tested if whole or term.verdicts_differ or _is_beyond(term.pull)]
        noise = [entry for entry in one.noise if whole or _is_beyond(entry.pull)]
        if whole or shown or noise:
            lines = [line for term in shown for line in _term_lines(term, found.labels)]
            lines += [line for entry in noise for line in _noise_lines(entry, one, found.labels)]
            parts += [Text(_clean(f"{one.title}  {one.kind}"), style="bold"), _table(lines)]
            parts += [_indented(text) for text in _sentences(one, found)]
            parts.append(Text())
    parts.append(_indented(_method(found), "dim"))
    return Group(*parts)


def _table(lines: list[Line]) -> Table:
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 1), header_style="dim")
    for heading in ("term", "", "value +- sd", "inclusion", "verdict", "differs"):
        right = heading in ("inclusion", "differs")
        table.add_column(heading, justify="right" if right else "left", no_wrap=heading != "verdict")
    for line in lines:
        style = "bold" if line.beyond else ""
        cells = (line.name, line.label, line.value, line.inclusion, line.verdict, line.pull)
        table.add_row(*(Text(_clean(cell), style=style) for cell in cells))
    return table


def _section(k: int, one: ComponentComparison, found: Comparison) -> Section:
    return Section(
        anchor=f"c{k + 1}",
        title=one.title,
        sentences=tuple(_sentences(one, found)),
        terms=tuple(line for term in one.terms for line in _term_lines(term, found.labels)),
        noise=tuple(line for entry in one.noise for line in _noise_lines(entry, one, found.labels)),
    )


def _is_untested(term: TermComparison) -> bool:
    return all(value is None or value.verdict == "untested" for value in term.values)


def _is_beyond(pull: Pull | None) -> bool:
    return pull is not None and pull.beyond


def _pull_text(pull: Pull | None, count: int) -> str:
    if pull is None:
        return ""
    pair = f" {pull.pair[0]}-{pull.pair[1]}" if count > 2 else ""
    return f"{'! ' if pull.beyond else ''}{pull.size:.1f} sd{pair}"


def _term_lines(term: TermComparison, labels: tuple[str, ...]) -> Iterator[Line]:
    """One line for each result."""
    for k, (label, value) in enumerate(zip(labels, term.values, strict=True)):
        name, pull = (term.name, _pull_text(term.pull, len(labels))) if k == 0 else ("", "")
        beyond = _is_beyond(term.pull)
        if value is None:
            yield Line(name, label, "not in the library", "", "", pull, beyond)
        else:
            yield Line(name, label, _value(value), f"{value.inclusion:.3f}", value.verdict, pull, beyond)


def _value(value: Estimate) -> str:
    if value.verdict == "untested":
        return "not tested"
    scale = per_unit(value.printed, value.unit)
    return str(measured(value.mean / scale, value.sd / scale, value.printed))


def _noise_lines(entry: NoiseComparison, one: ComponentComparison, labels: tuple[str, ...]) -> Iterator[Line]:
    for k, (label, value) in enumerate(zip(labels, entry.values, strict=True)):
        first = (f"{entry.letter} {entry.run}", _pull_text(entry.pull, len(labels)))
        name, pull = first if k == 0 else ("", "")
        kind: Kind = "accelerometer" if one.kind == "accelerometer" else "gyroscope"
        text = _noise_value(value, entry.letter, kind) if value else "no such run"
        yield Line(name, label, text, "", "", pull, _is_beyond(entry.pull))


def _noise_value(value: NoiseEstimate, letter: str, kind: Kind) -> str:
    unit, si = NOISE_UNITS[kind]["NBK".index(letter)], NOISE_SI[kind]["NBK".index(letter)]
    size = value.value / per_unit(unit, si)
    if value.log_sd > VAGUE:
        return f"below {below(size * math.exp(ONE_SIDED * value.log_sd), unit)}"
    sd = size * value.log_sd if math.isfinite(value.log_sd) else 0.0
    return str(measured(size, sd, unit)) + ("" if sd else " (given)")


def _answer(found: Comparison) -> list[str]:
    """Say whether anything differs, and what most."""
    every = [(one, entry) for one in found.components for entry in differing(one)]
    changed = sum(term.verdicts_differ for one in found.components for term in one.terms)
    verdicts = f"{changed} {'verdict differs' if changed == 1 else 'verdicts differ'}."
    if not every:
        return [f"Nothing differs beyond uncertainty in {found.tests} comparisons; {verdicts}"]
    one, worst = max(every, key=lambda pair: pair[1].pull.size if pair[1].pull else 0.0)
    count = f"{len(every)} {'value differs' if len(every) == 1 else 'values differ'}"
    size = worst.pull.size if worst.pull else math.nan
    return [
        f"{count} beyond uncertainty, most {_called(worst)} of {one.title}, by {size:.1f} sd;",
        verdicts,
    ]


def _called(entry: TermComparison | NoiseComparison) -> str:
    if isinstance(entry, TermComparison):
        return entry.name
    return f"noise {entry.letter} of run {entry.run}"


def _sentences(one: ComponentComparison, found: Comparison) -> Iterator[str]:
    """Say how a component was matched, what differs, and what cannot be compared."""
    members = [(label, m) for label, m in zip(found.labels, one.members, strict=True) if m]
    if one.by_order:
        names = listed([f"{label} {member.id}" for label, member in members])
        yield f"The ids differ: matched by kind and order, {names}."
    if len({member.class_id for _, member in members}) > 1:
        classes = listed([f"{label} {member.class_id or 'none'}" for label, member in members])
        yield f"The classes, and so the priors, differ: {classes}."
    far = [f"{_called(entry)} ({entry.pull.size:.1f} sd)" for entry in differing(one) if entry.pull]
    compared = sum(entry.pull is not None for entry in (*one.terms, *one.noise))
    yield (
        f"Beyond uncertainty: {listed(far)}."
        if far
        else f"None of {compared} terms and noise figures differs beyond uncertainty."
    )
    untested = [term.name for term in one.terms if _is_untested(term)]
    if untested:
        yield f"No result tests {listed(untested)}."
    changed = [term.name for term in one.terms if term.verdicts_differ]
    if changed:
        yield f"The verdict differs on {listed(changed)}."
    partly = [term.name for term in one.terms if sum(v is not None for v in term.values) < len(members)]
    if partly:
        yield f"Not in every library, which the other estimates depend on: {listed(partly)}."


def _method(found: Comparison) -> str:
    return (
        f"A difference counts from {found.threshold:.1f} sd on: in {found.tests} comparisons chance reaches"
        f" that with {100.0 * LEVEL:.0f} % at most (Bonferroni). Terms are compared under the full library,"
        " noise by its logarithm, and the results as independent."
    )


def _indented(text: str, style: str = "") -> Padding:
    return Padding(Text(_clean(text), style=style), (0, 0, 0, 1))


def _clean(text: str) -> str:
    """Names come from files: what is not printable does not reach the terminal."""
    return "".join(sign if sign.isprintable() else "?" for sign in text)
