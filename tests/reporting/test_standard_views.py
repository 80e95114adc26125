"""Fitted coefficients in the symbols of the standards."""

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
from imubayes.sensors.equations import standard
from imubayes.sensors.terms import columns, library

LIB = library("accelerometer")


def _correlation(p, rng):
    root = rng.standard_normal((p, 2 * p))
    cov = root @ root.T
    sd = np.sqrt(np.diag(cov))
    return cov / np.outer(sd, sd)


@pytest.fixture
def study():
    """A component of a class, with correlated coefficients."""
    one = sensor_result("S", lib=LIB)
    one = replace(one, correlation=_correlation(len(LIB.terms), np.random.default_rng(4)))
    result = study_result(one)
    entry = sensor("mems_tactical", kind="accelerometer")
    spec = replace(result.study.sensors[0], sensor_class=entry, library=LIB)
    return replace(result, study=replace(result.study, sensors=(spec,)))


def _changed(study, **terms):
    """The study with other terms, or more of its component."""
    one = study.sensors[0]
    if "terms" in terms:
        one = replace(one, selection=replace(one.selection, terms=tuple(terms.pop("terms"))))
    return replace(study, sensors=(replace(one, **terms),))


def _in(study, name):
    """Values of the component by a standard, and that standard."""
    return standards(study.study, study.sensors[0])[name], standard(name, kind="accelerometer")


def test_value_of_a_symbol_is_its_term_over_the_gain_and_the_convention(study):
    mean = {term.name: term.full_mean for term in study.sensors[0].selection.terms}
    found = {row["symbol"]: row for row in _in(study, "ieee1293")[0]["values"]}
    gain = 1.0 + mean["b1"]
    for symbol, term, weight in (("K0", "b0", 1.0), ("K2", "b2", 1.0), ("d_p", "m_k", -1.0)):
        assert found[symbol]["value"] == pytest.approx(mean[term] / (gain * weight), rel=1e-12)
        assert found[symbol]["term"] == term


def test_sd_carries_the_correlations_as_draws_do(study):
    """60,000 draws know an sd to 0.3 %; five of that."""
    terms, correlation = study.sensors[0].selection.terms, study.sensors[0].correlation
    mean, sd = (np.array([getattr(t, key) for t in terms]) for key in ("full_mean", "full_sd"))
    # a scale factor so uncertain that it shows in every value
    sd[1] = 0.01
    changed = (replace(t, full_sd=float(s)) for t, s in zip(terms, sd, strict=True))
    found, known = _in(_changed(study, terms=changed), "ieee1293")
    cov = correlation * np.outer(sd, sd)
    draws = np.random.default_rng(1).multivariate_normal(mean, cov, 60_000, method="eigh")
    p = known.from_general(dict(zip([t.name for t in terms], draws.T, strict=True)))
    fields = {row.symbol: row.field for row in known.symbols}
    tested = {row["symbol"]: row["sd"] for row in found["values"]}
    for symbol in ("K0", "K2", "d_p"):
        # what the linearisation leaves out is of the order of the gain's variance, 1e-4
        assert tested[symbol] == pytest.approx(float(np.std(getattr(p, fields[symbol]))), rel=0.015)


def test_terms_without_a_symbol_and_those_not_tested_are_said(study):
    basic, _ = _in(study, "basic")
    verdicts = {term.name: term.verdict for term in study.sensors[0].selection.terms}
    assert {row["verdict"] for row in basic["values"]} <= set(verdicts.values()) - {"untested"}
    assert "b2" in basic["general_only"]
    html = report_html(study)
    assert "In the symbols of IEEE 1293" in html and "Without a symbol there: b2" in html


def test_every_symbol_of_the_standard_is_somewhere(study):
    """A triad's component leaves out what only turns its case."""
    terms, correlation = study.sensors[0].selection.terms, study.sensors[0].correlation
    kept = [k for k, t in enumerate(terms) if t.name != "m_k"]
    part = _changed(study, terms=[terms[k] for k in kept], correlation=correlation[np.ix_(kept, kept)])
    found, known = _in(part, "ieee1293")
    assert "d_p" in found["absent"]
    told = [row["symbol"] for row in found["values"]] + [*found["untested"], *found["absent"]]
    assert sorted(told) == sorted(row.symbol for row in known.symbols if row.term)


def test_gain_that_is_not_positive_is_said_in_place_of_values(study):
    terms = study.sensors[0].selection.terms
    wrong = _changed(study, terms=(replace(t, full_mean=-2.0) if t.name == "b1" else t for t in terms))
    found, _ = _in(wrong, "ieee1293")
    assert found["values"] == () and "gain" in found["trouble"]
    assert "gain" in report_html(wrong)


@pytest.mark.parametrize("name", ["basic", "ieee1293"])
def test_values_take_over_what_dropped_terms_do_in_the_test_as_least_squares_on_its_rows_says(name, study):
    plans = tumble(angles=8, dwell=2.0, rate=1.0), centrifuge([1, 5, 20], dwell=3.0, rate=1.0)
    X = np.vstack([columns(LIB, plan.inputs.channels, len(plan.inputs)) for plan in plans])
    view, known = _in(_changed(study, drive=factor_of(X, np.zeros(len(X)), LIB.names)), name)

    means = {t.name: t.full_mean for t in study.sensors[0].selection.terms}
    mean, fields = np.array([means[n] for n in LIB.names]), {row.symbol: row.field for row in known.symbols}
    inside = np.isin(LIB.names, [row.term for row in known.symbols])
    lost = X[:, ~inside] @ mean[~inside]
    added, *_ = np.linalg.lstsq(X[:, inside], lost, rcond=None)
    theta = dict(zip(np.array(LIB.names)[inside].tolist(), mean[inside] + added, strict=True))
    expected = known.from_general(theta)
    for row in view["values"]:
        assert row["value"] == pytest.approx(getattr(expected, fields[row["symbol"]]), rel=1e-7, abs=1e-15)
    left = lost - X[:, inside] @ added
    assert view["absorbed"] is not None
    assert view["absorbed"]["rms"] == pytest.approx(np.sqrt(np.mean(lost**2)), rel=1e-9)
    assert view["absorbed"]["left"] == pytest.approx(np.sqrt(np.mean(left**2)), rel=1e-9)
    assert f"{len(X):,} samples" in view["absorbed"]["inputs"]


def test_component_without_correlations_has_no_standards(result):
    assert json.loads(result_json(result))["sensors"][0]["standards"] == {}
