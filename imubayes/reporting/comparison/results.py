"""Results side by side: the same terms, and which differences are beyond their uncertainty.

Terms are compared under the full library, where an estimate does not depend on which other terms were kept,
noise by its logarithm, and scenes by what each term takes of the budget. Results count as independent; two
analyses of the same data agree better than that says.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

from imubayes.errors import InputError
from imubayes.reporting.comparison.pulls import LETTERS, Pull, is_beyond, judged, largest, threshold_of
from imubayes.reporting.comparison.result_files import ComponentFile, NoiseEstimate, ResultFile
from imubayes.reporting.comparison.scenes import (
    SceneComparison,
    scene_judged,
    scene_tests,
    scenes_compared,
)
from imubayes.reporting.result.file import Written
from imubayes.reporting.result.sensors import Term

AXES = ("ax", "ay", "az", "gx", "gy", "gz")
"""Components of a triad, which are compared with their own kind only."""


@dataclass(frozen=True, slots=True)
class TermComparison:
    """A term in every result.

    Attributes
    ----------
    name : of the term.
    values : of each result; None where its library lacks the term, or it has no such component.
    pull : largest difference; None where fewer than two can be compared.
    verdicts_differ : whether the verdicts are not all the same.
    """

    name: str
    values: tuple[Term | None, ...]
    pull: Pull | None
    verdicts_differ: bool


@dataclass(frozen=True, slots=True)
class NoiseComparison:
    """One of N, B, K of a run in every result; as `TermComparison`."""

    run: str
    letter: str
    values: tuple[NoiseEstimate | None, ...]
    pull: Pull | None


@dataclass(frozen=True, slots=True)
class ComponentComparison:
    """A component in every result that has it.

    Attributes
    ----------
    members : of each result; None where it has no such component.
    by_order : whether they were matched by kind and order, for their ids differ.
    terms, noise, scenes : compared.
    """

    members: tuple[ComponentFile | None, ...]
    by_order: bool
    terms: tuple[TermComparison, ...]
    noise: tuple[NoiseComparison, ...]
    scenes: tuple[SceneComparison, ...] = ()

    @property
    def kind(self) -> str:
        """Accelerometer or gyroscope."""
        return next(one.kind for one in self.members if one)

    @property
    def title(self) -> str:
        """Return the id, or the ids that were matched."""
        return ", ".join(dict.fromkeys(one.id for one in self.members if one))


@dataclass(frozen=True, slots=True)
class Comparison:
    """Results side by side.

    Attributes
    ----------
    results : files, in the order of their labels.
    labels : A, B, C ...
    components : in the order of the first result that has each.
    alone : (label, id) of components that no other result has.
    tests : number of comparisons.
    threshold : difference over its sd from which one is beyond uncertainty.
    """

    results: tuple[Written, ...]
    labels: tuple[str, ...]
    components: tuple[ComponentComparison, ...]
    alone: tuple[tuple[str, str], ...]
    tests: int
    threshold: float


def compared(results: Sequence[ResultFile]) -> Comparison:
    """Set results side by side.

    Parameters
    ----------
    results : two or more. Components are matched by id and kind; of those that are left, by kind and order.

    Raises
    ------
    InputError : if there are fewer than two or more than 26 results, or no two have a component in common.
    """
    if not 2 <= len(results) <= len(LETTERS):
        raise InputError(f"expected 2 to {len(LETTERS)} results to compare, came {len(results)}")
    labels = tuple(LETTERS[: len(results)])
    matches, alone = _matched(results, labels)
    if not matches:
        raise InputError("the results have no kind of sensor in common: there is nothing to compare")
    pairs = [(_aligned(members), by_order) for members, by_order in matches]
    components = [
        replace(
            _component(members, by_order, labels),
            scenes=scenes_compared(results, members, labels),
        )
        for members, by_order in pairs
    ]
    tests = sum(_tests(component) for component in components)
    threshold = threshold_of(tests)
    judged = tuple(_judged(component, threshold) for component in components)
    return Comparison(tuple(one.file for one in results), labels, judged, alone, tests, threshold)


Members = tuple[ComponentFile | None, ...]


def _matched(
    results: Sequence[ResultFile], labels: Sequence[str]
) -> tuple[list[tuple[Members, bool]], tuple[tuple[str, str], ...]]:
    """Members of each component with whether they were matched by order, and what is alone."""
    rest = [list(result.components) for result in results]
    matches: list[tuple[Members, bool]] = []
    for key, by_order in ((_by_id, False), (_by_order, True)):
        tables = [_keyed(left, key) for left in rest]
        for one in dict.fromkeys(name for table in tables for name in table):
            members = tuple(table.get(one) for table in tables)
            if sum(member is not None for member in members) > 1:
                matches.append((members, by_order))
                rest = [
                    [each for each in left if each is not member]
                    for left, member in zip(rest, members, strict=True)
                ]
    return matches, tuple((label, one.id) for label, left in zip(labels, rest, strict=True) for one in left)


def _keyed(
    components: Iterable[ComponentFile], key: Callable[[ComponentFile], tuple[str, str]]
) -> dict[tuple[str, str, int], ComponentFile]:
    """Components by their key and their number among those of the same key."""
    found: dict[tuple[str, str, int], ComponentFile] = {}
    count: dict[tuple[str, str], int] = {}
    for one in components:
        number = count[key(one)] = count.get(key(one), -1) + 1
        found[*key(one), number] = one
    return found


def _by_id(component: ComponentFile) -> tuple[str, str]:
    return component.kind, component.id


def _by_order(component: ComponentFile) -> tuple[str, str]:
    axis = component.id.rpartition(".")[2]
    return component.kind, axis if axis in AXES else ""


def _aligned(members: Members) -> Members:
    """Give runs of the first member's order their names there, where two have no run in common."""
    first = next(one for one in members if one)
    names = list(dict.fromkeys(run for run, _ in first.noise))
    return tuple(one if one is None else _renamed(one, names) for one in members)


