"""``imubayes run --budget`` and ``--accuracy`` as a person meets them."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from imubayes.ladder.rungs import NAMES
from imubayes.reporting.results import result_json
from imubayes.study.method import run
from imubayes.study.schema import read_study

IMU = """
[study]
title = "case"
[decision]
compare = false
[[sensor]]
id = "imu"
kind = "imu"
class = "mems_tactical"
library.accelerometer = { powers = 1, asymmetry = -1 }
library.gyroscope = { powers = 1, asymmetry = -1 }
[[sensor.run]]
name = "tumble"
procedure = "tumble"
simulate = { angles = 8, planes = 3, dwell = "2 s", rate = "2 Hz", latitude = "45 deg" }
"""

SHAKEN = """
[[sensor]]
id = "gyro"
kind = "gyroscope"
class = "mems_consumer"
[[sensor.run]]
name = "r0"
procedure = "oscillation"
simulate = { amplitude = "30 deg", frequencies = ["1 Hz"], rate = "50 Hz", dwell = "2 s" }
"""


@pytest.fixture
def study(study: Path) -> Path:
    """The small study, which asks for no method itself."""
    study.write_text(study.read_text().replace('method = "exact"\n', ""))
    return study


@pytest.fixture
def imu(tmp_path: Path) -> Path:
    """A study of a whole IMU."""
    path = tmp_path / "imu.toml"
    path.write_text(IMU)
    return path


def _run(command, study: Path, *options: str) -> tuple[dict, str, str]:
    """Result, report and words of a run."""
    out = study.parent / "out"
    ended = command("run", study, "--out", out, *options)
    assert ended.code == 0
    return json.loads((out / "result.json").read_text()), (out / "report.html").read_text(), ended.words


def _asked(study: Path, **sampling: object) -> dict:
    """Result of a study that asks for this itself."""
    told = read_study(study)
    return json.loads(result_json(run(replace(told, sampling=replace(told.sampling, **sampling)))))


def test_a_budget_says_in_every_output_what_was_taken_and_what_it_gave_up(command, study):
    result, report, shown = _run(command, study, "--budget", "10 us")
    (sensor,) = result["sensors"]
    choice = sensor["choice"]
    assert (choice["rung"], choice["asked"], choice["next"]["rung"]) == (
        "means",
        "a budget of 1e-05 s",
        "sparse",
    )
    assert sensor["method"] == "means"
    assert result["provenance"]["command"].endswith('--budget "1e-05 s"')
    for text in (shown, " ".join(report.split())):
        assert "ordinary least squares, BIC" in text
        assert "The next rung" in text
        assert "Left out for the sake of time: the residual checks" in text
        assert "the cheapest: none fits a budget of 1e-05 s" in text
        assert re.search(r"models weighed in [\d.]+ s, picked by the method: how probable", text)
        assert "picked by the method: how probable the others are is not known" in text
        assert "carry at most" not in text
    assert sensor["missing"] is None
    assert choice["met"] is False


def test_least_squares_on_fewer_dwells_than_terms_tells_none_of_them(command, tmp_path):
    path = tmp_path / "shaken.toml"
    path.write_text(SHAKEN)
    result, _, _ = _run(command, path, "--method", "means")
    sensor = result["sensors"][0]
    assert len(sensor["terms"]) > 9  # dwells, one a mount
    said = {term["name"]: term["verdict"] for term in sensor["terms"]}
    assert {*said.values()} <= {"inseparable", "unresolved", "untested"}
    causes = {one["cause"] for one in sensor["votes"]["disagreements"] if said[one["term"]] == "inseparable"}
    assert causes == {"collinearity"}


def test_a_cheap_rung_agrees_with_the_default_within_what_it_foresees(command, study):
    """Plug-in against the noise's posterior: three times what was foreseen, and their Monte Carlo errors."""
    cheap = _run(command, study, "--accuracy", "1e9")[0]["sensors"][0]
    best = _run(command, study, "--method", "collapsed")[0]["sensors"][0]
    climbed = [step["rung"] for step in cheap["choice"]["climbed"]]
    assert climbed == list(NAMES[:2])
    apart = [
        abs(a["full_mean"] - b["full_mean"]) / b["full_sd"]
        for a, b in zip(cheap["terms"], best["terms"], strict=True)
    ]
    assert np.max(apart) < 3.0 * cheap["choice"]["next"]["change_sd"] + 0.3


def test_a_budget_of_an_imu_is_shared_by_its_components_and_gives_the_method_to_all(command, imu):
    hurried, report, shown = _run(command, imu, "--budget", "10 us")
    usual = _asked(imu, method="plug-in")
    assert [one["id"][-2:] for one in hurried["sensors"]] == ["ax", "ay", "az", "gx", "gy", "gz"]
    for one, other in zip(hurried["sensors"], usual["sensors"], strict=True):
        choice = one["choice"]
        assert (choice["rung"], choice["next"]["rung"], choice["met"]) == ("plug-in", "averaged", False)
        assert one["terms"] == other["terms"] and one["calibration"] == other["calibration"]
        assert other["residuals"] and not one["residuals"]
    for text in (shown, " ".join(report.split())):
        assert "the cheapest: none fits a budget of 1e-05 s" in text
        assert "Left out for the sake of time: the residual checks" in text


def test_an_imu_is_climbed_until_no_component_changes_by_more_than_the_accuracy(imu):
    for one in _asked(imu, accuracy=1e9)["sensors"]:
        assert [step["rung"] for step in one["choice"]["climbed"]] == ["plug-in", "averaged"]
        assert one["choice"]["met"] and one["method"] == "averaged"
