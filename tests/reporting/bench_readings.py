"""What the reports of a plan and of a fleet say, and where each number of it stands in ``result.json``."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from typing import Any

from report_reading import Meant, agrees, fixed, grids, named, readings, tree
from tool_readings import NUM, PERCENT, wrong_numbers

from imubayes.reporting.lots_words import class_name
from imubayes.sensors.catalogue import sensor

Found = dict[str, Any]
Match = re.Match[str]

LASTING = rf"{NUM} (?:s|min|h)(?: {NUM} min)?"


def _lasting(said: str) -> float:
    """Seconds of a time in words."""
    sizes = {"s": 1.0, "min": 60.0, "h": 3600.0}
    return sum(
        float(n.replace(",", "")) * sizes[unit] for n, unit in re.findall(r"([\d.,]+) (s|min|h)", said)
    )


# A plan


def wrong_plan(html: str, result: Found) -> list[str]:
    """What a page of a plan says that its result does not; the steps stand in its tables."""
    return wrong_numbers(
        html,
        result,
        (*PLAN, *fixed(rf"^({re.escape(result['plan']['sensor'])}): ")),
        told=lambda block: None if block.anchor in ("plan", "next") else block,
    )


def _plan(result: Found, name: str) -> Found:
    return named(result["plan"]["plans"], name)


def _time(plan: Found, said: str) -> Meant:
    """Dwells' time, as the words round it: to the minute."""
    found = _lasting(said)
    step = 60.0 if found >= 600.0 else 1.0
    return None if abs(found - plan["seconds"]) <= 0.5 * step + 1e-6 else math.nan


def _best(result: Found, match: Match) -> Iterable[Meant]:
    best, needed = _plan(result, "best"), result["plan"]["needed"]
    right = _time(best, match[2]) is None and best["worst"] == match[3]
    return [len(best["steps"]), None if right else math.nan, None, len(needed), best["worst_ratio"]]


def _gain(result: Found, name: str) -> float:
    return abs(1.0 - _plan(result, name)["worst_ratio"] / _plan(result, "even")["worst_ratio"])


def _even(result: Found, match: Match) -> Iterable[Meant]:
    even = _plan(result, "even")
    right = even["worst"] == match[2] and _time(even, match[1]) is None
    return [None, None, even["worst_ratio"] if right else math.nan, _gain(result, "best")]


def _alone(result: Found, match: Match) -> Iterable[Meant]:
    same = _plan(result, "same")
    return [None, same["worst_ratio"] if same["worst"] == match[1] else math.nan, _gain(result, "same")]


def _status(result: Found, match: Match) -> Iterable[Meant]:
    best = _plan(result, "best")
    return [len(best["steps"]), _time(best, match[2])]


def _checked(result: Found, match: Match) -> Iterable[Meant]:
    plan = result["plan"]
    terms = [term for term in plan["terms"] if term["name"] in plan["needed"]]
    ratios = [[term[name]["simulated"] / term[name]["sd"] for term in terms] for name in ("best", "even")]
    return [plan.get("units"), *(end(found) for found in ratios for end in (min, max))]


def _outcome(result: Found, match: Match) -> Iterable[Meant]:
    plan = _plan(result, NAMES[match[1].lower()])
    return [None, len(plan["steps"]), _time(plan, match[3])]


def _panel(result: Found, match: Match) -> Iterable[Meant]:
    return [None, _gain(result, "best") if _plan(result, "best")["worst"] == match[1] else math.nan]


NAMES = {"evenly": "even", "same equipment": "same", "best plan": "best"}
"""Plans, as a page calls them."""


def _ratios(result: Found, match: Match) -> Iterable[Meant]:
    """Sd of a term over that of its prior, in the order of the plans."""
    term = named(result["plan"]["terms"], match[1])
    whole = term["needed_sd"] or term["prior_sd"]
    said = re.findall(rf"({'|'.join(NAMES)}) ({NUM})", match[2])
    right = all(abs(float(n) - term[NAMES[o]]["sd"] / whole) <= 0.051 * float(n) + 1e-12 for o, n in said)
    return [None, None if right and said else math.nan]


