"""Sums over all models, and models that stand for all."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imubayes.selection import spaces
from imubayes.selection.spaces import fold, heaviest, sizes, standing_for, tally

seeds = st.integers(0, 2**32 - 1)


def _weights(seed: int, p: int) -> np.ndarray:
    return np.random.default_rng(seed).random(1 << p) ** 12


@settings(deadline=None, max_examples=30)
@given(seeds, st.integers(0, 9), st.integers(2, 6))
def test_a_tally_over_blocks_is_the_sum_over_models(seed, p, bits):
    weight = _weights(seed, p)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(spaces, "BLOCK_BITS", bits)
        told = tally(weight, p)
        top = heaviest(weight, 5)
    sums, total = fold(weight, p)
    np.testing.assert_allclose(told.having, sums, rtol=1e-12)
    assert told.total == pytest.approx(total, rel=1e-12)
    np.testing.assert_allclose(told.by_size, np.bincount(sizes(p), weight, p + 1), rtol=1e-12)
    assert top.tolist() == np.argsort(-weight, kind="stable")[:5].tolist()


@given(seeds)
def test_models_that_stand_for_all_have_the_weight_of_all_and_the_heavy_ones_their_own(seed):
    weight = _weights(seed, 12)
    which, share = standing_for(weight, 200)
    assert share.sum() == pytest.approx(weight.sum(), rel=1e-12)
    assert len(which) <= 2 * 200 + 10
    heavy = np.flatnonzero(weight > weight.sum() / 200)
    np.testing.assert_array_equal(share[np.searchsorted(which, heavy)], weight[heavy])


def test_sums_over_models_that_stand_for_all_are_right_on_average():
    """A systematic draw of m models misses a share by less than its tails' weight over sqrt(m), 4 sd."""
    p, count = 14, 400
    for seed in range(5):
        weight = _weights(seed, p)
        which, share = standing_for(weight, count)
        rest = weight[weight < weight.sum() / count].sum() / weight.sum()
        inside = (which[:, None] >> np.arange(p)) & 1
        found, expected = share @ inside / share.sum(), tally(weight, p).having / weight.sum()
        assert np.max(np.abs(found - expected)) < 4.0 * 0.5 * rest / np.sqrt(count)
