"""Allan deviation against published numbers of NBS and NIST, its confidence, and the fit of its logarithm."""

import allantools
import numpy as np
import pytest
from allantools import ci
from quiet_logs import quiet_log

from imubayes.inference.allan import allan_curve, allan_deviation, confidence_band, fit_allan, log_covariance

SAMPLES = 4000
TAU = np.array([1.0, 2.0, 5.0, 10.0, 50.0, 200.0])

NBS14 = np.array([892.0, 809.0, 823.0, 798.0, 671.0, 644.0, 883.0, 903.0, 677.0])
"""Frequency data of NBS Monograph 140, Annex 8.E (Riley, NIST SP 1065, table 29)."""


def thousand_points():
    """Riley's 1000-point test: a linear congruential generator (NIST SP 1065, section 12.4)."""
    n, out = 1234567890, []
    for _ in range(1000):
        out.append(n / 2147483647.0)
        n = 16807 * n % 2147483647
    return np.array(out)


@pytest.mark.parametrize(
    ("y", "published"),
    [
        (NBS14, {1: 91.22945, 2: 85.95287}),
        (thousand_points(), {1: 2.922319e-01, 10: 9.159953e-02, 100: 3.241343e-02}),
    ],
    ids=["nine points", "thousand points"],
)
def test_deviation_is_the_published_one(y, published):
    tau, deviation = allan_deviation(y, np.arange(float(len(y))), 1.0)
    found = dict(zip(tau.tolist(), deviation.tolist(), strict=True))
    for m, value in published.items():
        assert found[m] == pytest.approx(value, rel=0.5e-6 / 2.9)


def test_deviation_of_a_record_with_a_gap_is_that_of_allantools_on_its_parts_pooled():
    rng = np.random.default_rng(2)
    parts = rng.normal(size=400).cumsum(), rng.normal(size=700).cumsum()
    t = np.concatenate((np.arange(400.0), 1e5 + np.arange(700.0)))
    tau, deviation = allan_deviation(np.concatenate(parts), t, 1.0)
    squares, counts = np.zeros(len(tau)), np.zeros(len(tau))
    for y in parts:
        held = tau <= len(y) // 2
        _, found, _, n = allantools.oadev(y, rate=1.0, data_type="freq", taus=tau[held])
        squares[held] += n * found**2
        counts[held] += n
    np.testing.assert_allclose(deviation, np.sqrt(squares / counts), rtol=1e-12)


@pytest.mark.parametrize(("noise", "alpha"), [({"N": 1.0}, 0), ({"N": 1e-6, "K": 0.1}, -2)])
def test_spectral_covariance_has_the_degrees_of_freedom_of_greenhall_and_riley(noise, alpha):
    """Two routes to the variance of ln A: 2/edf by structure functions, and the sum over the periodogram.

    They treat the ends of a record differently: by one part in n/m of the degrees of freedom, and where a
    sample is all there is of the averaging time (m = 1), sampling aliases the walk.
    """
    spectral = 2.0 / np.diag(log_covariance(noise, TAU, (SAMPLES, 1.0)))
    published = [ci.edf_greenhall(alpha, 2, int(m), SAMPLES + 1, overlapping=True) for m in TAU]
    np.testing.assert_allclose(spectral[1:], published[1:], rtol=0.08)


@pytest.mark.parametrize("alpha", [2, 0, -1, -2])
@pytest.mark.parametrize("samples", [400, 100_000])
def test_band_is_that_of_allantools(alpha, samples):
    """The other route sums over a hundred lags, or a table's fit: 2 % of the degrees of freedom.

    Of the longest averaging time there is one.
    """
    tau = np.array([1.0, 2.0, 5.0, 10.0, samples // 20, samples // 5, samples // 2])
    low, high = confidence_band(tau, np.ones(7), np.full(7, alpha), (samples, 1.0))
    edf = [ci.edf_greenhall(alpha, 2, int(m), samples + 1, overlapping=True) for m in tau[:-1]] + [1.0]
    expected = np.array([ci.confidence_interval(1.0, each, ci=0.9) for each in edf])
    np.testing.assert_allclose(np.column_stack((low, high)), expected, rtol=0.01)


def test_covariance_is_that_of_simulated_logs():
    noise = {"N": 1.0, "K": 0.02}
    rng = np.random.default_rng(3)
    t = np.arange(float(SAMPLES))
    logs = [allan_deviation(quiet_log(noise, SAMPLES, 1.0, rng), t, 1.0) for _ in range(100)]
    chosen = np.isin(logs[0][0], [1.0, 10.0, 16.0, 100.0, 158.0])
    values = 2.0 * np.log([deviation[chosen] for _, deviation in logs])
    expected = log_covariance(noise, logs[0][0][chosen], (SAMPLES, 1.0))
    correlation = expected / np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    found = np.corrcoef(values, rowvar=False)
    # a correlation r from 100 logs has the sd (1 - r^2) / sqrt(100)
    assert np.all(np.abs(found - correlation) < 4.0 * (1.0 - correlation**2) / np.sqrt(100.0) + 0.05)


def test_fit_of_the_allan_variance_finds_the_processes_within_its_errors():
    noise = {"N": 1.0, "B": 0.15, "K": 0.02, "Q": 2.0}
    names, n = tuple(noise), 20_000
    truth = np.log(list(noise.values()))
    z = []
    for seed in range(16):
        y = quiet_log(noise, n, 1.0, np.random.default_rng(seed))
        curve = allan_curve(y, np.arange(float(n)), 1.0, noise)
        found = fit_allan(curve, noise, names, (n, 1.0))
        z.append((np.log(found.values) - truth) / found.log_sd)
    z = np.array(z)
    assert np.all(np.abs(z.mean(axis=0)) < 4.0 / np.sqrt(len(z)))
    # sd of an sd from 16 draws is 0.18
    assert np.all((z.std(axis=0) > 0.28) & (z.std(axis=0) < 1.72))


def test_a_size_that_the_curve_does_not_tell_is_not_said_to_be_known():
    noise = {"N": 1.0, "B": 0.5, "R": -1e-9, "G": 1.2, "tau": 90.0}
    y = quiet_log({"N": 1.0, "B": 0.5}, 100, 1.0, np.random.default_rng(3))
    curve = allan_curve(y, np.arange(100.0), 1.0, noise)
    found = dict(zip(noise, fit_allan(curve, noise, tuple(noise), (100, 1.0)).log_sd, strict=True))
    assert found["N"] < 0.5
    assert found["R"] > 2.0
    assert found["tau"] > 1.0


def test_curve_is_the_sum_of_its_shares_and_none_for_a_short_record():
    noise = {"N": 1.0, "K": 0.01}
    y = quiet_log(noise, 500, 1.0, np.random.default_rng(1))
    curve = allan_curve(y, np.arange(500.0), 1.0, noise)
    total = sum(share**2 for share in curve.shares.values())
    np.testing.assert_allclose(curve.fitted**2, total, rtol=1e-12)
    assert set(curve.shares) == {"N", "K"} and (curve.low < curve.high).all()
    assert allan_curve(y[:1], np.arange(1.0), 1.0, noise) is None
