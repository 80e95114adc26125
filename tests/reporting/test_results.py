"""A study's result as it is published."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from results_found import judged_result, repeatability, sampled_result, sensor_result, study_result

from imubayes.reporting.result.file import adapter
from imubayes.reporting.results import (
    column_moments,
    command,
    noise_posterior,
    published_result,
    result_json,
)


def written(study) -> dict:
    return json.loads(result_json(study))


def test_result_is_strict_json_that_reads_back(result) -> None:
    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    assert adapter().validate_python(json.loads(result_json(result), parse_constant=refuse))


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, np.float64("nan")])
def test_what_is_not_finite_becomes_null(result, value: float) -> None:
    sensor = result.sensors[0]
    check = replace(sensor.checks[0], whiteness_p=value)
    broken = replace(sensor, checks=(check,), calibration={"scale": value, "bias": np.float64(2.0)})
    (entry,) = written(replace(result, sensors=(broken,)))["sensors"]
    assert entry["residuals"][0]["whiteness_p"] is None
    assert entry["calibration"] == {"scale": None, "bias": 2.0}


def test_component_of_a_triad_is_written_with_its_own_terms_only() -> None:
    sensor = sensor_result("IMU.ay")
    seen, own = sensor.selection.observability, [term.name for term in sensor.selection.terms]
    columns = tuple(f"ay.{name}" for name in own)
    wide = replace(
        seen,
        names=("ax.b0", *columns),
        tested=np.concatenate([[False], seen.tested]),
        ratio=np.concatenate([[0.5], seen.ratio]),
        alone=np.concatenate([[0.5], seen.alone]),
        vif=np.concatenate([[9.0], seen.vif]),
        groups=(),
    )
    selection = replace(sensor.selection, columns=columns, observability=wide)
    (entry,) = written(study_result(replace(sensor, selection=selection)))["sensors"]
    assert list(entry["observability"]) == own
    assert entry["observability"]["b0"]["ratio"] == seen.ratio[0]


def test_terms_of_a_triads_component_have_their_own_names() -> None:
    sensor = judged_result()
    columns = tuple(f"ay.{name}" for name in sensor.selection.columns)
    panel = sensor.panel
    there = tuple(f"ay.{name}" for name in panel.sensitivity.names)
    sparse = replace(panel.sindy[0], names=there, model=there[:2], inclusion=dict.fromkeys(there, 0.5))
    far = replace(
        panel, sindy=(sparse,), sensitivity=replace(panel.sensitivity, names=there, swing=there[:1])
    )
    seen = replace(
        sensor.selection.observability,
        names=tuple(f"ay.{name}" for name in sensor.selection.observability.names),
    )
    selection = replace(sensor.selection, columns=columns, observability=seen)
    (block,) = published_result(study_result(replace(sensor, selection=selection, panel=far)))["sensors"]
    assert block["sindy"]["stlsq"]["model"] == ("b0", "b1") and "b0" in block["sindy"]["stlsq"]["inclusion"]
    assert block["sensitivity"]["swing"] == ("b0",) and "b0" in block["sensitivity"]["g_prior"]


def test_moments_by_the_chains_stand_beside_each_term_and_are_null_where_exact() -> None:
    sensor = sampled_result()
    terms = written(study_result(sensor))["sensors"][0]["terms"]
    first = sensor.chains.theta[:, :, 0].ravel().tolist()
    mean = sum(first) / len(first)
    sd = (sum((x - mean) ** 2 for x in first) / (len(first) - 1)) ** 0.5
    assert terms[0]["mcmc_mean"] == pytest.approx(mean, rel=1e-12)
    assert terms[0]["mcmc_sd"] == pytest.approx(sd, rel=1e-9)
    assert terms[4]["plug_in_inclusion"] == sensor.selection.plug_in[4]
    exact = written(study_result(sensor_result()))["sensors"][0]
    assert all(t["mcmc_mean"] is t["mcmc_sd"] is t["plug_in_inclusion"] is None for t in exact["terms"])
    assert exact["noise_posterior"] == {} and exact["extras"] == exact["distrusted"] == []


def test_component_of_a_triad_takes_its_own_columns_of_the_chains() -> None:
    sensor = sampled_result()
    columns = tuple(f"ay.{name}" for name in sensor.selection.columns)
    other = ("ax.b0", *columns, *sensor.chains.names[len(columns) :])
    theta = np.concatenate((sensor.chains.theta[:, :, :1] + 7.0, sensor.chains.theta), axis=-1)
    triad = replace(
        sensor,
        selection=replace(sensor.selection, columns=columns),
        chains=replace(sensor.chains, names=other, theta=theta),
    )
    assert column_moments(triad) == column_moments(sensor)


def test_noise_posterior_holds_nine_tenths_of_the_draws_between_its_ends() -> None:
    chains = sampled_result().chains
    for g, run in enumerate(chains.runs):
        for k, letter in enumerate("NBK"):
            told, draws = noise_posterior(chains)[run][letter], chains.noise[:, :, g, k]
            # 2000 draws: the ends fall between two of them
            inside = np.mean((draws >= told["q05"]) & (draws <= told["q95"]))
            assert inside == pytest.approx(0.9, abs=1.0 / 2000.0)
            assert told["q05"] < told["mean"] < told["q95"]


def test_sessions_are_written_with_null_where_a_unit_lacks_one() -> None:
    one = repeatability("b0")
    (entry,) = written(replace(study_result(), sessions=(one,)))["sessions"]
    assert entry["mean"][-1][-1] is None and entry["mean"][0][0] == one.mean[0, 0]
    assert entry["between"] == dict(zip(("mean", "q05", "q95"), one.between, strict=True))


def test_command_repeats_the_method_that_was_asked_for() -> None:
    study = study_result().study
    assert command(study) == "imubayes run studies/acc07.toml"
    full = replace(study, sampling=replace(study.sampling, method="full"))
    assert command(full) == "imubayes run studies/acc07.toml --method full"
