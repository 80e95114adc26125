"""A component in the same scene of several results: what it requires, and what each term takes of the budget.

Shares are compared as errors in the budget's unit, so that a budget that was changed is no difference by
itself. Their sd is that of a normal with the same 90 % interval.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from imubayes.reporting.comparison.pulls import Pull, judged, largest, normal_of
from imubayes.reporting.comparison.result_files import ComponentFile, ResultFile
from imubayes.reporting.result.sensors import Scene, TermInScene


@dataclass(frozen=True, slots=True)
class ShareComparison:
    """A term's share of a scene's budget in every result.

    Attributes
    ----------
    name : of the term.
    values : of each result; None where it lacks the term or the scene.
    pull : largest difference; None where fewer than two can be compared.
    """

    name: str
    values: tuple[TermInScene | None, ...]
    pull: Pull | None

    @property
    def required_differs(self) -> bool:
        """Whether some models have the term and others not."""
        return len({value.kept for value in self.values if value}) > 1


@dataclass(frozen=True, slots=True)
class SceneComparison:
    """A component in a scene of every result.

    Attributes
    ----------
    name, quantity : of the scene, and of what its budget is of.
    members : of each result; None where it has no such scene.
    terms : compared.
    reseeded : whether the studies' seeds differ, which decide how a scene of the catalogue moves.
    """

    name: str
    quantity: str
    members: tuple[Scene | None, ...]
    terms: tuple[ShareComparison, ...]
    reseeded: bool


def scenes_compared(
    results: Sequence[ResultFile], members: Sequence[ComponentFile | None], labels: Sequence[str]
) -> tuple[SceneComparison, ...]:
    """Set the scenes of a matched component side by side.

    Parameters
    ----------
    results : with their scenes.
    members : the component in each of them; None where it has none.
    labels : of the results.

    Returns
    -------
    scenes that two results or more have, matched by name and by what the budget is of.
    """
    tables = [
        _keyed(one for one in result.scenes if one.sensor == member.id) if member else {}
        for result, member in zip(results, members, strict=True)
    ]
    seeds = {result.seed for result, table in zip(results, tables, strict=True) if table}
    found = [
        (key, tuple(table.get(key) for table in tables))
        for key in dict.fromkeys(key for table in tables for key in table)
    ]
    return tuple(
        SceneComparison(*key[:2], there, _terms(there, labels), len(seeds) > 1)
        for key, there in found
        if sum(one is not None for one in there) > 1
    )


def _keyed(scenes: Iterable[Scene]) -> dict[tuple[str, str, int], Scene]:
    """Scenes by name, quantity and number among those of the same."""
    found: dict[tuple[str, str, int], Scene] = {}
    for one in scenes:
        number = sum(key[:2] == (one.name, one.budget["quantity"]) for key in found)
        found[one.name, one.budget["quantity"], number] = one
    return found


def _terms(there: Sequence[Scene | None], labels: Sequence[str]) -> tuple[ShareComparison, ...]:
    tables = [{term.name: term for term in one.terms} if one else {} for one in there]
    limits = [one.budget["limit"] if one else math.nan for one in there]
    return tuple(
        _term(name, [table.get(name) for table in tables], limits, labels)
        for name in dict.fromkeys(name for table in tables for name in table)
    )


def _term(
    name: str, values: Sequence[TermInScene | None], limits: Sequence[float], labels: Sequence[str]
) -> ShareComparison:
    errors = {
        label: (limit * one.share_of_budget, limit * normal_of(one.share_q05, one.share_q95))
        for label, one, limit in zip(labels, values, limits, strict=True)
        if one
    }
    return ShareComparison(name, tuple(values), largest(errors))


def scene_tests(one: SceneComparison) -> int:
    """Count the comparisons of a scene: all pairs of results of what can be compared."""
    return sum(math.comb(sum(v is not None for v in term.values), 2) for term in one.terms if term.pull)


def scene_judged(one: SceneComparison, threshold: float) -> SceneComparison:
    """Mark the differences that are beyond uncertainty."""
    terms = tuple(replace(term, pull=judged(term.pull, threshold)) for term in one.terms)
    return replace(one, terms=terms)
