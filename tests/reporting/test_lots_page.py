import re

import pytest
from lots_found import lot_result

from imubayes.reporting.lots_figures import ACCENT, EMPTY, OPEN, needed_matrix


@pytest.fixture(scope="module")
def result():
    return lot_result()


def test_bar_of_a_lot_is_as_long_as_its_shares(result):
    svg = needed_matrix(result, "a").svg
    cells = re.findall(r"<title>(\S+), [^<]*</title>(.*?)</g>", svg)
    widths = dict.fromkeys((EMPTY, ACCENT, OPEN), 0.0)
    term = next(t for t in result.classes[0].terms if t.name == "b1")
    drawing = next(drawn for name, drawn in cells if name == "b1")
    widths |= {
        fill: float(w) for w, fill in re.findall(r'width="([\d.]+)" height="[\d.]+" fill="(#\w+)"', drawing)
    }
    whole = widths[EMPTY]
    assert widths[ACCENT] / whole == pytest.approx(term.needed.value, abs=0.1 / whole)
    assert widths[OPEN] / whole == pytest.approx(term.open, abs=0.1 / whole)


def test_question_mark_stands_where_the_test_cannot_tell_of_half_of_the_units(result):
    marks = needed_matrix(result, "a").svg.count(">?</text>")
    assert marks == sum(term.open >= 0.5 for one in result.classes for term in one.terms) > 0