PLAN = (
    *readings(
        {
            rf"(\d+) dwells in ({LASTING}) leave (\w+) worst known of (\d+) needed terms, to ({NUM}) of":
                _best,
            rf"^(\d+) dwells in ({LASTING}) · planned": _status,
            rf"Going evenly through '[^']*' for ({LASTING}) leaves (\w+) at ({NUM}); the plan's worst sd is"
            rf" ({NUM} %)": _even,
            rf"with that run alone leaves (\w+) at ({NUM}), ({NUM} %)": _alone,
            rf"Over ({NUM}) simulated units the rms errors of the needed terms are ({NUM}) to ({NUM}) of what"
            rf" is predicted for the plan, and ({NUM}) to ({NUM}) of": _checked,
            rf"(Evenly|Same equipment|Best plan): (\d+) dwells in ({LASTING})": _outcome,
            rf"The worst needed term \((\w+)\) has ({NUM} %) less sd": _panel,
            rf"(?:: |; |sd, )(\w+) ((?:(?:, )?(?:{'|'.join(NAMES)}) {NUM})+)": _ratios,
            rf"over ({NUM}) simulated units": lambda r, m: [r["plan"].get("units")],
            rf"give or take ({NUM})": lambda r, m: [(2 * r["plan"]["units"]) ** -0.5],
        }
    ),
    *fixed(r"(?:and|it is) (1)(?: is as|, give)"),
)  # fmt: skip


# The hours of classes


def wrong_hours(html: str, result: Found) -> list[str]:
    """What a page of hours says that its result does not, in sentences, figures and tables."""
    wrong = wrong_numbers(html, result, HOURS)
    cells = {"hours": _hour_cells, "classes": _test_cells, "open": _limit_cells}
    for grid in grids(tree(html)):
        wanted = cells[grid.anchor](result["hours"]) if grid.anchor in cells else grid.rows
        pairs = zip(grid.rows, wanted, strict=True)
        wrong += [f"#{grid.anchor}: {row}: {meant}" for row, meant in pairs if not _row_right(row, meant)]
    return wrong


def _row_right(row: tuple[str, ...], meant: Sequence[Any]) -> bool:
    return len(row) == len(meant) and all(
        said == one if isinstance(one, str) else agrees(said, one)
        for said, one in zip(row, meant, strict=True)
    )


def _class_named(hours: Found, name: str) -> Found:
    return next(one for one in hours["classes"] if _name(hours, one) == name.lower())


def _name(hours: Found, one: Found) -> str:
    return class_name(sensor(one["id"], kind=hours["kind"])).lower()


def _open_terms(one: Found) -> list[Found]:
    terms = [term for term in one["terms"] if term["seconds"] is None]
    return sorted(terms, key=lambda term: -(term["share_of_budget"] or 0.0))


def _hour_cells(hours: Found) -> Iterable[Sequence[Any]]:
    for terms in zip(*(one["terms"] for one in hours["classes"]), strict=True):
        yield (terms[0]["name"], *map(_hour, terms))


def _hour(term: Found) -> Any:
    if term["seconds"] is not None:
        return float(term["seconds"])
    return "matters" if (term["share_of_budget"] or 0.0) >= 0.1 else "–"


def _test_cells(hours: Found) -> Iterable[Sequence[Any]]:
    for one in hours["classes"]:
        told = [sum((t["seconds"] or math.inf) <= end for t in one["terms"]) for end in
                (one["seconds"], hours["reach"])]  # fmt: skip
        yield None, float(one["seconds"]), None, *told


def _limit_cells(hours: Found) -> Iterable[Sequence[Any]]:
    for one in hours["classes"]:
        for term in _open_terms(one):
            by = "catalogue" if term["most"] > 0.9 else "test"
            effect = (term["share_of_budget"], term["scene"].replace("_", " "))
            yield None, term["name"], None, *(effect if term["scene"] else ()), by


def _told_by(result: Found, match: Match) -> Iterable[Meant]:
    classes = result["hours"]["classes"]
    once, reach = ([one[key] for one in classes] for key in ("told_once", "told"))
    right = [
        _class_named(result["hours"], match[k])["told_once"] == n for k, n in ((2, min(once)), (4, max(once)))
    ]
    terms = len(classes[0]["terms"])
    return [min(once) if right[0] else -1, None, max(once) if right[1] else -1, None, terms, 10, min(reach),
            max(reach)]  # fmt: skip


