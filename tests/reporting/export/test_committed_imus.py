"""Every format, of the committed results of whole IMUs."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from imubayes.reporting.export import FORMATS, exported
from imubayes.reporting.export.characterized import characterized
from imubayes.sensors.imu import COMPONENTS

REPORTS = Path(__file__).parents[3] / "reports"
STUDIES = ("imu_tk_xsens", "imucal_ferraris")


@pytest.mark.parametrize("study", STUDIES)
@pytest.mark.parametrize("to", FORMATS)
def test_a_whole_imu_is_exported_in_every_format(study, to):
    digest = characterized(REPORTS / study, accept_misfit=True).source.sha256
    texts = exported(REPORTS / study, to, accept_misfit=True, model="basic" if to == "px4" else "best")
    assert texts and all(digest in text for text in texts.values())


@pytest.mark.parametrize("study", STUDIES)
def test_simulators_and_filters_get_the_biases_of_the_model_that_predicts_best(study):
    raw = json.loads((REPORTS / study / "result.json").read_text())["sensors"]
    best = {one["id"][-2:]: one["compensations"][0] for one in raw}
    place = {name: one["terms"].index("b0") for name, one in best.items()}
    bias = {name: one["mean"][place[name]] for name, one in best.items()}
    names: dict = {}
    texts = exported(REPORTS / study, "json", accept_misfit=True)
    exec(next(text for name, text in texts.items() if name.endswith("gnss_ins_sim.py")), names)
    error, record = (
        names["imu_err"],
        json.loads(next(iter(exported(REPORTS / study, "filter", accept_misfit=True).values()))),
    )
    np.testing.assert_allclose(error["accel_b"], [bias[c] for c in COMPONENTS[:3]], rtol=1e-8)
    kept = {state["name"]: k for k, state in enumerate(record["states"])}
    for c in COMPONENTS:
        sd = math.sqrt(best[c]["covariance"][place[c]][place[c]])
        P = record["P0"][kept[f"{c}.b0"]][kept[f"{c}.b0"]]
        assert math.sqrt(P) == pytest.approx(sd, rel=1e-9)
