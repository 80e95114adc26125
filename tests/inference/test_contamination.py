"""The mixture over dwells against dense algebra and every one of its 2^m states, and the first suspects."""

from dataclasses import replace
from itertools import product

import made
import numpy as np
import pytest
from scipy.special import betaln, logsumexp
from scipy.stats import multivariate_normal

import imubayes as ib
from imubayes.inference.dwells import Dwells, dwells_of
from imubayes.inference.linear import linear_of
from imubayes.inference.prior import class_sd
from imubayes.inference.robust import (
    SHARE,
    conditional,
    evidence,
    first_suspects,
    log_odds,
    log_posterior,
    sample,
)
from imubayes.inference.whiten import whiten
from imubayes.sensors.noise import Noise

NOISE = Noise(1.0, 0.3, 0.05)
PRIOR = np.array([3.0, 0.5, 10.0])
TAU = 20.0


def dwells(X, y):
    start = 12.0 * np.arange(len(y))
    means = made.rows_of(y, X, t=start + 5.0, duration=10.0)
    return Dwells(np.arange(len(y) + 1), start, start + 10.0, means)


def two_runs(seed, offsets, sizes=(6, 4)):
    """Dwell means of two runs with these offsets, by dwell."""
    rng = np.random.default_rng(seed)
    m = sum(sizes)
    X = rng.normal(size=(m, 3))
    y = X @ (PRIOR * rng.normal(size=3)) + 0.4 * rng.normal(size=m)
    for d, offset in offsets.items():
        y[d] += offset
    parts = np.split(np.arange(m), [sizes[0]])
    return [dwells(X[part], y[part]) for part in parts]


def dense(runs):
    """Covariance of all dwell means where none is contaminated, their mean's columns, and the means."""
    covariance = np.zeros((0, 0))
    for d in runs:
        W = whiten(NOISE, d.means.rows, np.eye(len(d)))[0]
        n = len(covariance)
        covariance = np.pad(covariance, ((0, len(d)), (0, len(d))))
        covariance[n:, n:] = np.linalg.inv(W.T @ W)
    return covariance, np.concatenate([d.means.X for d in runs]), np.concatenate([d.means.y for d in runs])


def states_of(runs):
    """Every state of the indicators, (2^m, m), and its log posterior from the dense covariance."""
    covariance, X, y = dense(runs)
    clean = covariance + (X * PRIOR**2) @ X.T
    m = len(y)
    states = np.array(list(product([False, True], repeat=m)))
    logs = [
        multivariate_normal.logpdf(y, cov=clean + np.diag(TAU**2 * on))
        + betaln(SHARE[0] + on.sum(), SHARE[1] + m - on.sum())
        for on in states
    ]
    return states, np.array(logs)


def evidence_of(runs):
    return evidence(runs, [NOISE] * len(runs), PRIOR, np.full(sum(map(len, runs)), TAU))


CASES = {"clean": {}, "borderline": {2: 3.0, 7: -2.6}, "many": {0: 8.0, 3: -9.0, 8: 7.0}}


@pytest.fixture(scope="module", params=CASES)
def case(request):
    runs = two_runs(4, CASES[request.param])
    return evidence_of(runs), *states_of(runs), runs


def test_log_posterior_is_that_of_the_dense_covariance(case):
    e, states, logs, _ = case
    ours = np.array([log_posterior(e, on) for on in states])
    # both are differences of numbers of the size of the largest
    np.testing.assert_allclose(ours - ours[0], logs - logs[0], atol=1e-9 * max(1.0, np.ptp(logs)))


