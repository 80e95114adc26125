"""What results say of the same thing, side by side: entries, groups of them, and how far they are apart.

Two estimates differ where ``|a - b| / sqrt(sd_a^2 + sd_b^2)`` is above a threshold that all comparisons
together exceed by chance in 5 % of cases at most (Bonferroni). Results that cannot be compared are an
`InputError`.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from statistics import NormalDist
from typing import Any, TypeVar

from imubayes.errors import InputError
from imubayes.inference import SIDE
from imubayes.reporting.blocks import Text
from imubayes.reporting.result import Interval
from imubayes.reporting.result.file import Written
from imubayes.sensors.terms import Kind

LEVEL = 0.05
"""Probability that anything at all is said to differ where nothing does."""

LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ"
"""Labels of the results."""

Estimate = tuple[float, float]
"""Mean and sd, or a count and what it is of."""


@dataclass(frozen=True, slots=True)
class LargestPull:
    """Largest difference over its sd between two of the results, by their labels.

    It is the largest of `tests` comparisons, of all pairs that can be compared, and `beyond` what uncertainty
    and the number of all comparisons allow.
    """

    pair: tuple[str, str]
    size: float
    tests: int = 1
    beyond: bool = False


def in_sd(estimate: Estimate, other: Estimate) -> float:
    """Difference of two means over its sd; nan where it has none."""
    sd = math.hypot(estimate[1], other[1])
    return abs(estimate[0] - other[0]) / sd if sd > 0.0 else math.nan


def fisher(estimate: Estimate, other: Estimate) -> float:
    """Size of a normal whose two-sided tail is Fisher's exact test of a of n against b of m.

    Examples
    --------
    >>> round(fisher((8, 8), (0, 8)), 2), fisher((4, 8), (4, 8))
    (3.78, 0.0)
    """
    from scipy.stats import fisher_exact

    (a, n), (b, m) = estimate, other
    p: Any = fisher_exact([[a, n - a], [b, m - b]])[1]
    return -NormalDist().inv_cdf(max(p / 2.0, sys.float_info.min)) if p < 1.0 else 0.0


def largest(
    estimates: Sequence[Estimate | None],
    size: Callable[[Estimate, Estimate], float] = in_sd,
    labels: Sequence[str] = LETTERS,
) -> LargestPull | None:
    """Largest difference between two of some estimates; None where no two can be compared.

    Examples
    --------
    >>> largest([(5.0, 0.3), (3.0, 0.4), (5.0, 3.0)])
    LargestPull(pair=('A', 'B'), size=4.0, tests=3, beyond=False)
    """
    there = [(label, estimate) for label, estimate in zip(labels, estimates, strict=False) if estimate]
    pulls = [
        LargestPull((a, b), size(estimate, other)) for (a, estimate), (b, other) in combinations(there, 2)
    ]
    finite = [pull for pull in pulls if math.isfinite(pull.size)]
    return replace(max(finite, key=lambda pull: pull.size), tests=len(finite)) if finite else None


def normal_of(low: float, high: float) -> float:
    """Standard deviation of a normal with this 90 % interval."""
    return (high - low) / (2.0 * SIDE)


def log_spread(interval: Interval) -> Estimate:
    """Logarithm of a spread, and the sd of it that its 90 % interval has; nan where it is not positive.

    Examples
    --------
    >>> value, sd = log_spread({"value": 1.0, "low": 0.5, "high": 2.0})
    >>> value, round(sd, 3)
    (0.0, 0.421)
    """
    if not interval["low"] > 0.0:
        return math.nan, math.nan
    return math.log(interval["value"]), normal_of(math.log(interval["low"]), math.log(interval["high"]))


Key = TypeVar("Key", bound=Hashable)
Value = TypeVar("Value")


@dataclass(frozen=True, slots=True)
class Entry:
    """A term, a noise figure, or a share of a budget.

    Attributes
    ----------
    name : as a table calls it.
    cells : what a table says of each result's value.
    record : the values as they are published.
    pulls : largest difference by what is compared; None where fewer than two can be.
    label : as sentences call it, where that is not its name.
    missing : number of results that have no such thing.
    divided : whether the results decide on it differently.
    silent : whether a terminal leaves it out where nothing differs.
    shown : whether a page does show it there.
    """

    name: str
    cells: Sequence[tuple[Text, ...]]
    record: Mapping[str, Any]
    pulls: Mapping[str, LargestPull | None]
    label: str = ""
    missing: int = 0
    divided: bool = False
    silent: bool = False
    shown: bool = True

    @property
    def largest(self) -> tuple[str, LargestPull | None]:
        """Largest difference, and what of."""
        there = [(what, pull) for what, pull in self.pulls.items() if pull]
        return max(there, key=lambda pair: pair[1].size, default=("", None))

    @property
    def pull(self) -> LargestPull | None:
        """Largest difference."""
        return self.largest[1]

    @property
    def beyond(self) -> bool:
        """Whether anything differs beyond uncertainty."""
        return self.pull is not None and self.pull.beyond


@dataclass(frozen=True, slots=True)
class Group:
    """A component, a class, or one of these in a scene.

    Attributes
    ----------
    name : of it; several where the results have it by other names.
    kind : of sensor.
    members : of each result; None where it has no such thing.
    terms : by name.
    record : what is published of it beside its entries.
    noise : by run and letter.
    scenes : that two results or more have.
    labels : of the results.
    """

    name: str
    kind: Kind
    members: tuple[Any, ...]
    terms: Mapping[str, Entry]
    record: Mapping[str, Any]
    noise: Mapping[tuple[str, str], Entry] = field(default_factory=dict)
    scenes: tuple[Group, ...] = ()
    labels: Sequence[str] = LETTERS

    @property
    def entries(self) -> tuple[Entry, ...]:
        """Terms and noise, without the scenes."""
        return *self.terms.values(), *self.noise.values()

    @property
    def there(self) -> list[tuple[str, Any]]:
        """Members with the labels of their results."""
        return [(label, member) for label, member in zip(self.labels, self.members, strict=False) if member]


@dataclass(frozen=True, slots=True)
class Comparison:
    """Results side by side, by whose order they have their labels, and what they have in common in groups.

    From `threshold` sd on one of so many `tests` is beyond uncertainty. Of what one result alone has, and
    cannot be compared, `alone` has its label and names.
    """

    files: Sequence[Written]
    results: Sequence[Any]
    groups: tuple[Group, ...]
    alone: Sequence[tuple[str, ...]]
    tests: int
    threshold: float


def check_number(results: Sequence[object]) -> None:
    """Refuse a single result, and more than there are labels."""
    if not 2 <= len(results) <= len(LETTERS):
        raise InputError(f"expected 2 to {len(LETTERS)} results to compare, came {len(results)}")


def numbered(values: Iterable[Value], key: Callable[[Value], Key]) -> dict[tuple[Key, int], Value]:
    """Values by their key and their number among those of the same key."""
    values_by_number: dict[tuple[Key, int], Value] = {}
    count: dict[Key, int] = {}
    for value in values:
        number = count[key(value)] = count.get(key(value), -1) + 1
        values_by_number[key(value), number] = value
    return values_by_number


def aligned(tables: Iterable[Mapping[Key, Value]], least: int = 1) -> dict[Key, tuple[Value | None, ...]]:
    """Values of each key that `least` tables have, in the first one's order; None where a table lacks it."""
    each = list(tables)
    keys = dict.fromkeys(key for table in each for key in table)
    return {
        key: tuple(table.get(key) for table in each)
        for key in keys
        if sum(key in table for table in each) >= least
    }


