"""The full navigator: closed forms far beyond what is linear, and the linear propagation."""

import math
from dataclasses import replace

import numpy as np
import pytest
from flights import G, R
from recorded_scenes import recorded

from imubayes.scenes import Course
from imubayes.scenes.effects import budget_effects
from imubayes.scenes.navigator import flown_sizes
from imubayes.scenes.propagation import Budget
from imubayes.scenes.trajectories import drawn, scene_named
from imubayes.sensors.catalogue import prior_sd, sensor
from imubayes.sensors.terms import Library, library

KINDS = ("accelerometer", "gyroscope")


def bias(kind: str) -> Library:
    """Library of the bias alone."""
    return Library(kind, library(kind).terms[:1])


def along(n: int, force, step: float = 0.01, **options):
    """Record of a case that does not turn and feels a force."""
    return recorded("along", step * np.arange(n), np.tile(force, (n, 1)), np.zeros((n, 3)), **options)


def test_rate_error_that_turns_the_case_right_round_has_its_closed_form() -> None:
    """A force a along x, and the frame computed turns by w about z: v = a / w (sin wt, 1 - cos wt)."""
    a, w, time = 3.0, 0.1, 60.0
    scene = along(6000, [a, 0.0, 0.0], attitude=np.tile(np.eye(3), (6000, 1, 1)))
    t = np.linspace(0.0, time, 6001)
    v = a / w * np.column_stack((np.sin(w * t) - w * t, 1.0 - np.cos(w * t)))
    r = a / w**2 * np.column_stack((1.0 - np.cos(w * t) - 0.5 * (w * t) ** 2, w * t - np.sin(w * t)))
    expected = (math.pi, np.linalg.norm(v, axis=1).max(), np.linalg.norm(r, axis=1).max())
    for quantity, size in zip(("attitude", "velocity", "position"), expected, strict=True):
        budget = Budget(quantity, 1.0, schuler=False)
        found = flown_sizes(scene, bias("gyroscope"), budget, np.array([[w]]), "z")
        assert found[0, 0] == pytest.approx(size, rel=2e-3)


@pytest.mark.parametrize("size", [1e-3, 2.0])
def test_force_error_tilts_along_the_round_earth_as_a_pendulum_of_its_radius(size: float) -> None:
    """The swing of a pendulum that a sideways pull turns: to twice arctan(a/g), in half a period."""
    up = along(300, [0.0, 0.0, G], 10.0)
    still = replace(up, duration=3000.0)
    swing = flown_sizes(still, bias("accelerometer"), Budget("position", 1.0), np.array([[size]]), "y")[0, 0]
    # axes of the case do not tilt with the place, so that the force is that of a frame which does not turn
    assert swing == pytest.approx(2.0 * R * math.atan(size / G), rel=5e-3)


def warm(name: str):
    """A minute of a scene with two draws, flown two and a half times while it warms up."""
    scene = drawn(scene_named(name), [(1, 5), (1, 6)], duration=60.0)
    heat = Course(np.array([0.0, 150.0]), {"T": np.array([290.0, 310.0]), "dT": np.full(2, 20.0 / 150.0)})
    return replace(
        scene,
        duration=150.0,
        course=heat,
        others=tuple(replace(s, duration=150.0, course=heat) for s in scene.others),
    )


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("quantity", ["output", "attitude", "velocity", "position"])
def test_small_errors_come_to_what_the_linear_propagation_makes_of_them(kind: str, quantity: str) -> None:
    """Every term, where the record repeats, shakes, warms up, and has two draws.

    10 %, as the linear propagation looks at 120 times, and the navigator at every row.
    """
    scene, lib = warm("quadrotor"), library(kind, set="extended", temperature=2)
    entry = sensor("mems_tactical", kind=kind)
    theta = 1e-2 * np.array([[prior_sd(entry, term)[0] for term in lib.terms]])
    budget = Budget(quantity, 1.0)
    found, linear = (
        flown_sizes(scene, lib, budget, theta, "x"),
        budget_effects(scene, lib, budget).single(theta),
    )
    driven = linear > 1e-4 * linear.max()
    np.testing.assert_allclose(found[driven], linear[driven], rtol=1e-9 if quantity == "output" else 0.1)
    assert driven.sum() > 10
