"""Cases in the report: known quantities in numbers and words, and what a kind of component needs."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy import stats

from imubayes.inference.recovered import Recovered
from imubayes.reporting.case_views import BLIND, CANNOT, case_views, pooled_verdict, published_cases
from imubayes.reporting.case_words import UNITS, held_together
from imubayes.reporting.document import report_html
from imubayes.reporting.results import result_json
from imubayes.selection.verdicts import EQUAL

MG = 9.80665e-3


def recovered(what="gravity", *, count=30, width=1, fitted=0.1 * MG, fresh=0.2 * MG, seed=1):
    rng = np.random.default_rng(seed)
    shape = (count, width)
    after = fitted * rng.normal(size=shape)
    sds = (np.full(shape, fitted), np.full(shape, fresh))
    return Recovered("hand", what, 100.0 * MG + after, after, 1.5 * after, *sds)


@pytest.fixture
def cased(make_sensor, make_study):
    """Three accelerometers of one case, with what is pooled and recovered of them, and k cases of them."""

    def of(*found, cases=1, pooled=None):
        pooled = {"b0": 1.0, "b0p": 0.97, "b3": 0.01, "c_jk": 0.86} if pooled is None else pooled
        sensors = [
            replace(make_sensor(f"U{k}.a{axis}"), pooled=pooled, recovered=found)
            for k in range(cases)
            for axis in "xyz"
        ]
        return make_study(*sensors)

    return of


def test_a_case_names_what_one_of_its_components_needs_beyond_the_others(cased):
    study = cased(recovered())
    first, *others = study.sensors
    terms = first.selection.terms
    more = tuple(replace(term, verdict="needed") if term.name == "b3" else term for term in terms)
    first = replace(first, selection=replace(first.selection, terms=more))
    (view,) = case_views(replace(study, sensors=(first, *others)))
    assert (
        "; ax needs also b1, b2, b3, m_j and m_k; ay and az need also b1, b2, m_j and m_k." in view.answer[0]
    )


def test_sensors_that_stand_alone_are_no_case(result):
    assert case_views(result) == () and list(published_cases(result)) == []


@pytest.mark.parametrize(("what", "width"), [("gravity", 1), ("rest", 3), ("closure", 2), ("turn", 1)])
def test_errors_are_root_mean_squares_in_the_printed_unit(cased, what, width):
    """Of a closure the two directions make one angle; of the others each number counts."""
    one = recovered(what, width=width)
    (view,) = case_views(cased(one))
    (row,) = view.rows
    unit = {"mg": MG, "deg/s": math.pi / 180.0, "deg": math.pi / 180.0}[UNITS[what][0]]
    squares = np.sum(one.after**2) / (30 if what == "closure" else 30 * width)
    printed = float(row.after.value) * 10.0**row.after.exponent
    assert printed == pytest.approx(math.sqrt(squares) / unit, rel=0.05)
    (record,) = next(published_cases(cased(one)))["recovered"]
    assert record["rms"]["after"] == pytest.approx(math.sqrt(squares), rel=1e-12)
    assert (row.inside, row.of) == (record["within_2_sd"], record["of"]) == (one.inside, 30 * width)


def test_the_sentence_on_gravity_has_the_numbers_of_its_row(cased):
    (view,) = case_views(cased(recovered(), recovered("rest", width=3)))
    (sentence,) = view.sentences
    row = view.rows[0]
    for size in (row.before, row.after, row.fitted, row.fresh, row.flown):
        assert f"{size.value} mg" in sentence
    assert f"{row.inside} of 30 lie within 2 sd" in sentence
    assert len(view.panels) == 2 and all(
        ElementTree.fromstring(panel.svg) is not None for panel in view.panels
    )


def test_where_the_fit_has_a_coefficient_for_each_error_nothing_is_predicted_of_it(cased):
    (view,) = case_views(cased(recovered(fitted=1e-3 * MG)))
    assert view.rows[0].fitted is None
    assert "a coefficient for each" in view.sentences[0]
    assert "0.20 mg for new ones" in " ".join(view.answer)


def test_a_kind_needs_what_its_components_show_together(cased):
    (view,) = case_views(cased(recovered()))
    (table,) = view.pooled
    verdicts = {row.term: row.verdict for row in table.rows}
    # alone b0p is undecided, and of c_jk no component's test can tell
    assert verdicts == {"b0": "needed", "b0p": "needed", "b3": "not needed", "c_jk": CANNOT}
    assert "Not every accelerometer shows b0p by itself" in table.sentence
    assert view.answer[0] == (
        "U0 as a whole: its accelerometers need b0 and b0p; ax, ay and az need also b1, b2, m_j and m_k."
    )


@pytest.mark.parametrize("inclusion", [0.0, 0.3, 1.0])
def test_what_no_component_can_tell_is_not_told_by_all_of_them(inclusion):
    assert pooled_verdict(inclusion, BLIND) == CANNOT
    assert pooled_verdict(inclusion, (*BLIND, "undecided"), EQUAL) != CANNOT


@pytest.mark.parametrize("inclusion", [0.0, 0.3, 0.9, 1.0])
def test_no_answer_of_a_kind_is_against_that_of_each_of_its_components(inclusion):
    assert pooled_verdict(inclusion, (*BLIND, "not needed", "not needed")) != "needed"
    assert pooled_verdict(inclusion, (*BLIND, "needed", "undecided")) != "not needed"


def test_the_page_and_the_file_hold_a_case(cased):
    study = cased(recovered())
    page = report_html(study)
    assert "U0 as a whole" in page and "within 2 sd" in page
    document = json.loads(result_json(study))
    (case,) = document["cases"]
    assert case["id"] == "U0" and case["recovered"][0]["what"] == "gravity"
    assert case["pooled"]["accelerometer"]["b0p"] == {"inclusion": 0.97, "verdict": "needed"}


@pytest.mark.parametrize(
    ("scale", "word"), [(2.0, "larger than predicted"), (0.5, "smaller than predicted"), (1.0, "as many as")]
)
def test_many_cases_say_on_the_first_screen_whether_their_errors_are_as_large_as_predicted(
    cased, scale, word
):
    one = recovered()
    sd = np.full_like(one.after, 1e-3)
    normal = stats.norm.ppf((np.arange(one.after.size) + 0.5) / one.after.size).reshape(one.after.shape)
    found = replace(one, after=scale * 1e-3 * normal, fitted=sd, fresh=2.0 * sd)
    study = cased(found, cases=8)
    (sentence,) = held_together(case_views(study))
    assert word in sentence and f"{8 * found.inside} of {8 * found.after.size} lie" in sentence
    records = [entry for case in published_cases(study) for entry in case["recovered"]]
    assert sum(entry["within_2_sd"] for entry in records) == 8 * found.inside
    first, _, _ = report_html(study).partition('<h2 id="cases">')
    assert _ and word in first


def test_many_cases_share_one_table(cased):
    page = report_html(cased(recovered(), cases=4))
    (table,) = re.findall(r'<h2 id="cases">.*?</section>', page, re.DOTALL)
    assert [f"U{k}" in table for k in range(4)] == [True] * 4
    assert table.count("<tr>") == 5 and "as a whole" not in page
