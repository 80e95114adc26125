"""A comparison for a terminal, as a page, and as numbers."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from imubayes.reporting.comparison.kinds import comparison_json
from imubayes.reporting.comparison.result_files import sensors_of
from imubayes.reporting.comparison.results import compared
from imubayes.reporting.comparison.results_page import comparison_record
from imubayes.reporting.result.file import written
from imubayes.reporting.results import result_json

ATTACK = "<b>x</b>"


@pytest.fixture
def found(make_study, make_sensor, tmp_path):
    """B differs from A in b2, by 50 sd; its sensor has another id."""
    files = []
    for name, moved in (("A-1", 0.0), (f"A-2{ATTACK}", 50.0)):
        sensor = make_sensor(name)
        terms = tuple(
            replace(t, full_mean=t.full_mean + moved * t.full_sd, verdict="undecided" if moved else t.verdict)
            if t.name == "b2"
            else t
            for t in sensor.selection.terms
        )
        sensor = replace(sensor, selection=replace(sensor.selection, terms=terms))
        file = tmp_path / f"{len(files)}.json"
        file.write_text(result_json(make_study(sensor)))
        files.append(sensors_of(written(file)))
    return compared(files)


def test_numbers_are_those_of_the_comparison(found):
    document = json.loads(comparison_json(comparison_record(found)))
    (component,) = document["components"]
    assert component["matched_by"] == "order" and len(component["ids"]) == 2
    assert [term["name"] for term in component["terms"] if term["differs"]] == ["b2"]
    (b2,) = [term for term in component["terms"] if term["name"] == "b2"]
    (a, b), (sd_a, sd_b) = b2["full_mean"], b2["full_sd"]
    assert b2["difference_over_sd"] == pytest.approx(abs(a - b) / (sd_a**2 + sd_b**2) ** 0.5, rel=1e-12)
    assert document["comparisons"] == found.tests and b2["between"] == ["A", "B"]
