"""The likelihood of noise processes against dense covariances, and the averages that it is taken of."""

import math

import made
import numpy as np
import pytest
from scipy.linalg import cho_factor, cho_solve

from imubayes.inference.noise_model import likelihood, process_model
from imubayes.inference.noise_rows import noise_rows, piece_edges
from imubayes.inference.whiten import Processes
from imubayes.sensors.noise import Noise, flicker, vague_prior

INTERVAL = 0.5
PRIOR = vague_prior(1.0, 100.0, INTERVAL)


def uneven_rows(rng, n=20):
    """Rows of two lengths, some of which touch, as one length."""
    duration = np.where(rng.random(n) < 0.5, 1.0, 2.5)
    gaps = np.where(rng.random(n) < 0.6, 0.0, 3.0)
    start = np.cumsum(np.concatenate(([0.0], (duration + gaps)[:-1])))
    X = np.column_stack((np.ones(n), rng.normal(size=n)))
    center = start + 0.5 * duration
    return made.rows_of(rng.normal(size=n), X, t=center, duration=duration, interval=INTERVAL), ((1.0, n),)


def dense(noise, rows):
    """Covariance of averages that may be quantized."""
    size = dict.fromkeys("NBKQG", 0.0) | {"tau": 1.0} | noise
    variance, tau = flicker(size["B"], INTERVAL, rows.rows.span)
    first_order = Processes(np.append(variance, size["G"] ** 2), np.append(tau, size["tau"]))
    C = made.dense(Noise(size["N"], 1.0, size["K"]), rows.rows, first_order)
    quantum = size["Q"] ** 2 / np.outer(rows.duration, rows.duration)
    C += 2.0 * np.diag(np.diag(quantum))
    for i in 1 + np.flatnonzero(np.isclose(np.diff(rows.t), 0.5 * (rows.duration[1:] + rows.duration[:-1]))):
        C[i, i - 1] -= quantum[i, i - 1]
        C[i - 1, i] -= quantum[i, i - 1]
    return C


def told(data, noise):
    return likelihood(data, tuple(noise), np.log(list(noise.values()))).levels


def restricted(C, X, y):
    """Restricted log likelihood by its textbook formula, up to what does not depend on C."""
    factor = cho_factor(C, lower=True)
    information = X.T @ cho_solve(factor, X)
    theta = np.linalg.solve(information, X.T @ cho_solve(factor, y))
    left = y - X @ theta
    log_det = 2.0 * np.sum(np.log(np.diag(factor[0])))
    return -0.5 * (log_det + np.linalg.slogdet(information)[1] + left @ cho_solve(factor, left))


POINTS = [
    {"N": 1.0},
    {"N": 1.0, "K": 0.4},
    {"N": 0.8, "Q": 0.9},
    {"N": 1.0, "G": 0.7, "tau": 6.0},
    {"N": 0.9, "B": 0.8, "K": 0.2, "Q": 0.5, "G": 0.6, "tau": 9.0},
]


def test_likelihood_differs_between_processes_as_the_dense_covariances_do():
    rows, levels = uneven_rows(np.random.default_rng(3))
    data = process_model(rows, levels, PRIOR)
    found = np.array([told(data, noise)[0] for noise in POINTS])
    expected = np.array([restricted(dense(noise, rows), rows.X, rows.y) for noise in POINTS])
    np.testing.assert_allclose(found - found[0], expected - expected[0], atol=1e-8)


@pytest.mark.parametrize(
    "names", [("N",), ("N", "K", "Q"), ("N", "G", "tau"), ("N", "B", "K", "Q", "G", "tau")]
)
def test_gradient_is_that_of_the_likelihood(names):
    """With a ramp or without, in rows of two lengths of which some touch."""
    model = process_model(*uneven_rows(np.random.default_rng(6)), PRIOR)
    x = np.log([{"N": 1.0, "B": 0.8, "K": 0.2, "Q": 0.5, "G": 0.6, "tau": 9.0}[name] for name in names])
    steps = 1e-4 * np.eye(len(x))
    found = [likelihood(model, names, x + sign * step).level for step in steps for sign in (1.0, -1.0)]
    expected = np.diff(-np.array(found).reshape(-1, 2), axis=1)[:, 0] / 2e-4
    np.testing.assert_allclose(likelihood(model, names, x, slopes=True).slope, expected, rtol=1e-5, atol=1e-6)


def test_a_ramp_adds_its_prior_to_the_covariance():
    rows, levels = uneven_rows(np.random.default_rng(4))
    data = process_model(rows, levels, PRIOR)
    noise = {"N": 1.0, "K": 0.3, "Q": 0.4}
    found = told(data, noise)
    t = rows.t
    middle = PRIOR["R"][1] * (t - t[0] + 0.5 * rows.duration[0] - 0.5 * rows.rows.span)
    C = dense(noise, rows)
    wider, plain = (restricted(one, rows.X, rows.y) for one in (C + np.outer(middle, middle), C))
    assert found[1] - found[0] == pytest.approx(wider - plain, abs=1e-8)


def test_quantization_of_neighbouring_samples_cancels_in_their_sum():
    """The average over a block has the quantization of its ends alone: 2 Q^2 / T^2, however it is cut."""
    Q, n = 0.7, 12
    noise = {"N": 1e-4, "Q": Q}
    angle = np.random.default_rng(6).normal(size=n + 1)
    y = Q * np.diff(angle)
    data = process_model(*noise_rows(made.rows_of(y)), PRIOR)
    D = np.diff(np.eye(n + 1), axis=0)
    C = Q**2 * D @ D.T + noise["N"] ** 2 * np.eye(n)
    assert np.ones(n) @ C @ np.ones(n) == pytest.approx(2.0 * Q**2 + n * noise["N"] ** 2)
    other = {"N": 1.0}
    found = told(data, noise)[0] - told(data, other)[0]
    X = np.ones((n, 1))
    assert found == pytest.approx(restricted(C, X, y) - restricted(np.eye(n), X, y), rel=1e-6)


@pytest.mark.parametrize("n", [50, 3000, 20_000, 300_000])
def test_pieces_cover_every_sample_once_are_few_and_reach_across_no_gap(n):
    t = np.arange(float(n))
    edges, levels = piece_edges(np.where(t < n // 2, t, t + 9000.0), 1.0)
    assert n // 2 in edges
    assert edges[0] == 0 and (np.diff(edges) > 0).all() and edges[-1] < n
    assert sum(count for _, count in levels) == len(edges) <= 5000
    assert np.diff(np.append(edges, n)).max() <= math.ceil(n / 1000)


def test_averages_are_those_of_their_samples():
    rng = np.random.default_rng(7)
    y, X = rng.normal(size=20_000), rng.normal(size=(20_000, 2))
    rows, levels = noise_rows(made.rows_of(y, X, duration=0.1))
    edges, _ = piece_edges(0.1 * np.arange(20_000), 0.1)
    for k in (0, 500, len(edges) - 2):
        np.testing.assert_allclose(rows.y[k], y[edges[k] : edges[k + 1]].mean(), rtol=1e-12)
        np.testing.assert_allclose(rows.X[k], X[edges[k] : edges[k + 1]].mean(axis=0), rtol=1e-10)
    assert rows.duration.sum() == pytest.approx(2000.0)
    assert process_model(rows, levels, PRIOR).joined[1:].all()
