"""Differences and their thresholds, each by a second route."""

import math

import numpy as np
import pytest
from scipy import stats

from imubayes.reporting.comparison.differences import fisher, largest, normal_of


@pytest.mark.parametrize(("a", "n", "b", "m"), [(8, 8, 0, 8), (3, 10, 7, 8), (0, 9, 1, 9), (40, 50, 10, 60)])
def test_shares_differ_as_the_ways_to_deal_them_out_say(a, n, b, m):
    ways = [math.comb(n, k) * math.comb(m, a + b - k) if k <= a + b else 0 for k in range(n + 1)]
    p = sum(count for count in ways if count <= ways[a]) / sum(ways)
    # a normal's two-sided tail; where everything is as likely, p = 1 has the size 0
    assert 2.0 * stats.norm.sf(fisher((a, n), (b, m))) == pytest.approx(p, rel=1e-8)
    assert fisher((a, n), (b, m)) == pytest.approx(fisher((b, m), (a, n)), rel=1e-12)


def test_shares_of_a_thousand_have_a_finite_size():
    assert np.isfinite(fisher((0, 1000), (1000, 1000)))


def test_largest_difference_of_shares_names_its_pair():
    pull = largest([(8, 8), (7, 8), None, (0, 8)], fisher)
    assert pull.pair == ("A", "D") and pull.size == fisher((8, 8), (0, 8))


def test_interval_of_a_normal_gives_its_sd_back():
    low, high = stats.norm(3.0, 0.7).ppf([0.05, 0.95])
    assert normal_of(low, high) == pytest.approx(0.7, rel=1e-12)