def test_odds_of_a_flip_are_the_ratio_of_the_two_posteriors(case):
    e, states, logs, _ = case
    index = {tuple(on): k for k, on in enumerate(states.tolist())}
    for on in states[:: len(states) // 40]:
        odds = log_odds(e, on, conditional(e, on))
        for d in range(len(on)):
            with_it, without = on.copy(), on.copy()
            with_it[d], without[d] = True, False
            expected = logs[index[tuple(with_it.tolist())]] - logs[index[tuple(without.tolist())]]
            assert odds[d] == pytest.approx(expected, abs=1e-8 * max(1.0, np.ptp(logs)))


def squared_pull(runs, on, d, offset):
    """Squared shift, in posterior sd, of all that is fitted if dwell d of the state `on` is kept."""
    covariance, X, y = dense(runs)
    others = np.flatnonzero(on & (np.arange(len(y)) != d))
    A = np.column_stack((X, np.eye(len(y))[:, others]))
    prior = np.diag(np.concatenate((PRIOR, np.full(len(others), TAU))) ** -2.0)
    precision = A.T @ np.linalg.solve(covariance, A) + prior
    push = A.T @ np.linalg.solve(covariance, offset * np.eye(len(y))[d])
    return push @ np.linalg.solve(precision, push)


def test_sampled_probability_and_harm_are_those_of_all_states(case):
    e, states, logs, runs = case
    weight = np.exp(logs - logsumexp(logs))
    harm = np.zeros(len(e.r))
    for on, share in zip(states, weight, strict=True):
        if share > 1e-7:
            mean, _ = conditional(e, on)
            for d in np.flatnonzero(on):
                harm[d] += share * squared_pull(runs, on, d, mean[d])
    rng = np.random.default_rng(3)
    chains = [sample(e, rng.random(len(harm)) < 0.3, rng) for _ in range(16)]
    for exact, found in (
        (weight @ states, np.array([c.probability for c in chains])),
        (harm, np.array([c.harm for c in chains])),
    ):
        standard_error = found.std(axis=0, ddof=1) / 4.0
        # 5 standard errors from 15 degrees of freedom, and what states that no chain meets would add
        np.testing.assert_array_less(
            np.abs(found.mean(axis=0) - exact), 5.0 * standard_error + 1e-4 + 1e-3 * exact
        )


def test_offsets_beyond_their_prior_lose_no_digits():
    """An offset of 1e9 sd: an update of the covariance by -tau^2 would cancel 18 digits."""
    runs = two_runs(4, {2: 1e9})
    e = evidence(runs, [NOISE, NOISE], PRIOR, np.full(10, 1e9))
    found = sample(e, np.zeros(10, dtype=bool), np.random.default_rng(1))
    assert found.probability[2] > 0.999
    assert np.delete(found.probability, 2).max() < 0.5
    assert abs(found.mean[2] - 1e9) < 5.0 * found.sd[2]


@pytest.mark.parametrize("start", [0, 1])
def test_one_of_two_dwells_is_off_and_the_data_do_not_tell_which(start):
    """A column that only two dwells see, with a wide prior: +offset of one is -offset of the other."""
    rng = np.random.default_rng(6)
    X = np.zeros((12, 2))
    X[:, 0], X[:2, 1] = 1.0, 1.0
    y = 0.3 * rng.normal(size=12) + np.where(np.arange(12) == 0, 60.0, 0.0)
    e = evidence([dwells(X, y)], [NOISE], np.array([3.0, 1e3]), np.full(12, 100.0))
    found = sample(e, np.arange(12) == start, np.random.default_rng(2), sweeps=2000)
    assert np.all(found.probability[:2] > 0.3)
    assert found.probability[:2].sum() == pytest.approx(1.0, abs=0.1)
    assert found.mean[0] == pytest.approx(-found.mean[1], rel=0.1)


SERVO = ib.sensor("quartz_flexure_servo", kind="accelerometer")
LIBRARY = ib.library("accelerometer")
SD = 3e-5
"""m/s^2; noise of a dwell mean of the class's typical sensor, its neighbours known."""


def tumble(seed, offsets=(), ringing=()):
    (run,) = ib.simulate(SERVO, [ib.tumble(angles=24, planes=3, rate=1.0)], seed=seed)
    output = run.output.copy()
    for dwell, size in offsets:
        output[30 * dwell : 30 * dwell + 30] += size
    for dwell in ringing:
        output[30 * dwell + 10 : 30 * dwell + 20] += 1e3 * SD * np.tile([1.0, -1.0], 5)
    return replace(run, output=output)


def suspects(run):
    rows = linear_of(run, LIBRARY)
    return first_suspects([rows], [dwells_of(rows)], class_sd(SERVO, LIBRARY))


def test_gross_offsets_are_suspected_whatever_else_is():
    rng = np.random.default_rng(1)
    off = rng.choice(72, 14, replace=False)
    sizes = SD * rng.choice([-1.0, 1.0], 14) * np.exp(rng.uniform(np.log(100.0), np.log(1000.0), 14))
    found, tau = suspects(tumble(1, tuple(zip(off, sizes, strict=True))))
    assert np.all(found[off])
    assert np.count_nonzero(found) <= 16
    assert np.all(tau >= np.abs(sizes).max() * 0.9)


def test_ringing_that_leaves_the_mean_alone_is_suspected():
    found, _ = suspects(tumble(1, ringing=(5, 40)))
    assert np.all(found[[5, 40]])


def test_where_most_dwells_ring_or_are_off_those_that_are_off_are_suspected():
    dwells = np.random.default_rng(2).permutation(72)
    off, ringing = dwells[:20], dwells[20:45]
    found, _ = suspects(tumble(2, [(k, 300.0 * SD) for k in off], ringing))
    assert set(off) <= set(np.flatnonzero(found)) and np.count_nonzero(found) <= 36


def test_output_without_any_noise_suspects_nothing():
    run = tumble(1)
    found, tau = suspects(replace(run, output=run.inputs.channels["f_i"].copy()))
    assert not found.any()
    assert np.all(np.isfinite(tau) & (tau > 0.0))
