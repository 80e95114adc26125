"""What scenes require of the components of a study."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from imubayes.campaign import Mission, SensorSpec
from imubayes.rig.inputs import Inputs
from imubayes.rig.simulate import library_of
from imubayes.scenes import Scene
from imubayes.scenes.propagation import Budget
from imubayes.sensors.noise import Noise
from imubayes.sensors.terms import library
from imubayes.study import findings

LIB = library("accelerometer", powers=2, asymmetry=-1, temperature=1)
UP = {"f_i": np.full(50, 2.0), "f_j": np.full(50, 3.0), "f_k": np.full(50, 5.0)}
MISSION = Mission(
    "lift",
    Scene("still", Inputs(np.arange(50.0), UP, 1.0), 50.0),
    Budget("output", 1.0),
    kind="accelerometer",
)


def _component(name="A", kind="accelerometer", names=LIB.names, verdict="needed"):
    """Every coefficient is exactly one."""
    terms = tuple(SimpleNamespace(name=term, inclusion=1.0, limit95=1.0, verdict=verdict) for term in names)
    runs = tuple(
        SimpleNamespace(name=run, duration=t, noise=Noise(n, 0.0, 0.0))
        for run, t, n in (("short", 1.0, 9.0), ("long", 2.0, 0.25))
    )
    return SimpleNamespace(
        id=name,
        kind=kind,
        selection=SimpleNamespace(terms=terms),
        draws=np.ones((5, len(names))),
        runs=runs,
        drive=None,
    )


SPEC = SensorSpec("A", "accelerometer", None, LIB, (), {})


def required(missions, results):
    """What the missions require of the components; no case errs together in an output."""
    components, cases = findings.required(missions, results)
    assert not cases
    return components


def _rms(found):
    return {term.name: term.rms for term in found.terms}


def test_effect_in_a_still_scene_is_the_input_itself_along_the_axis_of_the_mission():
    for axis, f in (("x", 2.0), ("y", 3.0), ("z", 5.0)):
        ((name, found),) = required([replace(MISSION, axis=axis)], [(SPEC, [_component()])])
        assert (name, found.scene, found.axis) == ("A", "lift", axis)
        assert _rms(found)["b2"] == pytest.approx(f**2, rel=1e-12)


def test_component_of_a_triad_lies_along_its_own_axis_whatever_the_mission_says():
    parts = [_component(f"A.a{axis}") for axis in "xyz"]
    found = dict(required([replace(MISSION, axis="z")], [(SPEC, parts)]))
    assert [found[f"A.a{axis}"].axis for axis in "xyz"] == ["x", "y", "z"]
    assert [_rms(one)["b1"] for one in found.values()] == pytest.approx([2.0, 3.0, 5.0], rel=1e-12)


def test_terms_that_the_scene_does_not_drive_are_named():
    ((_, found),) = required([MISSION], [(SPEC, [_component()])])
    (said,) = [note for note in found.notes if "drives" in note]
    idle = {name for name, rms in _rms(found).items() if rms == 0.0}
    assert said.startswith("it has no temperature") and {"b0*T", "s_i"} <= idle
    assert all(name in said for name in idle) and "c_jk" not in said


def test_a_scene_without_a_second_thermometer_says_that_it_drives_no_term_by_it():
    names = ("b0", "b0*gT")
    spec = replace(SPEC, library=library_of("accelerometer", names))
    ((_, found),) = required([MISSION], [(spec, [_component(names=names)])])
    (said,) = [note for note in found.notes if "drives" in note]
    assert said == ("it has no second thermometer, and nothing in it drives b0*gT: counted as without effect")


def test_budget_of_one_kind_is_for_its_sensors_only_and_others_for_all():
    gyro = library("gyroscope")
    both = [
        (SPEC, [_component()]),
        (SensorSpec("G", "gyroscope", None, gyro, (), {}), [_component("G", "gyroscope", gyro.names)]),
    ]
    assert [name for name, _ in required([MISSION], both)] == ["A"]
    everyone = replace(MISSION, kind=None, budget=Budget("position", 1.0))
    assert [name for name, _ in required([everyone], both)] == ["A", "G"]


def test_term_that_the_test_cannot_tell_is_not_there_whatever_its_inclusion():
    for verdict, quadrant in (("needed", "there and matters"), ("untested", "not shown, could matter")):
        ((_, found),) = required([MISSION], [(SPEC, [_component(verdict=verdict)])])
        assert {term.name: term.quadrant for term in found.terms}["b1"] == quadrant


def test_components_of_a_triad_err_together_where_they_add_up():
    parts = [_component(f"A.a{axis}") for axis in "xyz"]
    _, ((name, found),) = findings.required(
        [replace(MISSION, budget=Budget("velocity", 1e3), kind=None)], [(SPEC, parts)]
    )
    assert (name, found.scene, set(found.models)) == ("A", "lift", {one.id for one in parts})
    assert found.candidates == 3 * len(LIB.names)
