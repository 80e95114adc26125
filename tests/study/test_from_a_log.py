"""The three walks of docs/calibration.md, on logs that are made as the page says."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from hands import in_the_hand, with_truth
from run_files import csv_of

from imubayes.rig.simulate import synthesise
from imubayes.sensors.noise import Noise
from imubayes.sensors.terms import library

PAGE = (Path(__file__).parents[2] / "docs" / "calibration.md").read_text(encoding="utf-8")


def hand(path, header):
    """An IMU with a scale-factor error and a bias of each kind."""
    accelerometers = with_truth(
        library("accelerometer", powers=1, asymmetry=-1), {"ax.b0": 0.05, "ay.b1": 4e-3}
    )
    gyroscopes = with_truth(
        library("gyroscope", powers=1, asymmetry=-1), {"gz.b0": 5e-3, "gx.b1": 6e-3}, referenced=True
    )
    run = in_the_hand(accelerometers, gyroscopes, stills=18)
    csv_of(path.parent, header, np.column_stack((run.inputs.t, run.output)), path.name)
    return {
        "IMU-1.ax": {"b0": 0.05},
        "IMU-1.ay": {"b1": 4e-3},
        "IMU-1.gz": {"b0": 5e-3},
        "IMU-1.gx": {"b1": 6e-3},
    }


def positions(path, header):
    """24 positions of a tumble in three planes."""
    rng, angle = np.random.default_rng(3), np.deg2rad(np.arange(0.0, 360.0, 45.0))
    zero = np.zeros(8)
    f = np.vstack([
        np.column_stack(plane)
        for plane in ((np.cos(angle), np.sin(angle), zero), (np.cos(angle), zero, np.sin(angle)),
                      (zero, np.cos(angle), np.sin(angle)))
    ])  # fmt: skip
    count = np.full(24, 3000.0)
    mean = f[:, 0] * (1.0 + 4e-4) + 2e-3 - 3e-4 * f[:, 1] + 1e-5 * rng.standard_normal(24)
    csv_of(path.parent, header, np.column_stack((f, mean, count)), path.name)
    return {"ACC-1": {"b0": 2e-3 * 9.80665, "b1": 4e-4, "m_j": -3e-4}}


def rest(path, header):
    """Twenty minutes at 12.5 Hz, in deg/s."""
    t = 0.08 * np.arange(15_000)
    noise = Noise(np.deg2rad(0.1) / 60.0, np.deg2rad(2.0) / 3600.0, 0.0)
    rate = np.deg2rad(30.0) / 3600.0 + synthesise(noise, t, 0.08, np.random.default_rng(8))
    csv_of(path.parent, header, np.column_stack((t, np.rad2deg(rate))), path.name)
    return {"GYRO-1": {"b0": np.deg2rad(30.0) / 3600.0}}


@pytest.mark.parametrize("walk", [pytest.param(hand, marks=pytest.mark.slow), positions, rest])
def test_the_page_takes_a_log_to_its_calibration(walk, tmp_path, command) -> None:
    """What was put in lies within four sds of what comes out, and what is there is needed."""
    walks = [part for part in re.split(r"^## ", PAGE, flags=re.M) if "```csv" in part]
    section = walks[[hand, positions, rest].index(walk)]
    header, study = (re.search(rf"```{of}\n(.*?)```", section, re.S)[1] for of in ("csv", "toml"))
    file = re.search(r'^file = "(.*?)"', study, re.M)[1]
    truth = walk(tmp_path / file, header.strip())
    (tmp_path / "study.toml").write_text(study, encoding="utf-8")
    ended = command("run", tmp_path / "study.toml", "--out", tmp_path / "out")
    assert ended.code in (0, None), ended.words
    result = json.loads((tmp_path / "out" / "result.json").read_text(encoding="utf-8"))
    found = {one["id"]: {term["name"]: term for term in one["terms"]} for one in result["sensors"]}
    for sensor, coefficients in truth.items():
        for name, size in coefficients.items():
            term = found[sensor][name]
            assert term["verdict"] == "needed", (sensor, name)
            assert abs(term["mean"] - size) < 4.0 * term["sd"], (sensor, name)
