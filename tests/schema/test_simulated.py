"""How a study asks for a profile."""

from __future__ import annotations

import math

import pytest
from small_studies import study_of

from imubayes.rig.simulate import plan_run

STUDY = """
[[sensor]]
id = "A"
kind = "accelerometer"
class = "mems_tactical"
[[sensor.run]]
name = "run"
procedure = "{procedure}"
simulate = {{ {simulate} }}
"""


def planned(tmp_path, procedure: str, simulate: str):
    (sensor,) = study_of(tmp_path, STUDY.format(procedure=procedure, simulate=simulate)).sensors
    return plan_run(sensor.runs[0])


def test_tumble_with_positions_is_a_standard_set_and_without_them_turns_in_planes(tmp_path):
    assert len(planned(tmp_path, "tumble", 'positions = 26, dwell = "1 s", rate = "1 Hz"').inputs) == 26
    assert len(planned(tmp_path, "tumble", 'angles = 5, dwell = "1 s", rate = "1 Hz"').inputs) == 15


def test_tumble_with_a_latitude_has_the_earths_rate(tmp_path):
    plan = planned(tmp_path, "tumble", 'angles = 4, planes = 1, latitude = "30 deg"')
    assert plan.inputs.channels["w_i"].max() == pytest.approx(7.292115e-5 / 2.0, rel=1e-12)


def test_other_is_simulated_as_vibration_with_levels_in_any_unit_of_acceleration(tmp_path):
    plan = planned(tmp_path, "other", 'levels = ["19.6133 m/s^2"], mounts = 1')
    assert plan.procedure == "other"
    assert plan.inputs.channels["f_i"].std() == pytest.approx(2.0 * 9.80665, rel=1e-12)


def test_amplitude_of_an_oscillation_is_an_angle_and_its_frequencies_are_in_hertz(tmp_path):
    plan = planned(tmp_path, "oscillation", 'frequencies = ["2 Hz"], amplitude = "1 deg", latitude = "0 deg"')
    peak = plan.inputs.channels["w_i"].max()
    assert peak == pytest.approx(math.radians(1.0) * 2.0 * math.pi * 2.0, rel=1e-12)
