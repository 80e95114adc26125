"""Every format, of the committed results of whole IMUs."""

from __future__ import annotations

import json
import math
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from compiling import built, call

from imubayes.reporting.export import FORMATS, exported
from imubayes.reporting.export.characterized import UNLIMITED, characterized
from imubayes.reporting.export.source_texts import compiled
from imubayes.sensors.imu import COMPONENTS, forward, signals
from imubayes.sensors.imu_compensation import compensate

REPORTS = Path(__file__).parents[3] / "reports"
STUDIES = ("imu_tk_xsens", "imucal_ferraris")
SAMPLING = {"imu_tk_xsens": 100.0, "imucal_ferraris": 102.4}
"""Hz, of the recordings."""


def inputs_of(found, n=200):
    rng = np.random.default_rng(5)
    f, w = (
        rng.uniform(-0.9, 0.9, (n, 3)) * np.where(np.array(ends) >= UNLIMITED, 1.0, ends)
        for ends in (found.within.f, found.within.w)
    )
    return signals(f, w)


@pytest.mark.parametrize("study", STUDIES)
@pytest.mark.parametrize("to", FORMATS)
def test_a_whole_imu_is_exported_in_every_format(study, to):
    digest = characterized(REPORTS / study).source.sha256
    texts = exported(REPORTS / study, to)
    assert texts and all(digest in text for text in texts.values())


@pytest.mark.parametrize("study", STUDIES)
@pytest.mark.parametrize("model", ["needed", "full"])
def test_the_model_covers_the_inputs_of_its_stills_and_turns(study, model):
    """Gravity along every axis, and rates of hands; no output of a shock, which nobody knew the input of."""
    found = characterized(REPORTS / study, model=model)
    assert tuple(found.parts) == COMPONENTS
    assert all(end == pytest.approx(1.1 * 9.80665) for end in found.within.f)
    assert all(0.5 < end < 10.0 for end in found.within.w)
    at_rest = signals(9.81 * np.vstack([np.eye(3), -np.eye(3)]))
    back = compensate(found.imu, forward(found.imu, at_rest), found.within)
    np.testing.assert_allclose(back.f, at_rest.f, atol=1e-9)


@pytest.mark.parametrize("study", STUDIES)
def test_python_and_c_return_the_inputs(study, tmp_path):
    found = characterized(REPORTS / study)
    inputs = inputs_of(found)
    outputs = forward(found.imu, inputs)
    f, w = compiled(found)["compensate"](outputs.f, outputs.w)
    np.testing.assert_allclose(np.hstack([f, w]), np.hstack([inputs.f, inputs.w]), atol=1e-11)
    if shutil.which("gcc"):
        library = built(found, tmp_path)
        (name,) = (
            n.removesuffix("_compensation.h") for n in exported(REPORTS / study, "c") if n.endswith("n.h")
        )
        known = np.tile([0.0, 0.0, 0.0, 298.15, 0.0], (len(inputs.f), 1))
        by_c, codes = call(
            getattr(library, f"{name}_compensate"), np.hstack([outputs.f, outputs.w]), known, np.float64
        )
        assert not codes.any()
        np.testing.assert_allclose(by_c, np.hstack([f, w]), atol=1e-11)


@pytest.mark.parametrize("study", STUDIES)
def test_kalibr_accepts_the_file(study):
    """What its reader checks (ImuParameters): five keys, positive figures, a topic that is a text."""
    (text,) = exported(REPORTS / study, "kalibr").values()
    found = dict(re.findall(r"^(\w+): (\S+)", text, re.MULTILINE))
    densities = [
        f"{kind}_{what}"
        for kind in ("accelerometer", "gyroscope")
        for what in ("noise_density", "random_walk")
    ]
    assert set(found) == {*densities, "rostopic", "update_rate"}
    assert all(float(found[key]) > 0.0 for key in densities)
    assert float(found["update_rate"]) == pytest.approx(SAMPLING[study], rel=1e-3)


@pytest.mark.parametrize("study", STUDIES)
def test_simulators_and_filters_get_the_biases_of_the_model_that_predicts_best(study):
    raw = json.loads((REPORTS / study / "result.json").read_text())["sensors"]
    best = {one["id"][-2:]: one["compensations"][0] for one in raw}
    place = {name: one["terms"].index("b0") for name, one in best.items()}
    bias = {name: one["mean"][place[name]] for name, one in best.items()}
    names: dict = {}
    texts = exported(REPORTS / study, "json")
    exec(next(text for name, text in texts.items() if name.endswith("gnss_ins_sim.py")), names)
    error, record = names["imu_err"], json.loads(next(iter(exported(REPORTS / study, "filter").values())))
    np.testing.assert_allclose(error["accel_b"], [bias[c] for c in COMPONENTS[:3]], rtol=1e-8)
    kept = {state["name"]: k for k, state in enumerate(record["states"])}
    for c in COMPONENTS:
        sd = math.sqrt(best[c]["covariance"][place[c]][place[c]])
        P = record["P0"][kept[f"{c}.b0"]][kept[f"{c}.b0"]]
        assert math.sqrt(P) == pytest.approx(sd, rel=1e-9)
