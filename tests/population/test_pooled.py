"""One model for several components: against the evidences of all pairs of models, written out."""

from itertools import combinations

import numpy as np
import pytest

from imubayes.algebra.factor import factor_of
from imubayes.inference.prior import ScalePrior
from imubayes.inference.summary import Summary
from imubayes.population.classes import pooled_inclusion
from imubayes.selection.decision import select
from imubayes.sensors.terms import Library, library

NAMES = ("b0", "b1", "b2", "m_j")
EVERY = library("accelerometer", powers=2, asymmetry=-1)


def component(names, truth, seed):
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(60, len(names)))
    y = X @ np.array([truth.get(name, 0.0) for name in names]) + rng.normal(size=60)
    lib = Library("accelerometer", tuple(term for name in names for term in EVERY.terms if term.name == name))
    reach = dict.fromkeys(names, 3.0)
    summary = Summary(factor_of(X, y, names), library=lib, reach=reach)
    return select(summary, ScalePrior(np.ones(len(names))))


def by_set(selection):
    """Weight of every model over the prior's, by the set of its terms."""
    models = selection.models
    members = models.space.members(np.arange(len(models.space)))
    names, p = models.candidates.names, len(models.candidates.names)
    found = {}
    for inside, weight in zip(members, models.weight, strict=True):
        terms = frozenset(name for name, there in zip(names, inside, strict=True) if there)
        found[terms] = weight * (p + 1) * len(list(combinations(range(p), len(terms))))
    return found


def prior(size, p):
    return 1.0 / ((p + 1) * len(list(combinations(range(p), size))))


def test_pooled_inclusion_is_that_of_the_product_of_the_evidences():
    parts = [component(NAMES, {"b0": 0.3, "b2": 0.2}, seed) for seed in (1, 2, 3)]
    evidence = [by_set(part) for part in parts]
    joint = {s: prior(len(s), 4) * np.prod([e[s] for e in evidence]) for s in evidence[0]}
    total = sum(joint.values())
    found = pooled_inclusion(parts)
    for name in NAMES:
        expected = sum(weight for terms, weight in joint.items() if name in terms) / total
        assert found[name] == pytest.approx(expected, rel=1e-9)


def test_terms_that_a_component_lacks_are_averaged_over_by_the_others():
    first, second = component(NAMES, {"b1": 0.4}, 4), component(("b2", "b1"), {"b1": 0.3}, 5)
    evidence, lacking = by_set(first), by_set(second)
    shared = ("b1", "b2")
    joint = {}
    for terms in lacking:
        alike = [s for s in evidence if s & set(shared) == terms]
        weights = np.array([prior(len(s), 4) for s in alike])
        mean = np.array([evidence[s] for s in alike]) @ weights / weights.sum()
        joint[terms] = prior(len(terms), 2) * mean * lacking[terms]
    found = pooled_inclusion([first, second])
    assert set(found) == set(shared)
    for name in shared:
        expected = sum(w for terms, w in joint.items() if name in terms) / sum(joint.values())
        assert found[name] == pytest.approx(expected, rel=1e-9)


def test_weak_hints_of_three_components_add_up():
    """A term two standard errors from zero in each is needed by the kind, though none alone shows it."""
    rng = np.random.default_rng(6)
    parts = []
    for _ in range(3):
        X, _ = np.linalg.qr(rng.normal(size=(200, 4)))
        noise = rng.normal(size=200)
        noise -= X @ (X.T @ noise)
        y = X @ np.array([0.0, 0.0, 2.5, 0.0]) + noise / noise.std()
        lib = Library("accelerometer", tuple(term for term in EVERY.terms if term.name in NAMES))
        summary = Summary(factor_of(X, y, lib.names), library=lib, reach=dict.fromkeys(lib.names, 1.0))
        parts.append(select(summary, ScalePrior(np.full(4, 3.0))))
    name = parts[0].terms[2].name
    alone = [next(t.inclusion for t in part.terms if t.name == name) for part in parts]
    assert pooled_inclusion(parts)[name] > max(alone) + 0.1
