"""Results of sensors side by side: the same terms, noise and scenes, and what differs beyond uncertainty.

Terms are compared under the full library, where an estimate does not depend on which other terms were kept,
noise by its logarithm, and scenes by what each term takes of the budget. Results count as independent; two
analyses of the same data agree better than that says.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

from imubayes.errors import InputError
from imubayes.inference.intervals import SIDE
from imubayes.reporting.blocks import Page, Prose, Row, Section, Text, typeset, verdict
from imubayes.reporting.comparison.differences import (
    Comparison,
    Entry,
    Estimate,
    Group,
    aligned,
    column,
    comparison,
    differing,
    entry,
    head_record,
    labels_of,
    numbered,
    pull_record,
    terms_of,
)
from imubayes.reporting.comparison.page import (
    DIFFERENCE,
    RESULT,
    comparison_page,
    counted,
    entry_rows,
    incomplete,
    most_different,
    titled,
)
from imubayes.reporting.comparison.scenes import scene_record, scene_section, scenes_compared
from imubayes.reporting.result.entries import Sensor, SensorsResult, Term
from imubayes.reporting.result.file import Written
from imubayes.reporting.rounding import NOISE_SI, NOISE_UNITS, below, measured, per_unit
from imubayes.selection.verdicts import listed
from imubayes.sensors.imu import COMPONENTS
from imubayes.sensors.terms import Kind

WHOLE = 2
"""Components of which a terminal gets every term; of more, only what differs."""

VAGUE = 0.5
"""sd of the logarithm from which noise is a limit rather than a value."""

QUESTION = "The same terms, their values, noise, verdicts and scenes: what differs beyond uncertainty?"

HEAD = ("term", RESULT, "value", "inclusion", "verdict", DIFFERENCE)
NOISE_HEAD = ("noise, run", RESULT, "value", DIFFERENCE)

HOW = (
    "Terms are compared under the full library, noise by its logarithm, scenes by the errors that terms bring"
    " about there, and the results as independent."
)


def sensors_compared(files: Sequence[Written], results: Sequence[SensorsResult]) -> Comparison:
    """Set results of sensors side by side.

    Parameters
    ----------
    results : two or more. Components are matched by id and kind; of those that are left, by kind and order.

    Raises
    ------
    InputError : if there are fewer than two or more than 26 results, or no two have a component in common.
    """
    labels = labels_of(results)
    rest = [list(result.sensors) for result in results]
    groups: list[Group] = []
    for key in (_name, _place):
        for members in aligned((numbered(left, key) for left in rest), least=2).values():
            groups.append(_component(results, members, labels))
            for left, member in zip(rest, members, strict=True):
                left[:] = [one for one in left if one is not member]
    if not groups:
        raise InputError("the results have no kind of sensor in common: there is nothing to compare")
    alone = [(label, one.id) for label, left in zip(labels, rest, strict=True) for one in left]
    return comparison(files, results, groups, alone)


def _name(sensor: Sensor) -> tuple[str, str]:
    return sensor.kind, sensor.id


def _place(sensor: Sensor) -> tuple[str, str]:
    """Kind, and axis of a triad's component, which is compared with its own kind only."""
    axis = sensor.id.rpartition(".")[2]
    return sensor.kind, axis if axis in COMPONENTS else ""


def _component(
    results: Sequence[SensorsResult], members: tuple[Sensor | None, ...], labels: Sequence[str]
) -> Group:
    there = [one for one in members if one]
    return Group(
        ", ".join(dict.fromkeys(one.id for one in there)),
        there[0].kind,
        labels,
        members,
        {name: _term(name, values, labels) for name, values in terms_of(members).items()},
        {key: _noise(*key, values, labels) for key, values in aligned(_noise_tables(members)).items()},
        scenes_compared(results, members, labels),
    )


def _term(name: str, values: Sequence[Term | None], labels: Sequence[str]) -> Entry:
    there = {label: value for label, value in zip(labels, values, strict=True) if value}
    if len({value.unit for value in there.values()}) > 1:
        units = ", ".join(f"{label} {value.unit}" for label, value in there.items())
        raise InputError(f"term {name} has different units ({units}): run the studies with the same version")
    tested = [
        (value.full_mean, value.full_sd) if value and value.verdict != "untested" else None
        for value in values
    ]
    return entry(labels, name, values, tested, decisions=(value.verdict for value in there.values()))


