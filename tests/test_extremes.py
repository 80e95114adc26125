"""The extremes through the whole method: studies as a user runs them."""

from __future__ import annotations

import csv
import json
import math

import numpy as np
import pytest
from page_reading import report_html

from imubayes.reporting.results import result_json
from imubayes.study.method import run
from imubayes.study.schema import read_study, record_study

STUDY = """
[study]
title = "extremes"
seed = 3
method = "exact"
[decision]
compare = false
[[sensor]]
id = "A"
kind = "accelerometer"
class = "mems_industrial"
library = {{ powers = 3, asymmetry = 0 }}
[[sensor.run]]
name = "tumble"
procedure = "tumble"
simulate = {{ angles = 12, dwell = "5 s", rate = "4 Hz" }}
[[sensor.run]]
name = "arm"
procedure = "centrifuge"
simulate = {{ levels = {levels}, dwell = "5 s", rate = "4 Hz" }}
"""


def _decided(found) -> dict:
    return json.loads(result_json(found))["sensors"][0]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("extremes")


def test_a_centrifuge_at_a_hundred_thousand_g_says_how_many_digits_are_left(folder):
    path = folder / "gun.toml"
    path.write_text(STUDY.format(levels='["1 g", "1000 g", "1e5 g"]'))
    found = run(path)
    sensor = _decided(found)
    numbers = [term[key] for term in sensor["terms"] for key in ("mean", "sd", "inclusion")]
    assert all(value is not None and math.isfinite(value) for value in numbers)
    # a cubic term of 1e10 m/s^2 beside 1e-3 of noise: few digits, and the first paragraph says so
    assert min(sensor["digits"]["coefficients"], sensor["digits"]["sd"]) < 3
    assert "The arithmetic is sure to leave" in report_html(found)


def test_time_stamps_of_a_billion_seconds_change_no_decision(folder):
    path = folder / "arm.toml"
    path.write_text(STUDY.format(levels='["1 g", "5 g", "20 g"]'))
    files = folder / "files"
    files.mkdir()
    written = record_study(read_study(path), files)
    early = next(file for file in written if file.suffix == ".toml")
    before = _decided(run(early))
    for file in files.glob("*.csv"):
        _shift(file, 1e9)
    after = _decided(run(early))
    assert before["digits"]["coefficients"] >= 5
    for one, other in zip(before["terms"], after["terms"], strict=True):
        # stamps are rounded to 1e-7 s of 0.25 s, a share of 5e-7 of each interval: far below an sd
        assert abs(other["mean"] - one["mean"]) <= 1e-3 * max(one["sd"], 1e-300), one["name"]
        assert other["inclusion"] == pytest.approx(one["inclusion"], abs=1e-4)
        assert other["verdict"] == one["verdict"]


def _shift(file, seconds: float) -> None:
    """Add to the time stamps of a recorded run."""
    with file.open() as stream:
        head, *rows = list(csv.reader(stream))
    column = next(k for k, name in enumerate(head) if name.split()[0] == "t")
    for row in rows:
        row[column] = repr(float(np.float64(row[column]) + seconds))
    with file.open("w", newline="") as stream:
        csv.writer(stream).writerows([head, *rows])
