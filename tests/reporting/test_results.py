"""A study's result as it is published."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from page_reading import printed, report_html
from populations_found import SESSIONS, UNITS, class_found
from results_found import judged_result, sampled_result, sensor_result, study_result

from imubayes.reporting.document import report_page
from imubayes.reporting.result.file import adapter
from imubayes.reporting.results import column_moments, command, noise_posterior, result_json
from imubayes.selection.panel import Unasked


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
    own = column_moments(sensor)
    assert {name: told for name, told in column_moments(triad).items() if name in own} == own


def test_noise_posterior_holds_nine_tenths_of_the_draws_between_its_ends() -> None:
    chains = sampled_result().chains
    for g, run in enumerate(chains.runs):
        for k, letter in enumerate("NBK"):
            told, draws = noise_posterior(chains)[run][letter], chains.noise[:, :, g, k]
            # 2000 draws: the ends fall between two of them
            inside = np.mean((draws >= told["q05"]) & (draws <= told["q95"]))
            assert inside == pytest.approx(0.9, abs=1.0 / 2000.0)
            assert told["q05"] < told["mean"] < told["q95"]


def test_command_repeats_the_method_that_was_asked_for() -> None:
    study = study_result().study
    assert command(study) == "imubayes run studies/acc07.toml"
    full = replace(study, sampling=replace(study.sampling, method="full"))
    assert command(full) == "imubayes run studies/acc07.toml --method full"


def test_population_is_in_the_results_in_si(result) -> None:
    found = class_found()
    (entry,) = json.loads(result_json(replace(result, classes=(found,))))["population"]
    assert (entry["class"], entry["units"], entry["sessions"]) == ("mems_consumer", [*UNITS], [*SESSIONS])
    whole, one = entry["terms"][:2]
    assert whole["mean"]["median"] is None and one["parameter"] == "ax.b0"
    assert one["mean"]["median"] == pytest.approx(found.terms[1].spreads.mean.value)
    assert one["unit_to_unit"]["q95"] == pytest.approx(found.terms[1].spreads.unit_to_unit.high)
    assert one["session_shift"]["sessions"] == [*SESSIONS] and len(one["session_shift"]["mean"]) == 3
    assert (one["verdict"], one["answers"]) == ("needed", {"needed": 8})
    assert one["needed"]["q05"] == pytest.approx(found.terms[1].need.share.low)


def test_opinion_that_could_not_be_had_is_named_in_report_terminal_and_file() -> None:
    sensor = judged_result()
    unasked = (Unasked("ssr", "ValueError, <nothing> to drop"), Unasked("reduced model", "no room"))
    panel = replace(sensor.panel, sindy=sensor.panel.sindy[:2], reduced=None, unasked=unasked)
    result = study_result(replace(sensor, panel=panel))
    html = report_html(result)
    assert (
        "Left out: SSR (ValueError, &lt;nothing&gt; to drop)." in html and "Left out: reduced model" in html
    )
    assert "Left out: SSR (ValueError, <nothing> to drop)." in printed(report_page(result))
    (written,) = json.loads(result_json(result))["sensors"]
    assert written["reduced"] is None and set(written["sindy"]) == {"stlsq", "sr3"}
    assert written["unasked"][0] == {"method": "ssr", "reason": "ValueError, <nothing> to drop"}
