"""A fresh report says what its result says; text, figures and numbers of a page are read as they stand."""

from __future__ import annotations

import json

import pytest
from grounds import Grounds, explained
from report_answers import wrong_lots, wrong_sensors
from report_reading import Block, Grid, drawn, grids, sentences, tree, written

from imubayes.population.lots import measure
from imubayes.reporting.document import report_html
from imubayes.reporting.lots_page import lots_json
from imubayes.reporting.results import result_json
from imubayes.study.method import run
from imubayes.study.schema import read, read_study

LOTS = """
[study]
seed = 4
[lots]
kind = "gyroscope"
classes = ["mems_consumer", "mems_tactical", "fog_navigation"]
units = 3
methods = 1
basic = true
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


def test_answers_of_a_fresh_result_on_classes_are_those_of_its_units(tmp_path):
    (tmp_path / "lots.toml").write_text(LOTS)
    assert [*wrong_lots(json.loads(lots_json(measure(read(tmp_path / "lots.toml")[1]))))] == []


def test_numbers_and_answers_of_a_fresh_report_on_a_sensor_are_those_of_its_result(tmp_path):
    (tmp_path / "study.toml").write_text(SENSOR)
    found = run(read_study(tmp_path / "study.toml"))
    html, result = report_html(found), json.loads(result_json(found))
    assert explained(html, Grounds(result)) > 0.8
    assert [*wrong_sensors(sentences(tree(html)), result)] == []


def test_text_is_read_by_block_under_its_heading_and_figures_without_their_labels():
    page = tree(
        '<h2 id="a">One</h2><p>It is <b>2</b>\xa0%.</p><p class="sub">3</p>'
        '<svg aria-label="four: 4"><title>5 of 6</title><text>7</text></svg>'
        '<h3 id="b">Two</h3><table><tr><th>k</th></tr><tr><td>8</td></tr></table>'
    )
    assert sentences(page) == [Block("a", "One"), Block("a", "It is 2 %."), Block("b", "Two")]
    assert drawn(page) == [Block("a", "four: 4"), Block("a", "5 of 6")]
    assert grids(page) == [Grid("b", ("k",), (("8",),))]


@pytest.mark.parametrize(
    ("text", "sizes"),
    [
        ("2 min, 1.5e3 and (1.0 +- 0.5)e6", [(120.0, 30.0), (1500.0, 50.0), (1e6, 5e4), (5e5, 5e4)]),
        ("5,800 times 7.9 %", [(5800.0, 50.0), (0.079, 5e-4)]),
    ],
)
def test_numbers_are_read_in_the_size_of_their_units_with_half_of_their_last_digit(text, sizes):
    assert [*written(text)] == [pytest.approx(one) for one in sizes]
