"""A comparison of class-level results: as a page, and as numbers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any

from imubayes.inference.intervals import Share
from imubayes.population.needs import HALF
from imubayes.reporting.blocks import Page, Prose, Row, Section, Text, typeset
from imubayes.reporting.comparison.lot_files import PopulationFile, unit_of_term
from imubayes.reporting.comparison.lots import (
    ClassComparison,
    LotComparison,
    LotSceneComparison,
    PopulationComparison,
    RequiredComparison,
)
from imubayes.reporting.comparison.pulls import Pull, is_beyond, normal_of
from imubayes.reporting.comparison.records import head_record, pull_record
from imubayes.reporting.comparison.view import (
    DIFFERENCE,
    RESULT,
    comparison_page,
    counted,
    difference,
    headed,
    largest_first,
    titled,
)
from imubayes.reporting.lots_words import amid, scene_name, slug
from imubayes.reporting.rounding import measured, percent, percents, share_range
from imubayes.selection.verdicts import listed
from imubayes.sensors.terms import Kind

QUESTION = "The same classes, terms and scenes: which populations differ beyond uncertainty?"

HOW = (
    "Shares of units are compared by Fisher's exact test, means and spreads of the population by their"
    " intervals, spreads by their logarithms, and the lots as independent: of the same seed they are not. Of"
    " other seeds they are other batches of their class, which may truly differ."
)

ORDER_HEAD = ("terms of", RESULT, "median (90 % of the units)")
HEAD = ("term", RESULT, "needed", "mean", "spread", DIFFERENCE)
SCENE_HEAD = ("term", RESULT, "required", "share of the budget", DIFFERENCE)

LITTLE = 0.01
"""Share of a budget below which a term that no unit requires is left out."""


def lots_page(found: LotComparison) -> Page:
    """Say and show what differs between lots."""
    alone = ", ".join(f"{name} ({label})" for label, name in found.alone)
    return comparison_page(
        found,
        QUESTION,
        answer=_answer(found),
        how=HOW,
        alone=f"Classes in one result only: {alone}." if alone else "",
        sections=(_section(one, found) for one in found.classes),
    )


def _answer(found: LotComparison) -> Iterator[str]:
    """Say whether any class differs, and in what most."""
    every = [(one.id, *pair) for one in found.classes for pair in _differing(one)]
    if not every:
        yield f"No class differs beyond uncertainty in {found.tests} comparisons."
        return
    name, what, pull = max(every, key=lambda entry: entry[2].size)
    yield (
        f"{counted(len(every), 'value differs', 'values differ')} beyond uncertainty, most {what} of {name},"
        f" by {pull.size:.1f} sd."
    )


def _differing(one: ClassComparison) -> list[tuple[str, Pull]]:
    """What differs beyond uncertainty, by name, the largest first."""
    terms = [(f"{term.name} ({what})", pull) for term in one.terms for what, pull in term.pulls]
    scenes = [
        (f"{term.name} (required in {scene_name(scene.name)})", term.pull)
        for scene in one.scenes
        for term in scene.terms
    ]
    return largest_first([*terms, *scenes])


def _section(one: ClassComparison, found: LotComparison) -> Section:
    kind, labels = found.kind, found.labels
    whole = len(found.classes) == 1
    terms = [row for term in one.terms for row in _rows(term, labels, kind, whole)]
    blocks = (
        Prose(" ".join(_sentences(one, found))),
        titled("Model order", one.id, ORDER_HEAD, _order_rows(one, labels), "ttt"),
        titled("The population", one.id, HEAD, terms, "tttffn"),
        *(_scene_section(scene, one.id, labels) for scene in one.scenes),
    )
    return Section(one.id, blocks, slug("class", one.id), f"{kind}s")


def _sentences(one: ClassComparison, found: LotComparison) -> Iterator[str]:
    far = [f"{what}, {pull.size:.1f} sd" for what, pull in _differing(one)]
    yield f"Beyond uncertainty: {'; '.join(far)}." if far else "Nothing differs beyond uncertainty."
    orders = [(label, m.order) for label, m in zip(found.labels, one.members, strict=True) if m]
    told = listed(f"{label} {order.value:.3g}" for label, order in orders)
    apart = "; the ranges of the units do not overlap" if one.apart else ""
    yield f"The median unit needs {told} terms{apart}."
    for scene in one.scenes:
        other = [term.name for term in scene.terms if _divides(term)]
        if other:
            where = f"In the scene {scene_name(scene.name)} the smallest models of most units have"
            yield f"{where} {listed(other)} in one result and not in all."
    partly = [term.name for term in one.terms if any(v is None for v in term.values)]
    if partly:
        yield f"Not in every library, which the other estimates depend on: {listed(partly)}."


def _divides(term: RequiredComparison) -> bool:
    """Whether most units require a term in one result and not in another."""
    return len({count >= HALF * of for count, of in filter(None, term.required)}) > 1


def _order_rows(one: ClassComparison, labels: Sequence[str]) -> tuple[Row, ...]:
    """Numbers of terms: needed, and of the smallest model of each scene."""
    rows = [("needed", [m.order if m else None for m in one.members])]
    rows += [(scene_name(s.name), [m.order if m else None for m in s.members]) for s in one.scenes]
    return tuple(
        Row((*headed(k, name), label, _range(order)), brief=name == "needed")
        for name, orders in rows
        for k, (label, order) in enumerate(zip(labels, orders, strict=True))
    )


def _range(order: Share | None) -> str:
    return amid(order) if order else "not there"


def _rows(term: PopulationComparison, labels: Sequence[str], kind: Kind, whole: bool) -> Iterator[Row]:
    there = [(what, pull) for what, pull in term.pulls if pull]
    what, largest = max(there, key=lambda pair: pair[1].size, default=("", None))
    beyond = any(is_beyond(pull) for _, pull in there)
    for k, (label, value) in enumerate(zip(labels, term.values, strict=True)):
        name, pull = headed(k, term.name, difference(largest, len(labels), what))
        told = _population(value, term.name, kind) if value else ("not there", "", "")
        yield Row((name, label, *told, pull), strong=beyond, brief=beyond or whole)


def _population(value: PopulationFile, name: str, kind: Kind) -> tuple[Text, ...]:
    if not value.tested:
        return "not tested", "", ""
    mean, spread = (typeset(estimate(one, name, kind)) for one in (value.mean, value.spread))
    return percents(value.share), mean, spread


def estimate(found: Share, name: str, kind: Kind) -> str:
    """Median of a term's mean or spread with the sd of its interval, in the unit that people use.

    Examples
    --------
    >>> estimate(Share(41.8e-6, 39.8e-6, 43.8e-6), "b1", "gyroscope")
    '41.8 +- 1.2 ppm'
    """
    unit, size = unit_of_term(name, kind)
    return str(measured(found.value / size, normal_of(found.low, found.high) / size, unit))


def _scene_section(scene: LotSceneComparison, of: str, labels: Sequence[str]) -> Section:
    rows = [row for term in scene.terms if _counts(term) for row in _scene_rows(term, labels)]
    return titled(f"Scene {scene_name(scene.name)}", of, SCENE_HEAD, rows, "ttttn")


def _counts(term: RequiredComparison) -> bool:
    wanted = any(count for count, _ in filter(None, term.required))
    return wanted or any(one and one.value >= LITTLE for one in term.shares)


def _scene_rows(term: RequiredComparison, labels: Sequence[str]) -> Iterator[Row]:
    beyond = is_beyond(term.pull)
    for k, (label, count, taken) in enumerate(zip(labels, term.required, term.shares, strict=True)):
        name, pull = headed(k, term.name, difference(term.pull, len(labels)))
        required = f"{percent(count[0] / count[1])}" if count else "not there"
        of = share_range(taken) if taken else ""
        yield Row((name, label, required, of, pull), strong=beyond, brief=beyond or _divides(term))


def lots_record(found: LotComparison) -> dict[str, Any]:
    """Values of ``result.json``, SI."""
    return {
        **head_record(found),
        "kind": found.kind,
        "units": found.units,
        "classes": [_class_record(one) for one in found.classes],
        "alone": [{"result": label, "class": name} for label, name in found.alone],
    }


def _class_record(one: ClassComparison) -> dict[str, Any]:
    return {
        "id": one.id,
        "orders": [asdict(member.order) if member else None for member in one.members],
        "orders_apart": one.apart,
        "terms": [
            {
                "name": term.name,
                "values": [asdict(value) if value else None for value in term.values],
                **{what: pull_record(pull) for what, pull in term.pulls},
            }
            for term in one.terms
        ],
        "scenes": [
            {
                "name": scene.name,
                "orders": [asdict(member.order) if member else None for member in scene.members],
                "terms": [
                    {
                        "name": term.name,
                        "required": term.required,
                        "shares": [s and asdict(s) for s in term.shares],
                    }
                    | pull_record(term.pull)
                    for term in scene.terms
                ],
            }
            for scene in one.scenes
        ],
    }
