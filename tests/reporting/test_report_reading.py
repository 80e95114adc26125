"""A fresh class-level report says what its result says, and the reader of reports finds what does not."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from lots_readings import wrong_lots
from report_reading import Block, Grid, Reading, agrees, drawn, grids, problems, sentences, tree, written
from study_readings import wrong_study

from imubayes.population.lots import measure
from imubayes.reporting.blocks import page_html
from imubayes.reporting.document import report_html
from imubayes.reporting.lots_page import lots_json, lots_page
from imubayes.reporting.results import result_json
from imubayes.study.method import run
from imubayes.study.schema import read, read_study

STUDY = """
[study]
title = "Which terms does a navigation FOG need?"
seed = 4
[lots]
kind = "gyroscope"
classes = ["mems_consumer", "mems_tactical", "fog_navigation"]
units = 3
methods = 1
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


SENSOR = """
[study]
title = "A tumble and an arm"
seed = 2
method = "exact"
[[sensor]]
id = "ACC-07"
kind = "accelerometer"
class = "mems_tactical"
library = { powers = 2, asymmetry = -1 }
truth = { b0 = "1500 ug", b1 = "310 ppm", m_j = "350 urad", S_ij = "60 ug/(rad/s)^2" }
[[sensor.run]]
name = "tumble"
procedure = "tumble"
simulate = { angles = 12, planes = 3, dwell = "8 s", rate = "5 Hz" }
[[sensor.run]]
name = "arm"
procedure = "centrifuge"
simulate = { levels = ["1 g", "10 g"], mounts = 4, dwell = "8 s", rate = "5 Hz" }
"""


def test_every_number_of_a_fresh_report_on_a_sensor_is_one_of_the_result(tmp_path):
    (tmp_path / "study.toml").write_text(SENSOR)
    found = run(read_study(tmp_path / "study.toml"))
    assert wrong_study(report_html(found), json.loads(result_json(found))) == []
