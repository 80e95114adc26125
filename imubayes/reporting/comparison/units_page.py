"""Units beside their class: as a page, and as numbers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from imubayes.reporting.blocks import Both, Page, Prose, Row, Section, Text, typeset, verdict
from imubayes.reporting.comparison.lot_files import unit_of_term
from imubayes.reporting.comparison.lots_page import estimate
from imubayes.reporting.comparison.pulls import Pull, is_beyond
from imubayes.reporting.comparison.records import head_record, pull_record
from imubayes.reporting.comparison.units import NoiseOfUnit, TermOfUnit, UnitInClass, UnitsComparison
from imubayes.reporting.comparison.view import DIFFERENCE, comparison_page, difference, largest_first, titled
from imubayes.reporting.rounding import NOISE_SI, NOISE_UNITS, measured, per_unit, percents
from imubayes.selection.verdicts import listed
from imubayes.sensors.terms import Kind
from imubayes.units import counted

QUESTION = "Is this unit typical of its class? Its terms and noise beside the population of a simulated lot."

HOW = (
    "A term's sd is that of the unit's estimate (under the full library), of the population's mean, and the"
    " population's spread together; noise is compared by its logarithm with that of the lot's units. The lot"
    " is one batch of its class: another may be wider."
)

HEAD = (
    "term",
    "value",
    Both("class mean", "class: mean, spread"),
    Both("class spread", None),
    Both("needed in", None),
    "verdict",
    DIFFERENCE,
)
NOISE_HEAD = ("noise", "value", "median of the class", DIFFERENCE)


def units_page(found: UnitsComparison) -> Page:
    """Say and show whether units are typical of their class."""
    alone = ", ".join(f"{name} ({label}, class {entry or 'none'})" for label, name, entry in found.alone)
    return comparison_page(
        found,
        QUESTION,
        answer=map(_answer, found.units),
        how=HOW,
        alone=f"Their class is not in the class-level study: {alone}." if alone else "",
        sections=(_section(k, one, found) for k, one in enumerate(found.units)),
    )


def _answer(one: UnitInClass) -> str:
    far = _far(one)
    id, lot = one.component.id, f"the lot of class {one.component.class_id}"
    if not far:
        return f"{id} is typical of {lot}."
    name, pull = far[0]
    return f"{id} is not typical of {lot}: {name} is {pull.size:.1f} sd from it."


def _far(one: UnitInClass) -> list[tuple[str, Pull]]:
    terms = [(term.name, term.pull) for term in one.terms]
    return largest_first([*terms, *((f"noise {noise.letter}", noise.pull) for noise in one.noise)])


def _section(k: int, one: UnitInClass, found: UnitsComparison) -> Section:
    kind = found.lot.kind
    terms = [_line(term, kind) for term in one.terms]
    noise = [_noise_line(entry, kind) for entry in one.noise]
    return Section(
        one.component.id,
        (
            Prose(" ".join(_sentences(one))),
            titled("The terms", one.component.id, HEAD, terms, "ttfttfn"),
            titled("Noise", one.component.id, NOISE_HEAD, noise, "tttn"),
        ),
        f"u{k + 1}",
        f"{kind} of {one.label}, beside the {one.component.class_id} of {found.lot_label}",
    )


def _sentences(one: UnitInClass) -> Iterator[str]:
    far = [f"{name} ({pull.size:.1f} sd)" for name, pull in _far(one)]
    count = sum(entry.pull is not None for entry in (*one.terms, *one.noise))
    yield (
        f"Beyond what a typical unit shows: {listed(far)}."
        if far
        else f"None of {counted(count, 'value')} is beyond what a typical unit shows."
    )
    silent = [term.name for term in one.terms if term.pull is None]
    if silent:
        yield f"Not tested in the unit or the class: {listed(silent)}."
    if one.missing:
        yield f"The class-level study does not have {listed(one.missing)}."


def _line(term: TermOfUnit, kind: Kind) -> Row:
    unit, tested = term.unit, term.population.tested
    scale = per_unit(unit.printed_unit, unit.unit)
    value = "not tested"
    if unit.verdict != "untested":
        value = str(measured(unit.full_mean / scale, unit.full_sd / scale, unit.printed_unit))
    known: tuple[Text, ...] = ("not tested", "", "")
    if tested:
        mean, spread = (
            estimate(one, term.name, kind) for one in (term.population.mean, term.population.spread)
        )
        mean = Both(typeset(mean).page, _without_sd(term, kind))
        known = (mean, typeset(spread), percents(term.population.share))
    told = (verdict(unit.verdict), difference(term.pull, 2))
    shown = tested and unit.verdict != "untested"
    return Row((term.name, typeset(value), *known, *told), strong=is_beyond(term.pull), brief=shown)


def _without_sd(term: TermOfUnit, kind: Kind) -> str:
    """Mean and spread of the class for a terminal, two digits of the spread."""
    unit, size = unit_of_term(term.name, kind)
    found = measured(term.population.mean.value / size, term.population.spread.value / size, unit)
    return str(found).replace("+-", ",").replace(" ,", ",")


def _noise_line(noise: NoiseOfUnit, kind: Kind) -> Row:
    k = "NBK".index(noise.letter)
    size = per_unit(NOISE_UNITS[kind][k], NOISE_SI[kind][k])
    value = str(measured(noise.value / size, 0.0, NOISE_UNITS[kind][k]))
    median = str(measured(noise.median / size, noise.median / size * noise.log_sd, NOISE_UNITS[kind][k]))
    cells = (noise.letter, typeset(value), typeset(median), difference(noise.pull, 2))
    return Row(cells, strong=is_beyond(noise.pull))


def units_record(found: UnitsComparison) -> dict[str, Any]:
    """Values of ``result.json``, SI."""
    return {
        **head_record(found),
        "units": [_unit_record(one) for one in found.units],
        "alone": [{"result": label, "id": name, "class": entry} for label, name, entry in found.alone],
    }


def _unit_record(one: UnitInClass) -> dict[str, Any]:
    return {
        "result": one.label,
        "id": one.component.id,
        "class": one.component.class_id,
        "typical": not _far(one),
        "terms": [
            {
                "name": term.name,
                "unit": term.unit.unit,
                "full_mean": term.unit.full_mean,
                "full_sd": term.unit.full_sd,
                "verdict": term.unit.verdict,
                "population": asdict(term.population),
                **pull_record(term.pull),
            }
            for term in one.terms
        ],
        "noise": [
            {
                "name": noise.letter,
                "value": noise.value,
                "class_median": noise.median,
                "class_log_sd": noise.log_sd,
                **pull_record(noise.pull),
            }
            for noise in one.noise
        ],
        "missing": list(one.missing),
    }
