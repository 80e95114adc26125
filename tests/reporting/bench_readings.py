"""What the reports of a plan and of a fleet say, and where each number of it stands in ``result.json``."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from typing import Any

from report_reading import Meant, Reading, fixed
from tool_readings import NUM, PERCENT, wrong_numbers

from imubayes.reporting.rounding import per_unit

LASTING = rf"{NUM} (?:s|min|h)(?: {NUM} min)?"


def _lasting(said: str) -> float:
    """Seconds of a time in words."""
    sizes = {"s": 1.0, "min": 60.0, "h": 3600.0}
    return sum(
        float(n.replace(",", "")) * sizes[unit] for n, unit in re.findall(r"([\d.,]+) (s|min|h)", said)
    )


# A plan


def wrong_plan(html: str, result: dict[str, Any]) -> list[str]:
    """What a page of a plan says that its result does not; the steps stand in its tables."""
    return wrong_numbers(
        html,
        result,
        (*PLAN, fixed(rf"^({re.escape(result['plan']['sensor'])}): ")),
        told=lambda block: None if block.anchor in ("plan", "next") else block,
    )


def _plan(result: Any, name: str) -> dict[str, Any]:
    return next(one for one in result["plan"]["plans"] if one["name"] == name)


def _time(plan: dict[str, Any], said: str) -> Meant:
    """Dwells' time, as the words round it: to the minute."""
    found = _lasting(said)
    step = 60.0 if found >= 600.0 else 1.0
    return None if abs(found - plan["seconds"]) <= 0.5 * step + 1e-6 else math.nan


