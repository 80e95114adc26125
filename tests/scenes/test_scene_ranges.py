"""Ranges of the catalogue's scenes."""

from __future__ import annotations

import math

import pytest

from imubayes.errors import TermError
from imubayes.scenes.ranges import catalogue_scenes, scene_named
from imubayes.scenes.trajectories import MANNERS


def test_every_scene_of_the_catalogue_has_a_manner_to_move_and_no_manner_is_left_over() -> None:
    assert {one.id for one in catalogue_scenes()} == set(MANNERS)


def test_ranges_are_in_si() -> None:
    quadrotor = scene_named("quadrotor")
    assert quadrotor.load == (0.0, 3.0 * 9.80665)
    assert quadrotor.rate[1] == pytest.approx(math.radians(400.0))
    assert quadrotor.band == (50.0, 400.0) and quadrotor.temperature == (263.15, 323.15)
    assert quadrotor.warming == pytest.approx(1.0 / 6.0)


def test_shock_that_a_trajectory_does_not_hold_is_said() -> None:
    assert "20,000 g are not in it" in scene_named("gun-projectile").note


def test_scene_that_is_not_known_names_its_neighbours() -> None:
    with pytest.raises(TermError, match="did you mean quadrotor"):
        scene_named("quadroter")
    with pytest.raises(TermError, match="known are bench_static"):
        scene_named("sauna")
