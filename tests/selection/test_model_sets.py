"""Prior of the models: sizes, and terms that call for others. A list of all subsets is the space of all
subsets. Sums over all models, and models that stand for all. Pieces come back in order; processes that share
the cores already take one thread each. Searching around a list, against all subsets."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba.core import config

import imubayes as ib
from imubayes.algebra.factor import factor_of
from imubayes.selection import model_sets
from imubayes.selection.criteria import criteria
from imubayes.selection.kernels import exponentials, logarithms
from imubayes.selection.model_sets import (
    Space,
    Union,
    admissible,
    admissible_counts,
    heaviest,
    hierarchy,
    listed,
    log_model_prior,
    pieces,
    sizes,
    standing_for,
    tally,
)

seeds = st.integers(0, 2**32 - 1)


def _both(p: int, seed: int) -> tuple[Space, Space, np.ndarray]:
    every = Space(p)
    inside = every.members(np.arange(len(every)))
    return every, Space.of(inside), np.random.default_rng(seed).uniform(size=len(every))


@given(st.integers(1, 6), seeds)
def test_listing_every_subset_changes_nothing(p, seed):
    every, some, weight = _both(p, seed)
    own = np.random.default_rng(seed).random(p)
    bits, others = np.flatnonzero(own < 0.4).tolist(), np.flatnonzero(own > 0.7).tolist()
    assert len(every) == len(some)
    assert every.sizes().tolist() == some.sizes().tolist()
    for there, absent in ((bits, others), (bits, []), ([], others)):
        numbers = [np.arange(len(one)).reshape(one.shape)[one.where(there, absent)] for one in (every, some)]
        assert numbers[0].ravel().tolist() == numbers[1].tolist()
    np.testing.assert_allclose(every.sums(weight)[0], some.sums(weight)[0], rtol=1e-12)
    assert every.members(np.array([len(every) - 1])).all()


@given(st.integers(1, 12), seeds)
def test_a_union_of_lists_adds_the_weights_of_what_they_share(p, seed):
    rng = np.random.default_rng(seed)
    rows = [np.unique(rng.random((6, p)) < 0.5, axis=0) for _ in range(2)]
    parts, union = [listed(inside, rng.uniform(0.1, 1.0, len(inside))) for inside in rows], Union()
    there: dict[tuple[bool, ...], float] = {}
    for (part, shares), log in zip(parts, (-800.0, -800.5), strict=True):
        union.add(part, shares, log)
        for row, share in zip(part.inside.tolist(), shares.tolist(), strict=True):
            there[tuple(row)] = there.get(tuple(row), 0.0) + share * math.exp(log + 800.0)
    space, weight = union.summed(p)
    assert len(space) == len(there)
    assert space.members(np.array([len(space) - 1])).all()
    whole = sum(there.values())
    for row, share in zip(space.members(np.arange(len(space))).tolist(), weight.tolist(), strict=True):
        assert share == pytest.approx(there[tuple(row)] / whole, rel=1e-12)


def test_a_union_of_every_subset_is_that_of_its_lists():
    p, rng = 4, np.random.default_rng(3)
    every, listing, space = Union(), Union(), Space(p)
    rows = space.members(np.arange(len(space)))
    for log in (-900.0, 700.0, 699.0):
        weight = rng.random(len(space))
        every.add(space, weight, log)
        listing.add(*listed(rows, weight), log)
    found = {tuple(row): share for row, share in zip(rows.tolist(), every.summed(p)[1].tolist(), strict=True)}
    some, weight = listing.summed(p)
    again = zip(some.members(np.arange(len(some))).tolist(), weight.tolist(), strict=True)
    assert {tuple(row): pytest.approx(share, rel=1e-12) for row, share in again} == found


def _weights(seed: int, p: int) -> np.ndarray:
    return np.random.default_rng(seed).random(1 << p) ** 12


@settings(deadline=None, max_examples=30)
@given(seeds, st.integers(0, 9), st.integers(2, 6))
def test_a_tally_over_blocks_is_the_sum_over_models(seed, p, bits):
    weight = _weights(seed, p)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(model_sets, "BLOCK_BITS", bits)
        told = tally(weight, p)
        top = heaviest(weight, 5)
    sums = [weight[np.arange(1 << p) >> j & 1 == 1].sum() for j in range(p)]
    np.testing.assert_allclose(told.having, sums, rtol=1e-12)
    assert told.total == pytest.approx(weight.sum(), rel=1e-12)
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


@given(seeds)
def test_light_models_are_drawn_at_even_places_of_their_running_sum(seed):
    weight = _weights(seed, 12)
    which, _ = standing_for(weight, 200)
    limit = min(weight.sum() / 200, np.sort(weight)[-10])
    ends = np.cumsum(np.where(weight < limit, weight, 0.0))
    places = (np.arange(200) + 0.5) / 200 * ends[-1]
    expected = np.union1d(np.flatnonzero(weight >= limit), np.searchsorted(ends, places, side="right"))
    np.testing.assert_array_equal(which, expected)


def test_logarithms_and_exponentials_are_those_of_a_library():
    rng = np.random.default_rng(1)
    x = np.concatenate((np.exp(rng.uniform(-700.0, 700.0, 1000)), 1.0 + rng.uniform(-1e-6, 1e-6, 1000)))
    logs, powers = x.copy(), np.empty(len(x), dtype=np.int64)
    logarithms(logs, logs.view(np.int64), powers)
    np.testing.assert_allclose(logs, np.log(x), rtol=1e-15, atol=0.0)
    low = np.concatenate((rng.uniform(-700.0, 1.0, 1000), [-709.0, -np.inf]))
    powers = np.empty(len(low), dtype=np.int64)
    given = low.copy()
    exponentials(given, 0.5, 2.0, powers, powers.view(np.float64))
    np.testing.assert_allclose(given, np.exp(0.5 * (low - 2.0)), rtol=1e-15, atol=0.0)


def test_an_error_in_a_piece_is_raised(monkeypatch):
    monkeypatch.setattr(config, "NUMBA_NUM_THREADS", 2)
    with pytest.raises(ZeroDivisionError):
        pieces(lambda k: 1 // (k - 2), 4)


NAMES = tuple(f"x{k}" for k in range(12))


@pytest.mark.parametrize(("seed", "needs"), [(0, ()), (1, ()), (2, ()), (3, (("x2", "x0"), ("x5", "x4")))])
def test_information_criteria_of_a_poor_list_are_those_of_all_subsets(seed, needs):
    """From the empty subset alone the way leads to the best of all: columns are not all but collinear."""
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(80, 12)) + 0.5 * rng.normal(size=(80, 1))
    theta = np.where(rng.random(12) < 0.5, rng.normal(size=12), 0.0)
    if needs:
        theta[[0, 2]] = 0.0, 2.0  # a child that stands out, and a parent that is not there
    f = factor_of(X, X @ theta + rng.normal(size=80), NAMES)
    exact = criteria(f, [], np.ones(12), NAMES, needs=needs)
    among = np.zeros((1, 12), dtype=bool)
    found = criteria(f, [], np.ones(12), NAMES, needs=needs, among=among, widen=True)
    assert [one.model for one in found] == [one.model for one in exact]
    np.testing.assert_allclose([one.value for one in found], [one.value for one in exact], rtol=1e-12)
    assert not any(one.exact for one in found)
    assert not needs or all({"x0", "x2"} <= {*one.model} for one in found)


FORESTS = st.integers(1, 7).flatmap(
    lambda p: st.tuples(st.just(p), st.lists(st.integers(-1, p - 1), min_size=p, max_size=p))
)


def _needs(parents: list[int]) -> list[tuple[int, int]]:
    """A parent of a smaller number makes trees and no circles."""
    return [(child, parent) for child, parent in enumerate(parents) if 0 <= parent < child]


@given(FORESTS)
def test_counts_are_those_of_all_models_one_by_one(forest):
    p, parents = forest
    needs = _needs(parents)
    counts = np.zeros(p + 1)
    for bits in product((0, 1), repeat=p):
        counts[sum(bits)] += all(bits[a] <= bits[b] for a, b in needs)
    assert admissible_counts(p, needs).tolist() == counts.tolist()
    assert admissible(Space(p), needs).sum() == counts.sum()


@given(FORESTS, st.sampled_from(["beta-binomial", "uniform", 0.2]))
def test_prior_of_the_admissible_models_sums_to_one(forest, model_prior):
    p, parents = forest
    needs = _needs(parents)
    total = np.sum(admissible_counts(p, needs) * np.exp(log_model_prior(model_prior, p, needs)))
    assert total == pytest.approx(1.0, rel=1e-12)


def test_powers_asymmetries_and_temperature_call_for_what_they_modify():
    lib = ib.library("accelerometer", powers=4, asymmetry=2, temperature=2, temperature_of=("b1",))
    pairs = dict(hierarchy(lib.names))
    assert pairs == {
        "b2": "b0", "b3": "b1", "b4": "b2", "b0p": "b0", "b1p": "b1", "b2p": "b2",
        "b1*T": "b1", "b1*T2": "b1*T", "b0*dT": "b0",
    }  # fmt: skip
    assert dict(hierarchy(("ax.b1", "ax.b3", "ay.b3"))) == {"ax.b3": "ax.b1"}
