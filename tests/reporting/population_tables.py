"""Tables of a class, of its sessions and of all cases: each cell's text, or its numbers, by the result."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from statistics import median
from typing import Any

from population_readings import limit, moves, percents, spread_said, told, two_digits
from report_reading import NUMBER, Grid, Meant, agrees

from imubayes.reporting.rounding import per_unit

Found = dict[str, Any]
Cell = str | Sequence[Meant]
ANSWER = {"needed": "● needed", "not needed": "○ not needed", "undecided": "◐ undecided"}
ERROR = {"gravity": "length of the force in a still, from local g"}


def together(r: Found) -> list[Found]:
    """Parameters, of all components together where there are several, whose sessions can be compared."""
    names = {one["parameter"] for one in r["sessions"]}
    return [
        one
        for one in r["sessions"]
        if one["p_value"] is not None
        and not ("." in one["parameter"] and one["parameter"].split(".")[-1] in names)
    ]


def between(one: Found) -> float:
    return two_digits(one["between"]["mean"] / per_unit(one["printed_unit"], one["unit"]))


def pull(one: Found) -> tuple[float, str]:
    """Largest difference of two sessions in sd, and of which unit and sessions."""
    size, u, a, b = max(
        (abs(pull or 0.0), u, *sorted((a, b)))
        for u, unit in enumerate(one["pulls"])
        for a, row in enumerate(unit)
        for b, pull in enumerate(row)
    )
    return size, f"{one['units'][u]}, {one['sessions'][a]} to {one['sessions'][b]}"


def _printed(unit: str) -> str:
    return re.sub(r"^u", "µ", unit).replace("^2", "²").replace("^3", "³")


def _class_cells(r: Found, grid: Grid) -> Iterator[Sequence[Cell]]:
    found = r["population"][int(grid.anchor.removeprefix("class-")) - 1]
    for row, one in zip(grid.rows, told(found), strict=True):
        unit, answers = per_unit(one["printed_unit"], one["unit"]), one["answers"]
        all_axes = not one["component"] and len(found["components"]) > 1
        axes = {part["verdict"] for part in found["terms"] if part["term"] == one["term"] and part is not one}
        yield [
            one["parameter"] + (", all" if all_axes else ""),
            "by axis" if all_axes and len(axes) > 1 else ANSWER.get(one["verdict"], ""),
            [
                answers.get("needed", 0),
                sum(answers.values()),
                *percents({"median": 0.0, **one["needed"]})[1:],
            ],
            *_together(one, unit),
            [] if all_axes else [one["mean"][key] / unit for key in ("median", "sd")],
            *(
                spread_said(one, key, re.findall("below ", said) or [None])[1:]
                for key, said in (("unit_to_unit", row[-5]), ("turn_on", row[-4]))
            ),
            percents(one["common_share"]) if moves(one) else [],
            [two_digits(math.hypot(*one["measurement"].values()) / unit)],
            _printed(one["printed_unit"]),
        ]


def _together(one: Found, unit: float) -> Iterator[Sequence[Cell]]:
    """Cells of what all units say together; results made before there was such a thing have none."""
    if found := one.get("pooled"):
        share = dict(
            zip(("median", "q05", "q95"), (found["share"][k] for k in ("value", "low", "high")), strict=True)
        )
        yield [found["inclusion"]]
        yield percents(share)
        yield [limit(found["limit"] / unit)]


def _session_cells(r: Found, grid: Grid) -> Iterator[Sequence[Cell]]:
    shown = sorted(together(r), key=lambda one: (one["p_value"], -pull(one)[0]))
    for one in shown:
        unit, (largest, where) = per_unit(one["printed_unit"], one["unit"]), pull(one)
        typical = median(sd for sds in one["sd"] for sd in sds if sd is not None)
        yield [
            one["parameter"],
            [two_digits(typical / unit)],
            [between(one)],
            [two_digits(one["between"][end] / unit) for end in ("q05", "q95")],
            _printed(one["printed_unit"]),
            [largest],
            where,
            "<0.001" if one["p_value"] < 0.001 else [one["p_value"]],
            "✗ no" if one["exceeds"] else "✓ yes",
        ]


def _case_cells(r: Found, grid: Grid) -> Iterator[Sequence[Cell]]:
    mg = per_unit("mg", "m/s^2")
    for case in r["cases"]:
        for one in case["recovered"]:
            sizes = (one["rms"][key] for key in ("before", "after", "flown", "fitted", "fresh"))
            yield [
                case["id"],
                ERROR[one["what"]],
                one["run"],
                [one["count"]],
                *([size / mg] for size in sizes),
                "mg",
                [one["within_2_sd"], one["of"]],
            ]


CELLS = {"class": _class_cells, "sessions": _session_cells, "cases": _case_cells}


def wrong_rows(grid: Grid, result: Found) -> Iterator[str]:
    for row, cells in zip(grid.rows, CELLS[grid.anchor.partition("-")[0]](result, grid), strict=True):
        for said, meant in zip(row, cells, strict=True):
            if not _right(said, meant):
                yield f"#{grid.anchor}: '{said}' in the row of {row[0]} is {meant} in the result"


def _right(said: str, meant: Cell) -> bool:
    if isinstance(meant, str):
        return said == meant
    found = NUMBER.findall(said)
    return len(found) == len(meant) and all(map(agrees, found, meant))
