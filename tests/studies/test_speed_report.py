"""What the committed report on speed must show: ours is right, and ahead where that is the point."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from studies.speed.contests import SpeedStudy
from studies.speed.words import WRONG

REPORT = Path(__file__).parents[2] / "reports" / "speed" / "result.json"
CONTESTS = json.loads(REPORT.read_text(encoding="utf-8"))["contests"]

SECONDS = {("enumeration", 26): 3.0}
"""Time that a problem takes at most, however ours solves it."""

AHEAD = {("subsets", "statsmodels OLS"): 100.0, ("g-prior", "numpy, one by one"): 20.0}
AHEAD |= {("g-prior", "R, BAS"): 10.0, ("g-prior", "R, BMS"): 10.0, ("posterior", "nutpie, NUTS"): 5.0}
"""Times ours that a peer takes at least, where that is the point."""


def test_report_has_every_contest_of_the_study():
    asked = [(subject, size) for subject, sizes in SpeedStudy().contests.items() for size in sizes]
    assert [(one["subject"], one["size"]) for one in CONTESTS] == asked


@pytest.mark.parametrize("contest", CONTESTS, ids=lambda one: one["title"])
def test_our_answer_is_right_in_time_and_ahead_of_those_who_took_part(contest):
    own = contest["places"][0]
    assert own["ours"] and (own["error"] or 0.0) < WRONG.get(contest["subject"], math.inf)
    limit = SECONDS.get((contest["subject"], contest["size"]), math.inf)
    assert all(min(place["seconds"]) <= limit for place in contest["places"] if place["ours"])
    for peer in contest["places"]:
        if peer["seconds"]:
            ratio = min(peer["seconds"]) / min(own["seconds"])
            assert ratio >= AHEAD.get((contest["subject"], peer["name"]), 0.0), peer["name"]
