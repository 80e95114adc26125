"""Noise: likelihood and estimates against dense covariances and simulated truths; averages behind them."""

import math
from dataclasses import replace

import made
import numpy as np
import pytest
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize

import imubayes as ib
from imubayes.inference.linear import block_edges, blocks_of, linear_of, with_columns
from imubayes.inference.noise_model import (
    NBK,
    cost,
    estimate,
    likelihood,
    nbk_model,
    noise_blocks,
    noise_rows,
    piece_edges,
    process_model,
)
from imubayes.inference.summary import noise_by_rule
from imubayes.inference.whiten import Processes, processes
from imubayes.rig.simulate import synthesise
from imubayes.sensors.noise import Noise, NoiseRule, flicker, noise_prior, vague_prior

INDUSTRIAL = ib.sensor("mems_industrial", kind="accelerometer")
LIBRARY = ib.library("accelerometer")
PRIOR = noise_prior(INDUSTRIAL)
SMALL = {"N": (1.0, 1.0), "B": (0.5, 1.0), "K": (0.02, 1.0)}


def tumble(**options):
    return ib.tumble(**{"angles": 12, "planes": 3, "dwell": 30.0, "rate": 1.0, **options})


def run_of(seed, noise=None, truth=None, **options):
    (run,) = ib.simulate(INDUSTRIAL, [tumble(**options)], seed=seed, truth=truth or {}, noise=noise)
    return run


def drawn_noise(rng):
    return Noise(*(median * math.exp(spread * rng.standard_normal()) for median, spread in PRIOR.values()))


def logs(found):
    return np.log([found.noise.N, found.noise.B, found.noise.K])


