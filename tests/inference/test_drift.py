"""The bias over a record that walks, against dense least squares on a grid so fine that it is the walk."""

from dataclasses import replace

import numpy as np
import pytest

from imubayes.inference.drift import drift_of
from imubayes.inference.linear import linear_of
from imubayes.inference.summary import summarize
from imubayes.reporting.chain_views import STRAYED
from imubayes.rig.inputs import Inputs, Run
from imubayes.sensors.noise import Noise, NoiseRule
from imubayes.sensors.terms import library

LIB = library("accelerometer", powers=1, asymmetry=-1)
SD = np.full(len(LIB.names), 1e-2)
NOISE = Noise(2e-3, 0.0, 4e-4)
DWELL, FINE, G = 1.0, 20, 9.81
STARTS = np.arange(60) + 5.0 * (np.arange(60) >= 25)
"""Dwells one after another, with one gap, s."""


def tumbled(seed):
    rng = np.random.default_rng(seed)
    angle = 2.0 * np.pi * np.arange(len(STARTS)) / 12
    channels = {"f_i": G * np.cos(angle), "f_j": G * np.sin(angle)}
    span = STARTS[-1] + DWELL
    fine = (np.arange(int(span * FINE)) + 0.5) / FINE
    walk = np.cumsum(rng.standard_normal(len(fine))) * NOISE.K / np.sqrt(FINE)
    inside = (fine >= STARTS[:, None]) & (fine < STARTS[:, None] + DWELL)
    averages = inside / inside.sum(axis=1, keepdims=True)
    white = NOISE.N / np.sqrt(DWELL) * rng.standard_normal(len(STARTS))
    output = channels["f_i"] * 1.001 + 5e-3 + averages @ walk + white
    run = Run("tumble", "tumble", Inputs(STARTS + 0.5 * DWELL, channels, DWELL), output)
    return run, fine, averages, 5e-3 + np.array([walk[0], walk.mean(), walk[-1]])


def dense(run, fine, averages):
    """Bias at the start, on average and at the end: mean and covariance given the outputs, all at once."""
    X = np.column_stack([linear_of(run, LIB).X])
    walk = NOISE.K**2 * np.minimum.outer(fine, fine)
    seen = averages @ walk @ averages.T + X @ np.diag(SD**2) @ X.T + NOISE.N**2 / DWELL * np.eye(len(X))
    b0 = SD[0] ** 2 * np.ones(len(X))
    wanted = np.vstack((0.0 * fine, np.full(len(fine), 1.0 / len(fine)), np.eye(len(fine))[-1]))
    across = wanted @ walk @ averages.T + b0
    own = wanted @ walk @ wanted.T + SD[0] ** 2
    y = run.output - run.inputs.channels["f_i"]
    gain = np.linalg.solve(seen, across.T).T
    return gain @ y, np.sqrt(np.diag(own - gain @ across.T))


def found(run):
    rules = {"tumble": NoiseRule("fixed", NOISE)}
    rows = linear_of(run, LIB)
    summary = summarize([run], LIB, rules=rules, rows=[rows])
    return drift_of(summary, [rows], SD, "b0")


def test_bias_at_start_mean_and_end_is_that_of_dense_least_squares():
    run, fine, averages, _ = tumbled(1)
    mean, sd = dense(run, fine, averages)
    drift = found(run)
    scale = drift.full[0, 1] / sd[0]  # of the noise, which the decision fits
    assert abs(scale - 1.0) < 0.3
    assert drift.full[:, 1] == pytest.approx(scale * sd, rel=0.01)
    assert drift.full[:, 0] == pytest.approx(mean, abs=0.02 * sd.min())


def test_the_mean_over_the_record_is_known_better_than_its_ends_and_covers_the_truth():
    pulls = []
    for seed in range(40):
        run, _, _, truth = tumbled(seed)
        drift = found(run)
        pulls.append((drift.full[:, 0] - truth) / drift.full[:, 1])
    assert drift.full[1, 1] < 0.7 * drift.full[0, 1]
    assert np.all(np.abs(np.std(pulls, axis=0) - 1.0) < 4.0 / np.sqrt(80.0))


def test_a_warm_up_strays_farther_than_any_walk_and_a_walk_does_not():
    for seed in range(12):
        run, *_ = tumbled(seed)
        warm = replace(run, output=run.output + 0.1 * (1.0 - np.exp(-run.t / 30.0)))
        walks, warms = (abs(d.full[2, 0] - d.full[0, 0]) / d.walk for d in map(estimated, (run, warm)))
        assert walks < STRAYED < warms


def estimated(run):
    rows = linear_of(run, LIB)
    return drift_of(summarize([run], LIB, rows=[rows]), [rows], SD, "b0")
