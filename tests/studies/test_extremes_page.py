"""The page on the extremes: what it says is what was measured."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import pytest
from tool_readings import wrong_extremes

from imubayes.reporting.blocks import page_html
from imubayes.reporting.result.file import json_text
from studies.extremes.measure import QUANTITIES, Extremes, ExtremesStudy, Outcome, Told, measure
from studies.extremes.page import extremes_answer, extremes_page, extremes_record


@pytest.fixture(scope="module")
def found() -> Extremes:
    return measure(ExtremesStudy(families=("columns",), every=4))


def _with(found: Extremes, told: Told) -> Extremes:
    first = found.outcomes[0]
    wrong = Outcome(first.family, "wrong", 2.0, True, dict.fromkeys(QUANTITIES, told), ())
    return replace(found, outcomes=(wrong, *found.outcomes))


def test_an_answer_that_claims_too_much_is_counted_in_the_first_sentence(found):
    assert extremes_answer(found)[0].startswith("None of")
    assert extremes_answer(_with(found, Told(3.0, 5.0)))[0].startswith("6 of")
    assert "6 is NaN or infinite" in extremes_answer(_with(found, Told(-math.inf, 5.0)))[0]


def test_problems_that_were_refused_are_counted_beside_the_promise(found):
    first = Outcome("noise", "1", 2.0, True, dict.fromkeys(QUANTITIES, Told(9.0, 8.0)), (), 40)
    refused = replace(first, told=dict.fromkeys(QUANTITIES, Told(math.nan, math.nan)), refused=("why",))
    answer = " ".join(extremes_answer(replace(found, outcomes=(first, refused))))
    assert "That leaves out 1 of 2 such problems, which were refused" in answer
    assert "leaves out" not in " ".join(extremes_answer(replace(found, outcomes=(first,))))


def test_the_promise_says_for_how_many_rows_it_was_measured(found):
    first = Outcome("noise", "1", 2.0, True, dict.fromkeys(QUANTITIES, Told(9.0, 8.0)), (), 40)
    copies = replace(first, family="rows", rows=10**9)
    answer = " ".join(extremes_answer(replace(found, outcomes=(first, replace(first, rows=100_000), copies))))
    assert "40 to 100,000 rows, and up to 1,000,000,000 of a short record stacked on itself" in answer


def test_every_number_of_the_page_is_one_of_the_result(found):
    assert (
        wrong_extremes(page_html(extremes_page(found)), json.loads(json_text(extremes_record(found)))) == []
    )
