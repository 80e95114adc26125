"""A comparison of results of sensors: as a page, and as numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

from imubayes.reporting.blocks import Page, Prose, Row, Section, Text, typeset, verdict
from imubayes.reporting.comparison.pulls import is_beyond
from imubayes.reporting.comparison.records import head_record, pull_record
from imubayes.reporting.comparison.result_files import NoiseEstimate
from imubayes.reporting.comparison.results import (
    Comparison,
    ComponentComparison,
    NoiseComparison,
    TermComparison,
    differing,
)
from imubayes.reporting.comparison.scene_views import scene_record, scene_section
from imubayes.reporting.comparison.view import (
    DIFFERENCE,
    RESULT,
    comparison_page,
    counted,
    difference,
    headed,
    titled,
)
from imubayes.reporting.result.sensors import Term
from imubayes.reporting.rounding import NOISE_SI, NOISE_UNITS, below, measured, per_unit
from imubayes.selection.verdicts import listed
from imubayes.sensors.terms import Kind

WHOLE = 2
"""Components of which a terminal gets every term; of more, only what differs."""

VAGUE = 0.5
"""sd of the logarithm from which noise is a limit rather than a value."""

ONE_SIDED = 1.645
"""Normal quantile of 95 %."""

QUESTION = "The same terms, their values, noise, verdicts and scenes: what differs beyond uncertainty?"

HEAD = ("term", RESULT, "value", "inclusion", "verdict", DIFFERENCE)
NOISE_HEAD = ("noise, run", RESULT, "value", DIFFERENCE)

HOW = (
    "Terms are compared under the full library, noise by its logarithm, scenes by the errors that terms bring"
    " about there, and the results as independent."
)


def results_page(found: Comparison) -> Page:
    """Say and show what differs between results of sensors."""
    alone = ", ".join(f"{name} ({label})" for label, name in found.alone)
    return comparison_page(
        found,
        QUESTION,
        answer=_answer(found),
        how=HOW,
        alone=f"Only in one result: {alone}." if alone else "",
        sections=(_section(k, one, found) for k, one in enumerate(found.components)),
    )


def comparison_record(found: Comparison) -> dict[str, Any]:
    """Values of ``result.json``, SI."""
    return {
        **head_record(found),
        "components": [_component_record(one) for one in found.components],
        "alone": [{"result": label, "id": name} for label, name in found.alone],
    }


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
                "full_mean": [value.full_mean if value else None for value in term.values],
                "full_sd": [value.full_sd if value else None for value in term.values],
                "inclusion": [value.inclusion if value else None for value in term.values],
                "verdicts": [value.verdict if value else None for value in term.values],
                "verdicts_differ": term.verdicts_differ,
                **pull_record(term.pull),
            }
            for term in one.terms
        ],
        "noise": [
            {
                "run": noise.run,
                "name": noise.letter,
                "value": [value.value if value else None for value in noise.values],
                "log_sd": [value.log_sd if value else None for value in noise.values],
                **pull_record(noise.pull),
            }
            for noise in one.noise
        ],
        "scenes": [scene_record(scene) for scene in one.scenes],
    }


def _section(k: int, one: ComponentComparison, found: Comparison) -> Section:
    whole = len(found.components) <= WHOLE
    terms = [row for term in one.terms for row in _term_rows(term, found.labels, whole)]
    noise = [row for entry in one.noise for row in _noise_rows(entry, one, found.labels, whole)]
    tables = [titled("The terms", one.title, HEAD, terms, "tttnfn")]
    if noise:
        tables.append(titled("Noise", one.title, NOISE_HEAD, noise, "tttn"))
    scenes = [scene_section(s, one.title, found.labels, kind_of(one), whole=whole) for s in one.scenes]
    said = Prose(" ".join(_sentences(one, found)))
    return Section(one.title, [said, *tables, *scenes], f"c{k + 1}", one.kind)


def kind_of(one: ComponentComparison) -> Kind:
    """Kind of a component, as the units ask for it."""
    return "accelerometer" if one.kind == "accelerometer" else "gyroscope"


def _is_untested(term: TermComparison) -> bool:
    return all(value is None or value.verdict == "untested" for value in term.values)


def _term_rows(term: TermComparison, labels: Sequence[str], whole: bool) -> Iterator[Row]:
    """One line for each result."""
    beyond = is_beyond(term.pull)
    brief = not _is_untested(term) and (whole or term.verdicts_differ or beyond)
    for k, (label, value) in enumerate(zip(labels, term.values, strict=True)):
        name, pull = headed(k, term.name, difference(term.pull, len(labels)))
        told: tuple[Text, ...] = ("not in the library", "", "")
        if value is not None:
            told = (typeset(_value(value)), f"{value.inclusion:.3f}", verdict(value.verdict))
        yield Row((name, label, *told, pull), strong=beyond, brief=brief)


def _value(value: Term) -> str:
    if value.verdict == "untested":
        return "not tested"
    unit = value.printed_unit
    scale = per_unit(unit, value.unit)
    return str(measured(value.full_mean / scale, value.full_sd / scale, unit))


def _noise_rows(
    entry: NoiseComparison, one: ComponentComparison, labels: Sequence[str], whole: bool
) -> Iterator[Row]:
    beyond = is_beyond(entry.pull)
    for k, (label, value) in enumerate(zip(labels, entry.values, strict=True)):
        name, pull = headed(k, f"{entry.letter} {entry.run}", difference(entry.pull, len(labels)))
        text = _noise_value(value, entry.letter, kind_of(one)) if value else "no such run"
        yield Row((name, label, typeset(text), pull), strong=beyond, brief=whole or beyond)


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
    scenes = [scene for one in found.components for scene in one.scenes]
    others = sum(any(term.required_differs for term in scene.terms) for scene in scenes)
    verdicts = f"{counted(changed, 'verdict differs', 'verdicts differ')}"
    verdicts += (
        f"; {others} of {counted(len(scenes), 'scene requires', 'scenes require')} other terms."
        if scenes
        else "."
    )
    if not every:
        return [f"Nothing differs beyond uncertainty in {found.tests} comparisons; {verdicts}"]
    one, worst = max(every, key=lambda pair: pair[1].pull.size if pair[1].pull else 0.0)
    count = counted(len(every), "value differs", "values differ")
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
