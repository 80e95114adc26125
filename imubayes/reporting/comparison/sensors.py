"""Results of sensors side by side: the same terms, noise and scenes, and what differs beyond uncertainty.

Under the full library an estimate does not depend on which other terms were kept. What a term takes of a
budget is compared as an error in the budget's unit, so that another budget is no difference by itself.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from imubayes.errors import InputError
from imubayes.reporting.blocks import Prose, Section, Text, verdict
from imubayes.reporting.comparison import differences, page
from imubayes.reporting.lots_words import scene_name
from imubayes.reporting.result.entries import Scene, Sensor, SensorsResult, Term, TermInScene
from imubayes.reporting.result.file import Written
from imubayes.reporting.rounding import duration, measured, noise_unit, per_unit, share
from imubayes.reporting.rows import noise_cell
from imubayes.reporting.scene_words import budget_unit
from imubayes.selection.verdicts import listed
from imubayes.sensors.imu import COMPONENTS
from imubayes.sensors.terms import Kind
from imubayes.units import counted

WHOLE = 2
"""Components of which a terminal gets every term; of more, only what differs."""

NUMBERS = ("full_mean", "full_sd", "inclusion")
"""Of a term, that a comparison publishes under their own names."""

HEAD = ("term", page.RESULT, "value", "inclusion", "verdict", page.DIFFERENCE)
NOISE_HEAD = ("noise, run", page.RESULT, "value", page.DIFFERENCE)
SCENE_HEAD = ("term", page.RESULT, "share of the budget", "required", page.DIFFERENCE)


def sensors_compared(files: Sequence[Written], results: Sequence[SensorsResult]) -> differences.Comparison:
    """Set results of sensors side by side."""
    differences.check_number(results)
    rest = [list(result["sensors"]) for result in results]
    groups: list[differences.Group] = []
    for key in (lambda one: (one["kind"], one["id"]), _place):
        for members in differences.aligned(
            (differences.numbered(left, key) for left in rest), least=2
        ).values():
            groups.append(_component(results, members))
            for left, member in zip(rest, members, strict=True):
                left[:] = [one for one in left if one is not member]
    if not groups:
        raise InputError("the results have no kind of sensor in common: there is nothing to compare")
    alone = [
        (label, one["id"]) for label, left in zip(differences.LETTERS, rest, strict=False) for one in left
    ]
    return differences.comparison(files, results, groups, alone)


def _place(sensor: Sensor) -> tuple[str, str]:
    """Kind, and axis of a triad's component, which is compared with its own kind only."""
    axis = sensor["id"].rpartition(".")[2]
    return sensor["kind"], axis if axis in COMPONENTS else ""


def _component(results: Sequence[SensorsResult], members: tuple[Sensor | None, ...]) -> differences.Group:
    there = [one for one in members if one]
    kind, ids = there[0]["kind"], list(dict.fromkeys(one["id"] for one in there))
    noise = differences.aligned(_noise_tables(members)).items()
    return differences.Group(
        ", ".join(ids),
        kind,
        members,
        {name: _term(name, values) for name, values in differences.terms_of(members).items()},
        {
            **differences.columns(members, ids="id"),
            "kind": kind,
            "matched_by": "order" if len(ids) > 1 else "id",
            **differences.columns(members, classes="class", models="model"),
            **dict.fromkeys(("terms", "noise", "scenes"), ()),
        },
        {key: _noise(*key, values, kind) for key, values in noise},
        _scenes(results, members, kind),
    )


def _term(name: str, values: Sequence[Term | None]) -> differences.Entry:
    used = {label: value["unit"] for label, value in zip(differences.LETTERS, values, strict=False) if value}
    if len(set(used.values())) > 1:
        units = ", ".join(f"{label} {unit}" for label, unit in used.items())
        raise InputError(f"term {name} has different units ({units}): run the studies with the same version")
    tested = [
        (value["full_mean"], value["full_sd"]) if value and value["verdict"] != "untested" else None
        for value in values
    ]
    divided = len({value["verdict"] for value in values if value}) > 1
    record = {
        "name": name,
        "unit": next(iter(used.values())),
        **differences.columns(values, **{key: key for key in NUMBERS}, verdicts="verdict"),
        "verdicts_differ": divided,
    }
    return differences.Entry(
        name,
        [
            (term_value(value), f"{value['inclusion']:.3f}", verdict(value["verdict"]))
            if value
            else ("not in the library", "", "")
            for value in values
        ],
        record,
        {"": differences.largest(tested)},
        missing=len(values) - len(used),
        divided=divided,
        silent=not any(tested),
    )


