"""Searching around a list, against all subsets."""

from __future__ import annotations

import numpy as np
import pytest

from imubayes.algebra.factor import factor_of
from imubayes.selection.criteria import criteria

NAMES = tuple(f"x{k}" for k in range(12))


@pytest.mark.parametrize("seed", range(5))
def test_information_criteria_of_a_poor_list_are_those_of_all_subsets(seed):
    """From the empty subset alone the way leads to the best of all: columns are not all but collinear."""
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(80, 12)) + 0.5 * rng.normal(size=(80, 1))
    y = X @ np.where(rng.random(12) < 0.5, rng.normal(size=12), 0.0) + rng.normal(size=80)
    f = factor_of(X, y, NAMES)
    exact = criteria(f, [], np.ones(12), NAMES)
    found = criteria(f, [], np.ones(12), NAMES, among=np.zeros((1, 12), dtype=bool), widen=True)
    assert [one.model for one in found] == [one.model for one in exact]
    np.testing.assert_allclose([one.value for one in found], [one.value for one in exact], rtol=1e-12)
    assert not any(one.exact for one in found)


def test_inadmissible_subsets_are_no_way():
    rng = np.random.default_rng(3)
    X = rng.normal(size=(60, 4))
    y = X @ [0.0, 0.0, 2.0, 0.0] + rng.normal(size=60)
    f = factor_of(X, y, NAMES[:4])
    needs = (("x2", "x0"),)
    among = np.zeros((1, 4), dtype=bool)
    found = criteria(f, [], np.ones(4), NAMES[:4], needs=needs, among=among, widen=True)
    exact = criteria(f, [], np.ones(4), NAMES[:4], needs=needs)
    assert [one.model for one in found] == [one.model for one in exact]
    assert all("x0" in one.model for one in found if "x2" in one.model)
