"""Units of one class in a study: what is put together, and what is not."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import imubayes as ib
from imubayes.campaign import Sampling, SensorSpec, Study
from imubayes.population.sessions import in_common, pooled_by_kind
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
    return {term.name: term for term in found.terms}


def paired(sensors, result):
    return [(spec, [one]) for spec, one in zip(sensors, result.sensors, strict=True)]


def test_tests_between_sessions_share_one_level_in_a_class(result):
    found = result.classes[0]
    tested = [term.spreads for term in found.terms if not math.isnan(term.spreads.p_value)]
    assert len(tested) > 1
    assert sum(one.level for one in tested) == pytest.approx(0.01)


def test_sessions_of_a_unit_are_compared(result):
    found = {one.parameter: one for one in result.sessions}
    assert found["b0"].units == UNITS and found["b0"].sessions == SESSIONS
    assert found["b0"].exceeds and not found["b1"].exceeds


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


def test_weak_hints_of_three_components_add_up(sensors, result):
    """A term 2.5 standard errors from zero in each is of all of them, though none alone shows it."""
    selection = result.sensors[0].selection
    terms = tuple(
        replace(term, full_mean=2.5 * 0.3 * 0.954 * term.prior_sd, full_sd=0.287 * term.prior_sd)
        if term.name == "b1"
        else replace(term, full_sd=term.prior_sd)
        for term in selection.terms
    )
    one = replace(selection, terms=terms)
    few = replace(selection, terms=terms[:1])
    spec = sensors[0]
    alone = pooled_by_kind(spec, ["accelerometer"], [one])["accelerometer"]
    three = pooled_by_kind(spec, ["accelerometer"] * 3, [one] * 3)["accelerometer"]
    assert alone["b1"] < 0.95 < three["b1"] and three["b0"] == 0.5
    assert set(pooled_by_kind(spec, ["accelerometer"] * 2, [one, few])["accelerometer"]) == {terms[0].name}
