"""Every committed report says what its own result says: each number, each count, wherever it stands."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from bench_readings import wrong_fleet, wrong_plan
from lots_readings import wrong_lots
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
    "plan_tactical": wrong_plan,
    "ranks": wrong_ranks,
    "scenes": wrong_lots,
    "scenes_accelerometers": wrong_lots,
    "speed": wrong_speed,
    "trade_mems_vs_fog": wrong_trade,
    "trade_quickstart": wrong_trade,
}
"""Of each report, what holds its page against its result; one that is not here is of sensors."""


@pytest.mark.parametrize("name", sorted(page.parent.name for page in REPORTS.glob("*/report.html")))
def test_committed_report_says_what_its_result_says(name):
    html = (REPORTS / name / "report.html").read_text(encoding="utf-8")
    result = json.loads((REPORTS / name / "result.json").read_text(encoding="utf-8"))
    assert READERS.get(name, wrong_study)(html, result) == []
