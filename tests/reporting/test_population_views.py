from __future__ import annotations

import json
from dataclasses import replace

import pytest
from block_readings import panels, rows, said
from populations_found import SESSIONS, UG, UNITS, class_found

from imubayes.reporting.document import report_html
from imubayes.reporting.population_views import class_section
from imubayes.reporting.results import result_json


def test_study_of_few_units_has_no_section(result) -> None:
    assert "What units of this class have in common" not in report_html(result)


def test_rows_are_the_terms_that_the_test_tells_all_axes_first() -> None:
    view = [class_section(class_found(), 0)]
    assert [row[0] for row in rows(view)] == ["b0, all", "ax.b0", "az.b0", "ax.m_j"]
    assert "3 more parameters" in said(view) and "Common is the share" in said(view)


def test_axes_that_differ_have_no_verdict_together() -> None:
    found = class_found()
    other = replace(found.terms[2], need=replace(found.terms[2].need, verdict="not needed"))
    mixed = replace(found, terms=(*found.terms[:2], other, *found.terms[3:]))
    told = [row[1].lstrip("●○ ") for row in rows([class_section(mixed, 0)])]
    assert told[:3] == ["by axis", "needed", "not needed"]


def test_numbers_of_a_row_are_those_of_the_population_in_printed_units() -> None:
    found = rows([class_section(class_found(), 0)])
    _, _, units, mean, unit, turn_on, common, error, printed = found[1]
    assert found[0][3] == "" and mean == "−250000 ± 12000"
    assert (unit, turn_on) == ("30000 (20000 to 50000)", "1000 (500 to 3000)")
    assert (error, printed) == ("220", "µg")
    assert units.startswith("8 of 8 ") and common.startswith("90")
    assert found[3][5] == "below 60"


def test_units_are_drawn_term_by_term() -> None:
    drawn = panels([class_section(class_found(), 0)])
    assert len(drawn) == 2
    assert "az" in drawn[0].svg and "b0" in drawn[0].title


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
