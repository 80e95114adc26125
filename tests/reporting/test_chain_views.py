"""How the posterior was found, in words and tables: rung, chains, test bench, uncertain noise."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest
from results_found import sampled_result

from imubayes.reporting.chain_views import bias_sentence, diagnoses, own_errors
from imubayes.selection.decision import Bias


@pytest.mark.parametrize("sampled", [True, False])
def test_bridge_is_held_against_the_exact_evidence_only_where_they_mean_the_same(sampled):
    sensor = sampled_result()
    found = sensor.chains.diagnostics
    if not sampled:
        count = len(sensor.chains.names)
        found = replace(
            found,
            parameters=found.parameters[:count],
            ess=found.ess[:count],
            rhat=found.rhat[:count],
            tau=found.tau[:count],
        )
    told = diagnoses(sensor, replace(sensor.chains, diagnostics=found))
    assert ("noise's prior costs" in told) == sampled and ("must agree" in told) != sampled


@pytest.mark.parametrize(("id", "listed"), [("imu.ay", ["gravity", "tilt_j.ay"]), ("alone", None)])
def test_a_component_lists_the_bench_and_its_own_errors(id, listed):
    names = ["gravity", "tilt_j.ax", "tilt_j.ay", "turn_on.log.gz"]
    extras = [
        SimpleNamespace(extra=SimpleNamespace(name=name, kind=name.partition(".")[0])) for name in names
    ]
    found = own_errors(SimpleNamespace(id=id, extras=extras))
    assert [entry.extra.name for entry in found] == (listed or names)


@pytest.mark.parametrize(("drift", "told"), [(3.0, False), (9.0, False), (30.0, True)])
def test_drift_of_the_bias_is_told_where_it_is_more_than_its_error_bar_and_that_of_the_bias(drift, told):
    mean, sd, of_drift = 1e-3, 1e-4, 4e-5
    moved = drift * 1e-5
    bias = Bias((mean, sd), (mean, sd), (mean + moved, sd), (moved, of_drift), walk=4e-5)
    assert bool(bias_sentence(replace(sampled_result(), bias=bias))) == told
