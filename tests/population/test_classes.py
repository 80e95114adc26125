"""Units of one class in a study: what is put together, and what is not."""

import math
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

import imubayes as ib
from imubayes.algebra.factor import factor_of
from imubayes.campaign.study import Sampling, SensorSpec, Study
from imubayes.inference.prior import ScalePrior
from imubayes.inference.summary import Summary
from imubayes.population.classes import in_common, pooled_inclusion
from imubayes.rig.recordings import RunSpec
from imubayes.selection.decision import select
from imubayes.sensors.noise import Noise, NoiseRule
from imubayes.sensors.terms import Library, library
from imubayes.study import method

TUMBLE = {"profile": "tumble", "angles": 6, "planes": 2, "dwell": 5.0, "rate": 1.0}
NOISE = Noise(6e-4, 3e-4, 0.0)
UNITS, SESSIONS = ("A", "B", "C", "D"), ("1", "2")


def specs():
    """Four tactical accelerometers in two sessions, of which the second moves the bias of all of them."""
    rng = np.random.default_rng(1)
    usual = SensorSpec(
        id="",
        kind="accelerometer",
        sensor_class=ib.sensor("mems_tactical", kind="accelerometer"),
        library=ib.library("accelerometer", powers=1, asymmetry=-1),
        runs=(RunSpec("tumble", "tumble", simulate=TUMBLE, noise=NoiseRule("fixed", NOISE)),),
        truth={},
    )
    for unit in UNITS:
        b0, b1, m_j = rng.normal(0.0, (0.03, 6e-4, 5e-4))
        for session in SESSIONS:
            bias = b0 + 0.02 * (session == "2") + rng.normal(0.0, 1e-3)
            truth = {"b0": float(bias), "b1": float(b1), "m_j": float(m_j)}
            yield replace(usual, id=unit + session, unit=unit, session=session, truth=truth)


@pytest.fixture(scope="module")
def sensors():
    return tuple(specs())


@pytest.fixture(scope="module")
def result(sensors):
    how = Sampling(method="exact")
    return method.run(Study("four units", 1, sensors, Path("four.toml"), "", how, compare=False))


def terms(found):
    return {term.name: term for term in found.terms}


def paired(sensors, result):
    return [(spec, [one]) for spec, one in zip(sensors, result.sensors, strict=True)]


def test_tests_between_sessions_share_one_level_in_a_class(result):
    found = result.classes[0]
    tested = [term.spreads for term in found.terms if not math.isnan(term.spreads.p_value)]
    assert len(tested) > 1
    assert sum(one.level for one in tested) == pytest.approx(0.01)


def test_class_needs_what_its_units_need_and_tells_what_the_test_cannot(result):
    found = terms(result.classes[0])
    assert (found["b0"].need.verdict, found["b1"].need.verdict) == ("needed", "needed")
    # two sessions may be all that the bias is: only the rest is surely of the units
    assert found["b0"].need.pooled.inclusion < 0.95 < found["b1"].need.pooled.inclusion
    assert found["S_ij"].need.verdict == "cannot tell" and not found["S_ij"].told
    assert found["S_ij"].need.pooled is None


def test_sensors_without_a_unit_are_units_of_their_own(sensors, result):
    alone = [(replace(spec, unit="", session=""), found) for spec, found in paired(sensors, result)]
    (found,) = in_common(alone)
    assert found.units == tuple(spec.id for spec in sensors) and found.sessions == ("",)
    assert math.isnan(terms(found)["b0"].spreads.turn_on.value)


def test_three_units_or_units_without_a_class_have_no_population(sensors, result):
    every = paired(sensors, result)
    assert not tuple(in_common(every[:6]))
    assert not tuple(in_common([(spec, [replace(one, class_id="")]) for spec, (one,) in every]))


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