def noise_of(sensor: Sensor) -> dict[tuple[str, str], differences.Estimate]:
    """N, B, K of every run, with the sd of the logarithm: zero where it was given.

    By the chains where it was sampled, as a log-normal value of the same mean and sd; else as it was
    estimated or given.
    """
    spreads = {run["name"]: run["noise_log_sd"] for run in sensor["runs"]}
    found = {
        (run, letter): (values[letter], spreads[run][letter] if run in spreads else math.nan)
        for run, values in sensor["noise"].items()
        for letter in ("N", "B", "K")
    }
    for run, draws in sensor["noise_posterior"].items():
        for letter in ("N", "B", "K"):
            mean, sd = draws[letter]["mean"], draws[letter]["sd"]
            log_sd = math.sqrt(math.log1p((sd / mean) ** 2)) if mean > 0.0 else math.nan
            found[run, letter] = mean, log_sd
    return found


def _noise_tables(members: Sequence[Sensor | None]) -> Iterator[dict[tuple[str, str], differences.Estimate]]:
    """Noise by run; runs in the first member's order have its names where two have no run in common."""
    tables = [noise_of(one) if one else {} for one in members]
    first = next(table for table, one in zip(tables, members, strict=True) if one)
    names = list(dict.fromkeys(run for run, _ in first))
    for table in tables:
        own = list(dict.fromkeys(run for run, _ in table))
        same = len(own) != len(names) or set(own) & set(names)
        name = dict(zip(own, own if same else names, strict=True))
        yield {(name[run], letter): value for (run, letter), value in table.items()}


def _noise(
    run: str, letter: str, values: Sequence[differences.Estimate | None], kind: Kind
) -> differences.Entry:
    logs = [(math.log(value[0]), value[1]) if value and value[0] > 0.0 else None for value in values]
    sizes, log_sds = ([value and value[k] for value in values] for k in (0, 1))
    return differences.Entry(
        f"{letter} {run}",
        [_noise_cells(value, letter, kind) for value in values],
        {"run": run, "name": letter, "value": sizes, "log_sd": log_sds},
        {"": differences.largest(logs)},
        f"noise {letter} of run {run}",
    )


def _scenes(
    results: Sequence[SensorsResult], members: Sequence[Sensor | None], kind: Kind
) -> tuple[differences.Group, ...]:
    """Scenes of a matched component side by side: by name and by what the budget is of."""
    tables = [
        differences.numbered(
            (scene for scene in result["scenes"] if scene["sensor"] == one["id"]),
            lambda scene: (scene["name"], scene["budget"]["quantity"]),
        )
        if one
        else {}
        for result, one in zip(results, members, strict=True)
    ]
    shared = differences.aligned(tables, least=2)
    return tuple(_scene(name, quantity, found, kind) for ((name, quantity), _), found in shared.items())


def _scene(name: str, quantity: str, members: tuple[Scene | None, ...], kind: Kind) -> differences.Group:
    limits = [one and one["budget"]["limit"] for one in members]
    terms = {}
    for term, values in differences.terms_of(members).items():
        errors = [
            (
                limit * one["share_of_budget"],
                limit * differences.normal_of(one["share_q05"], one["share_q95"]),
            )
            if one and limit is not None
            else None
            for one, limit in zip(values, limits, strict=True)
        ]
        kept = {one["kept"] for one in values if one}
        shares = dict.fromkeys(("share_of_budget", "share_q05", "share_q95"))
        record = {
            "name": term,
            **differences.columns(values, **{key: key for key in shares}, required="kept"),
            "required_differs": len(kept) > 1,
        }
        shown = any(one and (one["kept"] or one["share_q95"] >= page.LITTLE) for one in values)
        cells, pulls = tuple(map(_share_cells, values)), {"": differences.largest(errors)}
        terms[term] = differences.Entry(term, cells, record, pulls, divided=len(kept) > 1, shown=shown)
    record = {
        "name": name,
        "quantity": quantity,
        "limits": limits,
        **differences.columns(members, durations="duration", models="model"),
        "left_out_q95": [one and one["left_out"]["q95"] for one in members],
        "terms": (),
    }
    return differences.Group(name, kind, members, terms, record)


def _answer(found: differences.Comparison) -> Iterator[str]:
    changed = sum(term.divided for one in found.groups for term in one.terms.values())
    scenes = [scene for one in found.groups for scene in one.scenes]
    others = sum(any(term.divided for term in scene.terms.values()) for scene in scenes)
    verdicts = f"{counted(changed, 'verdict')} differ{'s' if changed == 1 else ''}"
    if scenes:
        require = "requires" if len(scenes) == 1 else "require"
        verdicts += f"; {others} of {counted(len(scenes), 'scene')} {require} other terms"
    most = page.most_different((one, one.entries) for one in found.groups)
    yield f"{most or f'Nothing differs beyond uncertainty in {found.tests} comparisons'}; {verdicts}."


