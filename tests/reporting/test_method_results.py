from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from imubayes.reporting.method_results import opinions
from imubayes.reporting.results import result_json

NAMES = ["aic", "aicc", "bic", "hqc", "ebic", "waic", "loo", "leave_one_run_out"]


def test_methods_are_written_under_the_names_of_the_contract(make_judged, make_study) -> None:
    (sensor,) = json.loads(result_json(make_study(make_judged())))["sensors"]
    assert list(sensor["criteria"]) == NAMES
    assert all(set(one) >= {"model", "value"} for one in sensor["criteria"].values())
    assert list(sensor["sindy"]) == ["stlsq", "sr3", "ssr", "frols"]
    assert all(set(one) >= {"model", "inclusion"} for one in sensor["sindy"].values())
    assert sensor["groups"] == [{"terms": ["c_jj", "c_kk"], "any_inclusion": 0.52}]
    assert [one["input"] for one in sensor["misfit"]["found"]] == ["hysteresis of T"]


def test_what_a_method_does_not_say_is_null(make_judged, make_study) -> None:
    (sensor,) = json.loads(result_json(make_study(make_judged())))["sensors"]
    assert sensor["criteria"]["bic"]["pareto_k"] is None and sensor["criteria"]["loo"]["pareto_k"] == 0.31
    assert sensor["criteria"]["loo"]["samples"] is None


def test_votes_and_other_priors_read_back_as_they_were(make_judged, make_study) -> None:
    sensor = make_judged()
    (written,) = json.loads(result_json(make_study(sensor)))["sensors"]
    votes, found = sensor.panel.votes, sensor.panel.sensitivity
    assert tuple(written["votes"]["terms"]) == votes.terms
    for table, name in ((votes.strength, "strength"), (votes.keeps, "keeps")):
        assert tuple(written["votes"][name]) == votes.methods
        assert np.array_equal(np.array(list(written["votes"][name].values())), table)
    assert np.array_equal(np.array(list(written["sensitivity"]["inclusion"].values())).T, found.inclusion)
    assert written["reduced"]["lost"] == pytest.approx(sensor.panel.reduced.lost, rel=1e-15)


def test_terms_of_a_triads_component_have_their_own_names(make_judged) -> None:
    sensor = make_judged()
    columns = tuple(f"ay.{name}" for name in sensor.selection.columns)
    panel = sensor.panel
    there = tuple(f"ay.{name}" for name in panel.sensitivity.names)
    sparse = replace(panel.sindy[0], names=there, model=there[:2], inclusion=dict.fromkeys(there, 0.5))
    far = replace(
        panel, sindy=(sparse,), sensitivity=replace(panel.sensitivity, names=there, swing=there[:1])
    )
    block = opinions(replace(sensor, selection=replace(sensor.selection, columns=columns), panel=far))
    assert block["sindy"]["stlsq"]["model"] == ("b0", "b1") and "b0" in block["sindy"]["stlsq"]["inclusion"]
    assert block["sensitivity"]["swing"] == ("b0",) and "b0" in block["sensitivity"]["g_prior"]


def test_without_other_methods_their_keys_are_there_and_empty(make_sensor) -> None:
    block = opinions(make_sensor())
    assert block["criteria"] == block["sindy"] == {} and block["groups"] == []
    assert [block[name] for name in ("sensitivity", "votes", "reduced", "misfit")] == [None] * 4
