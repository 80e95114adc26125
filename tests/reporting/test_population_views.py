from __future__ import annotations

import json
from dataclasses import replace

import pytest
from block_readings import rows
from populations_found import SESSIONS, UG, UNITS, class_found, term_found

from imubayes.inference.intervals import Share
from imubayes.reporting.document import report_html
from imubayes.reporting.population_views import class_section, class_sentences, resolved, spread_text
from imubayes.reporting.results import result_json


def test_study_of_few_units_has_no_section(result) -> None:
    assert "What units of this class have in common" not in report_html(result)


def test_axes_that_differ_have_no_verdict_together() -> None:
    found = class_found()
    other = replace(found.terms[2], need=replace(found.terms[2].need, verdict="not needed"))
    mixed = replace(found, terms=(*found.terms[:2], other, *found.terms[3:]))
    told = [row[1].lstrip("●○ ") for row in rows([class_section(mixed, 0)])]
    assert told[:3] == ["by axis", "needed", "not needed"]


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


def said(found) -> str:
    return " ".join(class_sentences(found))


def test_sessions_that_agree_better_than_by_chance_are_a_finding_on_the_error_bars() -> None:
    found = class_found()
    steady = replace(found.terms[3], spreads=replace(found.terms[3].spreads, p_value=0.9995))
    said_of = "The sessions of ax.m_j agree better than by chance"
    assert said_of in said(replace(found, terms=(*found.terms[:3], steady, *found.terms[4:])))
    assert said_of not in said(found)


def test_axes_with_different_answers_are_named_one_by_one() -> None:
    found = class_found()
    other = replace(found.terms[2], need=replace(found.terms[2].need, verdict="not needed"))
    text = said(replace(found, terms=(*found.terms[:2], other, *found.terms[3:])))
    assert "The class needs ax.b0." in text and "It does not need az.b0 and ax.m_j." in text


def test_units_of_one_session_each_do_not_tell_of_turn_on() -> None:
    text = said(class_found(sessions=("",)))
    assert "sessions" not in text and "both what a unit is and what a turn-on does" in text


def test_spread_that_may_be_nothing_is_printed_as_a_limit_no_smaller_than_it_is() -> None:
    assert not resolved(Share(1.0, 0.1, 3.0)) and resolved(Share(1.0, 0.5, 3.0))
    found = term_found("b0", sessions=("",))
    spreads = replace(found.spreads, unit=Share(1.0 * UG, 0.1 * UG, 3.01 * UG))
    assert spread_text(replace(found, spreads=spreads), "unit") == "below 3.1 ug"


def test_terms_of_which_no_unit_tells_are_not_said_to_spread() -> None:
    found = class_found()
    silent = tuple(term_found(name, verdict="cannot tell") for name in ("c_jj", "c_kk"))
    text = said(replace(found, terms=silent, components=("",)))
    assert "c_jj and c_kk" in text and "From unit to unit" not in text
