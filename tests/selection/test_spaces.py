"""A list of all subsets is the space of all subsets."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imubayes.selection.spaces import Every, Listed, listed, united

seeds = st.integers(0, 2**32 - 1)


def _both(p: int, seed: int) -> tuple[Every, Listed, np.ndarray]:
    every = Every(p)
    inside = every.members(np.arange(len(every)))
    return every, Listed(inside), np.random.default_rng(seed).uniform(size=len(every))


@given(st.integers(1, 6), seeds)
def test_listing_every_subset_changes_nothing(p, seed):
    every, some, weight = _both(p, seed)
    bits = np.flatnonzero(np.random.default_rng(seed).random(p) < 0.5).tolist()
    assert len(every) == len(some)
    assert every.sizes().tolist() == some.sizes().tolist()
    assert every.having(bits).tolist() == some.having(bits).tolist()
    assert every.having_any(bits).tolist() == some.having_any(bits).tolist()
    np.testing.assert_allclose(every.sums(weight)[0], some.sums(weight)[0], rtol=1e-12)
    assert every.members(np.array([every.full])).all()


@given(st.integers(1, 12), seeds)
def test_united_lists_add_the_weights_of_what_they_share(p, seed):
    rng = np.random.default_rng(seed)
    rows = [np.unique(rng.random((6, p)) < 0.5, axis=0) for _ in range(2)]
    parts = [listed(inside, rng.uniform(0.1, 1.0, len(inside))) for inside in rows]
    space, weight = united([s for s, _ in parts], [w for _, w in parts])
    there: dict[tuple[bool, ...], float] = {}
    for part, shares in parts:
        for row, share in zip(part.inside.tolist(), shares.tolist(), strict=True):
            there[tuple(row)] = there.get(tuple(row), 0.0) + share
    assert len(space) == len(there)
    assert space.members(np.array([space.full])).all()
    for row, share in zip(space.members(np.arange(len(space))).tolist(), weight.tolist(), strict=True):
        assert share == pytest.approx(there[tuple(row)], rel=1e-12)
