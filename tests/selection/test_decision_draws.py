"""Draws agree with the verdicts' own numbers."""

import math

import numpy as np
import pytest
from scipy.stats import binomtest

import imubayes as ib
from imubayes.inference.summary import summarize
from imubayes.selection.decision import posterior_draws, prior_draws, select

DRAWS = 20_000
FOUR_SIGMA = 6.3e-5
"""Chance of a normal number beyond four sds; for counts, of which few are expected, by the binomial law."""


@pytest.fixture(scope="module")
def selection():
    """Strong, weak and zero terms; some correlated, some confounded, and those of w never excited."""
    sensor = ib.sensor("mems_industrial", kind="accelerometer")
    lib = ib.library("accelerometer", powers=3, asymmetry=0)
    sd = dict(zip(lib.names, ib.prior(sensor, lib).sd.tolist(), strict=True))
    truth = {"b0": 2.0 * sd["b0"], "b1": sd["b1"], "b3": 2.0 * sd["b3"], "m_j": 0.05 * sd["m_j"]}
    runs = ib.simulate(sensor, [ib.tumble(angles=16, dwell=30.0, rate=0.5)], seed=3, truth=truth)
    return select(summarize(runs, lib, sensor=sensor), ib.prior(sensor, lib))


@pytest.fixture(scope="module")
def draws(selection):
    return posterior_draws(selection, DRAWS, np.random.default_rng(1))


def unconfounded(selection):
    return [(j, t) for j, t in enumerate(selection.terms) if not t.confounded_with]


def test_share_of_draws_that_contain_a_term_is_its_inclusion(selection, draws):
    for count, term in zip(np.count_nonzero(draws, axis=0), selection.terms, strict=True):
        assert binomtest(int(count), DRAWS, term.inclusion).pvalue > FOUR_SIGMA
    assert any(0.02 < term.inclusion < 0.98 for term in selection.terms)


def test_mean_and_sd_of_the_draws_are_the_model_averaged_ones(selection, draws):
    for j, term in unconfounded(selection):
        values = draws[:, j]
        assert abs(values.mean() - term.mean) <= 4.0 * term.sd / math.sqrt(DRAWS)
        fourth = np.mean((values - values.mean()) ** 4)
        assert abs(values.var() - term.sd**2) <= 4.0 * math.sqrt(fourth / DRAWS) + 1e-12 * term.sd**2


def test_quantiles_of_the_draws_are_the_model_averaged_ones(selection, draws):
    for j, term in unconfounded(selection):
        spread = 4.0 * math.sqrt(0.05 * 0.95 / DRAWS)
        assert (
            np.mean(draws[:, j] < term.q05)
            <= 0.05 + spread
            <= np.mean(draws[:, j] <= term.q05) + 2.0 * spread
        )
        assert (
            np.mean(draws[:, j] <= term.q95)
            >= 0.95 - spread
            >= np.mean(draws[:, j] < term.q95) - 2.0 * spread
        )


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


def test_the_same_generator_gives_the_same_draws(selection):
    for make in (posterior_draws, prior_draws):
        once, again, other = (make(selection, 50, np.random.default_rng(seed)) for seed in (5, 5, 6))
        np.testing.assert_array_equal(once, again)
        assert np.any(once != other)
