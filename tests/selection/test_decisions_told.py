"""Draws agree with the verdicts' own numbers. Data that contradict the prior: a wrong sign or unit must be
told, not explained away. Verdicts where errors of the test bench share a column with a term: the prior of
the error decides."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from benches import measured
from decisions import campaign_of, typical
from scipy.stats import binomtest

import imubayes as ib
from imubayes.algebra.factor import reorder
from imubayes.inference.linear import linear_of
from imubayes.inference.nuisances import solve
from imubayes.inference.prior import ScalePrior, class_sd
from imubayes.inference.residuals import check_residuals
from imubayes.inference.summary import Summary
from imubayes.selection.decision import posterior_draws, prior_draws, select
from imubayes.selection.enumerate import enumerate_models
from imubayes.selection.models import inclusion_given
from imubayes.selection.verdicts import STRAINED
from imubayes.sensors.catalogue import draw_unit

DRAWS = 20_000
FOUR_SIGMA = 6.3e-5
"""Chance of a normal number beyond four sds; for counts, of which few are expected, by the binomial law."""


@pytest.fixture(scope="module")
def selection():
    """Strong, weak and zero terms; some correlated, some confounded, and those of w never excited."""
    sd, plans = typical("mems_industrial"), [ib.tumble(angles=16, dwell=30.0, rate=0.5)]
    truth = {"b0": 2.0 * sd["b0"], "b1": sd["b1"], "b3": 2.0 * sd["b3"], "m_j": 0.05 * sd["m_j"]}
    return campaign_of("mems_industrial", plans, truth=truth, powers=3, asymmetry=0).selection


@pytest.fixture(scope="module")
def draws(selection):
    return posterior_draws(selection, DRAWS, np.random.default_rng(1))


def test_share_of_draws_that_contain_a_term_is_its_inclusion(selection, draws):
    for count, term in zip(np.count_nonzero(draws, axis=0), selection.terms, strict=True):
        assert binomtest(int(count), DRAWS, term.inclusion).pvalue > FOUR_SIGMA
    assert any(0.02 < term.inclusion < 0.98 for term in selection.terms)


def test_draws_of_one_model_hold_the_correlations_of_its_posterior(selection, draws):
    candidates, components = selection.models.candidates, selection.models.components
    model = selection.models.best[0][0]
    columns = [selection.columns.index(name) for name in model]
    R = candidates.whole[:, [candidates.columns.index(name) for name in model]]
    sd = np.array([selection.terms[j].prior_sd for j in columns])
    scale = components.weight @ components.scale
    covariance = np.linalg.inv((R * sd).T @ (R * sd) / scale**2 + np.eye(len(sd)))  # prior sds as units
    size = np.sqrt(np.diag(covariance))
    expected = covariance / np.outer(size, size)
    others = np.setdiff1d(np.arange(draws.shape[1]), columns)
    inside = np.all(draws[:, columns] != 0.0, axis=1)
    tested = [j for j in others if selection.terms[j].verdict != "untested"]
    from_it = draws[inside & np.all(draws[:, tested] == 0.0, axis=1)][:, columns]
    assert np.max(np.abs(expected - np.eye(len(sd)))) > 0.5
    found = np.corrcoef(from_it.T)
    np.testing.assert_array_less(np.abs(found - expected), 4.0 / np.sqrt(len(from_it)) + 1e-9)


def test_prior_draws_have_the_prior_s_moments(selection):
    values = prior_draws(selection, DRAWS, np.random.default_rng(3))
    inside = values != 0.0
    # any size of the model is equally likely: uniform over 0 ... p
    sizes = np.bincount(inside.sum(axis=1), minlength=len(selection.terms) + 1) / DRAWS
    level = 1.0 / len(sizes)
    assert np.max(np.abs(sizes - level)) < 4.5 * math.sqrt(level * (1.0 - level) / DRAWS)
    for j, term in enumerate(selection.terms):
        part = values[inside[:, j], j]
        assert abs(len(part) / DRAWS - 0.5) < 4.0 * 0.5 / math.sqrt(DRAWS)
        assert part.std() == pytest.approx(term.prior_sd, rel=4.0 / math.sqrt(2.0 * len(part)))


SENSOR = ib.sensor("mems_tactical", kind="accelerometer")
LIBRARY = ib.library("accelerometer", powers=3, asymmetry=0)
TRUTH = {"b0": 5e-3, "b1": 2e-4}


def _run(truth=TRUTH):
    (run,) = ib.simulate(SENSOR, [ib.tumble(angles=12, planes=2, dwell=10.0, rate=1.0)], seed=5, truth=truth)
    return run


def _decided(run):
    summary = ib.summarize([run], LIBRARY, sensor=SENSOR)
    selection = ib.select(summary, ib.prior(SENSOR, LIBRARY))
    return summary, selection


@pytest.mark.parametrize("factor", [-1.0, 1000.0], ids=["flipped output", "output in mg"])
def test_wrong_sign_or_unit_strains_the_prior(factor):
    run = _run()
    _, selection = _decided(replace(run, output=factor * run.output))
    assert max(term.strain for term in selection.terms) > 10.0 * STRAINED


def test_run_without_its_own_input_does_not_fit_and_needs_no_term():
    run = _run()
    channels = {name: values for name, values in run.inputs.channels.items() if name != "f_i"}
    run = replace(run, inputs=replace(run.inputs, channels=channels))
    summary, selection = _decided(run)
    assert not check_residuals(linear_of(run, LIBRARY), selection.free, summary.runs[0]).fits
    assert all(term.verdict != "needed" for term in selection.terms)


@pytest.mark.parametrize(("name", "size"), [("b1", 0.02), ("b0", 0.5)])
def test_unit_far_outside_its_class_is_needed_named_and_still_explained(name, size):
    run = _run(TRUTH | {name: size})
    summary, selection = _decided(run)
    (term,) = [term for term in selection.terms if term.name == name]
    assert term.strain == pytest.approx(size / term.prior_sd, rel=0.05)
    assert term.inclusion > 0.99
    checked = check_residuals(linear_of(run, LIBRARY), selection.free, summary.runs[0])
    assert checked.scale == pytest.approx(1.0, abs=0.3)


def test_unit_of_its_class_strains_nothing():
    _, selection = _decided(_run())
    assert max(term.strain for term in selection.terms) < STRAINED
    assert np.all(np.isfinite(selection.free))


ARCSEC = math.pi / 648000.0
TACTICAL = ib.sensor("mems_industrial", kind="accelerometer")
TUMBLE, ARM = ib.tumble(angles=24, rate=1.0), ib.centrifuge([1, 2, 5, 10, 20], rate=1.0)


def verdicts(plans, kinds, **given):
    """Verdicts on a unit of the class with the given coefficients, on a bench that is right."""
    lib = ib.library("accelerometer", powers=3, asymmetry=0)
    rng = np.random.default_rng(1)
    truth = {**draw_unit(TACTICAL, lib, rng), **given}
    sd = class_sd(TACTICAL, lib)
    summary, _ = solve(measured(TACTICAL, plans, truth, {}, rng), lib, sd, kinds, sensor=SENSOR)
    chosen = ib.select(summary, ScalePrior([*sd, *(extra.sd for extra in summary.extras)]))
    return {term.name: term for term in chosen.terms}


@pytest.mark.parametrize("plans", [[TUMBLE], [TUMBLE, ARM]], ids=["tumble", "with-centrifuge"])
def test_a_misalignment_as_large_as_the_doubt_in_the_fixture_is_inseparable_from_it(plans):
    """Mounting faces as rough as the sensor's misalignment, 0.9 mrad in this class, tell nothing of it."""
    found = verdicts(plans, {"fixture_common": 1e-3}, m_j=1e-3, m_k=-8e-4)
    for name, partner in (("m_j", "fixture_common_k"), ("m_k", "fixture_common_j")):
        assert found[name].verdict == "inseparable"
        assert found[name].confounded_with == (partner,)
        assert "turned over in its fixture" in found[name].reason
        # the sum is known and nothing else: the two priors share it out
        assert found[name].full_sd == pytest.approx(1.0 / math.hypot(1 / 9e-4, 1 / 1e-3), rel=0.05)
    if ARM in plans:
        assert found["b1"].verdict == found["b3"].verdict == "needed"