def noise_of(sensor: Sensor) -> dict[tuple[str, str], Estimate]:
    """N, B, K of every run, with the sd of the logarithm: zero where it was given.

    By the chains where it was sampled, as a log-normal value of the same mean and sd; else as it was
    estimated or given.
    """
    spreads = {run.name: run.noise_log_sd for run in sensor.runs}
    found = {
        (run, letter): (values[letter], spreads[run][letter] if run in spreads else math.nan)
        for run, values in sensor.noise.items()
        for letter in ("N", "B", "K")
    }
    for run, draws in sensor.noise_posterior.items():
        for letter in ("N", "B", "K"):
            mean, sd = draws[letter]["mean"], draws[letter]["sd"]
            log_sd = math.sqrt(math.log1p((sd / mean) ** 2)) if mean > 0.0 else math.nan
            found[run, letter] = mean, log_sd
    return found


def _noise_tables(members: Sequence[Sensor | None]) -> Iterator[dict[tuple[str, str], Estimate]]:
    """Noise by run; runs in the first member's order have its names where two have no run in common."""
    tables = [noise_of(one) if one else {} for one in members]
    first = next(table for table, one in zip(tables, members, strict=True) if one)
    names = list(dict.fromkeys(run for run, _ in first))
    for table in tables:
        own = list(dict.fromkeys(run for run, _ in table))
        same = len(own) != len(names) or set(own) & set(names)
        name = dict(zip(own, own if same else names, strict=True))
        yield {(name[run], letter): value for (run, letter), value in table.items()}


def _noise(run: str, letter: str, values: Sequence[Estimate | None], labels: Sequence[str]) -> Entry:
    logs = [(math.log(value[0]), value[1]) if value and value[0] > 0.0 else None for value in values]
    return entry(labels, f"noise {letter} of run {run}", values, logs)


def sensors_page(found: Comparison) -> Page:
    """Say and show what differs between results of sensors."""
    alone = ", ".join(f"{name} ({label})" for label, name in found.alone)
    return comparison_page(
        found,
        QUESTION,
        answer=[_answer(found)],
        how=HOW,
        alone=f"Only in one result: {alone}." if alone else "",
        sections=(_section(k, one, found) for k, one in enumerate(found.groups)),
    )


def _answer(found: Comparison) -> str:
    """Say whether anything differs, and what most."""
    changed = sum(term.divided for one in found.groups for term in one.terms.values())
    scenes = [scene for one in found.groups for scene in one.scenes]
    others = sum(any(term.divided for term in scene.terms.values()) for scene in scenes)
    verdicts = counted(changed, "verdict differs", "verdicts differ")
    if scenes:
        verdicts += f"; {others} of {counted(len(scenes), 'scene requires', 'scenes require')} other terms"
    most = most_different((one, one.entries) for one in found.groups)
    return f"{most or f'Nothing differs beyond uncertainty in {found.tests} comparisons'}; {verdicts}."


def _section(k: int, one: Group, found: Comparison) -> Section:
    whole = len(found.groups) <= WHOLE
    terms = [row for name, term in one.terms.items() for row in _term_rows(name, term, one.labels, whole)]
    noise = [
        row
        for (run, letter), figure in one.noise.items()
        for row in entry_rows(
            one.labels,
            f"{letter} {run}",
            figure,
            [_noise_cells(value, letter, one.kind) for value in figure.values],
            brief=whole,
        )
    ]
    tables = [titled("The terms", one.name, HEAD, terms, "tttnfn")]
    if noise:
        tables.append(titled("Noise", one.name, NOISE_HEAD, noise, "tttn"))
    scenes = (scene_section(scene, one.name, whole=whole) for scene in one.scenes)
    return Section(one.name, [Prose(" ".join(_sentences(one))), *tables, *scenes], f"c{k + 1}", one.kind)


def _is_untested(term: Entry) -> bool:
    return all(value is None or value.verdict == "untested" for value in term.values)