def terms_of(members: Iterable[Any]) -> dict[str, tuple[Any, ...]]:
    """Terms by name, of each member; None where it lacks a term."""
    return aligned({term["name"]: term for term in member["terms"]} if member else {} for member in members)


def comparison(
    files: Sequence[Written],
    results: Sequence[Any],
    groups: Iterable[Group],
    alone: Sequence[tuple[str, ...]],
) -> Comparison:
    """Mark all that differs by more than uncertainty and the number of comparisons allow."""
    every = list(groups)
    entries = [entry for group in every for entry in with_scenes(group)]
    tests = sum(pull.tests for entry in entries for pull in entry.pulls.values() if pull)
    threshold = NormalDist().inv_cdf(1.0 - LEVEL / (2.0 * max(tests, 1)))
    marked = tuple(_marked(group, threshold) for group in every)
    return Comparison(files, results, marked, alone, tests, threshold)


def with_scenes(group: Group) -> Iterator[Entry]:
    """Entries of a group and of its scenes."""
    yield from group.entries
    for scene in group.scenes:
        yield from scene.entries


def _marked(group: Group, threshold: float) -> Group:
    def mark(entry: Entry) -> Entry:
        pulls = {
            what: pull and replace(pull, beyond=pull.size > threshold) for what, pull in entry.pulls.items()
        }
        return replace(entry, pulls=pulls)

    return replace(
        group,
        terms={name: mark(entry) for name, entry in group.terms.items()},
        noise={key: mark(entry) for key, entry in group.noise.items()},
        scenes=tuple(_marked(scene, threshold) for scene in group.scenes),
    )


def differing(entries: Iterable[Entry]) -> list[tuple[str, LargestPull]]:
    """What differs beyond uncertainty, by name, the largest difference first."""
    pulls = [
        (f"{entry.label or entry.name}{f' ({what})' if what else ''}", pull)
        for entry in entries
        for what, pull in entry.pulls.items()
        if pull and pull.beyond
    ]
    return sorted(pulls, key=lambda pair: -pair[1].size)


def columns(values: Iterable[Any], **keys: str) -> dict[str, list[Any]]:
    """Values by key, each with the key that it has in a result; None where a result lacks it."""
    every = list(values)
    return {key: [None if value is None else value[name] for value in every] for key, name in keys.items()}
