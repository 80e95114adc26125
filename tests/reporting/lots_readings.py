"""What a class-level report says, and where each number of it stands in ``result.json``.

The answers are worked out from the verdicts of the units: a second route to what the report was made from.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from report_reading import (
    Grid,
    Meant,
    Reading,
    agrees,
    drawn,
    fixed,
    grids,
    named,
    names,
    number,
    problems,
    quantile,
    readings,
    sentences,
    tree,
    walked,
)
from scipy.stats import betabinom

from imubayes.population.records import STEPS
from imubayes.reporting.lots_words import class_name, slug
from imubayes.sensors.catalogue import sensor
from imubayes.sensors.terms import library

TRIAD = {"b0", "b1", "m_j", "m_k"}

LIST = r"[A-Za-z][\w*]*(?:(?:, | and )[A-Za-z][\w*]*)*"
NUM = r"[\d.,]*\d(?:e-?\d+)?"
SHARE = rf"(?:below )?{NUM} (?:times|%)"


class Lots:
    """A class-level result, by the names that its report uses."""

    def __init__(self, result: dict[str, Any]) -> None:
        self.result, lots = result, result["lots"]
        self.terms: list[str] = lots["terms"]
        self.units: int = lots["units"]
        self.lots: int = lots.get("lots", 1)
        self.library = library(lots["kind"], powers=5, asymmetry=5, set="extended", temperature=2)
        self.check = lots["check"]
        self.methods = {one["method"]: one for one in lots.get("methods", ())}
        self.statements = lots.get("statements", ())
        self.classes = {class_name(sensor(one["id"], kind=lots["kind"])): one for one in lots["classes"]}
        self.called = {one["id"]: name for name, one in self.classes.items()}
        self.scenes = {
            (self.called[one["sensor"]], one["name"].replace("_", " ")): one for one in result["scenes"]
        }
        self.answers = {name: self._answers(one) for name, one in self.classes.items()}
        self.anchors = {
            slug("class", one["id"], *part): name
            for name, one in self.classes.items()
            for part in ((), ("population",))
        } | {
            slug("class", self.classes[name]["id"], one["name"]): (name, scene)
            for (name, scene), one in self.scenes.items()
        }
        self.stages = {
            slug("scene", one["name"], *part): scene
            for (_, scene), one in self.scenes.items()
            for part in ((), ("further",))
        }

    def of_title(self, title: str) -> str:
        """Name of the class that a page of its own has as title."""
        return next(name for name in self.classes if name[1:] == title[1:])

    def counts(self, name: str, term: str) -> list[tuple[int, int, int]]:
        """Units that need a term, do not, and leave it open, of each lot."""
        said = [unit["verdicts"][self.terms.index(term)] for unit in self.classes[name]["units"]]
        found = []
        for first in range(0, len(said), self.units):
            lot = said[first : first + self.units]
            needed, idle = lot.count("needed"), lot.count("not needed")
            found.append((needed, idle, len(lot) - needed - idle))
        return found

    @staticmethod
    def ends(counts: Sequence[int], units: Sequence[int]) -> tuple[float, float]:
        """90 % interval of a share of units: of one lot Jeffreys', of several that of a beta-binomial."""
        if len(counts) == 1 or not sum(units):
            return quantile(0.05, 0.95, counts[0] if sum(units) else 0, units[0])
        share, correlation = np.meshgrid((np.arange(500) + 0.5) / 500, (np.arange(30) + 0.5) / 30)
        spread = 1.0 / correlation - 1.0
        chance = np.prod(
            [
                betabinom.pmf(k, n, share * spread, (1.0 - share) * spread)
                for k, n in zip(counts, units, strict=True)
            ],
            axis=0,
        ).sum(axis=0)
        reached = np.cumsum(chance) - 0.5 * chance
        low, high = np.interp([0.05, 0.95], reached / chance.sum(), share[0]).tolist()
        return (low if any(counts) else 0.0), (high if sum(counts) < sum(units) else 1.0)

    def _answers(self, one: dict[str, Any]) -> dict[str, str]:
        found = {}
        for k, term in enumerate(self.terms):
            said = [unit["verdicts"][k] for unit in one["units"]]
            needed, idle = said.count("needed"), said.count("not needed")
            hidden = len(said) - needed - idle
            pooled = one["terms"][k].get("pooled", {"inclusion": 0.0})
            together = pooled["inclusion"] >= 0.95 and pooled["share"]["value"] >= 0.5
            shown = "needed" if together else "cannot tell"
            found[term] = shown if 2 * hidden >= len(said) else "needed" if needed >= idle else "not needed"
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
        needed, idle, hidden = zip(*self.counts(name, term), strict=True)
        low, high = self.ends(hidden, [self.units] * self.lots)
        if self.answers[name][term] == "cannot tell":
            return bool(low < 0.5)
        if 2 * sum(hidden) >= self.units * self.lots:
            return bool(named(self.classes[name]["terms"], term)["pooled"]["share"]["low"] < 0.5)
        most = needed if self.answers[name][term] == "needed" else idle
        told = [k + n for k, n in zip(needed, idle, strict=True)]
        return bool(high >= 0.5 or self.ends(most, told)[0] < 0.5)

    def harmless(self, name: str) -> list[str]:
        """Terms that a class cannot tell, and that take little of every scene at the limit of all units."""
        most: dict[str, list[float]] = {}
        for (owner, _), scene in self.scenes.items():
            for one in scene["terms"] if owner == name else ():
                most.setdefault(one["name"], []).append(one["most_of_budget"])
        return [term for term in self.of(name, "cannot tell") if max(most[term]) < 0.1]

    def needing(self, scene: str) -> int:
        """Classes that need any term in a scene."""
        return sum(bool(self.inside(name, scene, "needed")) for name in self.classes)


