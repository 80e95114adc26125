from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from imubayes.reporting.results import command, result_json
from imubayes.reporting.sampled_results import column_moments, noise_posterior


def written(study) -> dict:
    return json.loads(result_json(study))


@pytest.mark.parametrize("method", ["exact", "collapsed"])
def test_mcmc_block_names_the_method(make_sensor, make_sampled, make_study, method) -> None:
    sensor = make_sensor() if method == "exact" else make_sampled()
    (entry,) = written(make_study(sensor))["sensors"]
    assert entry["mcmc"]["sampler"] == entry["method"] == method


def test_mcmc_block_says_what_the_diagnostics_say(make_sampled, make_study) -> None:
    sensor = make_sampled(converged=False)
    block = written(make_study(sensor))["sensors"][0]["mcmc"]
    assert (block["worst"], block["ess_min"], block["rhat_max"]) == ("b2", 31.0, 1.83)
    assert block["converged"] is False and block["draws"] == 2000 and block["ensembles"] == 4
    assert block["log_evidence"]["value"] == 8120.4 and block["log_evidence"]["sd"] == 0.05


def test_moments_by_the_chains_stand_beside_each_term_and_are_null_where_exact(
    make_sensor, make_sampled, make_study
) -> None:
    sensor = make_sampled()
    terms = written(make_study(sensor))["sensors"][0]["terms"]
    first = sensor.chains.theta[:, :, 0].ravel().tolist()
    mean = sum(first) / len(first)
    sd = (sum((x - mean) ** 2 for x in first) / (len(first) - 1)) ** 0.5
    assert terms[0]["mcmc_mean"] == pytest.approx(mean, rel=1e-12)
    assert terms[0]["mcmc_sd"] == pytest.approx(sd, rel=1e-9)
    assert terms[4]["plug_in_inclusion"] == sensor.selection.plug_in[4]
    exact = written(make_study(make_sensor()))["sensors"][0]
    assert all(t["mcmc_mean"] is t["mcmc_sd"] is t["plug_in_inclusion"] is None for t in exact["terms"])
    assert exact["noise_posterior"] == {} and exact["extras"] == exact["distrusted"] == []


def test_component_of_a_triad_takes_its_own_columns_of_the_chains(make_sampled) -> None:
    sensor = make_sampled()
    columns = tuple(f"ay.{name}" for name in sensor.selection.columns)
    other = ("ax.b0", *columns, *sensor.chains.names[len(columns) :])
    theta = np.concatenate((sensor.chains.theta[:, :, :1] + 7.0, sensor.chains.theta), axis=-1)
    triad = replace(
        sensor,
        selection=replace(sensor.selection, columns=columns),
        chains=replace(sensor.chains, names=other, theta=theta),
    )
    assert column_moments(triad) == column_moments(sensor)


def test_noise_posterior_holds_nine_tenths_of_the_draws_between_its_ends(make_sampled) -> None:
    chains = make_sampled().chains
    for g, run in enumerate(chains.runs):
        for k, letter in enumerate("NBK"):
            told, draws = noise_posterior(chains)[run][letter], chains.noise[:, :, g, k]
            # 2000 draws: the ends fall between two of them
            inside = np.mean((draws >= told["q05"]) & (draws <= told["q95"]))
            assert inside == pytest.approx(0.9, abs=1.0 / 2000.0)
            assert told["q05"] < told["mean"] < told["q95"]


def test_test_bench_and_distrusted_dwells_are_written_in_si(make_sampled, make_study) -> None:
    sensor = make_sampled()
    (entry,) = written(make_study(sensor))["sensors"]
    gravity = entry["extras"][0]
    assert gravity["prior_sd"] == pytest.approx(50e-6 * 9.80665) and gravity["confounded_with"] == ["b1"]
    assert gravity["text"] == "error of local gravity" and len(entry["extras"]) == 3
    assert [dwell["start"] for dwell in entry["distrusted"]] == [120.0, 900.0]


def test_sessions_are_written_with_null_where_a_unit_lacks_one(make_study, make_sessions) -> None:
    one = make_sessions("b0")
    (entry,) = written(replace(make_study(), sessions=(one,)))["sessions"]
    assert entry["mean"][-1][-1] is None and entry["mean"][0][0] == one.mean[0, 0]
    assert entry["between"] == dict(zip(("mean", "q05", "q95"), one.between, strict=True))


def test_appendices_are_written_by_title_and_command(make_study, appendix) -> None:
    study = make_study()
    study = replace(study, study=replace(study.study, appendices=(appendix,)))
    (entry,) = json.loads(result_json(study))["appendices"]
    assert entry == {"title": appendix.title, "command": appendix.command}


def test_command_repeats_the_method_that_was_asked_for(make_study) -> None:
    study = make_study().study
    assert command(study) == "imubayes run studies/acc07.toml"
    full = replace(study, sampling=replace(study.sampling, method="full"))
    assert command(full) == "imubayes run studies/acc07.toml --method full"