def test_a_misalignment_beyond_the_doubt_in_the_fixture_is_needed():
    found = verdicts([TUMBLE, ARM], {"fixture_common": 2.0 * ARCSEC}, m_j=1e-3, m_k=-8e-4)
    for name, value in (("m_j", 1e-3), ("m_k", -8e-4)):
        assert found[name].verdict == "needed"
        assert abs(found[name].mean - value) < 4.0 * found[name].sd
        assert found[name].sd == pytest.approx(2.0 * ARCSEC, rel=0.1)


def test_width_of_the_prior_is_that_of_the_terms_and_not_of_the_bench():
    """Gravity known to 1e-3 leaves b1 that much, however wide b1's own prior is."""
    sensor, lib = ib.sensor("mems_tactical", kind="accelerometer"), ib.library("accelerometer", powers=1)
    runs = ib.simulate(sensor, [ib.tumble(angles=12, dwell=5.0)], seed=1, truth={"b1": 3e-4})
    prior = ib.prior(sensor, lib)
    summary, _ = solve(runs, lib, prior.sd, {"gravity": 1e-3}, sensor=sensor)
    whole = ScalePrior([*prior.sd, 1e-3])
    selection = select(summary, whole)
    wide = dict(selection.by_width)[3.0]
    by_hand = enumerate_models(
        Summary(reorder(summary.factor, selection.models.candidates.columns)),
        ScalePrior(
            [
                3.0 * whole.sd[summary.names.index(n)] if n != "gravity" else 1e-3
                for n in selection.models.candidates.columns
            ]
        ),
        always=("gravity",),
        scale_limit=10.0,
    )
    np.testing.assert_allclose(wide, inclusion_given(by_hand, ()), rtol=1e-9)
