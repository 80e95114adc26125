"""Evidence averaged over draws of the noise, against sums that are written out."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

import imubayes as ib
from imubayes.algebra.factor import factor_of
from imubayes.inference.mcmc import NoiseDraw
from imubayes.inference.prior import ScalePrior
from imubayes.inference.summary import Summary
from imubayes.selection.decision import select
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


def masks():
    return [tuple(j for j in range(3) if m >> j & 1) for m in range(8)]


def log_model_prior(columns):
    return -math.log(4.0) - math.log(math.comb(3, len(columns)))


def averaged(data):
    X, y = data
    draws = [draw_of(X, y, level) for level in LEVELS]
    models = [enumerate_models(Summary(d.factor), ScalePrior(SD), scale=1.0) for d in draws]
    return average(models, -np.array([d.log_marginal for d in draws]))


def joint_by_draw(data):
    """Joint of every model over the full library's evidence, by draw: (draws, models)."""
    X, y = data
    return np.array(
        [
            [
                dense_evidence(X, y, level, m) + log_model_prior(m) - dense_evidence(X, y, level, (0, 1, 2))
                for m in masks()
            ]
            for level in LEVELS
        ]
    )


def test_average_over_noise_is_the_sum_over_draws_weighted_by_importance(data):
    models, logs = averaged(data), joint_by_draw(data)
    total = np.exp(logs).mean(axis=0)
    np.testing.assert_allclose(models.weight, total / total.sum(), rtol=1e-9)
    assert models.log_evidence == pytest.approx(math.log(total.sum()), abs=1e-9)
    inside = [sum(w for m, w in zip(masks(), total, strict=True) if j in m) for j in range(3)]
    np.testing.assert_allclose(models.inclusion, np.array(inside) / total.sum(), rtol=1e-9)


def test_averaged_moments_are_those_of_all_models_at_all_draws(data):
    X, y = data
    models, logs = averaged(data), joint_by_draw(data)
    weight = np.exp(logs) / np.exp(logs).sum()
    mean, square = np.zeros(3), np.zeros(3)
    for level, row in zip(LEVELS, weight, strict=True):
        for m, w in zip(masks(), row, strict=True):
            part = X[:, m]
            covariance = np.linalg.inv(part.T @ part / level**2 + np.diag(1.0 / SD[list(m)] ** 2))
            fit = covariance @ part.T @ y / level**2
            mean[list(m)] += w * fit
            square[list(m)] += w * (np.diag(covariance) + fit**2)
    np.testing.assert_allclose(models.mean, mean, rtol=1e-8)
    np.testing.assert_allclose(models.sd, np.sqrt(square - mean**2), rtol=1e-8)


def test_average_given_a_term_is_over_the_models_that_have_it(data):
    models, logs = averaged(data), joint_by_draw(data)
    total = np.exp(logs).sum(axis=0)
    with_b2 = [w if 2 in m else 0.0 for m, w in zip(masks(), total, strict=True)]
    both = [w if 2 in m and 1 in m else 0.0 for m, w in zip(masks(), total, strict=True)]
    assert inclusion_given(models, ("b2",))[1] == pytest.approx(sum(both) / sum(with_b2), rel=1e-9)
    assert np.all(components_given(models, ("b2",)).inside[:, 2])


def test_plug_in_inclusion_is_that_without_draws():
    lib = ib.library("accelerometer", powers=3, asymmetry=0)
    sensor = ib.sensor("mems_tactical", kind="accelerometer")
    runs = ib.simulate(sensor, [ib.tumble(angles=12, dwell=5.0)], seed=2)
    summary, prior = ib.summarize(runs, lib, sensor=sensor), ib.prior(sensor, lib)
    plain = select(summary, prior)
    # noise twice as strong at every draw: weak terms are no longer seen
    f = summary.factor
    noisier = NoiseDraw(replace(f, R=f.R / 2.0, log_det=f.log_det + 2.0 * f.n * math.log(2.0)), 0.0)
    chosen = select(summary, prior, noises=[noisier, noisier])
    np.testing.assert_allclose(chosen.plug_in, [t.inclusion for t in plain.terms], atol=1e-9)
    assert plain.plug_in == ()
    full = {t.name: t.full_sd for t in plain.terms}
    assert all(t.full_sd >= full[t.name] for t in chosen.terms)
    assert any(t.full_sd > 1.8 * full[t.name] for t in chosen.terms)
