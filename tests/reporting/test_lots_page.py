import re

import pytest
from lots_found import SIZES, lot_result

from imubayes.population.needs import NEEDED, UNTOLD, WOULD_MATTER, answers_in
from imubayes.reporting.blocks import page_html
from imubayes.reporting.lots_figures import (
    ACCENT,
    EMPTY,
    OPEN,
    needed_matrix,
    scene_matrix,
)
from imubayes.reporting.lots_page import lots_page


@pytest.fixture(scope="module")
def result():
    return lot_result()


@pytest.fixture(scope="module")
def html(result):
    return page_html(lots_page(result))


def test_every_cell_of_the_first_matrix_leads_to_the_row_of_its_numbers(html, result):
    matrix = html[html.index('<svg id="needed-matrix"') :].partition("</svg>")[0]
    cells = [f"class-{name}-{term}" for term in result.study.library.names for name in SIZES]
    assert re.findall(r'href="#([^"]+)"', matrix) == cells
    assert all(f'<tr id="{cell}">' in html for cell in cells)


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


@pytest.mark.parametrize(
    ("answer", "mark"),
    [(NEEDED, 'class="frame"'), (UNTOLD, ">?</text>"), (WOULD_MATTER, 'class="hatch"')],
)
def test_each_answer_in_a_scene_has_a_mark_of_its_own(result, answer, mark):
    given = (told for one in result.classes for _, told in answers_in(one, one.missions[0]))
    assert scene_matrix(result, 0, "b").svg.count(mark) == sum(told == answer for told in given) > 0
