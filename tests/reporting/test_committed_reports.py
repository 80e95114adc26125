"""Every committed report says what its own result says: each number, each count, wherever it stands."""

from __future__ import annotations

import json
import random
from pathlib import Path

import numpy as np
import pytest
import report_reading
from bench_readings import wrong_fleet, wrong_hours, wrong_plan
from lots_readings import wrong_lots
from population_tables import wrong_rows
from report_reading import NUMBER, Block, Grid, grids, tree
from study_readings import wrong_study
from tool_readings import wrong_extremes, wrong_quality, wrong_ranks, wrong_speed, wrong_trade

REPORTS = Path(__file__).parents[2] / "reports"

READERS = {
    "accelerometer_grades": wrong_lots,
    "basic_vs_generalized": wrong_lots,
    "decision_quality": wrong_quality,
    "extremes": wrong_extremes,
    "fleet": wrong_fleet,
    "mems_vs_fog": wrong_lots,
    "plan_mems_vs_fog": wrong_hours,
    "plan_tactical": wrong_plan,
    "ranks": wrong_ranks,
    "scenes": wrong_lots,
    "scenes_accelerometers": wrong_lots,
    "speed": wrong_speed,
    "trade_mems_vs_fog": wrong_trade,
    "trade_quickstart": wrong_trade,
}
"""Of each report, what holds its page against its result; one that is not here is of sensors."""


def _read(name: str) -> tuple[str, dict]:
    html, result = (
        (REPORTS / name / file).read_text(encoding="utf-8") for file in ("report.html", "result.json")
    )
    return html, json.loads(result)


def _wrong(name: str) -> list[str]:
    """What any of its pages says that its result does not: a long study has one for each unit."""
    (html, result), pages = _read(name), sorted((REPORTS / name).glob("[0-9]*.html"))
    read = READERS.get(name, wrong_study)
    every = [html, *(page.read_text(encoding="utf-8") for page in pages)]
    return [wrong for one in every for wrong in read(one, result)]


@pytest.mark.parametrize("name", sorted(page.parent.name for page in REPORTS.glob("*/report.html")))
def test_committed_report_says_what_its_result_says(name):
    assert _wrong(name) == []


CHANGED = (
    "basic_vs_generalized",
    "decision_quality",
    "imu_tactical",
    "mimu4444",
    "plan_mems_vs_fog",
    "plan_tactical",
    "xsens_tumble",
)


def test_number_that_is_changed_anywhere_is_found(monkeypatch):
    """All but those that only say how to read a page, or are below a limit whatever they are."""
    rng, held, found = random.Random(1), report_reading.wrong_in, []

    def other(said: str) -> str:
        """The same number with five more in its last digit that is not zero."""
        k = max((i for i, digit in enumerate(said) if digit in "123456789"), default=said.find("0"))
        return f"{said[:k]}{(int(said[k]) + 5) % 10}{said[k + 1 :]}"

    def changed(block, readings, result):
        for number in NUMBER.finditer(block.text):
            if rng.random() < 0.03:
                a, b = number.span()
                text = block.text[:a] + other(number[0]) + block.text[b:]
                found.append(any(held(Block(block.anchor, text), readings, result)))
        return held(block, readings, result)

    monkeypatch.setattr(report_reading, "wrong_in", changed)
    for name in CHANGED:
        assert _wrong(name) == []
    assert len(found) > 120 and np.mean(found) > 0.87


@pytest.mark.parametrize(
    ("table", "column", "old", "new"),
    [
        ("class-1", 2, "24 of 24", "23 of 24"),
        ("class-1", 4, "97 %", "96 %"),
        ("class-1", 6, "−25600", "−25400"),
        ("class-1", 8, "below 74", "below 76"),
        ("class-1", 10, "230", "240"),
        ("sessions", 6, "imu7.az", "imu6.az"),
        ("sessions", 8, "✗ no", "✓ yes"),
        ("cases", 5, "0.074", "0.076"),
        ("cases", 10, "17 of 21", "18 of 21"),
    ],
)
def test_cells_that_are_changed_are_found(table, column, old, new):
    html, result = _read("mimu4444")
    grid = next(one for one in grids(tree(html)) if one.anchor == table)
    k = next(k for k, row in enumerate(grid.rows) if old in row[column])
    rows = list(grid.rows)
    rows[k] = tuple(cell.replace(old, new) if j == column else cell for j, cell in enumerate(rows[k]))
    assert list(wrong_rows(grid, result)) == []
    assert len(list(wrong_rows(Grid(grid.anchor, grid.head, tuple(rows)), result))) == 1