ANSWERS = ("needed", "not needed", "cannot tell", "would matter")
Match = re.Match[str]
Pair = tuple[str, str]
"""A class and a scene."""


def _by_some(lots: Lots, match: Match) -> Iterable[Meant]:
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


def _pairs(lots: Lots) -> dict[Pair, float]:
    """What the basic triad leaves in each scene, over the budget."""
    return {pair: number(one["basic_share_of_budget"]) for pair, one in lots.scenes.items()}


def _within(lots: Lots) -> int:
    return sum(share <= 1.0 for share in _pairs(lots).values())


def _in_brackets(lots: Lots, match: Match, anchor: str) -> Iterable[Meant]:
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


def _covered(lots: Lots, match: Match) -> Iterable[Meant]:
    return [None, *_coverage(lots, f"population_{match[1]}")]


def _coverage(lots: Lots, what: str) -> list[float]:
    one = lots.check[what]
    return [one["held"], one["of"], *(100.0 * end for end in _range_of(one["share"]))]


def _statements(lots: Lots, match: Match) -> list[float | None]:
    told = [one["verdict"] for one in lots.statements]
    counts = [told.count(verdict) for verdict in ("confirmed", "contradicted", "beyond the test")]
    return [len(told), *(count or None for count in counts)]


def _missed(lots: Lots, match: Match) -> Iterable[Meant]:
    short = [pair for pair, share in _pairs(lots).items() if share > 1.0]
    return [sorted({t for pair in short for t in lots.inside(*pair, "needed")} - TRIAD)]


def _basic(lots: Lots, match: Match) -> Iterable[Meant]:
    left = _pairs(lots)
    worst = max(left, key=lambda pair: left[pair])
    told = match[3] == f"{worst[0]} in {worst[1]}"
    return [_within(lots), len(left), None, left[worst] if told else math.nan]


def _truth(lots: Lots, match: Match) -> Iterable[Meant]:
    untold = sum(
        len(lots.inside(*pair, answer)) for pair in lots.scenes for answer in ("cannot tell", "would matter")
    )
    sizes = [
        None if lots.check[what]["value"] is None else float(lots.check[what][end])
        for what in ("precision", "recall")
        for end in ("value", "low", "high")
    ]
    return [len(lots.scenes) * len(lots.terms) - untold, lots.check["cells"][1], 10, *sizes, untold]


def _in_scene(lots: Lots, match: Match, anchor: str) -> Iterable[Meant]:
    """Largest share, of 95 % of the units, of what the classes that do not need these terms spend on them."""
    told = [scene for scene in lots.stages.values() if f"In the scene {scene} " in match[1]]
    scene = max(told, key=len) if told else lots.stages[anchor]
    without = [name for name in lots.classes if name in re.split(r", | and ", match[3])]
    most = max(
        one["share_range"][1]
        for name in without
        for one in lots.scenes[name, scene]["terms"]
        if one["name"] in re.findall(r"[\w*]+", match[2])
    )
    return [None, None, None, 95, max(most, 1e-3)]


