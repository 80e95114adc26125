"""A fresh report on a sensor says what its result says, and what is changed in it is found."""

from __future__ import annotations

import json

import pytest
from study_readings import wrong_study

from imubayes.reporting.document import report_html
from imubayes.reporting.results import result_json
from imubayes.study.method import run
from imubayes.study.schema import read_study

STUDY = """
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


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    path = tmp_path_factory.mktemp("study") / "study.toml"
    path.write_text(STUDY)
    found = run(read_study(path))
    return report_html(found), json.loads(result_json(found))


def test_every_number_of_a_report_on_a_sensor_is_one_of_the_result(made):
    assert wrong_study(*made) == []


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (" terms are needed", "1 terms are needed"),
        (" are untested (", "1 are untested ("),
        ("are needed: b0", "are needed: b2p, b0"),
        (" models hold ", "1 models hold "),
        ("residual over noise ", "residual over noise 1"),
        (" methods keep", "1 methods keep"),
        (" sd from zero", "1 sd from zero"),
    ],
)
def test_number_that_is_changed_anywhere_is_found(made, old, new):
    html, result = made
    assert old in html
    assert wrong_study(html.replace(old, new), result)
