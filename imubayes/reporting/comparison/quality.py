"""Results on how good the decision is, side by side: every method's scores under each treatment.

A score's sd is that of a normal with its 95 % interval, and the studies count as independent.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import NormalDist
from typing import Any

from imubayes.errors import InputError
from imubayes.quality.questions import Interval
from imubayes.reporting.comparison.pulls import LETTERS, Pull, judged, largest, threshold_of
from imubayes.reporting.comparison.result_files import Written, checked, number

SCORES = ("false keeps", "drops > 8 sd", "cost", "Brier", "log")
"""Scores that are compared, the last bin of the false drops among them."""

WIDTH = 2.0 * NormalDist().inv_cdf(0.975)
"""Width of a normal's 95 % interval, in sd."""


@dataclass(frozen=True, slots=True)
class QualityFile:
    """One ``result.json``: as `result_files.ResultFile`, with scores by (treatment, method)."""

    path: Path
    sha256: str
    study: str
    version: str
    scores: Mapping[tuple[str, str], tuple[Interval, ...]]


@dataclass(frozen=True, slots=True)
class MethodComparison:
    """A method in every result; `pulls` has the largest difference of each of `SCORES`."""

    name: str
    values: tuple[tuple[Interval, ...] | None, ...]
    pulls: tuple[Pull | None, ...]


@dataclass(frozen=True, slots=True)
class QualityComparison:
    """Results on the decision side by side, the methods by treatment."""

    results: tuple[QualityFile, ...]
    labels: tuple[str, ...]
    treatments: Mapping[str, tuple[MethodComparison, ...]]
    alone: tuple[tuple[str, str], ...]
    tests: int
    threshold: float


def quality_of(one: Written) -> QualityFile:
    """Check the result of a study of the decision's quality; both kinds of sensors together.

    Raises
    ------
    DataError : naming what is missing or wrong.
    """
    with checked(one.path):
        scores = {
            (str(told["treatment"]), str(method["method"])): _scores(method)
            for told in one.raw["scores"]
            if not told["kind"]
            for method in told["methods"]
        }
    return QualityFile(one.path, one.sha256, one.study, one.version, scores)


def _scores(raw: Mapping[str, Any]) -> tuple[Interval, ...]:
    found = (raw["false_keeps"], raw["false_drops"][-1], raw["cost"], raw["brier"], raw["log"])
    return tuple(Interval(number(one["value"]), number(one["low"]), number(one["high"])) for one in found)


def quality_compared(results: Sequence[QualityFile]) -> QualityComparison:
    """Set results on the decision side by side.

    Raises
    ------
    InputError : if there are fewer than two or more than 26 results, or no two have a treatment in common.
    """
    if not 2 <= len(results) <= len(LETTERS):
        raise InputError(f"expected 2 to {len(LETTERS)} results to compare, came {len(results)}")
    labels = tuple(LETTERS[: len(results)])
    keys = dict.fromkeys(key for one in results for key in one.scores)
    there = {key: tuple(one.scores.get(key) for one in results) for key in keys}
    shared = {key: values for key, values in there.items() if sum(v is not None for v in values) > 1}
    if not shared:
        raise InputError("the results have no treatment and method in common: there is nothing to compare")
    methods = {key: _method(key[1], values, labels) for key, values in shared.items()}
    tests = sum(map(_tests, methods.values()))
    threshold = threshold_of(tests)
    treatments: dict[str, tuple[MethodComparison, ...]] = {}
    for (treatment, _), one in methods.items():
        marked = replace(one, pulls=tuple(judged(pull, threshold) for pull in one.pulls))
        treatments[treatment] = (*treatments.get(treatment, ()), marked)
    alone = tuple(
        (label, f"{method}, {treatment}")
        for (treatment, method), values in there.items()
        if (treatment, method) not in shared
        for label, value in zip(labels, values, strict=True)
        if value
    )
    return QualityComparison(tuple(results), labels, treatments, alone, tests, threshold)


def _method(
    name: str, values: Sequence[tuple[Interval, ...] | None], labels: Sequence[str]
) -> MethodComparison:
    there = {label: value for label, value in zip(labels, values, strict=True) if value}
    pulls = (
        largest({label: (v[k].value, (v[k].high - v[k].low) / WIDTH) for label, v in there.items()})
        for k in range(len(SCORES))
    )
    return MethodComparison(name, tuple(values), tuple(pulls))


def _tests(one: MethodComparison) -> int:
    """Count the comparisons of a method: all pairs of results of what can be compared."""
    pairs = math.comb(sum(value is not None for value in one.values), 2)
    return pairs * sum(pull is not None for pull in one.pulls)
