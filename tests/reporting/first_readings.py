"""What the first screen of a study of sensors says, and where each number and name stands in its result."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from typing import Any

from report_reading import NUMBER, Block, Meant, fixed, named, problems, readings

from imubayes.reporting.rounding import per_unit
from imubayes.selection.verdicts import UNSEEN

Found = dict[str, Any]
Match = re.Match[str]

NUM = r"[-−]?[\d.,]*\d(?:e[-−]?\d+)?"
VERDICT = r"(needed|not needed|undecided|inseparable|unresolved|untested)"
NAMES = r"([\w*]+(?:(?:, | and )[\w*]+)*)"


def wrong_first(blocks: Sequence[Block], result: Found) -> list[str]:
    """What the first screen says that the result does not; a tile says less than what stands over it."""
    over = [one for one in blocks if re.search(rf": {VERDICT}, ", one.text)]
    told = [_digits(one) for one in over]
    read = [one for one in blocks if one in over or not any(_digits(one) <= own for own in told)]
    tiled = [one for one in result["sensors"] if any(tile.text.startswith(f"{one['id']}, ") for tile in over)]
    result = {**result, "sensors": tiled or result["sensors"]}
    ids = sorted((one["id"] for one in result["sensors"]), key=len, reverse=True)
    own = fixed(*(rf"(?<![\w-])({re.escape(name)})(?![\w-])" for name in ids))
    return problems(read, (*FIRST, *own), result)


def _digits(block: Block) -> set[str]:
    """Numbers of a block, without their powers of ten, which stand behind the sd where there is one."""
    return {said.partition("e")[0] for said in NUMBER.findall(block.text)}


def _needs(sensor: Found) -> list[str]:
    return [term["name"] for term in sensor["terms"] if term["verdict"] == "needed"]


def _one(result: Found, match: Match) -> Iterable[Meant]:
    sensor = named(result["sensors"], match[1], "id")
    return [None, _needs(sensor) or ["none"], len(sensor["terms"])]


def _all(result: Found, match: Match) -> Iterable[Meant]:
    """Terms that all components of a kind need: each by itself, or in one model for the case."""
    alike = [_needs(one) for one in result["sensors"] if one["kind"] == match[2]]
    pooled = [case["pooled"].get(match[2], {}) for case in result.get("cases", [])][:1]
    held = {name for one in pooled for name, term in one.items() if term["verdict"] == "needed"}
    said = re.split(", | and ", match[3])
    return [len(alike), None, [t for t in said if t in held or all(t in own for own in alike)]]


def _some(result: Found, match: Match) -> Iterable[Meant]:
    """Terms that some components need, with how many, of a kind that has as many components."""
    told = re.findall(r"([\w*]+) \((\d+)\)", match[1])
    for kind in {one["kind"] for one in result["sensors"]}:
        needs = [_needs(one) for one in result["sensors"] if one["kind"] == kind]
        right = all(sum(term in own for own in needs) == int(count) for term, count in told)
        if right and len(needs) == int(match[2]):
            return [None, len(needs)]
    return [None, math.nan]


def _title(result: Found, match: Match) -> Iterable[Meant]:
    names = {term["name"] for one in result["sensors"] for term in one["terms"]}
    return [len({name for one in result["sensors"] for name in _needs(one)}), len(names)]


def _runs(result: Found) -> list[Found]:
    return [run for one in result["sensors"] for run in one["noise_processes"].values()]


def _shown(result: Found, match: Match) -> Iterable[Meant]:
    """How many runs show a process, of how many."""
    runs = _runs(result)
    return [sum(match[3] in run["identified"] for run in runs), len(runs) if match[2] else None, None]


def _processes(result: Found, match: Match) -> Iterable[Meant]:
    """How many processes some run shows, of all that are looked for."""
    runs = _runs(result)
    named = [{name for run in runs for name in run[key]} for key in ("identified", "processes")]
    return [len(names - {"tau"}) for names in named]


def _tile(result: Found, match: Match) -> Iterable[Meant]:
    """Verdict, value and sd of a term, or of a process of the run that has this value."""
    owners = [one for one in result["sensors"] if match[1].startswith(one["id"])]
    owner = max(owners, key=lambda one: len(one["id"]))
    power = float(f"1e{match[6] or 0}")
    if own := [
        run["processes"][match[2]]
        for run in owner["noise_processes"].values()
        if match[2] in run["processes"]
    ]:
        size = per_unit(own[0]["printed_unit"], own[0]["unit"]) * power
        own += [{**own[0], **run[match[2]]} for run in owner["noise_posterior"].values() if match[2] in run]
        found = min(
            own, key=lambda one: abs(one["mean"] / size - float(match[4].replace(",", "").replace("−", "-")))
        )
        value = found["mean"]
    else:
        found = named(owner["terms"], match[2])
        size = per_unit(found["printed_unit"], found["unit"]) * power
        value = found["mean"]
        if ", < " in match[0]:  # limits are rounded up
            limit, said = found["limit95"] / size, float(match[4].replace(",", "").replace("−", "-"))
            return [None, None, None, said if limit <= said < 1.12 * limit else limit]
    right = None if found["verdict"] == match[3] else math.nan
    return [None, None, right, value / size, found["sd"] / size, None]


FIRST = (
    *readings(
        {
            rf"(?:^|(?<=: )|(?<=\. ))(\S+) needs {NAMES} of (\d+) terms?\.": _one,
            rf"[Aa]ll (\d+) (accelerometer|gyroscope)s need {NAMES}\.": _all,
            r"Some need(?: also)? ([^.]+?) of (\d+)\.": _some,
            r"Of (\d+) others its test cannot tell":
                lambda r, m: [sum(t["verdict"] in UNSEEN for t in r["sensors"][0]["terms"])],
            rf"(\d+) {VERDICT} [·(]":
                lambda r, m: [sum(t["verdict"] == m[2] for s in r["sensors"] for t in s["terms"])],
            r"\((?:\d+ of )?(\d+) components?\)": lambda r, m: [len(r["sensors"])],
            r"(\d+) of (\d+) components":
                lambda r, m: [sum(any(t.get("conditional") for t in s["terms"]) for s in r["sensors"]),
                              len(r["sensors"])],
            r"(\d+) of (\d+) terms? (?:is|are) needed": _title,
            r"(?:All )?(\d+)(?: of (\d+))? shows? [a-z -]+ ([A-Z])\.": _shown,
            r"(\d+) of (\d+) processes are shown by some run": _processes,
            rf"^(.+), ([\w*]+): {VERDICT}, (?:< )?\(?({NUM})(?: ± ({NUM}))?(?:\)e([-−]?\d+))?": _tile,
        }
    ),
    *fixed(r"with (95) %"),
)  # fmt: skip