def _term_rows(name: str, term: Entry, labels: Sequence[str], whole: bool) -> Iterator[Row]:
    brief = not _is_untested(term) and (whole or term.divided)
    return entry_rows(labels, name, term, map(_term_cells, term.values), brief=brief)


def _term_cells(value: Term | None) -> tuple[Text, ...]:
    if value is None:
        return "not in the library", "", ""
    return typeset(term_value(value)), f"{value.inclusion:.3f}", verdict(value.verdict)


def term_value(value: Term) -> str:
    """Coefficient of a term under the full library, in the unit that people use."""
    if value.verdict == "untested":
        return "not tested"
    scale = per_unit(value.printed_unit, value.unit)
    return str(measured(value.full_mean / scale, value.full_sd / scale, value.printed_unit))


def _noise_cells(value: Estimate | None, letter: str, kind: Kind) -> tuple[Text, ...]:
    if value is None:
        return (typeset("no such run"),)
    size, log_sd = value
    unit, scale = noise_unit(letter, kind)
    size /= scale
    if log_sd > VAGUE:
        return (typeset(f"below {below(size * math.exp(SIDE * log_sd), unit)}"),)
    sd = size * log_sd if math.isfinite(log_sd) else 0.0
    return (typeset(str(measured(size, sd, unit)) + ("" if sd else " (given)")),)


def noise_unit(letter: str, kind: Kind) -> tuple[str, float]:
    """Unit in which N, B or K is printed, and its size in SI."""
    k = "NBK".index(letter)
    return NOISE_UNITS[kind][k], per_unit(NOISE_UNITS[kind][k], NOISE_SI[kind][k])


def _sentences(one: Group) -> Iterator[str]:
    """Say how a component was matched, what differs, and what cannot be compared."""
    if len({member.id for _, member in one.there}) > 1:
        names = listed([f"{label} {member.id}" for label, member in one.there])
        yield f"The ids differ: matched by kind and order, {names}."
    if len({member.class_ for _, member in one.there}) > 1:
        classes = listed([f"{label} {member.class_ or 'none'}" for label, member in one.there])
        yield f"The classes, and so the priors, differ: {classes}."
    far = [f"{name} ({pull.size:.1f} sd)" for name, pull in differing(one.entries)]
    compared = sum(each.pull is not None for each in one.entries)
    yield (
        f"Beyond uncertainty: {listed(far)}."
        if far
        else f"None of {compared} terms and noise figures differs beyond uncertainty."
    )
    untested = [name for name, term in one.terms.items() if _is_untested(term)]
    if untested:
        yield f"No result tests {listed(untested)}."
    changed = [name for name, term in one.terms.items() if term.divided]
    if changed:
        yield f"The verdict differs on {listed(changed)}."
    yield from incomplete(one, len(one.there))


def sensors_record(found: Comparison) -> dict[str, Any]:
    """Values of ``result.json``, SI."""
    return {
        **head_record(found),
        "components": [_component_record(one) for one in found.groups],
        "alone": [{"result": label, "id": name} for label, name in found.alone],
    }


def _component_record(one: Group) -> dict[str, Any]:
    ids = column(one.members, "id")
    return {
        "ids": ids,
        "kind": one.kind,
        "matched_by": "order" if len({*ids} - {None}) > 1 else "id",
        "classes": column(one.members, "class_"),
        "models": column(one.members, "model"),
        "terms": [
            {
                "name": name,
                "unit": next(value.unit for value in term.values if value),
                **{key: column(term.values, key) for key in ("full_mean", "full_sd", "inclusion")},
                "verdicts": column(term.values, "verdict"),
                "verdicts_differ": term.divided,
                **pull_record(term.pull),
            }
            for name, term in one.terms.items()
        ],
        "noise": [
            {
                "run": run,
                "name": letter,
                "value": [value and value[0] for value in noise.values],
                "log_sd": [value and value[1] for value in noise.values],
                **pull_record(noise.pull),
            }
            for (run, letter), noise in one.noise.items()
        ],
        "scenes": [scene_record(scene) for scene in one.scenes],
    }
