"""Rotations and the parts of a force: laws of mechanics."""

import numpy as np

from imubayes.rig.motion import faster, heavier, longer, motion_of, stretched

ULPS = 1e-14


def spinning(rng, *, w=None, dw=None, radius=0.7, n=1000):
    """Random axis, rate and its derivative: f of a point at that radius, gravity along the axis."""
    axis, out = rng.normal(size=(2, n, 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    out = np.cross(axis, out)
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    w = rng.normal(size=(n, 1)) if w is None else w
    dw = rng.normal(size=(n, 1)) if dw is None else dw
    f = 9.8 * axis + radius * (-(w**2) * out + dw * np.cross(axis, out))
    vectors = {"f": f, "w": w * axis, "dw": dw * axis}
    channels = {f"{q}_{a}": v[:, k] for q, v in vectors.items() for k, a in enumerate("ijk")}
    return motion_of(channels, *np.zeros((2, n, 3)), turning=True), axis, out, w, dw


def test_a_faster_rig_moves_as_mechanics_says():
    rng = np.random.default_rng(3)
    motion, axis, out, w, dw = spinning(rng)
    share = rng.normal(size=w.shape)
    moved, gain = faster(motion, share), 1.0 + share
    f = 9.8 * axis + 0.7 * (-((gain * w) ** 2) * out + gain * dw * np.cross(axis, out))
    np.testing.assert_allclose(moved.f, f, atol=1e-11)
    np.testing.assert_allclose(moved.w, gain * w * axis, atol=1e-14)
    np.testing.assert_allclose(moved.dw, gain * dw * axis, atol=1e-14)


def test_an_arm_and_gravity_change_their_own_part_of_the_force():
    rng = np.random.default_rng(4)
    motion, axis, out, w, dw = spinning(rng)
    change = rng.normal(size=w.shape)
    across = 0.7 * (-(w**2) * out + dw * np.cross(axis, out))
    np.testing.assert_allclose(longer(motion, change).f, 9.8 * axis + (1.0 + change) * across, atol=1e-12)
    np.testing.assert_allclose(heavier(motion, change).f, (9.8 + change) * axis + across, atol=1e-12)
    level = np.linalg.norm(across, axis=1, keepdims=True)
    np.testing.assert_allclose(
        stretched(motion, change).f, 9.8 * axis + (1.0 + change * level) * across, atol=1e-11
    )


def test_where_nothing_turns_all_of_the_force_is_gravity():
    rng = np.random.default_rng(1)
    f = rng.normal(size=(4, 3))
    f *= 9.8 / np.linalg.norm(f, axis=1, keepdims=True)
    channels = {f"f_{a}": f[:, k] for k, a in enumerate("ijk")} | {"w_i": np.full(4, 3.0)}
    still = motion_of(channels, *np.zeros((2, 4, 3)), turning=False)
    np.testing.assert_allclose(heavier(still, np.full((4, 1), 0.1)).f, f * (9.9 / 9.8), rtol=1e-14)
    assert not longer(still, np.full((4, 1), 0.1)).across.any()


def test_a_rig_that_starts_from_rest_turns_about_its_acceleration():
    rng = np.random.default_rng(2)
    still = np.zeros((1000, 1))
    motion, axis, out, _, dw = spinning(rng, w=still)
    np.testing.assert_allclose(np.abs(np.sum(motion.axis * axis, axis=1)), 1.0, rtol=ULPS)
    np.testing.assert_allclose(motion.across, 0.7 * dw * np.cross(axis, out), atol=1e-13)
    rest, *_ = spinning(rng, w=still, dw=still)
    assert not rest.axis.any() and not rest.across.any()
    np.testing.assert_array_equal(faster(rest, np.ones((1000, 1))).f, rest.f)


def test_gravity_across_the_axis_is_left_alone_rather_than_given_a_direction_by_rounding():
    f = np.array([[0.0, 9.8, 1e-15]])
    motion = motion_of(
        {"f_i": f[:, 0], "f_j": f[:, 1], "f_k": f[:, 2], "w_k": np.ones(1)}, 0.0 * f, 0.0 * f, turning=True
    )
    np.testing.assert_array_equal(heavier(motion, np.ones((1, 1))).f, f)
