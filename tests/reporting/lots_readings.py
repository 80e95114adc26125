"""What a class-level report says, and where each number of it stands in ``result.json``.

The answers are worked out from the verdicts of the units: a second route to what the report was made from.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator
from typing import Any

from report_reading import (
    Grid,
    Meant,
    Reading,
    agrees,
    drawn,
    fixed,
    grids,
    names,
    number,
    problems,
    quantile,
    sentences,
    tree,
)

from imubayes.reporting.lots_words import class_name, slug
from imubayes.sensors.catalogue import prior_sd, sensor
from imubayes.sensors.terms import library

TRIAD = {"b0", "b1", "m_j", "m_k"}

LIST = r"[A-Za-z]\w*(?:(?:, | and )[A-Za-z]\w*)*"
NUM = r"[\d.,]*\d(?:e-?\d+)?"
SHARE = rf"(?:below )?{NUM} (?:times|%)"


class Lots:
    """A class-level result, by the names that its report uses."""

    def __init__(self, result: dict[str, Any]) -> None:
        lots = result["lots"]
        self.terms: list[str] = lots["terms"]
        self.units: int = lots["units"]
        self.library = library(lots["kind"], powers=5, asymmetry=5, set="extended")
        self.check = lots["check"]
        self.classes = {class_name(sensor(one["id"], kind=lots["kind"])): one for one in lots["classes"]}
        self.named = {one["id"]: name for name, one in self.classes.items()}
        self.scenes = {
            (self.named[one["sensor"]], one["name"].replace("_", " ")): one for one in result["scenes"]
        }
        self.answers = {name: self._answers(one) for name, one in self.classes.items()}
        self.anchors = {slug("class", one["id"]): name for name, one in self.classes.items()} | {
            slug("class", self.classes[name]["id"], one["name"]): (name, scene)
            for (name, scene), one in self.scenes.items()
        }
        self.stages = {slug("scene", one["name"]): scene for (_, scene), one in self.scenes.items()}

    def counts(self, name: str, term: str) -> tuple[int, int, int]:
        """Units that need a term, do not, and leave it open."""
        said = [unit["verdicts"][self.terms.index(term)] for unit in self.classes[name]["units"]]
        needed, idle = said.count("needed"), said.count("not needed")
        return needed, idle, len(said) - needed - idle

    def _answers(self, one: dict[str, Any]) -> dict[str, str]:
        found = {}
        for k, term in enumerate(self.terms):
            said = [unit["verdicts"][k] for unit in one["units"]]
            needed, idle = said.count("needed"), said.count("not needed")
            hidden = len(said) - needed - idle
            found[term] = (
                "cannot tell" if 2 * hidden >= len(said) else "needed" if needed >= idle else "not needed"
            )
        return found

    def of(self, name: str, answer: str) -> list[str]:
        """Terms of which a class has an answer."""
        return [term for term, told in self.answers[name].items() if told == answer]

    def total(self, answer: str) -> int:
        """Count of an answer over the terms of all classes."""
        return sum(len(self.of(name, answer)) for name in self.classes)

    def inside(self, name: str, scene: str, answer: str) -> list[str]:
        """Terms of which a class has an answer in a scene."""
        return [
            one["name"]
            for one in self.scenes[name, scene]["terms"]
            if self._inside(self.answers[name][one["name"]], one) == answer
        ]

    @staticmethod
    def _inside(told: str, one: dict[str, Any]) -> str:
        wanted = one["required"] >= 0.5
        if told == "needed":
            return "needed" if wanted else "not needed"
        matters = wanted or (told == "cannot tell" and one["share_of_budget"] >= 0.1)
        return "would matter" if matters else told

    def loose(self) -> int:
        """Answers that could be others with other units."""
        return sum(self._loose(name, term) for name in self.classes for term in self.terms)

    def _loose(self, name: str, term: str) -> bool:
        needed, idle, hidden = self.counts(name, term)
        low, high = quantile(0.05, 0.95, hidden, self.units)
        if self.answers[name][term] == "cannot tell":
            return bool(low < 0.5)
        return bool(high >= 0.5 or quantile(0.05, 0.95, max(needed, idle), needed + idle)[0] < 0.5)

    def needing(self, scene: str) -> int:
        """Classes that need any term in a scene."""
        return sum(bool(self.inside(name, scene, "needed")) for name in self.classes)


def _status(lots: Lots, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    answers = ("needed", "not needed", "cannot tell")
    return [*(lots.total(answer) for answer in answers), len(lots.terms), len(lots.classes)]


def _simulated(lots: Lots, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    return [lots.units, lots.loose(), len(lots.terms) * len(lots.classes), 90]


def _counted(lots: Lots, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    name = match[1].strip()
    return [None, len(lots.of(name, "needed")), len(lots.of(name, "cannot tell"))]


def _by_every(lots: Lots, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    return [[t for t in lots.terms if all(t in lots.of(name, "needed") for name in lots.classes)]]


def _by_some(lots: Lots, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    """Classes that need some terms, or scenes that require them of half of the classes."""
    owners = (
        {name: set(lots.of(name, "needed")) for name in lots.classes}
        if match[3] == "classes need"
        else {scene: _of_half(lots, scene) for scene in lots.stages.values()}
    )
    some = {owner for owner, terms in owners.items() if set(names(match[4])) <= terms}
    return [len(some), len(owners), None, None]


def _of_half(lots: Lots, scene: str) -> set[str]:
    votes = [term for name in lots.classes for term in lots.inside(name, scene, "needed")]
    return {term for term in votes if 2 * votes.count(term) >= len(lots.classes)}


def _pairs(lots: Lots) -> dict[tuple[str, str], float]:
    return {pair: number(one["basic_share_of_budget"]) for pair, one in lots.scenes.items()}


def _triad(lots: Lots, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    left = _pairs(lots).values()
    return [sum(share <= 1.0 for share in left), len(left)]


def _short(lots: Lots, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    return [sum(share > 1.0 for share in _pairs(lots).values())]


def _in_brackets(lots: Lots, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    """What the triad leaves of a class in a scene, or what its noise takes, by the words before it."""
    text, before = match.string, match.string[: match.start()].rstrip()
    pairs = [pair for pair in lots.scenes if before.endswith(f"{pair[0]} in {pair[1]}")]
    if anchor == "basic":
        owners = [name for name in lots.classes if text.lower().startswith(f"{name.lower()}:")]
        pairs += [pair for pair in lots.scenes if pair[0] in owners and before.endswith(pair[1])]
    if pairs:
        return [_pairs(lots)[max(pairs, key=lambda pair: len(pair[1]))]]
    loud = [name for name in lots.classes if before.endswith(name) and anchor in lots.stages]
    return [lots.scenes[loud[0], lots.stages[anchor]]["noise_share_of_budget"] if loud else math.nan]


def _covered(lots: Lots, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    one = lots.check[f"population_{match[1]}"]
    return [None, one["held"], one["of"], *(100.0 * end for end in _range_of(one["share"]))]


def _missed(lots: Lots, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    short = [pair for pair, share in _pairs(lots).items() if share > 1.0]
    return [sorted({t for pair in short for t in lots.inside(*pair, "needed")} - TRIAD)]


def _basic(lots: Lots, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    left = _pairs(lots)
    worst = max(left, key=lambda pair: left[pair])
    within = sum(one["within"] >= 0.5 for one in lots.scenes.values())
    told = match[4] == f"{worst[0]} in {worst[1]}"
    return [sum(s <= 1.0 for s in left.values()), len(left), within, None, left[worst] if told else math.nan]


def _truth(lots: Lots, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    every = [pair for pair in lots.scenes for _ in lots.terms]
    untold = sum(
        len(lots.inside(*pair, answer)) for pair in lots.scenes for answer in ("cannot tell", "would matter")
    )
    true = lots.check["cells"][1]
    sizes = [float(lots.check[what][end]) if lots.check[what]["value"] is not None else None
             for what in ("precision", "recall") for end in ("value", "low", "high")]  # fmt: skip
    return [len(every) - untold, true, 10, *sizes, untold]


def _in_scene(lots: Lots, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    """Largest share, of 95 % of the units, of what the classes that do not need these terms spend on them."""
    named = [scene for scene in lots.stages.values() if f"In the scene {scene} " in match[1]]
    scene = max(named, key=len) if named else lots.stages[anchor]
    without = [name for name in lots.classes if name in re.split(r", | and ", match[3])]
    terms = [t for t in lots.terms if t in re.findall(r"\w+", match[2])]
    most = max(
        one["share_range"][1]
        for name in without
        for one in lots.scenes[name, scene]["terms"]
        if one["name"] in terms
    )
    return [None, None, None, 95, max(most, 1e-3)]


def _every(lots: Lots, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    needed = [set(lots.of(name, "needed")) for name in lots.classes]
    return [len(set.intersection(*needed)), len(lots.terms)]


def _orders(lots: Lots, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    orders = [float(one["order"]["value"]) for one in lots.classes.values()]
    named = [lots.classes[match[k]]["order"]["value"] for k in (2, 4)]
    right = named == [max(orders), min(orders)]
    return [max(orders) if right else math.nan, None, min(orders) if right else math.nan, None]


def _needed_alt(lots: Lots, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    name = match[1].strip()
    return [None, lots.of(name, "needed"), len(lots.of(name, "cannot tell"))]


def _range_of(one: dict[str, float]) -> list[float]:
    return [float(one[end]) for end in ("value", "low", "high")]


def _order_alt(lots: Lots, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    return [None, *_range_of(lots.classes[match[1].strip()]["order"])]


def _cell(lots: Lots, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    needed, _, hidden = lots.counts(match[2], match[1])
    low, high = (100.0 * end for end in quantile(0.05, 0.95, needed, lots.units))
    return [None, None, needed / lots.units, low, high, hidden / lots.units]


def _population(lots: Lots, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    one = lots.classes[_class(lots, anchor)]
    term = next(term for term in lots.library.terms if term.name == match[1])
    mean = one["terms"][lots.terms.index(match[1])]["mean"]["value"]
    return [None, mean / prior_sd(sensor(one["id"], kind=lots.library.kind), term)[0]]


def _modelled(lots: Lots, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    return [lots.needing(match[3]), len(lots.classes), None]


def _needs_model(lots: Lots, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    name = lots.anchors[anchor]
    scenes = [scene for owner, scene in lots.scenes if owner == name]
    return [sum(bool(lots.inside(str(name), scene, "needed")) for scene in scenes), len(scenes)]


def _scene_cell(lots: Lots, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    place = (match[2], lots.stages[anchor]) if anchor in lots.stages else (_class(lots, anchor), match[2])
    one = next(t for t in lots.scenes[place]["terms"] if t["name"] == match[1])
    right = match[1] in lots.inside(*place, match[3])
    return [None, None, None, one["share_of_budget"] if right else math.nan, one["required"]]


def _class(lots: Lots, anchor: str) -> str:
    place = lots.anchors[anchor]
    return place if isinstance(place, str) else place[0]


def _of_class(lots: Lots, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    needed = lots.of(_class(lots, anchor), "needed")
    return [needed, len(needed), len(lots.terms)]


def _untold(lots: Lots, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    hidden = lots.of(_class(lots, anchor), "cannot tell")
    return [len(hidden), hidden]


def _single(lots: Lots, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    return [*_range_of(lots.classes[_class(lots, anchor)]["order"]), 90]


def _shared(lots: Lots, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    name = _class(lots, anchor)
    held = [
        term
        for term in lots.classes[name]["terms"]
        if term["name"] in lots.of(name, "needed") and term["mean"]["low"] * term["mean"]["high"] > 0.0
    ]
    return [len(held), len(lots.terms)]


def _here(lots: Lots, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    needed = lots.inside(*_place(lots, anchor), "needed")
    return [needed, len(needed)]


def _scene(lots: Lots, anchor: str) -> dict[str, Any]:
    return lots.scenes[_place(lots, anchor)]


def _place(lots: Lots, anchor: str) -> tuple[str, str]:
    """Class and scene of an anchor."""
    place = lots.anchors[anchor]
    assert not isinstance(place, str)
    return place


READINGS = (
    Reading(
        r"(\d+) needed · (\d+) not needed · (\d+) cannot tell"
        r" \((\d+) terms of (?:each of )?(\d+) class(?:es)?\)",
        _status,
    ),
    Reading(
        r"one lot of (\d+) \w+ of each class\. With other units of these lots (\d+) of the (\d+) answers"
        r" could change \((\d+) % intervals\)",
        _simulated,
    ),
    Reading(r"Every class needs (LIST)\.".replace("LIST", LIST), _by_every),
    Reading(rf"(\d+) of (\d+) (classes need|scenes require) ({LIST})\.", _by_some),
    Reading(r"In (\d+) of (\d+) pairs of class and scene, yes", _triad),
    Reading(r"In (\d+), no:", _short),
    Reading(rf"\(({SHARE}) (?:of )?the budget\)", _in_brackets),
    Reading(rf"There ({LIST}) (?:is|are) needed too", _missed),
    Reading(r"Of (\d+) terms:", lambda lots, match, anchor: [len(lots.terms)]),
    Reading(r"(?:: |; )([\w ]+?) needs (\d+), cannot tell (\d+)", _counted),
    Reading(
        r"basic triad of 12 parameters leaves less than the budget in (\d+) of (\d+) pairs of class and"
        rf" scene, a model of the generalized terms in (\d+); the triad's worst is ([\w ,]+), ({SHARE})",
        _basic,
    ),
    Reading(
        r"over ([\d,]+) cells of class, term and scene that the tests tell, of which ([\d,]+) truly take"
        r" (10) % of the budget or more, precision is (?:undefined|([\d.]+) \(([\d.]+) to ([\d.]+)\)) and"
        r" recall (?:undefined|([\d.]+) \(([\d.]+) to ([\d.]+)\))\."
        r"(?: Of ([\d,]+) more cells the tests cannot tell\.)?",
        _truth,
    ),
    Reading(
        r"([^.;]*) needs? ([^.;]+); ([^.;:]+?) (?:does|do) not: in (\d+) % of the units (?:it|each) takes"
        rf" less than ({SHARE}) (?:of )?the budget",
        _in_scene,
    ),
    Reading(r"^(\d+) of (\d+) terms are needed by every class$", _every),
    Reading(r"^The median unit needs ([\d.]+) terms of ([\w ]+), ([\d.]+) of ([\w ]+)$", _orders),
    Reading(r"(?:that the tests cannot tell: |; )([\w ]+): ([\w ]+), cannot tell (\d+)", _needed_alt),
    Reading(rf"(?:% of the units: |; )([A-Za-z][\w ]*?) ({NUM}) \(({NUM}) to ({NUM})\)", _order_alt),
    Reading(
        rf"^(\w+), ([\w ]+): needed in ({NUM} %) \(({NUM}) to ({NUM})\) of the units, open in ({NUM} %)$",
        _cell,
    ),
    Reading(rf"(?:typical size: |; )(\w+) (-?{NUM})(?=;|$)", _population),
    Reading(r"^(\d+) of (\d+) class(?:es)? needs? a model in the scene (.+)$", _modelled),
    Reading(r"needs a model in (\d+) of (\d+) scenes?$", _needs_model),
    Reading(
        rf"^(\w+), (.+): (needed|not needed|cannot tell|would matter), ({SHARE}) (?:of )?the budget,"
        rf" in the smallest model of ({NUM} %)$",
        _scene_cell,
    ),
    Reading(rf"^The class needs ({LIST}|no term), (\d+) of (\d+) terms\.", _of_class),
    Reading(rf"Of (\d+) the tests cannot tell: ({LIST})\.", _untold),
    Reading(
        rf"A single unit needs ({NUM}) \(({NUM}) to ({NUM})\) \(median, and (90) % of the units\)", _single
    ),
    Reading(r"^(\d+) of (\d+) terms are needed, and have a mean that all units share$", _shared),
    Reading(rf"^The class needs ({LIST}) here \((\d+)\)", _here),
    Reading(
        rf"the smallest model has ({NUM}) \(({NUM}) to ({NUM})\) terms \(median, and (90) % of the units\)",
        lambda lots, match, anchor: [*_range_of(_scene(lots, anchor)["order"]), 90],
    ),
    Reading(
        rf"Noise comes to ({SHARE}) (?:of )?the budget",
        lambda lots, match, anchor: [_scene(lots, anchor)["noise_share_of_budget"]],
    ),
    Reading(
        rf"({NUM} %) of the units have a model that stays within the budget with (95) %",
        lambda lots, match, anchor: [float(_scene(lots, anchor)["within"]), None],
    ),
    Reading(
        rf"The basic triad leaves ({SHARE}) (?:of )?the budget",
        lambda lots, match, anchor: [number(_scene(lots, anchor)["basic_share_of_budget"])],
    ),
    Reading(
        rf"population (spread|mean) in ([\d,]+) of ([\d,]+) cases, ({NUM}) % \(({NUM}) to ({NUM})\)", _covered
    ),
    fixed(r"reach the (0\.95) that was asked"),
    fixed(r"asked were (86) to (94) %"),
    fixed(r"The (90) % intervals hold"),
    fixed(r"Intervals hold (90) %"),
    fixed(r"inputs beyond (1) g"),
    fixed(r"its mean with (90) %|posterior with (90) % intervals"),
    fixed(r"median unit, and (5) to (95) % of the units"),
    fixed(r"(12) parameters"),
    fixed(r"(90) % of the units"),
    fixed(r"in (95) % of the units or more"),
    fixed(r"below (10?) %"),
    fixed(r"^(0): without any term|\. (0): without any term"),
)  # fmt: skip


def wrong_cells(grid: Grid, lots: Lots) -> Iterator[str]:
    """Cells of the tables of answers, and of sizes of models, that are not those of the result."""
    if grid.anchor == "order":
        for row in grid.rows:
            for name, said in zip(grid.head[1:], row[1:], strict=True):
                one = lots.classes[name] if row[0] == "needed" else lots.scenes[name, row[0]]
                meant = _range_of(one["order"])
                said_numbers = re.findall(NUM, said)
                if not all(agrees(text, value) for text, value in zip(said_numbers, meant, strict=True)):
                    yield f"#order: {name}, {row[0]}: '{said}' is {meant} in the result"
    elif grid.head[-1] == "class" and grid.anchor in lots.anchors:
        place = lots.anchors[grid.anchor]
        for row in grid.rows:
            told = (
                lots.answers[place][row[0]]
                if isinstance(place, str)
                else next(a for a in ANSWERS if row[0] in lots.inside(*place, a))
            )
            if row[-1] != told:
                yield f"#{grid.anchor}: {row[0]}: '{row[-1]}' is '{told}' in the result"
            if not isinstance(place, str):
                yield from _wrong_shares(grid.anchor, row, lots.scenes[place])


def _wrong_shares(anchor: str, row: tuple[str, ...], scene: dict[str, Any]) -> Iterator[str]:
    """Shares of a budget, of a term's row in the table of a scene, that are not those of the result."""
    one = next(term for term in scene["terms"] if term["name"] == row[0])
    meant = [one["share_of_budget"], *one["share_range"], one["true_share_of_budget"], one["required"]]
    said = re.findall(SHARE, " ".join(row[2:5]))
    if len(said) != len(meant) or not all(map(agrees, said, meant)):
        yield f"#{anchor}: {row[0]}: {said} is {meant} in the result"


