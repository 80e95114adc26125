"""Class-level results side by side: the same classes, terms and scenes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache
from typing import Any

from imubayes.errors import InputError, TermError
from imubayes.inference import Share
from imubayes.population.needs import HALF
from imubayes.reporting.blocks import Prose, Row, Section, Text
from imubayes.reporting.comparison import page
from imubayes.reporting.comparison.differences import (
    LETTERS,
    Comparison,
    Entry,
    Group,
    aligned,
    check_number,
    comparison,
    differing,
    fisher,
    largest,
    log_spread,
    normal_of,
    terms_of,
    with_scenes,
)
from imubayes.reporting.lots_words import amid, scene_name, slug
from imubayes.reporting.result.file import Written
from imubayes.reporting.result.many import Class, ClassInScene, ClassTerm, LotsResult
from imubayes.reporting.rounding import measured, percent, percents, share_range, unit_of
from imubayes.rig.simulate import library_of
from imubayes.selection.verdicts import listed
from imubayes.sensors.terms import Kind

ORDER_HEAD = ("terms of", page.RESULT, "median (90 % of the units)")
HEAD = ("term", page.RESULT, "needed", "mean", "spread", page.DIFFERENCE)
SCENE_HEAD = ("term", page.RESULT, "required", "share of the budget", page.DIFFERENCE)

Population = dict[str, Any]
"""A term over the units of a class: `needed`, how many need it of how many; the same as a `share`; `mean` and
`spread`, SI; and whether the test of any unit excites it (`tested`): else the population is the prior's."""


def lots_compared(files: Sequence[Written], results: Sequence[LotsResult]) -> Comparison:
    """Set class-level results side by side."""
    check_number(results)
    lots = [result["lots"] for result in results]
    if len({lot["kind"] for lot in lots}) > 1:
        kinds = ", ".join(f"{label} {lot['kind']}s" for label, lot in zip(LETTERS, lots, strict=False))
        raise InputError(f"the classes are of different kinds of sensors ({kinds}): compare lots of one kind")
    tables = [{grade["id"]: grade for grade in lot["classes"]} for lot in lots]
    labelled, shared = list(zip(LETTERS, tables, strict=False)), aligned(tables, least=2)
    if not shared:
        classes = "; ".join(f"{label} {', '.join(names)}" for label, names in labelled)
        raise InputError(f"the results have no class in common ({classes}): there is nothing to compare")
    alone = [(label, name) for label, table in labelled for name in table if name not in shared]
    return comparison(files, results, [_class(results, *pair) for pair in shared.items()], alone)


def _class(results: Sequence[LotsResult], name: str, members: tuple[Class | None, ...]) -> Group:
    kind = results[0]["lots"]["kind"]
    scenes = (
        {scene["name"]: scene for scene in result["scenes"] if member and scene["sensor"] == name}
        for result, member in zip(results, members, strict=True)
    )
    counts = [len(member["units"]) if member else 0 for member in members]
    orders = [member["order"] for member in members if member]
    return Group(
        name,
        kind,
        members,
        {term: _term(term, values, members, kind) for term, values in terms_of(members).items()},
        {
            "id": name,
            "orders": [member and member["order"] for member in members],
            # the ranges of the numbers of needed terms do not overlap
            "orders_apart": max(order["low"] for order in orders) > min(order["high"] for order in orders),
            **dict.fromkeys(("terms", "scenes"), ()),
        },
        scenes=tuple(_scene(*scene, counts, kind) for scene in aligned(scenes, least=2).items()),
    )


def population_of(term: ClassTerm, of: Class) -> Population:
    """Publish a term over the units of a class."""
    k, n = [entry["name"] for entry in of["terms"]].index(term["name"]), len(of["units"])
    return {
        "needed": (round(term["needed"]["value"] * n), n),
        "share": term["needed"],
        "mean": term["mean"],
        "spread": term["spread"],
        "tested": any(unit["verdicts"][k] != "untested" for unit in of["units"]),
    }


def _term(
    name: str, values: Sequence[ClassTerm | None], members: Sequence[Class | None], kind: Kind
) -> Entry:
    populations = [
        value and of and population_of(value, of) for value, of in zip(values, members, strict=True)
    ]
    tested = [population if population and population["tested"] else None for population in populations]
    means = [population["mean"] if population else None for population in tested]
    pulls = {
        "needed": largest([population["needed"] if population else None for population in tested], fisher),
        "mean": largest([(m["value"], normal_of(m["low"], m["high"])) if m else None for m in means]),
        "spread": largest(
            [log_spread(population["spread"]) if population else None for population in tested]
        ),
    }
    cells = [_cells(population, name, kind) for population in populations]
    return Entry(name, cells, {"name": name, "values": populations}, pulls, missing=populations.count(None))