def _unnamed(lots: Lots, match: Match, anchor: str) -> Iterable[Meant]:
    """How many terms, beside those that are named, exactly these classes need in a scene."""
    told = [scene for scene in lots.stages.values() if match[1].startswith(f"In the scene {scene} ")]
    scene = max(told, key=len) if told else lots.stages[anchor]
    owners = {name.lower() for name in re.split(r", | and ", match[1].removeprefix(f"In the scene {scene} "))}
    needing = {
        term: {n.lower() for n in lots.classes if term in lots.inside(n, scene, "needed")}
        for term in lots.terms
    }
    return [None, None, sum(each == owners for each in needing.values()) - len(match[2].split(", "))]


def _by_any(lots: Lots) -> set[str]:
    """Terms that a class needs in a scene; of itself without scenes."""
    if not lots.scenes:
        return {term for name in lots.classes for term in _needed(lots, name)}
    return {term for place in lots.scenes for term in lots.inside(*place, "needed")}


def _tile(lots: Lots, said: tuple[int, int]) -> tuple[float, float]:
    """Terms needed and that would matter, where a class in a scene has so many."""
    pairs = [tuple(len(lots.inside(*place, a)) for a in ("needed", "would matter")) for place in lots.scenes]
    return said if said in pairs else (math.nan, math.nan)


def _others(lots: Lots) -> list[dict[str, Any]]:
    return [one for name, one in lots.methods.items() if name != "evidence"]


