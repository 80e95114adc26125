"""A scene of several results side by side: table, sentences and numbers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from imubayes.reporting.blocks import Row, Section
from imubayes.reporting.comparison.pulls import is_beyond
from imubayes.reporting.comparison.records import pull_record
from imubayes.reporting.comparison.scenes import SceneComparison, ShareComparison
from imubayes.reporting.comparison.view import DIFFERENCE, RESULT, difference, headed, titled
from imubayes.reporting.result.sensors import Scene, TermInScene
from imubayes.reporting.rounding import duration, measured, share
from imubayes.reporting.scene_words import budget_unit
from imubayes.selection.verdicts import listed
from imubayes.sensors.terms import Kind

HEAD = ("term", RESULT, "share of the budget", "required", DIFFERENCE)
LITTLE = 0.01
"""Share of a budget below which a term that no model has is left out."""


def scene_section(
    scene: SceneComparison, of: str, labels: Sequence[str], kind: Kind, *, whole: bool
) -> Section:
    """Shares of the budget, a line for each result, of terms that count in one of them, and what they say."""
    rows = [row for term in scene.terms if _counts(term) for row in _rows(term, labels, whole)]
    return titled(f"Scene {called(scene)}", of, HEAD, rows, "ttttn", *scene_sentences(scene, labels, kind))


def called(scene: SceneComparison) -> str:
    """Name of a scene, with what its budget is of."""
    return f"{scene.name.replace('_', ' ')} ({scene.quantity})"


def _counts(term: ShareComparison) -> bool:
    return is_beyond(term.pull) or any(
        value and (value.kept or value.share_q95 >= LITTLE) for value in term.values
    )


def _rows(term: ShareComparison, labels: Sequence[str], whole: bool) -> Iterator[Row]:
    beyond = is_beyond(term.pull)
    for k, (label, value) in enumerate(zip(labels, term.values, strict=True)):
        name, pull = headed(k, term.name, difference(term.pull, len(labels)))
        told = (_share(value), "yes" if value.kept else "no") if value else ("not there", "")
        shown = whole or beyond or term.required_differs
        yield Row((name, label, *told, pull), strong=beyond, brief=shown)


def _share(value: TermInScene) -> str:
    return f"{share(value.share_of_budget)} ({share(value.share_q05)} to {share(value.share_q95)})"


def scene_sentences(scene: SceneComparison, labels: Sequence[str], kind: Kind) -> Iterator[str]:
    """Say what differs in a scene, what it requires, and what leaving out the rest costs."""
    there = [(label, one) for label, one in zip(labels, scene.members, strict=True) if one]
    opening = f"In the scene {called(scene)}"
    other = [term.name for term in scene.terms if term.required_differs]
    if other:
        yield f"{opening} models differ in {listed(other)}."
    else:
        model = listed(there[0][1].model) if there[0][1].model else "no term"
        yield f"{opening} all require the same: {model}."
    far = [term.name for term in scene.terms if is_beyond(term.pull)]
    if far:
        yield f"Beyond uncertainty there: {listed(far)}."
    left = listed(f"{label} {amount(one.left_out['q95'], scene.quantity, kind)}" for label, one in there)
    yield f"What the terms left out come to there, with 95 %: {left}."
    yield from _conditions(scene, there, kind)


def _conditions(scene: SceneComparison, there: Sequence[tuple[str, Scene]], kind: Kind) -> Iterator[str]:
    """Say what is not the same of the scenes."""
    if len({(one.budget["limit"], one.duration) for _, one in there}) > 1:
        asked = listed(
            f"{label} {amount(one.budget['limit'], scene.quantity, kind)} over {duration(one.duration)}"
            for label, one in there
        )
        yield f"The budgets are not the same: {asked}."
    if scene.reseeded:
        yield "The studies have different seeds, by which a scene of the catalogue moves differently."
    failed = [label for label, one in there if not one.within_budget]
    if failed:
        yield f"No model stays within the budget in {listed(failed)}."


def amount(value: float, quantity: str, kind: Kind) -> str:
    """Size of an error in the unit that people use, two digits.

    Examples
    --------
    >>> amount(0.0123, "attitude", "gyroscope"), amount(0.0, "position", "gyroscope")
    ('0.70 deg', '0 m')
    """
    unit, size = budget_unit(quantity, kind)
    return str(measured(value / size, 0.0, unit))


def scene_record(scene: SceneComparison) -> dict[str, Any]:
    """Values of a scene for ``result.json``, SI."""
    members = scene.members
    return {
        "name": scene.name,
        "quantity": scene.quantity,
        "limits": [one.budget["limit"] if one else None for one in members],
        "durations": [one.duration if one else None for one in members],
        "models": [list(one.model) if one else None for one in members],
        "left_out_q95": [one.left_out["q95"] if one else None for one in members],
        "terms": [
            {
                "name": term.name,
                "share_of_budget": [value.share_of_budget if value else None for value in term.values],
                "share_q05": [value.share_q05 if value else None for value in term.values],
                "share_q95": [value.share_q95 if value else None for value in term.values],
                "required": [value.kept if value else None for value in term.values],
                "required_differs": term.required_differs,
                **pull_record(term.pull),
            }
            for term in scene.terms
        ],
    }
