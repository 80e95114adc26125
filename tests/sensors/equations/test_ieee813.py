"""IEEE 813: two input axes of one rotor."""

import numpy as np
import pytest

from imubayes.sensors.equations.ieee813 import SYMBOLS, TunedGyroAxis, component, indicated_pair

ROWS = 30


def _case(rng):
    return {f"{name}_{axis}": rng.normal(size=ROWS) for name in ("f", "w", "dw") for axis in "xyz"}


def test_both_axes_follow_the_written_out_drift_in_case_axes():
    rng = np.random.default_rng(1)
    case, e, c = _case(rng), rng.normal(size=(2, 9)) * 0.1, ("x", "y")
    ax, ay, az = (case[f"f_{axis}"] for axis in "xyz")
    wx, wy, wz = (case[f"w_{axis}"] for axis in "xyz")
    axes = [TunedGyroAxis(axis, *values) for axis, values in zip(c, e, strict=True)]
    out_x, out_y = indicated_pair(*axes, case, ROWS)
    B, K, m_xy, m_xz, D_xx, D_xy, D_xz, D_xxz, D_xyz = e[0]
    drift = B + D_xx * ax + D_xy * ay + D_xz * az + D_xxz * ax * az + D_xyz * ay * az
    np.testing.assert_allclose(out_x, (1 + K) * (wx + m_xy * wy + m_xz * wz + drift), rtol=1e-12, atol=1e-14)
    B, K, m_yx, m_yz, D_yy, D_yx, D_yz, D_yyz, D_yxz = e[1]
    drift = B + D_yy * ay + D_yx * ax + D_yz * az + D_yyz * ay * az + D_yxz * ax * az
    np.testing.assert_allclose(out_y, (1 + K) * (wy + m_yx * wx + m_yz * wz + drift), rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("axis", ["x", "y"])
def test_trap_component_axes_are_right_handed(axis):
    case = {f"w_{name}": row for name, row in zip("xyz", np.eye(3), strict=True)}
    i, j, k = (component(axis, case)[f"w_{name}"] for name in "ijk")
    np.testing.assert_array_equal(np.cross(i, j), k)
    symbols = "m_xy m_xz D_xx D_xy D_xz D_xxz D_xyz D_xzz"
    spelt = symbols if axis == "x" else symbols.translate(str.maketrans("xy", "yx"))
    assert [row.symbol for row in SYMBOLS[axis]][2:] == spelt.split()