def _scene(name: str, members: tuple[ClassInScene | None, ...], counts: Sequence[int], kind: Kind) -> Group:
    terms = {}
    for term, values in terms_of(members).items():
        required = [
            value and (round(value["required"] * count), count)
            for value, count in zip(values, counts, strict=True)
        ]
        shares = [value and Share(value["share_of_budget"], *value["share_range"]) for value in values]
        terms[term] = Entry(
            term,
            [
                (percent(count[0] / count[1]), share_range(share)) if count and share else ("not there", "")
                for count, share in zip(required, shares, strict=True)
            ],
            {"name": term, "required": required, "shares": [share and share._asdict() for share in shares]},
            {"": largest(required, fisher)},
            f"{term} (required in {scene_name(name)})",
            divided=len({count >= HALF * of for count, of in filter(None, required)}) > 1,
            shown=any(
                value and (value["required"] or value["share_of_budget"] >= page.LITTLE) for value in values
            ),
        )
    record = {"name": name, "orders": [member and member["order"] for member in members], "terms": ()}
    return Group(name, kind, members, terms, record)


def _answer(compared: Comparison) -> Iterator[str]:
    most = page.most_different((group, with_scenes(group)) for group in compared.groups)
    yield f"{most or f'No class differs beyond uncertainty in {compared.tests} comparisons'}."


def _section(k: int, grade: Group, compared: Comparison) -> Section:
    terms = page.entry_rows(grade.terms.values(), whole=len(compared.groups) == 1)
    orders = [  # numbers of terms: needed, and of the smallest model of each scene
        Row(
            ("" if k else name, label, amid(Share(**member["order"])) if member else "not there"),
            brief=group is grade,
        )
        for name, group in (("needed", grade), *((scene_name(scene.name), scene) for scene in grade.scenes))
        for k, (label, member) in enumerate(zip(LETTERS, group.members, strict=False))
    ]
    blocks = (
        Prose(" ".join(_sentences(grade))),
        page.titled("Model order", grade.name, ORDER_HEAD, orders, "ttt"),
        page.titled("The population", grade.name, HEAD, terms, "tttffn"),
        *(
            page.titled(
                f"Scene {scene_name(scene.name)}",
                grade.name,
                SCENE_HEAD,
                page.entry_rows(scene.terms.values(), whole=False),
                "ttttn",
            )
            for scene in grade.scenes
        ),
    )
    return Section(grade.name, blocks, slug("class", grade.name), f"{grade.kind}s", brief=True)


def _sentences(group: Group) -> Iterator[str]:
    far = [f"{what}, {pull.size:.1f} sd" for what, pull in differing(with_scenes(group))]
    yield f"Beyond uncertainty: {'; '.join(far)}." if far else "Nothing differs beyond uncertainty."
    told = listed(f"{label} {member['order']['value']:.3g}" for label, member in group.there)
    apart = "; the ranges of the units do not overlap" if group.record["orders_apart"] else ""
    yield f"The median unit needs {told} terms{apart}."
    for scene in group.scenes:
        other = [name for name, term in scene.terms.items() if term.divided]
        if other:
            where = f"In the scene {scene_name(scene.name)} the smallest models of most units have"
            yield f"{where} {listed(other)} in one result and not in all."
    yield from page.incomplete(group, len(group.members))


def _cells(value: Population | None, name: str, kind: Kind) -> tuple[Text, ...]:
    if value is None:
        return "not there", "", ""
    if not value["tested"]:
        return "not tested", "", ""
    share, mean, spread = population_texts(value, name, kind)
    return share, mean, spread


def population_texts(value: Population, name: str, kind: Kind) -> tuple[str, str, str]:
    """Share of the units that need a term, its mean and its spread, in the unit that people use."""
    unit = unit_of_term(name, kind)
    mean, spread = (
        str(measured(interval["value"], normal_of(interval["low"], interval["high"]), *unit))
        for interval in (value["mean"], value["spread"])
    )
    return percents(Share(**value["share"])), mean, spread


@cache
def unit_of_term(name: str, kind: Kind) -> tuple[str, float]:
    """Unit in which a term is printed, and its size in SI; no unit where the name is not known.

    Examples
    --------
    >>> unit_of_term("b1", "gyroscope"), unit_of_term("none", "gyroscope")
    (('ppm', 1e-06), ('', 1.0))
    """
    try:
        (term,) = library_of(kind, [name]).terms
    except TermError:
        return "", 1.0
    return unit_of(term)


LOTS = page.Comparing(
    lots_compared,
    "The same classes, terms and scenes: which populations differ beyond uncertainty?",
    _answer,
    "Shares of units are compared by Fisher's exact test, means and spreads of the population by their"
    " intervals, spreads by their logarithms, and the lots as independent: of the same seed they are not. Of"
    " other seeds they are other batches of their class, which may truly differ.",
    _section,
    alone="Classes in one result only",
    item="{1} ({0})",
    keys=("classes", "class"),
    more=lambda compared: {
        "kind": compared.results[0]["lots"]["kind"],
        "units": [result["lots"]["units"] for result in compared.results],
    },
)
