"""A study with scenes, from its file to its report."""

import json

import numpy as np
import pytest
from run_files import csv_of

from imubayes.algebra import factor as algebra
from imubayes.campaign.preparation import prepare, runs_of
from imubayes.reporting.export import exported
from imubayes.reporting.posterior import write_posterior
from imubayes.reporting.results import result_json
from imubayes.sensors.terms import columns
from imubayes.study.method import run
from imubayes.study.schema import read_study, record_study
from imubayes.work import silent

STUDY = """
[study]
title = "in use"
seed = 3
method = "exact"
catalogue = "own.toml"
[decision]
compare = false
[[sensor]]
id = "ACC"
kind = "accelerometer"
class = "mine"
library = { powers = 2, asymmetry = -1, temperature = 1 }
truth = { b0 = "3 mg", b2 = "300 ug/g^2", m_j = "1 mrad" }
[[sensor.run]]
name = "tumble"
procedure = "tumble"
simulate = { angles = 12, dwell = "10 s", rate = "2 Hz" }
[[scene]]
file = "flight.csv"
budget = { velocity = "10 cm/s" }
[[scene]]
name = "quadrotor"
duration = "1 min"
budget = { output = "1 mg" }
axis = "z"
"""
OWN = '[accelerometer.mine]\nlike = "mems_tactical"\ngrade = "mine"\n'
STEP, ROWS = 0.1, 400


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("use")
    (path / "use.toml").write_text(STUDY)
    (path / "own.toml").write_text(OWN)
    t = STEP * np.arange(ROWS)
    table = np.column_stack((t, 2.0 + np.sin(t), np.cos(3.0 * t), np.full(ROWS, 9.8)))
    csv_of(path, "t [s],f_i [m/s^2],f_j [m/s^2],f_k [m/s^2]", table, "flight.csv")
    return path


@pytest.fixture(scope="module")
def result(folder):
    return run(folder / "use.toml")


def test_rms_effect_is_that_of_the_draws_over_the_log(result, folder):
    """Second route: the output error of every draw at every row."""
    (_, found) = result.scenes[0]
    t, f_i, f_j, f_k = np.loadtxt(folder / "flight.csv", delimiter=",", skiprows=1).T
    lib = result.study.sensors[0].library
    X = columns(lib, {"f_i": f_i, "f_j": f_j, "f_k": f_k}, len(t))
    theta = result.sensors[0].draws
    for j, term in enumerate(found.terms):
        error = np.outer(theta[:, j], X[:, j])
        assert term.rms == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-10, abs=1e-30)


def test_model_holds_what_costs_the_budget_and_leaves_out_what_does_not(result):
    (_, flight), (_, hover) = result.scenes
    # 3 mg over 40 s is 1.2 m/s of velocity, 12 budgets; b0 is known to about 0.1 mg
    assert "b0" in flight.model and "S_ij" not in flight.model
    assert {"b0"} <= set(hover.model)
    assert (hover.axis, hover.duration) == ("z", 60.0)


def test_correlation_is_that_of_the_posterior_covariance(result):
    """Second route: the inverse of the normal equations with the prior, scaled to unit variance."""
    spec = result.study.sensors[0]
    ready = prepare(spec, runs_of(spec, result.study.seed, 0), silent, np.random.default_rng(0))
    R = ready.summary.factor.R[:-1, :-1] * ready.prior.sd
    cov = np.linalg.inv(R.T @ R + np.eye(len(R)))
    sd = np.sqrt(np.diag(cov))
    carriers = [spec.library.names.index(name) for name in spec.library.carriers]
    expected = (cov / np.outer(sd, sd))[np.ix_(carriers, carriers)]
    assert result.sensors[0].correlation == pytest.approx(expected, abs=1e-8)
    assert algebra.posterior(ready.summary.factor, ready.prior.sd)[1] == pytest.approx(
        sd * ready.prior.sd, rel=1e-8
    )


def test_recorded_study_still_finds_its_log_and_its_catalogue(folder, tmp_path):
    record_study(read_study(folder / "use.toml"), tmp_path)
    study = read_study(tmp_path / "use.toml")
    assert study.scenes[0].scene.duration == pytest.approx(STEP * ROWS)
    assert study.sensors[0].sensor_class.id == "mine"


TURNED = """
[study]
seed = 1
method = "exact"
[decision]
compare = false
[[sensor]]
id = "ACC"
kind = "accelerometer"
class = "mems_tactical"
library = { powers = 1, asymmetry = -1 }
truth = { b0 = "3 mg", S_ik = "60 ug/(rad/s)^2", s_j = "60 ug/(rad/s^2)" }
[[sensor.run]]
name = "steps"
procedure = "rate-table"
simulate = { rates = ["-300 deg/s", "0 deg/s", "300 deg/s"], dwell = "10 s", rate = "1 Hz" }
[[sensor.run]]
name = "swing"
procedure = "oscillation"
simulate = { frequencies = ["2 Hz"] }
[[scene]]
name = "quadrotor"
duration = "1 min"
budget = { output = "1 mg" }
"""


def test_what_a_lever_arm_ties_is_one_coefficient_from_the_study_to_its_exports(tmp_path):
    (tmp_path / "turned.toml").write_text(TURNED)
    found = run(tmp_path / "turned.toml")
    (sensor,) = found.sensors
    (tmp_path / "result.json").write_text(result_json(found), encoding="utf-8")
    write_posterior(found, tmp_path)
    told = json.loads(result_json(found))["sensors"][0]
    terms = {term["name"]: term for term in told["terms"]}
    assert terms["s_j"]["reason"] == f"one lever arm with S_ik: {terms['S_ik']['reason']}"
    assert terms["s_j"]["verdict"] == terms["S_ik"]["verdict"] == "needed"
    assert (
        terms["s_j"]["mean"]
        == terms["S_ik"]["mean"]
        == pytest.approx(60e-6 * 9.80665, abs=4.0 * terms["s_j"]["sd"])
    )
    assert "s_j" not in told["candidates"] and told["observability"]["s_j"] == told["observability"]["S_ik"]
    assert {"S_ik", "s_j"} <= set(told["model"])
    names = [term.name for term in sensor.selection.terms]
    j, k = names.index("s_j"), names.index("S_ik")
    assert (sensor.draws[:, j] == sensor.draws[:, k]).all() and sensor.correlation[j, k] == pytest.approx(1.0)
    (scene,) = found.scenes
    share = {term.name: term.share_of_budget for term in scene[1].terms}
    assert 0.0 < share["s_j"] != share["S_ik"] > 0.0  # each by its own part of the motion
    made = json.loads(exported(tmp_path / "result.json", "json")["acc_model.json"])
    written = {term["name"]: term["value"] for term in made["components"]["ax"]["terms"]}
    best = told["compensations"][0]
    predicting = dict(zip(best["terms"], best["mean"], strict=True))
    assert written["s_j"] == written["S_ik"] == predicting["s_j"] == predicting["S_ik"]
    assert written["s_j"] == pytest.approx(60e-6 * 9.80665, abs=4.0 * terms["s_j"]["sd"])
