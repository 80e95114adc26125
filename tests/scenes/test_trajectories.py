"""Ranges of the catalogue's scenes; generated scenes stay within them and obey kinematics."""

import math

import numpy as np
import pytest

from imubayes.scenes.trajectories import (
    MANNERS,
    MOST,
    _turning,
    _waves,
    catalogue_scenes,
    generated,
    scene_named,
)

SCENES = catalogue_scenes()
GRAVITY = 9.80665


def vectors(inputs, quantity):
    return np.array([inputs.channels[f"{quantity}_{axis}"] for axis in "ijk"])


@pytest.fixture(params=SCENES, ids=[one.id for one in SCENES])
def ranges(request):
    return request.param


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_motion_stays_within_the_ranges_of_its_scene_and_uses_one_of_them(ranges, seed) -> None:
    scene = generated(ranges, np.random.default_rng(seed))
    w, dw = (np.linalg.norm(vectors(scene.mean_motion, q), axis=0).max() for q in ("w", "dw"))
    room = 1.0 + 1e-12
    assert w <= ranges.rate[1] * room and dw <= ranges.slope[1] * room + 1e-300
    assert max(w / ranges.rate[1], dw / max(ranges.slope[1], 1e-300)) > 0.7
    heat, warming = scene.inputs.channels["T"], np.abs(scene.inputs.channels["dT"])
    assert ranges.temperature[0] - 1e-9 <= heat.min() and heat.max() <= ranges.temperature[1] + 1e-9
    assert warming.max() <= ranges.warming * room


def test_gravity_is_in_the_force_at_rest() -> None:
    force = vectors(generated(scene_named("bench_static"), np.random.default_rng(1)).mean_motion, "f")
    assert np.abs(force - np.array([[0.0], [0.0], [GRAVITY]])).max() < 1e-12


def test_angular_acceleration_is_the_derivative_of_the_rate_and_the_vertical_turns_with_it(ranges) -> None:
    """Central differences over a step h; their error is h^2/6 times a third derivative of order one."""
    manner, waves, h = MANNERS[ranges.id], _waves(np.random.default_rng(5)), 1e-4
    tau = np.linspace(0.0, 300.0, 400)
    before, here, after = (_turning(tau + step, manner, waves) for step in (-h, 0.0, h))
    w, dw, up = here[0], here[1], here[2][:, 2].T
    largest = max(1.0, np.abs(w).max() ** 3)
    assert np.abs((after[0] - before[0]) / (2.0 * h) - dw).max() < 20.0 * largest * h**2
    turns = (after[2] - before[2])[:, 2].T / (2.0 * h)
    assert np.abs(turns + np.cross(w, up, axis=0)).max() < 20.0 * largest * h**2
    assert np.abs(np.linalg.norm(up, axis=0) - 1.0).max() < 1e-12


def test_temperature_runs_on_over_the_whole_mission_within_its_range_and_its_rate(ranges) -> None:
    """The longest mission of the catalogue's range, up to 30 days: the record is repeated, this is not."""
    scene = generated(ranges, np.random.default_rng(6), duration=ranges.duration[1])
    course, (low, high) = scene.temperature, ranges.temperature
    heat, rate = course.channels["T"], course.channels["dT"]
    assert course.t[0] == 0.0 and course.t[-1] == pytest.approx(scene.duration)
    assert low - 1e-9 <= heat.min() and heat.max() <= high + 1e-9
    assert np.abs(rate).max() <= ranges.warming * (1.0 + 1e-12)
    slope = np.diff(heat) / np.diff(course.t)
    # a chord lies within p^2 h^2 / 12 of the mean of the rates at its ends, p h = 2 pi/1000 between knots
    assert np.abs(slope - 0.5 * (rate[1:] + rate[:-1])).max() <= ranges.warming * 4e-6 + 1e-12


CARRIED = [one for one in SCENES if MANNERS[one.id].rest and MANNERS[one.id].load == "swings"]


@pytest.mark.parametrize("ranges", CARRIED, ids=lambda one: one.id)
def test_what_rests_at_1_g_neither_climbs_nor_falls_on_average(ranges) -> None:
    scene = generated(ranges, np.random.default_rng(3))
    force = np.column_stack([scene.mean_motion.channels[f"f_{axis}"] for axis in "ijk"])
    up = np.mean(np.sum(scene.attitude[:, 2] * force, axis=1))
    assert up == pytest.approx(9.80665, rel=1e-3)


def test_same_seed_gives_the_same_scene_and_another_seed_another() -> None:
    first, again, other = (generated(SCENES[3], np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert np.array_equal(first.inputs.channels["f_i"], again.inputs.channels["f_i"])
    assert not np.array_equal(first.inputs.channels["w_i"], other.inputs.channels["w_i"])


def test_mission_longer_than_what_resolves_its_motion_repeats_a_record_and_says_so() -> None:
    scene = generated(scene_named("marine"), np.random.default_rng(1))
    assert len(scene.inputs) == MOST and any("repeated" in note for note in scene.notes)


def test_ranges_are_in_si() -> None:
    quadrotor = scene_named("quadrotor")
    assert quadrotor.load == (0.0, 3.0 * 9.80665)
    assert quadrotor.rate[1] == pytest.approx(math.radians(400.0))
    assert quadrotor.band == (50.0, 400.0) and quadrotor.temperature == (263.15, 323.15)
    assert quadrotor.warming == pytest.approx(1.0 / 6.0)
    assert "20,000 g are not in it" in scene_named("gun-projectile").note  # a shock
