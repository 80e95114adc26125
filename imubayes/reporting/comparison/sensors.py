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
    for key in (lambda sensor: (sensor["kind"], sensor["id"]), _place):
        for members in differences.aligned(
            (differences.numbered(left, key) for left in rest), least=2
        ).values():
            groups.append(_component(results, members))
            for left, member in zip(rest, members, strict=True):
                left[:] = [sensor for sensor in left if sensor is not member]
    if not groups:
        raise InputError("the results have no kind of sensor in common: there is nothing to compare")
    alone = [
        (label, sensor["id"])
        for label, left in zip(differences.LETTERS, rest, strict=False)
        for sensor in left
    ]
    return differences.comparison(files, results, groups, alone)


def _place(sensor: Sensor) -> tuple[str, str]:
    """Kind, and axis of a triad's component, which is compared with its own kind only."""
    axis = sensor["id"].rpartition(".")[2]
    return sensor["kind"], axis if axis in COMPONENTS else ""


def _component(results: Sequence[SensorsResult], members: tuple[Sensor | None, ...]) -> differences.Group:
    there = [sensor for sensor in members if sensor]
    kind, ids = there[0]["kind"], list(dict.fromkeys(sensor["id"] for sensor in there))
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
    noise = {
        (run, letter): (values[letter], spreads[run][letter] if run in spreads else math.nan)
        for run, values in sensor["noise"].items()
        for letter in ("N", "B", "K")
    }
    for run, draws in sensor["noise_posterior"].items():
        for letter in ("N", "B", "K"):
            mean, sd = draws[letter]["mean"], draws[letter]["sd"]
            log_sd = math.sqrt(math.log1p((sd / mean) ** 2)) if mean > 0.0 else math.nan
            noise[run, letter] = mean, log_sd
    return noise


def _noise_tables(members: Sequence[Sensor | None]) -> Iterator[dict[tuple[str, str], differences.Estimate]]:
    """Noise by run; runs in the first member's order have its names where two have no run in common."""
    tables = [noise_of(sensor) if sensor else {} for sensor in members]
    first = next(table for table, sensor in zip(tables, members, strict=True) if sensor)
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
            (scene for scene in result["scenes"] if scene["sensor"] == sensor["id"]),
            lambda scene: (scene["name"], scene["budget"]["quantity"]),
        )
        if sensor
        else {}
        for result, sensor in zip(results, members, strict=True)
    ]
    shared = differences.aligned(tables, least=2)
    return tuple(_scene(name, quantity, scenes, kind) for ((name, quantity), _), scenes in shared.items())


def _scene(name: str, quantity: str, members: tuple[Scene | None, ...], kind: Kind) -> differences.Group:
    limits = [member and member["budget"]["limit"] for member in members]
    terms = {}
    for term, values in differences.terms_of(members).items():
        errors = [
            (
                limit * value["share_of_budget"],
                limit * differences.normal_of(value["share_q05"], value["share_q95"]),
            )
            if value and limit is not None
            else None
            for value, limit in zip(values, limits, strict=True)
        ]
        kept = {value["kept"] for value in values if value}
        shares = dict.fromkeys(("share_of_budget", "share_q05", "share_q95"))
        record = {
            "name": term,
            **differences.columns(values, **{key: key for key in shares}, required="kept"),
            "required_differs": len(kept) > 1,
        }
        shown = any(value and (value["kept"] or value["share_q95"] >= page.LITTLE) for value in values)
        cells, pulls = tuple(map(_share_cells, values)), {"": differences.largest(errors)}
        terms[term] = differences.Entry(term, cells, record, pulls, divided=len(kept) > 1, shown=shown)
    record = {
        "name": name,
        "quantity": quantity,
        "limits": limits,
        **differences.columns(members, durations="duration", models="model"),
        "left_out_q95": [member and member["left_out"]["q95"] for member in members],
        "terms": (),
    }
    return differences.Group(name, kind, members, terms, record)


def _answer(comparison: differences.Comparison) -> Iterator[str]:
    changed = sum(term.divided for group in comparison.groups for term in group.terms.values())
    scenes = [scene for group in comparison.groups for scene in group.scenes]
    others = sum(any(term.divided for term in scene.terms.values()) for scene in scenes)
    verdicts = f"{counted(changed, 'verdict')} differ{'s' if changed == 1 else ''}"
    if scenes:
        require = "requires" if len(scenes) == 1 else "require"
        verdicts += f"; {others} of {counted(len(scenes), 'scene')} {require} other terms"
    most = page.most_different((group, group.entries) for group in comparison.groups)
    yield f"{most or f'Nothing differs beyond uncertainty in {comparison.tests} comparisons'}; {verdicts}."


def _section(k: int, group: differences.Group, comparison: differences.Comparison) -> Section:
    whole = len(comparison.groups) <= WHOLE
    terms, noise = (
        [*page.entry_rows(entries.values(), whole=whole)] for entries in (group.terms, group.noise)
    )
    tables = [page.titled("The terms", group.name, HEAD, terms, "tttnfn")]
    if noise:
        tables.append(page.titled("Noise", group.name, NOISE_HEAD, noise, "tttn"))
    for scene in group.scenes:
        # shares of the budget, a line for each result, of terms that count in one of them
        called = f"{scene_name(scene.name)} ({scene.record['quantity']})"
        rows = page.entry_rows(scene.terms.values(), whole=whole)
        said = (*_scene_sentences(scene, called), *_conditions(scene, comparison))
        tables.append(page.titled(f"Scene {called}", group.name, SCENE_HEAD, rows, "ttttn", *said))
    blocks = [Prose(" ".join(_sentences(group))), *tables]
    return Section(group.name, blocks, f"c{k + 1}", group.kind, brief=True)


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


def _sentences(group: differences.Group) -> Iterator[str]:
    if len({member["id"] for _, member in group.there}) > 1:
        names = listed([f"{label} {member['id']}" for label, member in group.there])
        yield f"The ids differ: matched by kind and order, {names}."
    if len({member["class"] for _, member in group.there}) > 1:
        classes = listed([f"{label} {member['class'] or 'none'}" for label, member in group.there])
        yield f"The classes, and so the priors, differ: {classes}."
    far = [f"{name} ({pull.size:.1f} sd)" for name, pull in differences.differing(group.entries)]
    compared = sum(each.pull is not None for each in group.entries)
    yield (
        f"Beyond uncertainty: {listed(far)}."
        if far
        else f"None of {compared} terms and noise figures differs beyond uncertainty."
    )
    untested = [name for name, term in group.terms.items() if term.silent]
    if untested:
        yield f"No result tests {listed(untested)}."
    changed = [name for name, term in group.terms.items() if term.divided]
    if changed:
        yield f"The verdict differs on {listed(changed)}."
    yield from page.incomplete(group, len(group.there))


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
    left = listed(f"{label} {amount(member['left_out']['q95'], scene)}" for label, member in scene.there)
    yield f"What the terms left out come to there, with 95 %: {left}."


def _conditions(scene: differences.Group, comparison: differences.Comparison) -> Iterator[str]:
    if len({(member["budget"]["limit"], member["duration"]) for _, member in scene.there}) > 1:
        asked = listed(
            f"{label} {amount(member['budget']['limit'], scene)} over {duration(member['duration'])}"
            for label, member in scene.there
        )
        yield f"The budgets are not the same: {asked}."
    seeds = {result["seed"] for result, there in zip(comparison.results, scene.members, strict=True) if there}
    if len(seeds) > 1:
        yield "The studies have different seeds, by which a scene of the catalogue moves differently."
    failed = [label for label, member in scene.there if not member["within_budget"]]
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
