"""Class-level results side by side: the same classes, terms and scenes, and what differs beyond uncertainty.

Shares of units are compared by Fisher's exact test, population means by their intervals, spreads by the
intervals of their logarithms. Lots count as independent: with the same seed, class and library they are the
same units, and agree better than that says.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from imubayes.errors import InputError
from imubayes.inference.intervals import Share
from imubayes.reporting.comparison.lot_files import (
    ClassFile,
    LotFile,
    LotSceneFile,
    PopulationFile,
    log_spread,
)
from imubayes.reporting.comparison.pulls import (
    LETTERS,
    Pull,
    judged,
    largest,
    largest_of_shares,
    normal_of,
    threshold_of,
)
from imubayes.reporting.result.file import Written
from imubayes.sensors.terms import Kind


@dataclass(frozen=True, slots=True)
class PopulationComparison:
    """A term of a class in every result.

    Attributes
    ----------
    name : of the term.
    values : of each result; None where it lacks the term or the class.
    needed, mean, spread : largest differences; None where fewer than two can be compared.
    """

    name: str
    values: tuple[PopulationFile | None, ...]
    needed: Pull | None
    mean: Pull | None
    spread: Pull | None

    @property
    def pulls(self) -> tuple[tuple[str, Pull | None], ...]:
        """The differences by name."""
        return ("needed", self.needed), ("mean", self.mean), ("spread", self.spread)


@dataclass(frozen=True, slots=True)
class RequiredComparison:
    """A term of a class in a scene of every result: units that require it, and their difference."""

    name: str
    required: tuple[tuple[int, int] | None, ...]
    shares: tuple[Share | None, ...]
    pull: Pull | None


@dataclass(frozen=True, slots=True)
class LotSceneComparison:
    """A class in a scene of every result."""

    name: str
    members: tuple[LotSceneFile | None, ...]
    terms: tuple[RequiredComparison, ...]


@dataclass(frozen=True, slots=True)
class ClassComparison:
    """A class in every result that has it; None where one has it not."""

    id: str
    members: tuple[ClassFile | None, ...]
    terms: tuple[PopulationComparison, ...]
    scenes: tuple[LotSceneComparison, ...]

    @property
    def apart(self) -> bool:
        """Whether the ranges of the numbers of needed terms do not overlap."""
        orders = [one.order for one in self.members if one]
        return max(order.low for order in orders) > min(order.high for order in orders)


@dataclass(frozen=True, slots=True)
class LotComparison:
    """Class-level results side by side; `alone` has (label, class) of what stands in one result only."""

    results: tuple[Written, ...]
    kind: Kind
    units: tuple[int, ...]
    labels: tuple[str, ...]
    classes: tuple[ClassComparison, ...]
    alone: tuple[tuple[str, str], ...]
    tests: int
    threshold: float


def lots_compared(results: Sequence[LotFile]) -> LotComparison:
    """Set class-level results side by side.

    Raises
    ------
    InputError : if there are fewer than two or more than 26 results, they are of different kinds of sensors,
        or no two have a class in common.
    """
    if not 2 <= len(results) <= len(LETTERS):
        raise InputError(f"expected 2 to {len(LETTERS)} results to compare, came {len(results)}")
    labels = tuple(LETTERS[: len(results)])
    if len({one.kind for one in results}) > 1:
        kinds = ", ".join(f"{label} {one.kind}s" for label, one in zip(labels, results, strict=True))
        raise InputError(f"the classes are of different kinds of sensors ({kinds}): compare lots of one kind")
    ids = dict.fromkeys(name for one in results for name in one.classes)
    there = {name: tuple(one.classes.get(name) for one in results) for name in ids}
    shared = {name: members for name, members in there.items() if _several(members)}
    if not shared:
        classes = "; ".join(
            f"{label} {', '.join(one.classes)}" for label, one in zip(labels, results, strict=True)
        )
        raise InputError(f"the results have no class in common ({classes}): there is nothing to compare")
    alone = tuple(
        (label, name)
        for name, members in there.items()
        if name not in shared
        for label, one in zip(labels, members, strict=True)
        if one
    )
    found = tuple(_class(name, members, labels) for name, members in shared.items())
    tests = sum(map(_tests, found))
    threshold = threshold_of(tests)
    judged_classes = tuple(_judged(one, threshold) for one in found)
    files, units = tuple(one.file for one in results), tuple(one.units for one in results)
    return LotComparison(files, results[0].kind, units, labels, judged_classes, alone, tests, threshold)


def _several(members: Sequence[object]) -> bool:
    return sum(one is not None for one in members) > 1


def _class(name: str, members: tuple[ClassFile | None, ...], labels: Sequence[str]) -> ClassComparison:
    terms = dict.fromkeys(term for one in members if one for term in one.terms)
    scenes = dict.fromkeys(scene for one in members if one for scene in one.scenes)
    return ClassComparison(
        name,
        members,
        tuple(
            _term(term, [one.terms.get(term) if one else None for one in members], labels) for term in terms
        ),
        tuple(
            _scene(scene, there, labels)
            for scene in scenes
            if _several(there := tuple(one.scenes.get(scene) if one else None for one in members))
        ),
    )


def _term(name: str, values: Sequence[PopulationFile | None], labels: Sequence[str]) -> PopulationComparison:
    there = {label: one for label, one in zip(labels, values, strict=True) if one and one.tested}
    means = {label: (one.mean.value, normal_of(one.mean.low, one.mean.high)) for label, one in there.items()}
    return PopulationComparison(
        name,
        tuple(values),
        largest_of_shares({label: one.needed for label, one in there.items()}),
        largest(means),
        largest({label: log_spread(one.spread) for label, one in there.items()}),
    )


def _scene(name: str, members: tuple[LotSceneFile | None, ...], labels: Sequence[str]) -> LotSceneComparison:
    terms = dict.fromkeys(term for one in members if one for term in one.required)
    return LotSceneComparison(name, members, tuple(_required(term, members, labels) for term in terms))


def _required(name: str, members: Sequence[LotSceneFile | None], labels: Sequence[str]) -> RequiredComparison:
    counts = tuple(one.required.get(name) if one else None for one in members)
    there = {label: count for label, count in zip(labels, counts, strict=True) if count}
    shares = tuple(one.shares.get(name) if one else None for one in members)
    return RequiredComparison(name, counts, shares, largest_of_shares(there))


def _tests(one: ClassComparison) -> int:
    """Count the comparisons of a class: all pairs of results of what can be compared."""
    terms = [
        math.comb(sum(value is not None and value.tested for value in term.values), 2)
        for term in one.terms
        for _, pull in term.pulls
        if pull
    ]
    scenes = [
        math.comb(sum(count is not None for count in term.required), 2)
        for scene in one.scenes
        for term in scene.terms
    ]
    return sum(terms) + sum(scenes)


def _judged(one: ClassComparison, threshold: float) -> ClassComparison:
    terms = tuple(
        replace(term, **{name: judged(pull, threshold) for name, pull in term.pulls}) for term in one.terms
    )
    scenes = tuple(
        replace(scene, terms=tuple(replace(term, pull=judged(term.pull, threshold)) for term in scene.terms))
        for scene in one.scenes
    )
    return replace(one, terms=terms, scenes=scenes)
