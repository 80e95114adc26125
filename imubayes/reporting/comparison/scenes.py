"""A component in the same scene of several results: what it requires, and what each term takes of the budget.

Shares are compared as errors in the budget's unit, so that a budget that was changed is no difference by
itself. Their sd is that of a normal with the same 90 % interval.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from imubayes.reporting.blocks import Section, Text
from imubayes.reporting.comparison.differences import (
    Group,
    aligned,
    column,
    entry,
    normal_of,
    numbered,
    pull_record,
    terms_of,
)
from imubayes.reporting.comparison.page import DIFFERENCE, LITTLE, RESULT, entry_rows, titled
from imubayes.reporting.result.entries import Scene, Sensor, SensorsResult, TermInScene
from imubayes.reporting.rounding import duration, measured, share
from imubayes.reporting.scene_words import budget_unit
from imubayes.selection.verdicts import listed
from imubayes.sensors.terms import Kind

HEAD = ("term", RESULT, "share of the budget", "required", DIFFERENCE)


def scenes_compared(
    results: Sequence[SensorsResult], members: Sequence[Sensor | None], labels: Sequence[str]
) -> tuple[Group, ...]:
    """Set the scenes of a matched component side by side: by name and by what the budget is of.

    Parameters
    ----------
    results : with their scenes.
    members : the component in each of them; None where it has none.
    labels : of the results.
    """
    tables = [
        numbered((scene for scene in result.scenes if scene.sensor == one.id), _quantity) if one else {}
        for result, one in zip(results, members, strict=True)
    ]
    kind: Kind = next(one.kind for one in members if one)
    seeds = {result.seed for result, table in zip(results, tables, strict=True) if table}
    return tuple(
        replace(_scene(name, found, labels, kind), quantity=quantity, reseeded=len(seeds) > 1)
        for ((name, quantity), _), found in aligned(tables, least=2).items()
    )


def _quantity(scene: Scene) -> tuple[str, str]:
    return scene.name, scene.budget["quantity"]


def _scene(name: str, members: tuple[Scene | None, ...], labels: Sequence[str], kind: Kind) -> Group:
    limits = [one.budget["limit"] if one else math.nan for one in members]
    terms = {}
    for term, values in terms_of(members).items():
        errors = [
            (limit * one.share_of_budget, limit * normal_of(one.share_q05, one.share_q95)) if one else None
            for one, limit in zip(values, limits, strict=True)
        ]
        kept = (one.kept for one in values if one)
        terms[term] = entry(labels, term, values, errors, decisions=kept)
    return Group(name, kind, labels, members, terms)


def scene_section(scene: Group, of: str, *, whole: bool) -> Section:
    """Shares of the budget, a line for each result, of terms that count in one of them, and what they say."""
    called = f"{scene.name.replace('_', ' ')} ({scene.quantity})"
    rows = [
        row
        for name, term in scene.terms.items()
        if term.beyond or any(value and (value.kept or value.share_q95 >= LITTLE) for value in term.values)
        for row in entry_rows(
            scene.labels, name, term, map(_share_cells, term.values), brief=whole or term.divided
        )
    ]
    said = (*_scene_sentences(scene, called), *_conditions(scene))
    return titled(f"Scene {called}", of, HEAD, rows, "ttttn", *said)


def _share_cells(value: TermInScene | None) -> tuple[Text, ...]:
    if value is None:
        return "not there", ""
    low, high = share(value.share_q05), share(value.share_q95)
    return f"{share(value.share_of_budget)} ({low} to {high})", "yes" if value.kept else "no"


def _scene_sentences(scene: Group, called: str) -> Iterator[str]:
    """Say what differs in a scene, what it requires, and what leaving out the rest costs."""
    other = [name for name, term in scene.terms.items() if term.divided]
    if other:
        yield f"In the scene {called} models differ in {listed(other)}."
    else:
        model = scene.there[0][1].model
        yield f"In the scene {called} all require the same: {listed(model) if model else 'no term'}."
    far = [name for name, term in scene.terms.items() if term.beyond]
    if far:
        yield f"Beyond uncertainty there: {listed(far)}."
    left = listed(
        f"{label} {amount(one.left_out['q95'], scene.quantity, scene.kind)}" for label, one in scene.there
    )
    yield f"What the terms left out come to there, with 95 %: {left}."


def _conditions(scene: Group) -> Iterator[str]:
    """Say what is not the same of the scenes."""
    if len({(one.budget["limit"], one.duration) for _, one in scene.there}) > 1:
        asked = listed(
            f"{label} {amount(one.budget['limit'], scene.quantity, scene.kind)} over {duration(one.duration)}"
            for label, one in scene.there
        )
        yield f"The budgets are not the same: {asked}."
    if scene.reseeded:
        yield "The studies have different seeds, by which a scene of the catalogue moves differently."
    failed = [label for label, one in scene.there if not one.within_budget]
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


def scene_record(scene: Group) -> dict[str, Any]:
    """Values of a scene for ``result.json``, SI."""
    return {
        "name": scene.name,
        "quantity": scene.quantity,
        "limits": [one and one.budget["limit"] for one in scene.members],
        "durations": column(scene.members, "duration"),
        "models": column(scene.members, "model"),
        "left_out_q95": [one and one.left_out["q95"] for one in scene.members],
        "terms": [
            {
                "name": name,
                **{key: column(term.values, key) for key in ("share_of_budget", "share_q05", "share_q95")},
                "required": column(term.values, "kept"),
                "required_differs": term.divided,
                **pull_record(term.pull),
            }
            for name, term in scene.terms.items()
        ],
    }