def _asked(lots: Lots, each: str | None) -> list[Meant]:
    """Other methods, units that they were asked about, all units, and units of each lot."""
    per_lot = sum(bool(one.get("methods")) for one in lots.classes.values()) * lots.lots
    units = max(one["units"] for one in lots.methods.values())
    whole = len(lots.classes) * lots.lots * lots.units
    return [len(_others(lots)), units, whole, None if each is None else units // per_lot]


def _shared(lots: Lots) -> list[Meant]:
    told = [one for one in _others(lots) if one["of"]]
    shares = [one["share"]["value"] for one in told]
    counts = [sum(one["keeps"].values()) + sum(one["drops"].values()) for one in told]
    of = sum(one["of"] for one in told)
    return [1.0 - sum(counts) / of, None, min(shares), None, max(shares)]


def _range_of(one: dict[str, float]) -> list[float]:
    return [float(one[end]) for end in ("value", "low", "high")]


def _scene_cell(lots: Lots, match: Match, anchor: str) -> Iterable[Meant]:
    place = (match[2], lots.stages[anchor]) if anchor in lots.stages else (_class(lots, anchor), match[2])
    one = named(lots.scenes[place]["terms"], match[1])
    right = match[1] in lots.inside(*place, match[3])
    return [None, None, None, one["share_of_budget"] if right else math.nan, one["required"]]


def _class(lots: Lots, anchor: str) -> str:
    place = lots.anchors[anchor]
    return place if isinstance(place, str) else place[0]


def _needed(lots: Lots, name: str) -> list[str]:
    return lots.of(name, "needed")


OF_CLASS = readings(
    {
        rf"^The class needs ({LIST}|no term), (\d+) of (\d+) terms\.": lambda of, m: [
            found := _needed(*of), len(found), len(of[0].terms)
        ],
        rf"Of (\d+) the tests cannot tell: ({LIST})\.": lambda of, m: [
            len(found := of[0].of(of[1], "cannot tell")), found
        ],
        rf"Whatever they are, ({LIST}) takes? less than (10) % of every scene's budget": lambda of, m: [
            of[0].harmless(of[1]), 10
        ],
        rf"A single unit needs ({NUM}) \(({NUM}) to ({NUM})\) \(median, and (90) % of the units\)":
            lambda of, m: [*_range_of(of[0].classes[of[1]]["order"]), 90],
    },
    lambda lots, match, anchor: (lots, _class(lots, anchor)),
)  # fmt: skip
"""Of a class, by its anchor."""

OF_PAIR = readings(
    {
        rf"^The class needs ({LIST}|no term) here \((\d+)\)":
            lambda of, m: [found := of[0].inside(*of[1], "needed"), len(found)],
        rf"the smallest model has ({NUM}) \(({NUM}) to ({NUM})\) terms \(median, and (90) % of the units\)":
            lambda of, m: [*_range_of(of[0].scenes[of[1]]["order"]), 90],
        rf"with a calibration over the inputs of the test ({NUM}) \(({NUM}) to ({NUM})\)":
            lambda of, m: [*_range_of(of[0].scenes[of[1]]["tested_order"])],
        rf"Noise comes to ({SHARE}) (?:of )?the budget":
            lambda of, m: [of[0].scenes[of[1]]["noise_share_of_budget"]],
        rf"({NUM} %) of the units have a model that stays within the budget with (95) %":
            lambda of, m: [float(of[0].scenes[of[1]]["within"]), None],
    },
    lambda lots, match, anchor: (lots, lots.anchors[anchor]),
)  # fmt: skip
"""Of a class in a scene, by its anchor."""


def _alone(lots: Lots, match: Match, anchor: str) -> Lots:
    """What a page of a class is about; the whole result elsewhere."""
    owner = lots.anchors.get(anchor)
    if not isinstance(owner, str):
        return lots
    own = lots.classes[owner]
    scenes = [one for one in lots.result["scenes"] if one["sensor"] == own["id"]]
    return Lots({**lots.result, "lots": {**lots.result["lots"], "classes": [own]}, "scenes": scenes})


OF_ALL = readings(
    {
        r"(\d+) needed · (\d+) not needed · (\d+) cannot tell"
        r" \((\d+) terms of (?:each of )?(\d+) class(?:es)?\)":
            lambda r, m: [*(r.total(answer) for answer in ANSWERS[:3]), len(r.terms), len(r.classes)],
        r"one lot of (\d+) \w+ of each class\. With other units of these lots (\d+) of the (\d+) answers"
        r" could change \((\d+) % intervals\)":
            lambda r, m: [r.units, r.loose(), len(r.terms) * len(r.classes), 90],
        r"Simulated: (\d+) lots of (\d+) \w+ of each class, with magnitudes drawn over the class's range\."
        r" With other lots (\d+) of the (\d+) answers could change \((\d+) % intervals\)":
            lambda r, m: [r.lots, r.units, r.loose(), len(r.terms) * len(r.classes), 90],
        rf"Every class needs ({LIST})\.":
            lambda r, m: [[t for t in r.terms if all(t in _needed(r, name) for name in r.classes)]],
        rf"(\d+) of (\d+) (classes need|scenes require) ({LIST})\.": _by_some,
        r"In (\d+) of (\d+) pairs of class and scene, yes": lambda r, m: [_within(r), len(r.scenes)],
        r"In (\d+), no:": lambda r, m: [sum(share > 1.0 for share in _pairs(r).values())],
        rf"There ({LIST}) (?:is|are) needed too": _missed,
        r"Of (\d+) terms:": lambda r, m: [len(r.terms)],
        rf"^(.+): The class needs ({LIST}|no term), (\d+) of (\d+) terms\.":
            lambda r, m: [None, found := _needed(r, r.of_title(m[1])), len(found), len(r.terms)],
        r"(?:: |; )([\w ]+?) needs (\d+), cannot tell (\d+)":
            lambda r, m: [None, len(_needed(r, m[1].strip())), len(r.of(m[1].strip(), "cannot tell"))],
        r"basic triad of 12 parameters lacks stays within the budget in (\d+) of (\d+) pairs of class and"
        rf" scene; its worst is ([\w ,]+), ({SHARE})":
            _basic,
        r"over ([\d,]+) cells of class, term and scene that the tests tell, of which ([\d,]+) truly take"
        r" (10) % of the budget or more, precision is (?:undefined|([\d.]+) \(([\d.]+) to ([\d.]+)\)) and"
        r" recall (?:undefined|([\d.]+) \(([\d.]+) to ([\d.]+)\))\."
        r"(?: Of ([\d,]+) more cells the tests cannot tell\.)?": _truth,
        r"^(\d+) of (\d+) terms are needed by .*?(?: in some scene)?$":
            lambda r, m: [len(_by_any(r)), len(r.terms)],
        r"^(\d+) \+(\d+)\?$": lambda r, m: [*_tile(r, (int(m[1]), int(m[2])))],
        r"^(\d+) other methods? were asked about (\d+) of the (\d+) units"
        r" \(the first (?:(\d+) )?of each lot\)":
            lambda r, m: _asked(r, m[4]),
        r"were asked about (\d+), the first of each class .* R-hat is ([\d.]+) at most, after (\d+) steps":
            lambda r, m: [r.methods["collapsed"]["units"], None, STEPS],
        r"zero with (95) %": lambda r, m: [95],
        rf"They share ({NUM} %) of the decision's sure .*: least ([\w-][\w -]*) with ({NUM} %), most"
        rf" ([\w-][\w -]*) with ({NUM} %)": lambda r, m: _shared(r),
        r"^(\d+) of (\d+) class(?:es)? needs? a model in the scene (.+)$":
            lambda r, m: [r.needing(m[3]), len(r.classes), None],
        rf"population (spread|mean) in ([\d,]+) of ([\d,]+) cases, ({NUM}) % \(({NUM}) to ({NUM})\)":
            _covered,
        r"^Of (\d+) published statements on these classes (?:(\d+) (?:is|are) confirmed)?(?:, | and )?"
        r"(?:(\d+) (?:is|are) contradicted)?(?:, | and )?(?:(\d+) (?:is|are) beyond the test)?": _statements,
        rf"Where a term takes (1) % .* (the true one) in ([\d,]+) of ([\d,]+) cases, ({NUM}) %"
        rf" \(({NUM}) to ({NUM})\), and a unit's own (90) % interval its own in ([\d,]+) of ([\d,]+) cases,"
        rf" ({NUM}) % \(({NUM}) to ({NUM})\); by the linear .* truth in ([\d,]+) of ([\d,]+) cases, ({NUM}) %"
        rf" \(({NUM}) to ({NUM})\)":
            lambda r, m: [
                1, None, *_coverage(r, "shares"), 90, *_coverage(r, "unit_shares"),
                *_coverage(r, "linear_shares"),
            ],
        rf"in cells within the budget: ({SHARE}) in the median, ({SHARE}) at most":
            lambda r, m: list(r.check["off"]),
    },
    _alone,
)  # fmt: skip

READINGS = (
    *OF_ALL,
    *OF_CLASS,
    *OF_PAIR,
    Reading(rf"\(({SHARE}) (?:of )?the budget\)", _in_brackets),
    Reading(
        r"([^.;]*) needs? ([^.;]+); ([^.;:]+?) (?:does|do) not: in (\d+) % of the units (?:it|each) takes"
        rf" less than ({SHARE}) (?:of )?the budget",
        _in_scene,
    ),
    Reading(r"([^.;:]*?) needs? ([\w*, ]+) and (\d+) more", _unnamed),
    Reading(
        rf"^([\w*]+), (.+): (needed|not needed|cannot tell|would matter), ({SHARE}) (?:of )?the budget,"
        rf" in the smallest model of ({NUM} %)$",
        _scene_cell,
    ),
    *fixed(
        r"reach the (0\.95) that was asked",
        r"asked were (86) to (94) %",
        r"(?:The (90) % intervals|Intervals) hold(?: (90) %)?",
        r"inputs beyond (1) g",
        r"its mean with (90) %|posterior with (90) % intervals",
        r"median unit, and (5) to (95) % of the units",
        r"(12) parameters",
        r"(90) % of the units",
        r"below (10?) %",
        r"stays below (10) % of every scene's budget with (95) %",
        r"stays below with (95) %",
        r"hierarchical posterior with (90) % intervals",
        r"^(0): without any term|\. (0): without any term",
    ),
)


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
    elif grid.anchor == "methods":
        for row, one in zip(grid.rows, lots.methods.values(), strict=True):
            said = [re.search(NUM, text)[0] for text in (row[-5], *re.split(" of ", " of ".join(row[-2:])))]
            meant = [100.0 * one["share"]["value"], *one["false"], *one["missed"]]
            if not all(map(agrees, said, meant)):
                yield f"#methods: {row[0]}: {said} is {meant} in the result"
    elif grid.head[-1] == "verdict":
        for row, one in zip(grid.rows, lots.statements, strict=True):
            if row[:2] != (one["text"], one["source"]) or not row[-1].startswith(one["verdict"]):
                yield f"#{grid.anchor}: {row} is {one} in the result"
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


FIRST = 5
"""Paragraphs of the first screen: the answer, two with the picture, how many there are of each, what it was
simulated from."""


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
    part = any(node.tag == "h1" and node.get("id") for _, node in walked(page))
    missing = [] if part or len(first) == FIRST else [f"#first: {len(first)} paragraphs"]
    said = [block for block in (*sentences(page), *drawn(page)) if block.anchor != "repeat"]
    wrong = [one for grid in grids(page) for one in wrong_cells(grid, lots)]
    return [*missing, *told_twice(result, lots), *problems(said, READINGS, lots), *wrong]
