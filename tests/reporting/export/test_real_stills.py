"""From a public recording to compensated stills, by the exported C: their norm is local gravity."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from compiling import built, call

from imubayes.reporting.export.characterized import characterized
from imubayes.sensors.noise import flicker
from imubayes.study.schema import read_runs

ROOT = Path(__file__).parents[3]

pytestmark = pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc")


def test_the_norm_of_the_compensated_stills_is_gravity_to_the_noise_of_their_means(
    tmp_path, monkeypatch, recordings
):
    monkeypatch.setenv("IMUBAYES_DATA", str(recordings))
    (run,) = read_runs(ROOT / "studies" / "xsens_tumble.toml")
    result = ROOT / "reports" / "xsens_tumble" / "result.json"
    stills = json.loads(result.read_text())["sensors"][0]["runs"][0]["stills"]
    found = characterized(result)
    before = np.array([run.output[(run.t >= a) & (run.t <= b)].mean(axis=0) for a, b in stills])
    known = np.tile([0.0, 0.0, 0.0, 298.15, 0.0], (len(stills), 1))
    library = built(found, tmp_path)
    after, codes = call(library.mti_compensate, np.hstack([before, 0.0 * before]), known, np.float64)
    error = np.linalg.norm(after[:, :3], axis=1) - run.gravity
    noise = max((part.noise for part in found.parts.values()), key=lambda one: one.B)
    lengths = np.array([b - a for a, b in stills])
    floor, _ = flicker(noise.B, lengths.min(), run.t[-1] - run.t[0])
    # an upper bound: the fit takes a part of the slow noise with it
    predicted = np.sqrt(np.mean(noise.N**2 / lengths) + floor.sum())
    assert not codes.any()
    assert np.sqrt(np.mean((np.linalg.norm(before, axis=1) - run.gravity) ** 2)) > 300.0 * predicted
    assert np.sqrt(np.mean(error**2)) < predicted