def _renamed(component: ComponentFile, names: Sequence[str]) -> ComponentFile:
    own = list(dict.fromkeys(run for run, _ in component.noise))
    if len(own) != len(names) or set(own) & set(names):
        return component
    name = dict(zip(own, names, strict=True))
    return replace(
        component, noise={(name[run], key): value for (run, key), value in component.noise.items()}
    )


def _component(members: Members, by_order: bool, labels: Sequence[str]) -> ComponentComparison:
    names = dict.fromkeys(name for one in members if one for name in one.terms)
    keys = dict.fromkeys(key for one in members if one for key in one.noise)
    return ComponentComparison(
        members,
        by_order,
        tuple(
            _term(name, [one.terms.get(name) if one else None for one in members], labels) for name in names
        ),
        tuple(_noise(key, [one.noise.get(key) if one else None for one in members], labels) for key in keys),
    )


def _term(name: str, values: Sequence[Term | None], labels: Sequence[str]) -> TermComparison:
    there = {label: value for label, value in zip(labels, values, strict=True) if value}
    if len({value.unit for value in there.values()}) > 1:
        units = ", ".join(f"{label} {value.unit}" for label, value in there.items())
        raise InputError(f"term {name} has different units ({units}): run the studies with the same version")
    tested = {label: value for label, value in there.items() if value.verdict != "untested"}
    pull = largest({label: (value.full_mean, value.full_sd) for label, value in tested.items()})
    return TermComparison(name, tuple(values), pull, len({value.verdict for value in there.values()}) > 1)


def _noise(
    key: tuple[str, str], values: Sequence[NoiseEstimate | None], labels: Sequence[str]
) -> NoiseComparison:
    logs = {
        label: (math.log(value.value), value.log_sd)
        for label, value in zip(labels, values, strict=True)
        if value and value.value > 0.0
    }
    return NoiseComparison(*key, tuple(values), largest(logs))


def _tests(component: ComponentComparison) -> int:
    """Count the comparisons of a component: all pairs of results of what can be compared."""
    entries = [*component.terms, *component.noise]
    counts = (sum(value is not None for value in entry.values) for entry in entries if entry.pull)
    return sum(math.comb(count, 2) for count in counts) + sum(map(scene_tests, component.scenes))


def _judged(component: ComponentComparison, threshold: float) -> ComponentComparison:
    return replace(
        component,
        terms=tuple(replace(term, pull=judged(term.pull, threshold)) for term in component.terms),
        noise=tuple(replace(one, pull=judged(one.pull, threshold)) for one in component.noise),
        scenes=tuple(scene_judged(scene, threshold) for scene in component.scenes),
    )


def differing(component: ComponentComparison) -> Iterator[TermComparison | NoiseComparison]:
    """Terms and noise of a component that differ beyond uncertainty, the largest difference first."""
    entries = [one for one in (*component.terms, *component.noise) if is_beyond(one.pull)]
    yield from sorted(entries, key=lambda one: -one.pull.size if one.pull else 0.0)