def _open_in(result: Found, match: Match) -> Iterable[Meant]:
    one = _class_named(result["hours"], match[2])
    return [sum(_hour(term) == "matters" for term in one["terms"]), None]


def _both_counts(result: Found, match: Match) -> Iterable[Meant]:
    one = _class_named(result["hours"], match[1])
    return [None, one["told_once"], one["told"]]


def _span(result: Found, match: Match) -> Iterable[Meant]:
    told = [one["told"] for one in result["hours"]["classes"]]
    return [10, min(told), max(told), len(result["hours"]["classes"][0]["terms"])]


HOURS = (
    *readings(
        {
            r"the test of a class tells (\d+) \(([\w ]+)\) to (\d+) \(([\w ]+)\) of its (\d+) terms; repeated"
            r" with new mounts for (\d+) days, (\d+) to (\d+)": _told_by,
            r"^(\d+) days tell (\d+) to (\d+) of (\d+) terms": _span,
            r"(?:it: |; )([\w ]+) (\d+), (\d+)(?=;|$)": _both_counts,
            r"(?:open|and|,) (\d+) terms? of ([\w ]+?)(?= and| could|,)": _open_in,
            r"of (\d+)\.$": lambda r, m: [len(r["hours"]["classes"][0]["terms"])],
        }
    ),
    *fixed(r"(10) days", r"(10 %) of", r"(95 %) after", r"(0.9) of the prior's"),
)


# A fleet


def wrong_fleet(html: str, result: Found) -> list[str]:
    """What a page of a fleet says that its result does not."""
    broken = (rf"({re.escape(one['name'])}: {re.escape(one['error'])})" for one in result["fleet"]["broken"])
    return wrong_numbers(html, result, (*FLEET, *fixed(*broken)))


def _median(result: Found, match: Match) -> Iterable[Meant]:
    fleet = result["fleet"]
    order = [float(fleet["order"][end]) for end in ("value", "low", "high")]
    return [fleet["read"], order[0], len(fleet["terms"]), 90, *order[1:]]


def _answered(result: Found, answer: str) -> list[str]:
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


def _pull(result: Found, match: Match) -> Iterable[Meant]:
    one = next(o for o in result["fleet"]["worst"] if (o["unit"], o["term"]) == (match[1], match[2]))
    return [None, None, one["pull"], None]


def _verdicts(result: Found, match: Match) -> Iterable[Meant]:
    return [sum(term["verdicts"][match[2]] for term in result["fleet"]["terms"]), None]


FLEET = (
    *readings(
        {
            rf"({NUM}) (needed|not needed|undecided|inseparable|unresolved|untested) [·(]": _verdicts,
            r"\((\d+) terms of ([\d,]+) units\) ·":
                lambda r, m: [len(r["fleet"]["terms"]), r["fleet"]["read"]],
            rf"({NUM}) [\w -]+: the median unit needs ({NUM}) of (\d+) terms? \((90) % of the units: ({NUM})"
            rf" to ({NUM})\)": _median,
            r"Needed in half of the units or more: ([^.]+)\.": lambda r, m: [_answered(r, "needed")],
            r"leaves open in half of the units or more: ([^.]+)\.": lambda r, m: [_answered(r, "open")],
            rf"beyond ({NUM}) sd": lambda r, m: [r["fleet"]["limit"]],
            rf"the farthest is at \+?({NUM}) sd": lambda r, m: [r["fleet"]["worst"][0]["pull"]],
            r"(\d+) units? stands? out from": lambda r, m: [r["fleet"]["outliers"]],
            rf"(?:: |, )(\S+) in (\w+) \(\+?({NUM}) sd, ([^)]*)\)": _pull,
            r"(\d+) units? of ([\d,]+) could not be read":
                lambda r, m: [len(r["fleet"]["broken"]), r["fleet"]["units"]],
            r"^(\d+) of (\d+) terms are needed by most units":
                lambda r, m: [len(_answered(r, "needed")), len(r["fleet"]["terms"])],
            rf"(?:needed: |; )(\S+) ({PERCENT})":
                lambda r, m: [None, named(r["fleet"]["terms"], m[1])["needed"]["value"]],
        }
    ),
    *fixed(r"(90) %"),
)  # fmt: skip