def _section(k: int, one: differences.Group, found: differences.Comparison) -> Section:
    whole = len(found.groups) <= WHOLE
    terms, noise = ([*page.entry_rows(entries.values(), whole=whole)] for entries in (one.terms, one.noise))
    tables = [page.titled("The terms", one.name, HEAD, terms, "tttnfn")]
    if noise:
        tables.append(page.titled("Noise", one.name, NOISE_HEAD, noise, "tttn"))
    for scene in one.scenes:
        # shares of the budget, a line for each result, of terms that count in one of them
        called = f"{scene_name(scene.name)} ({scene.record['quantity']})"
        rows = page.entry_rows(scene.terms.values(), whole=whole)
        said = (*_scene_sentences(scene, called), *_conditions(scene, found))
        tables.append(page.titled(f"Scene {called}", one.name, SCENE_HEAD, rows, "ttttn", *said))
    blocks = [Prose(" ".join(_sentences(one))), *tables]
    return Section(one.name, blocks, f"c{k + 1}", one.kind, brief=True)


def term_value(value: Term) -> str:
    """Coefficient of a term under the full library, in the unit that people use."""
    if value["verdict"] == "untested":
        return "not tested"
    printed = value["printed_unit"]
    return str(measured(value["full_mean"], value["full_sd"], printed, per_unit(printed, value["unit"])))


def _noise_cells(value: differences.Estimate | None, letter: str, kind: Kind) -> tuple[Text, ...]:
    if value is None:
        return ("no such run",)
    size, log_sd = value
    unit, scale = noise_unit(letter, kind)
    known = log_sd if math.isfinite(log_sd) else 0.0
    cell, limit = noise_cell(size / scale, known, unit)
    return (f"{'below ' if limit else ''}{cell}{'' if cell.sd or limit else ' (given)'}",)


def _sentences(one: differences.Group) -> Iterator[str]:
    if len({member["id"] for _, member in one.there}) > 1:
        names = listed([f"{label} {member['id']}" for label, member in one.there])
        yield f"The ids differ: matched by kind and order, {names}."
    if len({member["class"] for _, member in one.there}) > 1:
        classes = listed([f"{label} {member['class'] or 'none'}" for label, member in one.there])
        yield f"The classes, and so the priors, differ: {classes}."
    far = [f"{name} ({pull.size:.1f} sd)" for name, pull in differences.differing(one.entries)]
    compared = sum(each.pull is not None for each in one.entries)
    yield (
        f"Beyond uncertainty: {listed(far)}."
        if far
        else f"None of {compared} terms and noise figures differs beyond uncertainty."
    )
    untested = [name for name, term in one.terms.items() if term.silent]
    if untested:
        yield f"No result tests {listed(untested)}."
    changed = [name for name, term in one.terms.items() if term.divided]
    if changed:
        yield f"The verdict differs on {listed(changed)}."
    yield from page.incomplete(one, len(one.there))


def _share_cells(value: TermInScene | None) -> tuple[Text, ...]:
    if value is None:
        return "not there", ""
    low, high = share(value["share_q05"]), share(value["share_q95"])
    return f"{share(value['share_of_budget'])} ({low} to {high})", "yes" if value["kept"] else "no"


def _scene_sentences(scene: differences.Group, called: str) -> Iterator[str]:
    other = [name for name, term in scene.terms.items() if term.divided]
    if other:
        yield f"In the scene {called} models differ in {listed(other)}."
    else:
        model = scene.there[0][1]["model"]
        yield f"In the scene {called} all require the same: {listed(model) if model else 'no term'}."
    far = [name for name, term in scene.terms.items() if term.beyond]
    if far:
        yield f"Beyond uncertainty there: {listed(far)}."
    left = listed(f"{label} {amount(one['left_out']['q95'], scene)}" for label, one in scene.there)
    yield f"What the terms left out come to there, with 95 %: {left}."


def _conditions(scene: differences.Group, found: differences.Comparison) -> Iterator[str]:
    if len({(one["budget"]["limit"], one["duration"]) for _, one in scene.there}) > 1:
        asked = listed(
            f"{label} {amount(one['budget']['limit'], scene)} over {duration(one['duration'])}"
            for label, one in scene.there
        )
        yield f"The budgets are not the same: {asked}."
    seeds = {one["seed"] for one, there in zip(found.results, scene.members, strict=True) if there}
    if len(seeds) > 1:
        yield "The studies have different seeds, by which a scene of the catalogue moves differently."
    failed = [label for label, one in scene.there if not one["within_budget"]]
    if failed:
        yield f"No model stays within the budget in {listed(failed)}."


def amount(value: float, scene: differences.Group) -> str:
    """Size of an error in the unit that people use, two digits."""
    return str(measured(value, 0.0, *budget_unit(scene.record["quantity"], scene.kind)))


SENSORS = page.Comparing(
    sensors_compared,
    "The same terms, their values, noise, verdicts and scenes: what differs beyond uncertainty?",
    _answer,
    "Terms are compared under the full library, noise by its logarithm, scenes by the errors that terms bring"
    " about there, and the results as independent.",
    _section,
    alone="Only in one result",
    item="{1} ({0})",
    keys=("components", "id"),
)
