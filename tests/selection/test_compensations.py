"""What is exported: models against refits by least squares, and against positions that nobody has seen."""

import numpy as np
import pytest

from imubayes.inference.linear import linear_of
from imubayes.inference.prior import ScalePrior
from imubayes.inference.summary import summarize
from imubayes.rig.inputs import Inputs, Run
from imubayes.selection.compensations import compensations
from imubayes.selection.decision import select
from imubayes.sensors.noise import Noise, NoiseRule
from imubayes.sensors.terms import library

LIB = library("accelerometer", powers=3, asymmetry=-1)
G, N = 9.81, 1e-3
TRUTH = {"b0": 0.05, "b1": 2e-3, "m_j": 1e-3, "b2": 6e-6, "c_ij": 8e-6, "c_jk": 7e-6}


def positions(count, rng):
    """Two samples in each of some directions, with gaps between: every position is a dwell."""
    u = rng.standard_normal((count, 3))
    u = np.repeat(G * u / np.linalg.norm(u, axis=1, keepdims=True), 2, axis=0)
    t = np.add.outer(10.0 * np.arange(count), [0.0, 1.0]).ravel()
    inputs = Inputs(t, dict(zip(("f_i", "f_j", "f_k"), u.T, strict=True)), 1.0)
    bare = linear_of(Run("tumble", "tumble", inputs, u[:, 0]), LIB)
    theta = np.array([TRUTH.get(name, 0.0) for name in LIB.names])
    return Run("tumble", "tumble", inputs, u[:, 0] + bare.X @ theta + N * rng.standard_normal(len(t)))


def found(run, sd):
    rows = linear_of(run, LIB)
    rules = {"tumble": NoiseRule("fixed", Noise(N, 0.0, 0.0))}
    summary = summarize([run], LIB, rules=rules, rows=[rows])
    prior = ScalePrior(sd)
    chosen = select(summary, prior, LIB)
    return chosen, {one.model: one for one in compensations(summary, prior, [rows], chosen)}


def test_every_tested_term_misses_a_position_as_a_refit_without_it_does():
    run = positions(40, np.random.default_rng(1))
    rows = linear_of(run, LIB)
    tested = np.abs(rows.X).max(axis=0) > 0.0
    X, y, sd = rows.X[:, tested], rows.y, np.where(LIB.names == np.array("b0"), 1.0, 1e-2)
    _, models = found(run, sd)
    errors = []
    for k in range(40):
        out = np.arange(2 * k, 2 * k + 2)
        left = np.delete(np.arange(80), out)
        A = np.vstack((X[left] / N, np.diag(1.0 / sd[tested])))
        theta = np.linalg.lstsq(A, np.append(y[left] / N, np.zeros(tested.sum())), rcond=None)[0]
        errors.append(np.mean(y[out] - X[out] @ theta))
    assert models["full"].held_out == pytest.approx(np.sqrt(np.mean(np.square(errors))), rel=0.02)
    assert models["full"].positions == 40


def test_under_a_wide_prior_what_is_exported_predicts_new_positions_at_least_as_well_as_the_averaged_model():
    sums = np.zeros(2)
    for seed in range(8):
        rng = np.random.default_rng(seed)
        reach = linear_of(positions(20, rng), LIB)
        sd = 20.0 / np.maximum(np.abs(reach.X).max(axis=0), 1e-9)
        chosen, models = found(positions(16, rng), sd)
        best = next(iter(models.values()))
        new = linear_of(positions(200, rng), LIB)
        used = {t.name: t.mean for t in chosen.terms if t.name in chosen.model and t.verdict != "unresolved"}
        for k, theta in enumerate((used, dict(zip(best.terms, best.mean.tolist(), strict=True)))):
            left = new.y - new.X @ np.array([theta.get(name, 0.0) for name in LIB.names])
            sums[k] += np.mean(left**2) - N**2
    assert sums[1] < 0.5 * sums[0]


def test_covariance_of_a_smaller_model_is_that_of_the_projected_draws():
    run = positions(40, np.random.default_rng(3))
    _, models = found(run, np.where(LIB.names == np.array("b0"), 1.0, 1e-2))
    full, basic = models["full"], models["basic"]
    X = linear_of(run, LIB).X[:, [LIB.names.index(name) for name in full.terms]]
    kept = [full.terms.index(name) for name in basic.terms]
    draws = np.random.default_rng(1).multivariate_normal(full.mean, full.covariance, 20_000)
    projected = np.linalg.lstsq(X[:, kept], X @ draws.T, rcond=None)[0]
    assert np.std(projected, axis=1) == pytest.approx(np.sqrt(np.diag(basic.covariance)), rel=0.03)
    assert np.linalg.lstsq(X[:, kept], X @ full.mean, rcond=None)[0] == pytest.approx(basic.mean, rel=1e-6)
