"""The report on speed says what was measured, marks what is wrong, and names who was left out."""

from __future__ import annotations

import math

import numpy as np
import pytest
from page_reading import said

from imubayes.ladder.costs import Machine
from imubayes.reporting.blocks import page_html
from studies.speed.contests import Ladder, SpeedStudy
from studies.speed.growth import fitted
from studies.speed.measure import Found, Place, Speed
from studies.speed.page import speed_page

SIZES = (1_000, 10_000, 100_000)


def made_speed() -> Speed:
    contest = Found(
        "least squares",
        1_000,
        "Least squares of <rows>",
        "error in sd",
        "solution",
        (
            Place("imubayes", True, "", (0.002, 0.003), 1e-9, ""),
            Place("right", False, "", (0.02, 0.05), 0.01, ""),
            Place("far off", False, "", (0.001, 0.001), 28.0, ""),
            Place("R, BAS", False, "", (), math.nan, "R is not installed"),
        ),
    )
    models = Found(
        "enumeration",
        20,
        "Models",
        "difference",
        "posterior",
        (
            Place("imubayes, noise given", True, "", (0.01048576,), 0.0, ""),
            Place("imubayes, noise scale integrated", True, "", (0.1,), math.nan, ""),
        ),
    )
    ladder = Ladder("rows", "work", 1.0, tuple((n, lambda: None) for n in SIZES))
    law = fitted(ladder, np.array([[1e-3, 2e-3], [1e-2, 2e-2], [1e-1, 2e-1]]))
    machine = Machine("A processor", "System 1", 2, {"linear algebra": 1}, math.nan, {"numpy": "2.0"})
    study = SpeedStudy(repeats=2, contests={}, growth={})
    return Speed(study, (contest, models), (law,), machine, 1.0)


@pytest.fixture(scope="module")
def speed() -> Speed:
    return made_speed()


def test_page_says_what_it_said(speed, golden):
    """It marks the wrong answer, and names who was left out."""
    page = page_html(speed_page(speed))
    assert "far off (wrong)" in page and "left out: R is not installed" in page
    assert "Least squares of &lt;rows&gt;" in page
    golden("pages/speed.txt", said(page))