def small_blocks(rng, n=60, p=4):
    """Rows of one duration with a gap, in noise that shows all three processes."""
    start = np.concatenate((10.0 * np.arange(n // 2), 2e3 + 10.0 * np.arange(n - n // 2)))
    y = synthesise(Noise(1.0, 0.5, 0.02), start, 10.0, rng)
    X = rng.normal(size=(n, p))
    return made.rows_of(y + X @ rng.normal(size=p), X, t=start + 5.0, duration=10.0)


def dense_cost(x, blocks, prior, sd):
    """Negative log posterior of ln N, ln B, ln K from the dense covariance, by its textbook formulas."""
    C = made.dense(Noise(*np.exp(x)), blocks.rows, processes(blocks.rows))
    pull = sum(0.5 * ((v - math.log(m)) / s) ** 2 for v, (m, s) in zip(x, prior.values(), strict=True))
    if sd is not None:  # theta ~ N(0, sd^2): integrate it out of y
        C += (blocks.X * sd) @ (blocks.X * sd).T
        return pull + 0.5 * np.linalg.slogdet(C)[1] + 0.5 * blocks.y @ np.linalg.solve(C, blocks.y)
    information = blocks.X.T @ np.linalg.solve(C, blocks.X)
    theta = np.linalg.solve(information, blocks.X.T @ np.linalg.solve(C, blocks.y))
    left = blocks.y - blocks.X @ theta
    rest = np.linalg.slogdet(C)[1] + np.linalg.slogdet(information)[1]
    return pull + 0.5 * rest + 0.5 * left @ np.linalg.solve(C, left)


def test_estimate_is_the_best_of_two_maxima():
    """Where bias instability and random walk stand for each other, against searches from everywhere."""
    piga = ib.sensor("strategic_piga", kind="accelerometer")
    (run,) = ib.simulate(piga, [tumble()], seed=20, truth={})
    prior, blocks = noise_prior(piga), noise_blocks(linear_of(run, LIBRARY))
    model = nbk_model(blocks, prior, None)
    B, K = (np.log(prior[name][0]) + np.arange(-4.0, 5.0, 2.0) * prior[name][1] for name in ("B", "K"))
    found = [
        minimize(lambda x: cost(model, NBK, x), (math.log(prior["N"][0]), b, k), jac=True, method="L-BFGS-B")
        for b in B
        for k in K
    ]
    levels, logs_of_K = np.array([one.fun for one in found]), np.array([one.x[2] for one in found])
    good = levels < levels.min() + 0.1
    assert np.ptp(logs_of_K[good]) > 1.0  # there are two
    assert cost(model, NBK, logs(estimate(blocks, prior)))[0] < levels.min() + 1e-4


def test_a_column_that_all_but_repeats_another_takes_nothing_from_the_noise():
    rng = np.random.default_rng(3)
    blocks = small_blocks(rng)
    shape = rng.normal(size=(len(blocks.y), 1))

    def beside(size, first):
        return logs(
            estimate(with_columns(blocks, np.hstack((blocks.X, first * blocks.X[:, :1] + size * shape))))
        )

    told = [beside(size, 1.0) for size in (0.0, 1e-10, 1e-9)]
    assert np.ptp(told, axis=0).max() < 1e-6
    assert np.abs(told[0] - beside(1.0, 0.0)).max() > 1e-3


PROPER = pytest.mark.parametrize(
    "sd", [None, np.array([0.5, 1.0, 2.0, 1.0])], ids=["restricted", "proper prior"]
)


@PROPER
@pytest.mark.parametrize("axes", [False, True], ids=["one axis", "three axes"])
@pytest.mark.parametrize("at", [(0.0, 0.0, 0.0), (0.5, -3.0, 1.0), (-1.0, 1.0, -8.0)], ids=str)
def test_gradient_is_that_of_the_dense_posterior(sd, axes, at):
    rng, prior = np.random.default_rng(4), SMALL
    blocks = small_blocks(rng)
    if axes:
        blocks = replace(blocks, axes=rng.normal(size=(len(blocks), 3)))
    x, steps = np.log([1.0, 0.5, 0.02]) + at, 1e-4 * np.eye(3)
    ends = [[dense_cost(x + sign * step, blocks, prior, sd) for sign in (1.0, -1.0)] for step in steps]
    expected = np.array([(up - down) / 2e-4 for up, down in ends])
    # central differences: h^2/6 of the third derivative, and the rounding of the dense cost over h
    np.testing.assert_allclose(cost(nbk_model(blocks, prior, sd), NBK, x)[1], expected, rtol=1e-6, atol=1e-5)


def test_white_noise_by_rule_is_the_white_part_of_the_estimate():
    blocks = small_blocks(np.random.default_rng(1))
    whole, white = (noise_by_rule(blocks, NoiseRule(rule), None).noise for rule in ("estimate", "white"))
    assert whole.B > 0.0 < whole.K and white == Noise(whole.N, 0.0, 0.0)


@PROPER
@pytest.mark.parametrize("seed", [1, 2])
def test_estimate_is_the_maximum_of_the_dense_posterior_and_its_curvature(sd, seed):
    blocks, prior = small_blocks(np.random.default_rng(seed)), SMALL
    found = estimate(blocks, prior, sd)

    def cost(x):
        return dense_cost(x, blocks, prior, sd)

    to_rounding = {"xatol": 1e-7, "fatol": 1e-9}
    best = minimize(cost, np.log([1.0, 0.5, 0.02]), method="Nelder-Mead", options=to_rounding)
    sds = np.array(found.sd)
    # the dense one stops where the cost changes by 1e-9, which is 5e-5 of an error bar
    np.testing.assert_array_less(np.abs(logs(found) - best.x), 3e-4 * sds)
    step = 1e-3
    eye = step * np.eye(3)
    H = np.array(
        [
            [
                cost(best.x + a + b) - cost(best.x + a - b) - cost(best.x - a + b) + cost(best.x - a - b)
                for b in eye
            ]
            for a in eye
        ]
    ) / (4.0 * step**2)
    np.testing.assert_allclose(sds, np.sqrt(np.diag(np.linalg.inv(H))), rtol=0.01)


def test_error_bars_of_the_noise_are_neither_too_small_nor_too_large():
    """Sum of squares of 90 pulls of sensors drawn from the prior: chi-square with 90 degrees of freedom."""
    z = []
    for seed in range(30):
        truth = drawn_noise(np.random.default_rng([8, seed]))
        blocks = blocks_of(linear_of(run_of([8, seed], truth, rate=10.0, dwell=10.0), LIBRARY))
        found = estimate(blocks, PRIOR)
        z += ((logs(found) - np.log([truth.N, truth.B, truth.K])) / found.sd).tolist()
    power = np.array(z) @ np.array(z)
    assert abs(power - 90.0) < 4.0 * math.sqrt(2.0 * 90.0)


def exact_flicker(rng, n):
    """Averages over unit intervals of flicker noise of unit B, from its generalised covariance.

    That of ``B^2 / (2 pi f)`` is ``-(B^2 / pi) ln |t|``, twice integrated over two rows; a constant is open.
    """
    lag = np.abs(np.subtract.outer(np.arange(float(n)), np.arange(float(n))))
    parts = [x**2 * np.log(np.maximum(np.abs(x), 1.0)) for x in (lag + 1.0, lag - 1.0, lag)]
    levels, vectors = np.linalg.eigh((2.0 * parts[2] - parts[0] - parts[1]) / (2.0 * np.pi) + n)
    return vectors @ (np.sqrt(np.maximum(levels, 0.0)) * rng.standard_normal(n))


@pytest.mark.parametrize("B", [0.5, 4.0])
def test_flicker_that_is_drawn_exactly_is_found_below_the_white_noise_of_a_sample_and_above(B):
    found = []
    for seed in range(12):
        rng = np.random.default_rng([31, seed])
        y = rng.standard_normal(800) + B * exact_flicker(rng, 800)
        rows = made.rows_of(y, np.ones((800, 1)), t=np.arange(800.0), duration=1.0)
        found.append(logs(estimate(rows, {"N": (1.0, 2.0), "B": (1.0, 2.0), "K": (1e-4, 1.0)}))[:2])
    scatter = np.std(found, axis=0) / math.sqrt(len(found))
    np.testing.assert_array_less(np.abs(np.mean(found, axis=0) - np.log([1.0, B])), 3.0 * scatter)


def test_order_and_units_of_the_library_change_nothing():
    blocks = blocks_of(linear_of(run_of(5), LIBRARY))
    rng = np.random.default_rng(1)
    p = blocks.X.shape[1]
    mixed = blocks.X[:, rng.permutation(p)] * 10.0 ** rng.uniform(-6.0, 6.0, p)
    plain, other = estimate(blocks, PRIOR), estimate(with_columns(blocks, mixed), PRIOR)
    np.testing.assert_array_less(np.abs(logs(other) - logs(plain)), 1e-4 * np.array(plain.sd))


def test_averages_over_blocks_estimate_what_the_samples_do():
    run = run_of(7, angles=8, rate=10.0)
    samples = linear_of(run, LIBRARY)
    blocks = blocks_of(samples)
    assert len(blocks) <= len(samples) / 4
    fine, coarse = estimate(samples, PRIOR), estimate(blocks, PRIOR)
    # B and K show in the blocks as they do in the samples
    np.testing.assert_array_less(np.abs(logs(fine) - logs(coarse))[1:], 0.3 * np.array(coarse.sd)[1:])
    # of N the blocks hold a part; the difference of nested estimates has the difference of their variances
    lost = math.sqrt(coarse.sd[0] ** 2 - fine.sd[0] ** 2)
    assert abs(logs(fine) - logs(coarse))[0] < 4.0 * lost


def test_fewer_rows_than_columns_are_judged_under_a_proper_prior():
    """Twelve rows, twenty columns of which three matter: nine degrees of freedom are left for the noise."""
    rng, pulls = np.random.default_rng(2), []
    start = 30.0 * np.arange(12.0)
    for _ in range(20):
        sd = np.where(np.arange(20) < 3, 1e3, 1e-6)
        X = rng.normal(size=(12, 20))
        y = synthesise(Noise(1.0, 0.0, 0.0), start, 1.0, rng) + X @ (sd * rng.normal(size=20))
        found = estimate(
            made.rows_of(y, X, t=start), {"N": (1.0, 2.0), "B": (1e-3, 0.1), "K": (1e-6, 0.1)}, sd
        )
        assert found.sd[0] == pytest.approx(1.0 / math.sqrt(2.0 * 9.0), rel=0.3)
        pulls.append(math.log(found.noise.N) / found.sd[0])
    assert max(np.abs(pulls)) < 4.0
    assert abs(np.mean(pulls)) < 4.0 / math.sqrt(20.0)


def test_without_a_class_the_noise_is_still_found():
    noise = Noise(6e-4, 4e-4, 0.0)
    found = estimate(blocks_of(linear_of(run_of(7, noise, angles=24), LIBRARY)))
    z = (logs(found)[:2] - np.log([noise.N, noise.B])) / np.array(found.sd)[:2]
    assert np.max(np.abs(z)) < 4.0
    assert allan_at(found.noise.K, 1e3) < noise.B  # what is not there may be no larger than what hides it


def allan_at(K, tau):
    return K * math.sqrt(tau / 3.0)


def test_blocks_partition_the_samples_and_never_reach_across_a_gap():
    rng = np.random.default_rng(3)
    for blocks in (1, 7, 100, 5000):
        lengths = rng.integers(1, 60, 20)
        t = np.concatenate([1e3 * k + np.arange(float(length)) for k, length in enumerate(lengths)])
        edges = block_edges(t, 1.0, blocks)
        assert edges[0] == 0
        assert np.all(np.diff(edges) > 0)
        pieces = np.split(t, edges[1:])
        assert all(np.all(np.diff(piece) == 1.0) for piece in pieces)
        assert max(map(len, pieces)) <= math.ceil(len(t) / blocks)


INTERVAL = 0.5
VAGUE = vague_prior(1.0, 100.0, INTERVAL)


def uneven_rows(rng, n=20):
    """Rows of two lengths, some of which touch, as one length."""
    duration = np.where(rng.random(n) < 0.5, 1.0, 2.5)
    gaps = np.where(rng.random(n) < 0.6, 0.0, 3.0)
    start = np.cumsum(np.concatenate(([0.0], (duration + gaps)[:-1])))
    X = np.column_stack((np.ones(n), rng.normal(size=n)))
    center = start + 0.5 * duration
    return made.rows_of(rng.normal(size=n), X, t=center, duration=duration, interval=INTERVAL), ((1.0, n),)


def averaged_covariance(noise, rows):
    """Covariance of averages that may be quantized."""
    size = dict.fromkeys("NBKQG", 0.0) | {"tau": 1.0} | noise
    variance, tau = flicker(size["B"], INTERVAL, rows.rows.span)
    white = 2.0 * variance[0] * tau[0] / 9.0  # time constants in ratio 10 without an end
    first_order = Processes(np.append(variance, size["G"] ** 2), np.append(tau, size["tau"]), white)
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
    data = process_model(rows, levels, VAGUE)
    found = np.array([told(data, noise)[0] for noise in POINTS])
    expected = np.array([restricted(averaged_covariance(noise, rows), rows.X, rows.y) for noise in POINTS])
    np.testing.assert_allclose(found - found[0], expected - expected[0], atol=1e-8)


@pytest.mark.parametrize(
    "names", [("N",), ("N", "K", "Q"), ("N", "G", "tau"), ("N", "B", "K", "Q", "G", "tau")]
)
def test_gradient_is_that_of_the_likelihood(names):
    """With a ramp or without, in rows of two lengths of which some touch."""
    model = process_model(*uneven_rows(np.random.default_rng(6)), VAGUE)
    x = np.log([{"N": 1.0, "B": 0.8, "K": 0.2, "Q": 0.5, "G": 0.6, "tau": 9.0}[name] for name in names])
    steps = 1e-4 * np.eye(len(x))
    found = [likelihood(model, names, x + sign * step).level for step in steps for sign in (1.0, -1.0)]
    expected = np.diff(-np.array(found).reshape(-1, 2), axis=1)[:, 0] / 2e-4
    np.testing.assert_allclose(likelihood(model, names, x, slopes=True).slope, expected, rtol=1e-5, atol=1e-6)


def test_a_ramp_adds_its_prior_to_the_covariance():
    rows, levels = uneven_rows(np.random.default_rng(4))
    data = process_model(rows, levels, VAGUE)
    noise = {"N": 1.0, "K": 0.3, "Q": 0.4}
    found = told(data, noise)
    t = rows.t
    middle = VAGUE["R"][1] * (t - t[0] + 0.5 * rows.duration[0] - 0.5 * rows.rows.span)
    C = averaged_covariance(noise, rows)
    wider, plain = (restricted(one, rows.X, rows.y) for one in (C + np.outer(middle, middle), C))
    assert found[1] - found[0] == pytest.approx(wider - plain, abs=1e-8)


@pytest.mark.parametrize("n", [50, 3000, 20_000, 300_000])
def test_pieces_cover_every_sample_once_are_few_and_reach_across_no_gap(n):
    t, gap = np.arange(float(n)), n // 3 + 1
    edges, levels = piece_edges(np.where(t < gap, t, t + 9000.0), 1.0)
    assert gap in edges
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
    assert process_model(rows, levels, VAGUE).joined[1:].all()
