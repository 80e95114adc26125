"""Positions at rest: standard sets, the Earth's rate in them, and normal gravity as WGS-84 publishes it."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imubayes.rig.plans import EARTH_RATE, normal_gravity
from imubayes.rig.rotations import oscillation, rate_table
from imubayes.rig.tumbles import positions, static, tumble

G = 9.80665
SHORT = {"dwell": 1.0, "rate": 1.0}
"""One sample a dwell."""
SETS = (4, 6, 12, 24, 26)


@pytest.mark.parametrize("number", SETS)
def test_a_standard_set_has_its_number_of_positions_all_at_one_g_and_no_two_alike(number):
    plan = positions(number, gravity=9.79, latitude=0.3, **SHORT)
    f, w = plan.inputs.vectors("f"), plan.inputs.vectors("w")
    assert len(f) == number
    np.testing.assert_allclose(np.linalg.norm(f, axis=1), 9.79, rtol=1e-15)
    assert len(np.unique(np.hstack([f / 9.79, w / EARTH_RATE]).round(9), axis=0)) == number


def test_24_positions_are_the_rotations_of_a_cube():
    plan = positions(24, latitude=0.0, **SHORT)
    up, north = plan.inputs.vectors("f") / G, plan.inputs.vectors("w") / EARTH_RATE
    rotations = np.stack([north, np.cross(up, north), up], axis=1)
    group = Rotation.create_group("O").as_matrix()
    distance = np.abs(rotations[:, None] - group[None]).max(axis=(2, 3))
    assert sorted(distance.argmin(axis=1)) == list(range(24))
    assert distance.min(axis=1).max() < 1e-12


def test_26_positions_are_the_faces_edges_and_corners_of_a_cube():
    f = positions(26, **SHORT).inputs.vectors("f") / G
    wanted = Rotation.create_group("O").as_matrix()
    for seed, count in (([0, 0, 1], 6), ([0, 1, 1], 12), ([1, 1, 1], 8)):
        orbit = np.unique((wanted @ (np.array(seed) / np.linalg.norm(seed))).round(9), axis=0)
        assert len(orbit) == count
        assert all(np.abs(f - one).max(axis=1).min() < 1e-9 for one in orbit)


LATITUDES = [-1.2, 0.0, 0.4, math.pi / 2.0]


@pytest.mark.parametrize("profile", [*SETS, tumble, static])
@pytest.mark.parametrize("latitude", LATITUDES)
def test_gravity_and_the_earths_rate_make_the_angle_of_the_latitude(profile, latitude):
    options = {"latitude": latitude, **SHORT}
    plan = positions(profile, **options) if profile in SETS else tumble(**options)
    if profile is static:
        plan = static(1.0, 1.0, up=(1.0, 2.0, -2.0), latitude=latitude)
    f, w = plan.inputs.vectors("f"), plan.inputs.vectors("w")
    np.testing.assert_allclose(np.linalg.norm(w, axis=1), EARTH_RATE, rtol=1e-14)
    np.testing.assert_allclose(np.sum(f * w, axis=1) / (G * EARTH_RATE), math.sin(latitude), atol=1e-14)


@pytest.mark.parametrize("latitude", LATITUDES)
def test_tumble_has_the_earths_rate_of_the_standard_positions_in_every_attitude_that_both_have(latitude):
    cube, run = (
        np.hstack([plan.inputs.vectors("f") / G, plan.inputs.vectors("w") / EARTH_RATE])
        for plan in (positions(24, latitude=latitude, **SHORT), tumble(angles=4, latitude=latitude, **SHORT))
    )
    assert all(np.abs(cube - row).max(axis=1).min() < 1e-15 for row in run)
    for number in (4, 12):
        same = tumble(angles=number, planes=1, latitude=latitude, **SHORT)
        for quantity in ("f", "w"):
            standard = positions(number, latitude=latitude, **SHORT).inputs.vectors(quantity)
            np.testing.assert_array_equal(same.inputs.vectors(quantity), standard)


def test_axis_that_a_tumbling_case_turns_about_stays_level_to_the_north_in_every_plane():
    plan = tumble(angles=24, latitude=0.7, **SHORT)
    f, w = (plan.inputs.vectors(quantity).reshape(3, 24, 3) for quantity in ("f", "w"))
    for up, rate in zip(f / G, w / EARTH_RATE, strict=True):
        steps = np.cross(up, np.roll(up, -1, axis=0)) / math.sin(2.0 * math.pi / 24)
        np.testing.assert_allclose(rate - math.sin(0.7) * up, math.cos(0.7) * steps, atol=1e-14)


def test_earths_rate_at_the_equator_points_north_and_leaves_the_vertical_alone():
    plan = static(1.0, 1.0, latitude=0.0, north=(5.0, 0.0, 2.0))
    assert {name for name in plan.inputs.channels if name.startswith("w")} == {"w_k"}
    assert plan.inputs.channels["w_k"][0] == pytest.approx(EARTH_RATE, rel=1e-15)


def test_rate_is_inertial_so_that_a_table_that_turns_against_the_earth_stands_still():
    latitude = 0.7
    against = rate_table([-EARTH_RATE * math.sin(latitude)], mounts=1, latitude=latitude, **SHORT)
    assert "w_i" not in against.inputs.channels
    (still,) = rate_table([0.0], mounts=1, latitude=latitude, **SHORT).inputs.channels["w_i"]
    assert still == pytest.approx(EARTH_RATE * math.sin(latitude), rel=1e-15)


def test_force_at_rest_is_plus_one_g_upwards_and_the_input_axis_down_turns_both_force_and_rate():
    for up, down in (
        (positions(6, latitude=0.8, **SHORT), slice(1, 2)),
        (rate_table([1.5], mounts=2, latitude=0.8, **SHORT), slice(1, 2)),
        (oscillation([1.0], mounts=2, latitude=0.8, dwell=1.0, rate=8.0), slice(8, 16)),
    ):
        f, w = up.inputs.channels["f_i"], up.inputs.channels["w_i"]
        rows = down.stop - down.start
        assert f[0] == G
        np.testing.assert_array_equal(f[down], -f[:rows])
        np.testing.assert_array_equal(w[down], -w[:rows])


@pytest.mark.parametrize(
    ("latitude", "published"), [(0.0, 9.7803253359), (90.0, 9.8321849378), (-90.0, 9.8321849378)]
)
def test_gravity_on_the_ellipsoid_has_its_published_values(latitude, published):
    assert normal_gravity(math.radians(latitude), 0.0) == pytest.approx(published, abs=1e-10)


def test_gravity_at_45_degrees_is_that_of_the_series_of_grs80():
    # Moritz, Geodetic Reference System 1980: series in the latitude, as rounded as its coefficients
    s, s2 = math.sin(math.radians(45.0)) ** 2, math.sin(math.radians(90.0)) ** 2
    series = 9.780327 * (1.0 + 0.0053024 * s - 0.0000058 * s2)
    assert normal_gravity(math.radians(45.0), 0.0) == pytest.approx(series, abs=5e-6)


def test_gravity_falls_by_the_free_air_gradient():
    # 0.3086 mGal/m at middle latitudes, to its four digits
    gradient = (normal_gravity(0.8, 100.0) - normal_gravity(0.8, 0.0)) / 100.0
    assert gradient == pytest.approx(-3.086e-6, rel=1e-3)