FIRST = 3
"""Paragraphs of the first screen: the answer, how many there are of each, and what it was simulated from."""

ANSWERS = ("needed", "not needed", "cannot tell", "would matter")


def told_twice(result: dict[str, Any], lots: Lots) -> Iterator[str]:
    """Answers that ``result.json`` itself gives, where its units' verdicts give others."""
    for name, one in lots.classes.items():
        said = {term["name"]: term.get("answer") for term in one["terms"]}
        if said != lots.answers[name]:
            yield f"{name}: {said}"
        for key in ("needed", "not needed", "cannot tell"):
            if one.get(key.replace(" ", "_")) != lots.of(name, key):
                yield f"{name}: {key}: {one.get(key.replace(' ', '_'))}"
    for (name, scene), one in lots.scenes.items():
        for key, answer in (
            ("model", "needed"),
            ("would_matter", "would matter"),
            ("cannot_tell", "cannot tell"),
        ):
            if one.get(key) != lots.inside(name, scene, answer):
                yield f"{name} in {scene}: {key}: {one.get(key)}"


def wrong_lots(html: str, result: dict[str, Any]) -> list[str]:
    """What a class-level report says that its result does not; how it was made is not looked at."""
    page, lots = tree(html), Lots(result)
    first = [block for block in sentences(page) if block.anchor == "first"]
    missing = [] if len(first) == FIRST else [f"#first: {len(first)} paragraphs"]
    said = [block for block in (*sentences(page), *drawn(page)) if block.anchor != "repeat"]
    wrong = [one for grid in grids(page) for one in wrong_cells(grid, lots)]
    return [*missing, *told_twice(result, lots), *problems(said, READINGS, lots), *wrong]
