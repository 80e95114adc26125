"""Units of one class in a study: what is put together, and what is not."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import imubayes as ib
from imubayes.campaign.study import Sampling, SensorSpec, Study
from imubayes.population.classes import in_common
from imubayes.rig.recordings import RunSpec
from imubayes.sensors.noise import Noise, NoiseRule
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
    return {term.parameter.name: term for term in found.terms}


def paired(sensors, result):
    return [(spec, [one]) for spec, one in zip(sensors, result.sensors, strict=True)]


def test_every_unit_and_session_stands_at_its_place(sensors, result):
    (found,) = result.classes
    assert (found.units, found.sessions, found.components) == (UNITS, SESSIONS, ("",))
    for name in ("b0", "b1", "m_j"):
        truth = np.array([spec.truth[name] for spec in sensors]).reshape(4, 2)
        one = terms(found)[name]
        assert np.all(np.abs(one.value - truth) < 4.0 * one.error), name


def test_population_holds_what_the_units_were_made_with(result):
    found = terms(result.classes[0])
    assert found["b0"].spreads.common_share.low > 0.5
    low, high = found["b0"].spreads.shift
    assert high - low == pytest.approx(0.02, abs=4.0 * 1e-3 * math.sqrt(2.0 / 4.0))
    b1 = found["b1"].spreads
    assert b1.p_value > 0.01 and b1.turn_on.high < 0.5 * b1.unit.value


def test_tests_between_sessions_share_one_level_in_a_class(result):
    found = result.classes[0]
    tested = [term.spreads for term in found.terms if not math.isnan(term.spreads.p_value)]
    assert len(tested) > 1
    assert sum(one.level for one in tested) == pytest.approx(0.01)


def test_class_needs_what_its_units_need_and_tells_what_the_test_cannot(result):
    found = terms(result.classes[0])
    assert (found["b0"].need.verdict, found["b1"].need.verdict) == ("needed", "needed")
    assert found["b0"].need.pooled == pytest.approx(1.0, abs=1e-6)
    assert found["S_ij"].need.verdict == "cannot tell" and not found["S_ij"].told


def test_sensors_without_a_unit_are_units_of_their_own(sensors, result):
    alone = [(replace(spec, unit="", session=""), found) for spec, found in paired(sensors, result)]
    (found,) = in_common(alone)
    assert found.units == tuple(spec.id for spec in sensors) and found.sessions == ("",)
    assert math.isnan(terms(found)["b0"].spreads.turn_on.value)


def test_three_units_or_units_without_a_class_have_no_population(sensors, result):
    every = paired(sensors, result)
    assert not tuple(in_common(every[:6]))
    assert not tuple(in_common([(spec, [replace(one, class_id="")]) for spec, (one,) in every]))
