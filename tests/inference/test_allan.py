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


def test_an_offset_changes_nothing_and_a_scale_scales():
    y, t = thousand_points(), np.arange(1000.0)
    plain = allan_deviation(y, t, 1.0)[1]
    np.testing.assert_allclose(allan_deviation(3.0 * y + 9.8e3, t, 1.0)[1], 3.0 * plain, rtol=1e-9)


def test_a_ramp_has_the_deviation_of_its_slope():
    tau, deviation = allan_deviation(0.3 * np.arange(200.0), np.arange(200.0), 1.0)
    np.testing.assert_allclose(deviation, 0.3 * tau / math.sqrt(2.0), rtol=1e-10)


def test_parts_between_gaps_are_pooled_by_their_number_of_differences():
    y = thousand_points()
    first, second = (
        allan_deviation(y[:300], np.arange(300.0), 1.0),
        allan_deviation(y[300:], np.arange(700.0), 1.0),
    )
    t = np.concatenate((np.arange(300.0), 1e4 + np.arange(700.0)))
    pooled = allan_deviation(y, t, 1.0)
    for m in (1, 10, 100):
        counts = 300 - 2 * m + 1, 700 - 2 * m + 1
        expected = (counts[0] * at(first, m) ** 2 + counts[1] * at(second, m) ** 2) / sum(counts)
        assert at(pooled, m) ** 2 == pytest.approx(expected, rel=1e-10)


def test_a_step_across_a_gap_does_not_count():
    y = np.concatenate((np.zeros(50), np.ones(50)))
    t = np.concatenate((np.arange(50.0), 100.0 + np.arange(50.0)))
    assert not allan_deviation(y, t, 1.0)[1].any()
    assert allan_deviation(y, np.arange(100.0), 1.0)[1].any()


def test_dwells_of_one_sample_have_no_deviation():
    tau, deviation = allan_deviation(np.ones(5), 10.0 * np.arange(5.0), 1.0)
    assert len(tau) == len(deviation) == 0
