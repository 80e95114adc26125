"""Overlapping Allan deviation against the published numbers of NBS and NIST."""

import math

import numpy as np
import pytest

from imubayes.inference.allan import allan_deviation

NBS14 = np.array([892.0, 809.0, 823.0, 798.0, 671.0, 644.0, 883.0, 903.0, 677.0])
"""Frequency data of NBS Monograph 140, Annex 8.E (Riley, NIST SP 1065, table 29)."""


def thousand_points():
    """Riley's 1000-point test: a linear congruential generator (NIST SP 1065, section 12.4)."""
    n, out = 1234567890, []
    for _ in range(1000):
        out.append(n / 2147483647.0)
        n = 16807 * n % 2147483647
    return np.array(out)


def at(result, tau):
    return result[1][np.flatnonzero(result[0] == tau)[0]]


@pytest.mark.parametrize(("m", "published"), [(1, 91.22945), (2, 85.95287)])
def test_nine_points_have_the_published_deviation(m, published):
    assert at(allan_deviation(NBS14, np.arange(9.0), 1.0), m) == pytest.approx(published, abs=5e-6)


@pytest.mark.parametrize(("m", "published"), [(1, 2.922319e-01), (10, 9.159953e-02), (100, 3.241343e-02)])
def test_thousand_points_have_the_published_deviation(m, published):
    result = allan_deviation(thousand_points(), np.arange(1000.0), 1.0)
    assert at(result, m) == pytest.approx(published, rel=0.5e-6 / 2.9)


def test_deviation_is_the_definition_over_every_pair_of_neighbouring_averages():
    y, interval = np.random.default_rng(1).normal(size=60).cumsum(), 0.25
    tau, deviation = allan_deviation(y, interval * np.arange(60.0), interval)
    for m, value in zip(np.rint(tau / interval).astype(int), deviation, strict=True):
        means = np.convolve(y, np.full(m, 1.0 / m), mode="valid")
        assert value == pytest.approx(math.sqrt(0.5 * np.mean((means[m:] - means[:-m]) ** 2)), rel=1e-10)
    assert tau.max() <= 0.5 * 60 * interval


def test_dwells_of_one_sample_have_no_deviation():
    tau, deviation = allan_deviation(np.ones(5), 10.0 * np.arange(5.0), 1.0)
    assert len(tau) == len(deviation) == 0
