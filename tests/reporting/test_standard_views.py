"""Fitted coefficients in the symbols of the standards."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from page_reading import report_html
from results_found import sensor_result, study_result

from imubayes.algebra.factor import factor_of
from imubayes.reporting.results import result_json
from imubayes.reporting.standard_views import standards
from imubayes.rig.rotations import centrifuge
from imubayes.rig.tumbles import tumble
from imubayes.sensors.catalogue import sensor
from imubayes.sensors.equations.standards import standard
from imubayes.sensors.terms import columns, library


def _correlation(p, rng):
    root = rng.standard_normal((p, 2 * p))
    cov = root @ root.T
    sd = np.sqrt(np.diag(cov))
    return cov / np.outer(sd, sd)


@pytest.fixture
def study_of():
    """A component of a class, with correlated coefficients."""

    def make(kind, class_id):
        lib = library(kind)
        one = sensor_result("S", lib=lib)
        one = replace(one, correlation=_correlation(len(lib.terms), np.random.default_rng(4)))
        result = study_result(one)
        spec = replace(result.study.sensors[0], sensor_class=sensor(class_id, kind=kind), library=lib)
        return replace(result, study=replace(result.study, sensors=(spec,)))

    return make


def _values(result):
    return standards(result.study, result.sensors[0])


def test_value_of_a_symbol_is_its_term_over_the_gain_and_the_convention(study_of):
    result = study_of("accelerometer", "mems_tactical")
    mean = {term.name: term.full_mean for term in result.sensors[0].selection.terms}
    found = {row["symbol"]: row for row in _values(result)["ieee1293"]["values"]}
    gain = 1.0 + mean["b1"]
    for symbol, term, weight in (("K0", "b0", 1.0), ("K2", "b2", 1.0), ("d_p", "m_k", -1.0)):
        assert found[symbol]["value"] == pytest.approx(mean[term] / (gain * weight), rel=1e-12)
        assert found[symbol]["term"] == term


def test_sd_carries_the_correlations_as_draws_do(study_of):
    """60,000 draws know an sd to 0.3 %; five of that."""
    result = study_of("accelerometer", "mems_tactical")
    one = result.sensors[0]
    terms = one.selection.terms
    mean, sd = (np.array([getattr(t, key) for t in terms]) for key in ("full_mean", "full_sd"))
    # a scale factor so uncertain that it shows in every value
    sd[1] = 0.01
    terms = tuple(replace(t, full_sd=float(s)) for t, s in zip(terms, sd, strict=True))
    one = replace(one, selection=replace(one.selection, terms=terms))
    cov = one.correlation * np.outer(sd, sd)
    draws = np.random.default_rng(1).multivariate_normal(mean, cov, 60_000, method="eigh")
    p = standard("ieee1293", kind="accelerometer").from_general(
        dict(zip([t.name for t in terms], draws.T, strict=True))
    )
    found = standards(result.study, one)["ieee1293"]
    fields = {row.symbol: row.field for row in standard("ieee1293", kind="accelerometer").symbols}
    tested = {row["symbol"]: row["sd"] for row in found["values"]}
    for symbol in ("K0", "K2", "d_p"):
        # what the linearisation leaves out is of the order of the gain's variance, 1e-4
        assert tested[symbol] == pytest.approx(float(np.std(getattr(p, fields[symbol]))), rel=0.015)


def test_terms_without_a_symbol_and_those_not_tested_are_said(study_of):
    result = study_of("accelerometer", "mems_tactical")
    basic = _values(result)["basic"]
    verdicts = {term.name: term.verdict for term in result.sensors[0].selection.terms}
    assert {row["verdict"] for row in basic["values"]} <= set(verdicts.values()) - {"untested"}
    assert "b2" in basic["general_only"]
    html = report_html(result)
    assert "In the symbols of IEEE 1293" in html and "Without a symbol there: b2" in html


def test_every_symbol_of_the_standard_is_somewhere(study_of):
    result = study_of("accelerometer", "mems_tactical")
    spec = result.study.sensors[0]
    # a triad's component leaves out what only turns its case
    one = result.sensors[0]
    kept = [k for k, t in enumerate(one.selection.terms) if t.name != "m_k"]
    terms = tuple(one.selection.terms[k] for k in kept)
    one = replace(
        one, selection=replace(one.selection, terms=terms), correlation=one.correlation[np.ix_(kept, kept)]
    )
    found = standards(replace(result.study, sensors=(spec,)), one)["ieee1293"]
    assert "d_p" in found["absent"]
    told = [row["symbol"] for row in found["values"]] + [*found["untested"], *found["absent"]]
    symbols = [row.symbol for row in standard("ieee1293", kind="accelerometer").symbols if row.term]
    assert sorted(told) == sorted(symbols)


def test_gain_that_is_not_positive_is_said_in_place_of_values(study_of):
    result = study_of("accelerometer", "mems_tactical")
    one = result.sensors[0]
    terms = tuple(replace(t, full_mean=-2.0) if t.name == "b1" else t for t in one.selection.terms)
    one = replace(one, selection=replace(one.selection, terms=terms))
    found = standards(result.study, one)["ieee1293"]
    assert found["values"] == () and "gain" in found["trouble"]
    assert "gain" in report_html(replace(result, sensors=(one,)))


@pytest.mark.parametrize("name", ["basic", "ieee1293"])
def test_values_take_over_what_dropped_terms_do_in_the_test_as_least_squares_on_its_rows_says(name, study_of):
    result = study_of("accelerometer", "mems_tactical")
    one, lib = result.sensors[0], library("accelerometer")
    plans = tumble(angles=8, dwell=2.0, rate=1.0), centrifuge([1, 5, 20], dwell=3.0, rate=1.0)
    X = np.vstack([columns(lib, plan.inputs.channels, len(plan.inputs)) for plan in plans])
    one = replace(one, drive=factor_of(X, np.zeros(len(X)), lib.names))
    view = standards(result.study, one)[name]

    mean = np.array([{t.name: t.full_mean for t in one.selection.terms}[n] for n in lib.names])
    inside = [n in {row.term for row in standard(name, kind="accelerometer").symbols} for n in lib.names]
    outside = ~np.array(inside)
    lost = X[:, outside] @ mean[outside]
    added, *_ = np.linalg.lstsq(X[:, inside], lost, rcond=None)
    theta = dict(zip(np.array(lib.names)[inside].tolist(), mean[inside] + added, strict=True))
    expected = standard(name, kind="accelerometer").from_general(theta)
    fields = {row.symbol: row.field for row in standard(name, kind="accelerometer").symbols}
    for row in view["values"]:
        assert row["value"] == pytest.approx(getattr(expected, fields[row["symbol"]]), rel=1e-7, abs=1e-15)
    left = lost - X[:, inside] @ added
    assert view["absorbed"] is not None
    assert view["absorbed"]["rms"] == pytest.approx(np.sqrt(np.mean(lost**2)), rel=1e-9)
    assert view["absorbed"]["left"] == pytest.approx(np.sqrt(np.mean(left**2)), rel=1e-9)
    assert f"{len(X):,} samples" in view["absorbed"]["inputs"]


def test_component_without_correlations_has_no_standards(result):
    assert json.loads(result_json(result))["sensors"][0]["standards"] == {}
