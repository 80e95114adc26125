"""What is changed in the report on units of a class, in words, figures or tables, is found."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from population_tables import wrong_rows
from report_reading import Block, Grid, drawn, grids, sentences, tree
from session_readings import wrong_population

FOLDER = Path(__file__).parents[2] / "reports" / "mimu4444"


@pytest.fixture(scope="module")
def made():
    page = tree((FOLDER / "report.html").read_text(encoding="utf-8"))
    tables = [grid for grid in grids(page) if grid.anchor in ("class-1", "sessions", "cases")]
    blocks = [*sentences(page), *drawn(page)]
    return blocks, tables, json.loads((FOLDER / "result.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("8 accelerometers of class", "9 accelerometers of class"),
        ("in 3 sessions.", "in 4 sessions."),
        ("The class needs b0, b1,", "The class needs b0,"),
        ("differs by 10800 (8500 to", "differs by 10800 (8700 to"),
        ("changes by 1010 (680", "changes by 1020 (680"),
        ("next b0 changes", "next b1 changes"),
        ("b1 below 74 ppm", "b1 below 76 ppm"),
        ("94 % (70 to 100)", "94 % (70 to 99)"),
        ("session 1 by 590", "session 2 by 590"),
        ("2 of 3 sessions off", "3 of 3 sessions off"),
        ("48 more parameters", "47 more parameters"),
        ("1 of 10 parameters", "2 of 10 parameters"),
        ("92% of the scatter", "93% of the scatter"),
        ("largest pull 13 sd", "largest pull 16 sd"),
        ("457 of 504 lie", "458 of 504 lie"),
        ("481 expected", "480 expected"),
        ("3 of the 72 components", "3 of the 71 components"),
    ],
)
def test_words_that_are_changed_are_found(made, old, new):
    blocks, _, result = made
    changed = [Block(one.anchor, one.text.replace(old, new)) for one in blocks if old in one.text]
    assert changed
    for block in changed:
        assert wrong_population(tree(""), [block], result), block


@pytest.mark.parametrize(
    ("table", "column", "old", "new"),
    [
        ("class-1", 2, "24 of 24", "23 of 24"),
        ("class-1", 3, "−25600", "−25400"),
        ("class-1", 5, "below 74", "below 76"),
        ("class-1", 7, "230", "240"),
        ("sessions", 6, "imu7.az", "imu6.az"),
        ("sessions", 8, "✗ no", "✓ yes"),
        ("cases", 5, "0.074", "0.076"),
        ("cases", 10, "17 of 21", "18 of 21"),
    ],
)
def test_cells_that_are_changed_are_found(made, table, column, old, new):
    _, tables, result = made
    grid = next(one for one in tables if one.anchor == table)
    k = next(k for k, row in enumerate(grid.rows) if old in row[column])
    rows = list(grid.rows)
    rows[k] = tuple(cell.replace(old, new) if j == column else cell for j, cell in enumerate(rows[k]))
    assert list(wrong_rows(grid, result)) == []
    assert len(list(wrong_rows(Grid(grid.anchor, grid.head, tuple(rows)), result))) == 1
