"""The oscillating table, held against the mechanics of a rigid body, and vibration by its moments."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imubayes.rig.plans import EARTH_RATE, Plan
from imubayes.rig.rotations import oscillation, rate_table, vibration
from imubayes.rig.sequences import planned
from imubayes.sensors.terms import columns, library

FREQUENCIES, AMPLITUDE, LATITUDE = (0.5, 2.0, 5.0), 0.03, 0.6
SWING = oscillation(FREQUENCIES, amplitude=AMPLITUDE, dwell=4.0, rate=200.0, latitude=LATITUDE)


def dwells_of(name: str) -> np.ndarray:
    """Rows (frequencies, samples) of the mount with the input axis up."""
    return SWING.inputs.channels[name][: 3 * 800].reshape(3, 800)


def test_integral_of_the_rate_is_the_angle_and_its_derivative_the_angular_acceleration():
    turning = dwells_of("w_i") - EARTH_RATE * math.sin(LATITUDE)
    for frequency, w, dw in zip(FREQUENCIES, turning, dwells_of("dw_i"), strict=True):
        t = np.arange(800) / 200.0
        pulse = 2.0 * math.pi * frequency
        np.testing.assert_allclose(dw, -(pulse**2) * AMPLITUDE * np.sin(pulse * t), atol=1e-12 * pulse**2)
        # the trapezoid is short by (pulse h)^2 / 12 of the angle
        angle = np.concatenate([[0.0], np.cumsum(0.5 * (w[1:] + w[:-1]) / 200.0)])
        short = (pulse / 200.0) ** 2 / 12.0
        np.testing.assert_allclose(angle, AMPLITUDE * np.sin(pulse * t), atol=1.01 * AMPLITUDE * short)


def earth_in(plan: Plan, mount: int) -> np.ndarray:
    """What is left of w (n, 3) in a mount without the table's own rate."""
    turn, here = plan.turn, plan.inputs.mount == mount
    assert turn is not None
    w = plan.inputs.vectors("w")
    return (w - turn.rate[:, None] * turn.up)[here]


def rotated_earth(plan: Plan, mount: int, rate_of: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Earth's rate (n, 3) in the case of a mount, averaged over each sample, by a rotation in small steps."""
    here = np.flatnonzero(plan.inputs.mount == mount)
    t, dt, fine = plan.inputs.t[here], plan.inputs.interval, 400
    clock = np.arange(round((t[-1] - t[0]) / dt * fine) + fine + 1) * dt / fine - dt / 2.0
    rate = rate_of(clock)
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * dt / fine)])
    angle -= np.interp(0.0, clock, angle)
    turn = plan.turn
    assert turn is not None and turn.latitude is not None
    up = turn.up[here[0]]
    north = np.eye(3)[np.argmin(np.abs(up))]
    north = north - (north @ up) * up
    level = math.cos(turn.latitude) * north / np.linalg.norm(north)
    earth = EARTH_RATE * (math.sin(turn.latitude) * up + level)
    seen = Rotation.from_rotvec(-angle[:, None] * up).apply(earth)
    sums = np.concatenate([np.zeros((1, 3)), np.cumsum(0.5 * (seen[1:] + seen[:-1]), axis=0)]) / fine
    at = np.rint((t - t[0]) / dt * fine).astype(int)
    return sums[at + fine] - sums[at]


@pytest.mark.parametrize("latitude", [-0.9, 0.0, 0.6])
@pytest.mark.parametrize("mount", [0, 3, 7])
def test_the_earths_rate_turns_in_a_case_on_a_table_as_a_vector_does_along_its_angle(latitude, mount):
    rates, dwell, settle = np.radians([0.0, 10.0, -200.0]), 4.0, 2.0
    plan = rate_table(rates.tolist(), mounts=9, dwell=dwell, settle=settle, rate=5.0, latitude=latitude)
    # constant in a dwell, whose first sample is centred on its start, and even in between
    corners = np.add.outer((dwell + settle) * np.arange(3), [-0.1, dwell - 0.1]).ravel()
    expected = rotated_earth(plan, mount, lambda t: np.interp(t, corners, np.repeat(rates, 2)))
    np.testing.assert_allclose(earth_in(plan, mount), expected, atol=2e-5 * EARTH_RATE)


def test_the_earths_rate_turns_to_and_fro_in_a_case_that_swings():
    plan = oscillation([0.5], amplitude=1.0, mounts=5, dwell=4.0, rate=100.0, latitude=0.6)
    pulse = math.pi
    expected = rotated_earth(plan, 4, lambda t: pulse * np.cos(pulse * t))
    np.testing.assert_allclose(earth_in(plan, 4), expected, atol=1e-3 * EARTH_RATE)


