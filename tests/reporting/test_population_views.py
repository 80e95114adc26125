from __future__ import annotations

import json
from dataclasses import replace

import pytest
from populations_found import SESSIONS, UG, UNITS, class_found

from imubayes.reporting.document import report_html
from imubayes.reporting.population_views import class_views
from imubayes.reporting.results import result_json


def viewed(result, *found):
    return class_views(replace(result, classes=found))


def test_study_of_few_units_has_no_section(result) -> None:
    assert class_views(result) == ()
    assert "What units of this class have in common" not in report_html(result)


def test_rows_are_the_terms_that_the_test_tells_all_axes_first(result) -> None:
    (view,) = viewed(result, class_found())
    assert [(row.parameter, row.together) for row in view.rows] == [
        ("b0", True), ("ax.b0", False), ("az.b0", False), ("ax.m_j", False),
    ]  # fmt: skip
    assert view.left_out == 3 and view.repeated


def test_axes_that_differ_have_no_verdict_together(result) -> None:
    found = class_found()
    other = replace(found.terms[2], need=replace(found.terms[2].need, verdict="not needed"))
    (view,) = viewed(result, replace(found, terms=(*found.terms[:2], other, *found.terms[3:])))
    assert [row.verdict for row in view.rows[:3]] == ["", "needed", "not needed"]


def test_numbers_of_a_row_are_those_of_the_population_in_printed_units(result) -> None:
    (view,) = viewed(result, class_found())
    together, row = view.rows[:2]
    assert together.mean is None and str(row.mean) == "-250000 +- 12000 ug"
    assert (row.unit, row.turn_on) == ("30000 (20000 to 50000)", "1000 (500 to 3000)")
    assert row.printed == "ug"
    assert row.units == "8 of 8" and row.common.startswith("90")
    assert view.rows[3].turn_on == "below 60"
    assert str(row.error) == "220 ug"


def test_units_are_drawn_term_by_term(result) -> None:
    (view,) = viewed(result, class_found())
    assert len(view.panels) == 2
    assert "az" in view.panels[0].svg and "b0" in view.panels[0].title


def test_units_of_one_session_have_no_column_of_sessions(result) -> None:
    text = report_html(replace(result, classes=(class_found(sessions=("",)),)))
    assert ">unit to unit<" in text and ">between sessions<" not in text
    assert "what a turn-on changes is in the sd from unit to unit" in text


def test_population_is_in_the_results_in_si(result) -> None:
    (entry,) = json.loads(result_json(replace(result, classes=(class_found(),))))["population"]
    assert (entry["class"], entry["units"], entry["sessions"]) == ("mems_consumer", [*UNITS], [*SESSIONS])
    whole, one = entry["terms"][:2]
    assert whole["mean"]["median"] is None and one["parameter"] == "ax.b0"
    assert one["mean"]["median"] == pytest.approx(-250e3 * UG)
    assert one["unit_to_unit"]["q95"] == pytest.approx(50e3 * UG)
    assert one["session_shift"]["sessions"] == [*SESSIONS] and len(one["session_shift"]["mean"]) == 3
    assert (one["verdict"], one["answers"], one["needed"]["q05"]) == ("needed", {"needed": 8}, 0.8)
