"""Prior of the models: sizes, and terms that call for others."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import imubayes as ib
from imubayes import Summary
from imubayes.selection.enumerate import enumerate_models
from imubayes.selection.model_prior import admissible_counts, hierarchy, log_model_prior
from imubayes.selection.model_sets import Every, admissible

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
    assert admissible(Every(p), needs).sum() == counts.sum()


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


def test_hierarchy_leaves_the_admissible_models_in_proportion():
    """Given that a model is admissible, its odds against another such model are those without hierarchy."""
    rng = np.random.default_rng(4)
    X = rng.normal(size=(30, 4))
    y = X @ [0.3, 0.2, 0.0, 0.5] + rng.normal(size=30)
    s, names = Summary.from_arrays(X, y, ("b0", "b1", "b3", "b1p")), ("b0", "b1", "b3", "b1p")
    free = enumerate_models(s, ib.ScalePrior(0.5))
    bound = enumerate_models(s, ib.ScalePrior(0.5), needs=hierarchy(names))
    allowed = admissible(Every(4), [(2, 1), (3, 1)])
    np.testing.assert_allclose(bound.weight, np.where(allowed, free.weight, 0.0) / free.weight[allowed].sum())
    assert bound.inclusion[1] >= max(bound.inclusion[2], bound.inclusion[3])
