"""A fresh class-level report says what its result says, and the reader of reports finds what does not."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from lots_readings import wrong_lots
from report_reading import Block, Grid, Reading, agrees, drawn, grids, problems, sentences, tree, written

from imubayes.population.lots import measure
from imubayes.reporting.blocks import page_html
from imubayes.reporting.lots_page import lots_json, lots_page
from imubayes.study.schema import read

STUDY = """
[study]
title = "Which terms does a navigation FOG need?"
seed = 4
[lots]
kind = "gyroscope"
classes = ["mems_consumer", "mems_tactical", "fog_navigation"]
units = 3
basic = true
ASKS
[lots.library]
powers = 2
asymmetry = -1
[[lots.run]]
name = "rates"
procedure = "rate-table"
simulate = { rates = ["0 deg/s", "50 deg/s", "-50 deg/s"], mounts = 3, dwell = "4 s", rate = "1 Hz" }
[[scene]]
name = "helicopter"
duration = "10 min"
budget = { attitude = "1 deg" }
[[scene]]
name = "fixed_wing"
duration = "10 min"
budget = { position = "1 km" }
"""

ASKS = {
    "classes": "",
    "scenes": 'asks = "scenes"',
    "triad": 'asks = "triad"',
    "against": 'asks = { needed_by = ["fog_navigation"], not_by = ["mems_consumer", "mems_tactical"] }',
}


@pytest.fixture(scope="module")
def fresh(tmp_path_factory):
    path = tmp_path_factory.mktemp("lots") / "lots.toml"

    def study(asks: str):
        path.write_text(STUDY.replace("ASKS", ASKS[asks]))
        return read(path)[1]

    found = measure(study("classes"))
    return lambda asks: replace(found, study=study(asks))


@pytest.mark.parametrize("asks", ASKS)
def test_fresh_report_says_what_its_result_says(fresh, asks):
    found = fresh(asks)
    html, result = page_html(lots_page(found)), json.loads(lots_json(found))
    assert "terms of each of 3 classes" in html
    assert wrong_lots(html, result) == []


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (" cannot tell (", "1 cannot tell ("),
        (" answers could change", "0 answers could change"),
        ("cannot tell ", "cannot tell 1"),
        ('<h2 id="check">', '<p>Another 7 terms.</p><h2 id="check">'),
        (">cannot tell</td>", ">needed</td>"),
        (" times (", "0 times ("),
        (" terms are needed by every class", "0 terms are needed by every class"),
    ],
)
def test_number_that_is_changed_anywhere_is_found(fresh, old, new):
    found = fresh("classes")
    html, result = page_html(lots_page(found)), json.loads(lots_json(found))
    assert old in html
    assert wrong_lots(html.replace(old, new), result)


def test_answer_that_the_result_gives_against_its_units_is_found(fresh):
    found = fresh("classes")
    html, result = page_html(lots_page(found)), json.loads(lots_json(found))
    result["scenes"][0]["model"] = ["b0", *result["scenes"][0]["model"]]
    assert wrong_lots(html, result)


SAID = Reading(r"(\d+) of (\d+) are blue", lambda result, match, anchor: [result["blue"], result["all"]])


@pytest.mark.parametrize(
    ("text", "count"),
    [
        ("3 of 5 are blue.", 0),
        ("4 of 5 are blue.", 1),
        ("3 of 5 are blue, and 2 are not.", 1),
        ("b0 and c_ij2 are blue.", 0),
    ],
)
def test_number_is_explained_by_a_reading_or_is_a_problem(text, count):
    assert len(problems([Block("", text)], [SAID], {"blue": 3, "all": 5})) == count


def test_what_the_result_has_nothing_of_is_a_problem():
    assert problems([Block("", "3 of 5 are blue.")], [SAID], {"all": 5})


def test_text_is_read_by_block_under_its_heading_and_figures_without_their_ticks():
    page = tree(
        '<h2 id="a">One</h2><p>It is <b>2</b>\xa0%.</p><p class="sub">3</p>'
        '<svg aria-label="four: 4"><title>5 of 6</title><text>7</text></svg>'
        '<h3 id="b">Two</h3><table><tr><th>k</th></tr><tr><td>8</td></tr></table>'
    )
    assert sentences(page) == [Block("a", "One"), Block("a", "It is 2 %."), Block("b", "Two")]
    assert drawn(page) == [Block("a", "four: 4"), Block("a", "5 of 6")]
    assert grids(page) == [Grid("b", ("k",), (("8",),))]


@pytest.mark.parametrize(
    ("said", "meant", "right"),
    [
        ("12", 12, True),
        ("12", 13, False),
        ("5,800 times", 5812.0, True),
        ("7.9 %", 0.0789, True),
        ("7.9 %", 0.0796, False),
        ("below 0.1 %", 0.0004, True),
        ("below 0.1 %", 0.004, False),
        ("b0, b1 and g_i", ["g_i", "b0", "b1"], True),
        ("b0 and b1", ["b0"], False),
        ("none", [], True),
        ("1.000", float("nan"), False),
    ],
)
def test_what_is_said_is_what_is_meant_within_its_rounding(said, meant, right):
    assert agrees(said, meant) == right


def test_numbers_are_read_in_the_size_of_their_units():
    assert [value for value, _ in written("2 min, 1.5e3 and (1.0 +- 0.5)e6")] == [120.0, 1500.0, 1e6, 5e5]
