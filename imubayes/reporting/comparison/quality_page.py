"""A comparison of results on how good the decision is: as a page, and as numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any

from imubayes.quality.questions import Interval
from imubayes.reporting.blocks import Both, Page, Prose, Row, Section, Text
from imubayes.reporting.comparison.pulls import Pull, is_beyond
from imubayes.reporting.comparison.quality import SCORES, MethodComparison, QualityComparison
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
from imubayes.reporting.lots_words import slug
from imubayes.reporting.method_words import called
from imubayes.reporting.rounding import percents
from imubayes.selection.verdicts import listed

QUESTION = "How good is the decision: which scores of which methods differ beyond uncertainty?"

NARROW = ("false keeps", "drops", "cost", "Brier", "log")
"""Scores as a terminal has them."""

HEAD = ("method", RESULT, *map(Both, SCORES, NARROW), DIFFERENCE)

HOW = "Scores are compared by their bootstrap intervals (95 %), and the studies as independent."


def quality_page(found: QualityComparison) -> Page:
    """Say and show which scores differ."""
    alone = "; ".join(f"{called_as(name)} ({label})" for label, name in found.alone)
    return comparison_page(
        found,
        QUESTION,
        answer=[_answer(found)],
        how=HOW,
        alone=f"In one result only: {alone}." if alone else "",
        sections=(_section(name, methods, found) for name, methods in found.treatments.items()),
    )


def called_as(name: str) -> str:
    """Name of a method with its treatment, as they are printed."""
    method, _, treatment = name.partition(", ")
    return f"{called(method)}, {treatment}"


def _answer(found: QualityComparison) -> str:
    far = [
        (treatment, *pair) for treatment, methods in found.treatments.items() for pair in _differing(methods)
    ]
    if not far:
        return f"No score differs beyond uncertainty in {found.tests} comparisons."
    treatment, what, pull = max(far, key=lambda entry: entry[2].size)
    count = counted(len(far), "score differs", "scores differ")
    return f"{count} beyond uncertainty, most {what}, {treatment}, by {pull.size:.1f} sd."


def _differing(methods: Sequence[MethodComparison]) -> list[tuple[str, Pull]]:
    """Scores that differ beyond uncertainty, by name, the largest difference first."""
    return largest_first(
        [
            (f"{what} of {called(one.name)}", pull)
            for one in methods
            for what, pull in zip(SCORES, one.pulls, strict=True)
        ]
    )


def _section(treatment: str, methods: Sequence[MethodComparison], found: QualityComparison) -> Section:
    far = [f"{what} ({pull.size:.1f} sd)" for what, pull in _differing(methods)]
    said = f"Beyond uncertainty: {listed(far)}." if far else "No score differs beyond uncertainty."
    rows = [row for one in methods for row in _rows(one, found.labels)]
    table = titled("The scores", treatment, HEAD, rows, "fttttttn")
    return Section(treatment, (Prose(said), table), slug("treatment", treatment))


def _rows(one: MethodComparison, labels: Sequence[str]) -> Iterator[Row]:
    there = [(what, pull) for what, pull in zip(SCORES, one.pulls, strict=True) if pull]
    what, largest = max(there, key=lambda pair: pair[1].size, default=("", None))
    beyond = is_beyond(largest)
    for k, (label, values) in enumerate(zip(labels, one.values, strict=True)):
        page, terminal = (difference(largest, len(labels), of) for of in (what, ""))
        name, pull = headed(k, called(one.name), Both(page.page, terminal.terminal))
        scores: tuple[Text, ...] = ("not there",) + ("",) * (len(SCORES) - 1)
        if values:
            told = map(_score, SCORES, values)
            scores = tuple(Both(text, text.partition(" (")[0]) for text in told)
        cells = (name, label, *scores, pull)
        yield Row(cells, strong=beyond, brief=beyond or one.name == "decision")


def _score(what: str, found: Interval) -> str:
    """Rates in percent, the others as numbers; empty where a method has none."""
    if math.isnan(found.value):
        return ""
    if what in SCORES[:2]:
        return percents(found)
    return f"{found.value:.3g} ({found.low:.3g} to {found.high:.3g})"


def quality_record(found: QualityComparison) -> dict[str, Any]:
    """Values of ``result.json``."""
    return {
        **head_record(found),
        "treatments": [
            {"treatment": name, "methods": [_method_record(one) for one in methods]}
            for name, methods in found.treatments.items()
        ],
        "alone": [{"result": label, "method": name} for label, name in found.alone],
    }


def _method_record(one: MethodComparison) -> dict[str, Any]:
    return {
        "method": one.name,
        "scores": {
            what: {
                "values": [asdict(values[k]) if values else None for values in one.values],
                **pull_record(one.pulls[k]),
            }
            for k, what in enumerate(SCORES)
        },
    }