def test_a_table_at_rest_with_the_input_axis_level_feels_the_published_part_of_the_earths_rate():
    plan = rate_table([0.0], mounts=3, dwell=1.0, rate=1.0, latitude=math.radians(45.0))
    level = math.degrees(plan.inputs.channels["w_i"][2]) * 3600.0
    assert level == pytest.approx(15.041 / math.sqrt(2.0), rel=1e-5)  # deg/h


def test_a_table_whose_steps_come_in_another_order_is_turned_by_what_came_before():
    steps = [{"at": 1, "dwell": 4.0}, {"at": 0, "dwell": 2.0, "pause": 3.0}]
    options = {"rates": (0.0, 0.3), "mounts": 3, "rate": 2.0, "latitude": 0.6}
    plan = planned(rate_table, {**options, "steps": steps})
    rest = plan.inputs.vectors("w")[-4:]
    angle = 0.3 * 3.5 + 0.15 * 3.5  # to the middle of the last sample, and evenly down to rest
    north = Rotation.from_rotvec([-angle, 0.0, 0.0]).apply([0.0, 1.0, 0.0])
    expected = EARTH_RATE * (math.sin(0.6) * np.array([1.0, 0.0, 0.0]) + math.cos(0.6) * north)
    np.testing.assert_allclose(rest, np.tile(expected, (4, 1)), atol=1e-12)


G = 9.80665
LEVELS, DWELL, BAND = (0.0, 0.4, 1.0, 5.0), 5.0, (20.0, 120.0)
PLAN = vibration(LEVELS)
INDEPENDENT = 2.0 * (BAND[1] - BAND[0]) * DWELL
"""Values in a dwell: 2 W T."""


def in_dwells(values: np.ndarray) -> np.ndarray:
    """Rows (mounts, levels, samples, ...)."""
    return values.reshape(8, len(LEVELS), -1, *values.shape[1:])


def signals() -> np.ndarray:
    """Every dwell's signal of unit rms, (dwells, samples), from its largest component."""
    f = in_dwells(np.stack([PLAN.inputs.channels[f"f_{axis}"] for axis in "ijk"], axis=1))
    moving = f - f[:, :1]
    along = np.take_along_axis(
        moving, np.abs(moving).max(axis=(1, 2), keepdims=True).argmax(3)[..., None], 3
    )[:, 1:, :, 0]
    return (along / along.std(axis=2, keepdims=True)).reshape(-1, along.shape[2])


def test_rms_of_a_dwell_is_its_level_and_its_mean_is_gravity_to_rounding():
    f = in_dwells(PLAN.inputs.channels["f_i"])
    for mount, mean in ((0, G), (1, -G), (2, 0.0)):
        np.testing.assert_allclose(f[mount].mean(axis=1), mean, atol=1e-12 * G)
        np.testing.assert_allclose(f[mount].std(axis=1), G * np.array(LEVELS), atol=1e-12 * G)


def test_signal_keeps_to_its_band():
    power = np.abs(np.fft.rfft(signals(), axis=1)) ** 2
    frequency = np.fft.rfftfreq(signals().shape[1], 1.0 / 1000.0)
    inside = (frequency >= BAND[0] - 1e-9) & (frequency <= BAND[1] + 1e-9)
    assert power[:, ~inside].sum() < 1e-20 * power.sum()
    tones = power[:, inside]
    np.testing.assert_allclose(tones, np.broadcast_to(tones.mean(axis=1, keepdims=True), tones.shape))


def test_signal_is_normal_by_its_third_and_fourth_moment():
    x = signals()
    # sd of a skewness and a kurtosis of n independent normal values: sqrt(6/n), sqrt(24/n)
    assert np.abs(np.mean(x**3, axis=1)).max() < 4.0 * math.sqrt(6.0 / INDEPENDENT)
    assert np.abs(np.mean(x**4, axis=1) - 3.0).max() < 4.0 * math.sqrt(24.0 / INDEPENDENT)


@pytest.mark.parametrize(("mount", "name"), [(5, "c_ij"), (6, "c_ik"), (7, "c_jk")])
def test_mean_of_a_product_halfway_between_two_axes_is_half_the_variance(mount, name):
    lib = library("accelerometer")
    X = in_dwells(columns(lib, PLAN.inputs.channels, len(PLAN.inputs)))[mount, :, :, lib.names.index(name)]
    np.testing.assert_allclose(X.mean(axis=1), 0.5 * (G * np.array(LEVELS)) ** 2, atol=1e-10 * G**2)
