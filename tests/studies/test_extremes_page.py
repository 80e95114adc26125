"""The page on the extremes: what it says is what was measured."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from page_reading import said

from imubayes.reporting.blocks import page_html
from studies.extremes.measure import QUANTITIES, Extremes, ExtremesStudy, Outcome, Told, measure
from studies.extremes.page import extremes_answer, extremes_page


@pytest.fixture(scope="module")
def found() -> Extremes:
    return measure(ExtremesStudy(families=("columns",), every=4))


def _with(found: Extremes, told: Told) -> Extremes:
    first = found.outcomes[0]
    wrong = Outcome(first.family, "wrong", 2.0, True, dict.fromkeys(QUANTITIES, told), ())
    return replace(found, outcomes=(wrong, *found.outcomes))


def _of(*outcomes: Outcome) -> Extremes:
    return Extremes(ExtremesStudy(families=("noise", "rows"), every=4), outcomes, 1.0)


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


def test_page_says_what_it_said(golden):
    told = {name: Told(12.4 - k, 5.0) for k, name in enumerate(QUANTITIES)}
    first = Outcome("noise", "1", 2.0, True, told, (), 40)
    refused = Outcome("rows", "2", 1e12, True, dict.fromkeys(QUANTITIES, Told(math.nan, 5.0)), ("why",), 50)
    wrong = Outcome("rows", "3", 3.0, False, dict.fromkeys(QUANTITIES, Told(-math.inf, 5.0)), (), 60)
    golden("pages/extremes.txt", said(page_html(extremes_page(_of(first, refused, wrong)))))
