"""Evidence averaged over draws of the noise, against sums that are written out."""

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from decisions import campaign_of
from scipy.stats import multivariate_normal

import imubayes as ib
from imubayes.algebra.factor import factor_of
from imubayes.inference.mcmc import NoiseDraw, log_marginal
from imubayes.inference.prior import ScalePrior
from imubayes.inference.summary import Summary
from imubayes.selection.decision import posterior_draws, select
from imubayes.selection.enumerate import enumerate_models
from imubayes.selection.models import average, components_given, inclusion_given

NAMES = ("b0", "b1", "b2")
SD = np.array([1.0, 2.0, 0.5])
LEVELS = (0.7, 1.0, 1.6)
"""White noise at each draw."""


@pytest.fixture(scope="module")
def data():
    rng = np.random.default_rng(5)
    f = rng.normal(size=30)
    X = np.column_stack((np.ones(30), f, f**2))
    return X, X @ [0.4, -1.0, 0.0] + rng.normal(size=30)


def draw_of(X, y, level):
    """Rows whitened by a level of white noise, and the full library's evidence there."""
    whole = factor_of(X / level, y / level, NAMES, log_det=2.0 * len(y) * math.log(level))
    return NoiseDraw(whole, dense_evidence(X, y, level, (0, 1, 2)))


def dense_evidence(X, y, level, columns):
    part = X[:, columns] * SD[list(columns)]
    return float(multivariate_normal(cov=level**2 * np.eye(len(y)) + part @ part.T).logpdf(y))


def models_with(always):
    """Columns of each model that has the first `always` columns, by mask."""
    every = (np.flatnonzero(one[::-1]).tolist() for one in product((0, 1), repeat=3))
    return [m for m in every if {*range(always)} <= {*m}]


def averaged(data, always=0):
    draws = [draw_of(*data, level) for level in LEVELS]
    models = [
        enumerate_models(Summary(d.factor), ScalePrior(SD), always=NAMES[:always], scale=1.0) for d in draws
    ]
    return average(models, -np.array([d.log_marginal for d in draws]), [("b2",)])


def joint_by_draw(data, always=0):
    """Joint of every model over the full library's evidence, by draw: (draws, models)."""
    free, models = 3 - always, models_with(always)
    prior = [-math.log((free + 1) * math.comb(free, len(m) - always)) for m in models]
    logs = np.array([[dense_evidence(*data, level, m) for m in models] for level in LEVELS])
    return logs + prior - logs[:, -1:]


@pytest.mark.parametrize("always", [0, 1])
def test_average_over_noise_is_the_sum_over_draws_weighted_by_importance(data, always):
    models, total = averaged(data, always), np.exp(joint_by_draw(data, always)).mean(axis=0)
    np.testing.assert_allclose(models.weight, total / total.sum(), rtol=1e-9)
    assert models.log_evidence == pytest.approx(math.log(total.sum()), abs=1e-9)
    inside = [sum(w for m, w in zip(models_with(always), total, strict=True) if j in m) for j in range(3)]
    np.testing.assert_allclose(models.inclusion, np.array(inside) / total.sum(), rtol=1e-9)


@pytest.mark.parametrize("always", [0, 1, 2])
def test_averaged_moments_are_those_of_all_models_at_all_draws(data, always):
    """Also of columns that are in every model, which are integrated out before the others."""
    X, y = data
    models, logs = averaged(data, always), joint_by_draw(data, always)
    weight = np.exp(logs) / np.exp(logs).sum()
    mean, square = np.zeros(3), np.zeros(3)
    for level, row in zip(LEVELS, weight, strict=True):
        for m, w in zip(models_with(always), row, strict=True):
            part = X[:, m]
            covariance = np.linalg.inv(part.T @ part / level**2 + np.diag(1.0 / SD[m] ** 2))
            fit = covariance @ part.T @ y / level**2
            mean[m] += w * fit
            square[m] += w * (np.diag(covariance) + fit**2)
    np.testing.assert_allclose(models.mean, mean, rtol=1e-8)
    np.testing.assert_allclose(models.sd, np.sqrt(square - mean**2), rtol=1e-8)


def test_average_given_a_term_is_over_the_models_that_have_it(data):
    models, total = averaged(data), np.exp(joint_by_draw(data)).sum(axis=0)
    with_b2 = sum(w for m, w in zip(models_with(0), total, strict=True) if 2 in m)
    both = sum(w for m, w in zip(models_with(0), total, strict=True) if {1, 2} <= {*m})
    assert inclusion_given(models, ("b2",))[1] == pytest.approx(both / with_b2, rel=1e-9)
    assert np.all(components_given(models, ("b2",)).inside[:, 2])


def test_plug_in_inclusion_is_that_without_draws():
    plans = [ib.tumble(angles=12, dwell=5.0)]
    summary, prior, _, plain = campaign_of("mems_tactical", plans, seed=2, powers=3, asymmetry=0)
    # noise twice as strong at every draw: weak terms are no longer seen
    f = summary.factor
    noisier = NoiseDraw(replace(f, R=f.R / 2.0, log_det=f.log_det + 2.0 * f.n * math.log(2.0)), 0.0)
    chosen = select(summary, prior, noises=[noisier, noisier])
    np.testing.assert_allclose(chosen.plug_in, [t.inclusion for t in plain.terms], atol=1e-9)
    assert plain.plug_in == ()
    full = {t.name: t.full_sd for t in plain.terms}
    assert all(t.full_sd >= full[t.name] for t in chosen.terms)
    assert any(t.full_sd > 1.8 * full[t.name] for t in chosen.terms)


def test_draws_over_noises_have_the_moments_and_inclusions_of_the_average():
    plans = [ib.tumble(angles=12, dwell=5.0)]
    summary, prior, _, _ = campaign_of("mems_tactical", plans, seed=2, powers=3, asymmetry=0)
    f = summary.factor
    louder = [replace(f, R=f.R / s, log_det=f.log_det + 2.0 * f.n * math.log(s)) for s in (0.97, 1.04)]
    chosen = select(summary, prior, noises=[NoiseDraw(one, log_marginal(one, prior.sd)) for one in louder])
    models, names = chosen.models, [term.name for term in chosen.terms]
    assert all(0.1 < share < 0.9 for share, _ in models.parts)
    drawn = posterior_draws(chosen, 20_000, np.random.default_rng(1))
    drawn = drawn[:, [names.index(name) for name in models.names]]
    np.testing.assert_array_less(
        np.abs(drawn.mean(axis=0) - models.mean), 4.0 * models.sd / math.sqrt(20_000)
    )
    np.testing.assert_allclose(drawn.std(axis=0), models.sd, rtol=0.03)
    spread = np.sqrt(models.inclusion * (1.0 - models.inclusion) / 20_000)
    np.testing.assert_array_less(
        np.abs(np.mean(drawn != 0.0, axis=0) - models.inclusion), 4.0 * spread + 1e-9
    )
