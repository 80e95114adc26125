"""What a report says of all sessions and all cases of a class, and where it stands in its result.

Values are those of ``sessions`` and ``cases`` of ``result.json``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from typing import Any
from xml.etree.ElementTree import Element

from population_readings import CLASS_READINGS, MOST, NAME
from population_tables import between, together, wrong_rows
from report_reading import Block, Meant, grids, named, problems, readings
from study_phrases import NUM, SAID

Found = dict[str, Any]


def _of(r: Found, name: str) -> Found:
    return named(r["sessions"], name, "parameter")


def _changing(r: Found, match: re.Match[str]) -> Iterable[Meant]:
    moving = sorted((one for one in together(r) if one["exceeds"]), key=lambda one: one["p_value"])
    said = re.findall(rf"({NAME}) \(sd ", match.string)
    right = said == [one["parameter"] for one in moving[:MOST]]
    return [len(moving) if right else math.nan, len(together(r))]


# All cases together


def _held(r: Found, match: re.Match[str]) -> Iterable[Meant]:
    """Errors within 2 sd, counted from the errors; and how many there should be."""
    starts = {"Length of the force": "gravity", "Rates": "rest", "Up carried": "closure", "Angles": "turn"}
    what = next(what for start, what in starts.items() if match.string.startswith(start))
    rows = [row for case in r["cases"] for row in case["recovered"] if row["what"] == what]
    inside, of = (sum(row[key] for row in rows) for key in ("within_2_sd", "of"))
    expected = math.erf(math.sqrt(2.0)) * of
    larger = match[4] == "larger"
    return [inside, of, round(expected) if (inside < expected) == larger else math.nan]


def _drawn(r: Found, match: re.Match[str]) -> Iterable[Meant]:
    ids = {one["id"] for one in r["sensors"]}
    names = match[3].split(", ")
    return [len(names) if ids.issuperset(names) else math.nan, len(ids)]


SESSION_READINGS = readings(
    {
        r"^(\d+) of (\d+) parameters changes? between sessions": _changing,
        rf"({NAME}) \(sd ({NUM}) \S+\)": lambda r, m: [None, between(_of(r, m[1]))],
        rf"(\d+)% of the scatter of ({NAME})": lambda r, m: [round(100.0 * _of(r, m[2])["shared"]), None],
        rf"Each test alarms below p ({NUM})": lambda r, m: [together(r)[0]["level"]],
        r"(\d+) more parameters are in result\.json": lambda r, m: [len(r["sessions"]) - len(together(r))],
    }
)

CASE_READINGS = readings(
    {
        r"(\d+) of (\d+) lie within 2 sd of what is predicted"
        r"(?: \((\d+) expected: they are (larger|smaller) than predicted\))?": _held,
        r"drawn of (\d+) of the (\d+) components, those whose rows fit worst: ([^ ]+(?:, [^ ]+)*)\.$": _drawn,
    }
)


def is_of_class(block: Block) -> bool:
    """Whether a text is of a class, of its sessions, or of all cases together."""
    of_all = r"[\w ,-]+\. \d+ \w+ of class |[^.]+ \d+ of \d+ lie within 2 sd of what is predicted"
    top = block.anchor == "first" and re.match(of_all, block.text)
    return bool(top or re.match(r"class-\d+$|sessions$|cases$", block.anchor))


READINGS = {"sessions": SESSION_READINGS, "cases": CASE_READINGS}
"""Readings of a section; those of others are of a class, and of all cases at the top."""


def wrong_population(page: Element, blocks: Iterable[Block], result: Found) -> list[str]:
    """What a report says of units of a class, in sentences, figures and tables, that its result does not."""
    found = [
        problem
        for block in filter(is_of_class, blocks)
        for problem in problems(
            [block], (*READINGS.get(block.anchor, (*CLASS_READINGS, CASE_READINGS[0])), *SAID), result
        )
    ]
    tables = (grid for grid in grids(page) if re.match(r"class-\d+$|sessions$|cases$", grid.anchor))
    return [*found, *(wrong for grid in tables for wrong in wrong_rows(grid, result))]