def _best(result: Any, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    best = _plan(result, "best")
    right = _time(best, match[2]) is None and best["worst"] == match[3]
    return [
        len(best["steps"]),
        None if right else math.nan,
        None,
        len(result["plan"]["needed"]),
        best["worst_ratio"],
    ]


def _gain(result: Any, name: str) -> float:
    return abs(1.0 - _plan(result, name)["worst_ratio"] / _plan(result, "even")["worst_ratio"])


def _even(result: Any, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    even = _plan(result, "even")
    right = even["worst"] == match[2] and _time(even, match[1]) is None
    return [None, None, even["worst_ratio"] if right else math.nan, _gain(result, "best")]


def _alone(result: Any, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    same = _plan(result, "same")
    return [None, same["worst_ratio"] if same["worst"] == match[1] else math.nan, _gain(result, "same")]


def _checked(result: Any, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    plan = result["plan"]
    terms = [term for term in plan["terms"] if term["name"] in plan["needed"]]
    ends = []
    for name in ("best", "even"):
        ratios = [term[name]["simulated"] / term[name]["sd"] for term in terms]
        ends += [min(ratios), max(ratios)]
    return [plan.get("units"), *ends]


def _outcome(result: Any, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    name = {"Evenly": "even", "Same equipment": "same", "Best plan": "best"}[match[1]]
    plan = _plan(result, name)
    return [None, len(plan["steps"]), _time(plan, match[3])]


def _left(result: Any, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    """Predicted and prior sd of a term, of the plan that its section is of: one of them has it."""
    term = next(one for one in result["plan"]["terms"] if one["name"] == match[1])
    size = per_unit(match[3], term["unit"] if term["unit"] != "rad" else "rad")
    said = float(match[2].replace(",", ""))
    names = [plan["name"] for plan in result["plan"]["plans"]]
    sds = [term[name]["sd"] / size for name in names]
    return [None, min(sds, key=lambda sd: abs(sd - said)), None, term["prior_sd"] / size]


def _panel(result: Any, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    return [None, _gain(result, "best") if _plan(result, "best")["worst"] == match[1] else math.nan]


def _ratios(result: Any, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    """Sd of a term over that of its prior, in the order of the plans."""
    term = next(one for one in result["plan"]["terms"] if one["name"] == match[1])
    whole = term["needed_sd"] or term["prior_sd"]
    names = {"evenly": "even", "same equipment": "same", "best plan": "best"}
    said = re.findall(rf"(evenly|same equipment|best plan) ({NUM})", match[2])
    right = all(abs(float(n) - term[names[o]]["sd"] / whole) <= 0.051 * float(n) + 1e-12 for o, n in said)
    return [None, None if right and said else math.nan]


PLAN = (
    Reading(
        rf"(\d+) dwells in ({LASTING}) leave (\w+) worst known of (\d+) needed terms, to ({NUM}) of", _best
    ),
    Reading(
        rf"Going evenly through '[^']*' for ({LASTING}) leaves (\w+) at ({NUM}); the plan's worst sd is"
        rf" ({NUM} %)",
        _even,
    ),
    Reading(rf"with that run alone leaves (\w+) at ({NUM}), ({NUM} %)", _alone),
    Reading(
        rf"Over ({NUM}) simulated units the rms errors of the needed terms are ({NUM}) to ({NUM}) of what is"
        rf" predicted for the plan, and ({NUM}) to ({NUM}) of",
        _checked,
    ),
    Reading(rf"(Evenly|Same equipment|Best plan): (\d+) dwells in ({LASTING})", _outcome),
    Reading(rf"(\w+) an sd of ({NUM}) (\S+) \(prior ({NUM}) \S+\)", _left),
    Reading(rf"The worst needed term \((\w+)\) has ({NUM} %) less sd", _panel),
    Reading(rf"(?:: |; |sd, )(\w+) ((?:(?:, )?(?:evenly|same equipment|best plan) {NUM})+)", _ratios),
    Reading(rf"over ({NUM}) simulated units", lambda r, m, a: [r["plan"].get("units")]),
    Reading(rf"give or take ({NUM})", lambda r, m, a: [(2 * r["plan"]["units"]) ** -0.5]),
    fixed(r"(?:and|it is) (1)(?: is as|, give)"),
    fixed(rf"Own input over ({NUM}) min: from ({NUM}) to ({NUM}) "),
)


# A fleet


def wrong_fleet(html: str, result: dict[str, Any]) -> list[str]:
    """What a page of a fleet says that its result does not."""
    broken = [
        fixed(rf"({re.escape(one['name'])}: {re.escape(one['error'])})") for one in result["fleet"]["broken"]
    ]
    return wrong_numbers(html, result, (*FLEET, *broken))


def _median(result: Any, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    fleet = result["fleet"]
    order = [float(fleet["order"][end]) for end in ("value", "low", "high")]
    return [fleet["read"], order[0], len(fleet["terms"]), 90, *order[1:]]


def _answered(result: Any, answer: str) -> list[str]:
    """Terms of an answer, by the verdicts of the units."""
    found = []
    for term in result["fleet"]["terms"]:
        counts = term["verdicts"]
        total = sum(counts.values())
        needed, idle = counts["needed"], counts["not needed"]
        hidden = total - needed - idle
        told = "open" if 2 * hidden >= total else "needed" if needed >= idle else "not needed"
        if told == answer:
            found.append(term["name"])
    return found


def _shared(result: Any, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    terms = result["fleet"]["terms"]
    held = [
        t
        for t in terms
        if t["name"] in _answered(result, "needed") and t["mean"]["low"] * t["mean"]["high"] > 0
    ]
    return [len(held), len(terms)]


def _term(result: Any, name: str) -> dict[str, Any]:
    return next(term for term in result["fleet"]["terms"] if term["name"] == name)


def _pull(result: Any, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    one = next(o for o in result["fleet"]["worst"] if (o["unit"], o["term"]) == (match[1], match[2]))
    return [None, None, one["pull"], None]


FLEET = (
    Reading(
        rf"({NUM}) [\w -]+: the median unit needs ({NUM}) of (\d+) terms? \((90) % of the units: ({NUM}) to"
        rf" ({NUM})\)",
        _median,
    ),
    Reading(r"Needed in half of the units or more: ([^.]+)\.", lambda r, m, a: [_answered(r, "needed")]),
    Reading(r"leaves open in half of the units or more: ([^.]+)\.", lambda r, m, a: [_answered(r, "open")]),
    Reading(rf"beyond ({NUM}) sd", lambda r, m, a: [r["fleet"]["limit"]]),
    Reading(rf"the farthest is at \+?({NUM}) sd", lambda r, m, a: [r["fleet"]["worst"][0]["pull"]]),
    Reading(r"(\d+) units? stands? out from", lambda r, m, a: [r["fleet"]["outliers"]]),
    Reading(rf"(?:: |, )(\S+) in (\w+) \(\+?({NUM}) sd, ([^)]*)\)", _pull),
    Reading(r"(\d+) units? of ([\d,]+) could not be read",
            lambda r, m, a: [len(r["fleet"]["broken"]), r["fleet"]["units"]]),
    Reading(r"^(\d+) of (\d+) terms are needed by most units",
            lambda r, m, a: [len(_answered(r, "needed")), len(r["fleet"]["terms"])]),
    Reading(r"^(\d+) of (\d+) terms are needed, and have a mean", _shared),
    Reading(rf"(?:needed: |; )(\S+) ({PERCENT})", lambda r, m, a: [None, _term(r, m[1])["needed"]["value"]]),
    fixed(r"^Population mean over the class's typical size: (.+)$"),
    fixed(r"(90) %"),
)  # fmt: skip
