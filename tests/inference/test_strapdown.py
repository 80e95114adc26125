"""Directions carried on by rates: against quaternions integrated by another library, and exact turns."""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from imubayes.rig.motion import onward

T = np.linspace(0.0, 2.0, 201)


def tumbling(t):
    """A rate whose direction moves as fast as its size, rad/s."""
    return np.stack((2.0 * np.sin(3.0 * t), 1.5 * np.cos(2.0 * t), 1.0 + np.sin(t)), axis=-1)


def test_a_turn_about_a_fixed_axis_is_exact_at_any_rate_of_sampling():
    axis, t = np.array([0.6, 0.0, 0.8]), np.array([0.0, 0.7, 1.0, 2.5])
    carried = onward(t, np.tile(1.3 * axis, (4, 1)))[0]
    expected = Rotation.from_rotvec(-1.3 * 2.5 * axis).as_matrix()
    np.testing.assert_allclose(carried, expected, rtol=0.0, atol=1e-14)


def test_direction_follows_its_differential_equation_to_the_fourth_order():
    start = np.array([0.6, -0.64, 0.48])
    exact = solve_ivp(lambda t, u: -np.cross(tumbling(t), u), (0.0, 2.0), start, rtol=1e-12, atol=1e-13).y[
        :, -1
    ]
    coarse, fine = (np.linalg.norm(onward(t, tumbling(t))[0] @ start - exact) for t in (T[::4], T[::2]))
    # rates between two samples are taken as linear: what they curve shifts the steps by the second order
    assert fine < coarse / 3.5
    assert fine < 2.0 * 0.02**2
