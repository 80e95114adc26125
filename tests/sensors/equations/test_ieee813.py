"""IEEE 813: two input axes of one rotor."""

import numpy as np
import pytest

from imubayes.sensors.equations.ieee813 import (
    SYMBOLS,
    TunedGyroAxis,
    component,
    indicated_pair,
)
from imubayes.sensors.equations.standards import STANDARDS

ROWS = 30


def _case(rng):
    return {f"{name}_{axis}": rng.normal(size=ROWS) for name in ("f", "w", "dw") for axis in "xyz"}


def _rotor(direct, quadrature):
    x = TunedGyroAxis("x", D_own=direct, D_other=quadrature)
    return x, TunedGyroAxis("y", D_own=direct, D_other=-quadrature)


def test_both_axes_follow_the_written_out_drift_in_case_axes():
    rng = np.random.default_rng(1)
    case, e, c = _case(rng), rng.normal(size=(2, 9)) * 0.1, ("x", "y")
    ax, ay, az = (case[f"f_{axis}"] for axis in "xyz")
    wx, wy, wz = (case[f"w_{axis}"] for axis in "xyz")
    axes = [TunedGyroAxis(axis, *values) for axis, values in zip(c, e, strict=True)]
    out_x, out_y = indicated_pair(*axes, case, ROWS)
    K, m_xy, m_xz, B, D_xx, D_xy, D_xz, D_xxz, D_xyz = e[0]
    drift = B + D_xx * ax + D_xy * ay + D_xz * az + D_xxz * ax * az + D_xyz * ay * az
    np.testing.assert_allclose(out_x, (1 + K) * (wx + m_xy * wy + m_xz * wz + drift), rtol=1e-12, atol=1e-14)
    K, m_yx, m_yz, B, D_yy, D_yx, D_yz, D_yyz, D_yxz = e[1]
    drift = B + D_yy * ay + D_yx * ax + D_yz * az + D_yyz * ay * az + D_yxz * ax * az
    np.testing.assert_allclose(out_y, (1 + K) * (wy + m_yx * wx + m_yz * wz + drift), rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("axis", ["x", "y"])
def test_trap_component_axes_are_right_handed(axis):
    case = {f"w_{name}": row for name, row in zip("xyz", np.eye(3), strict=True)}
    i, j, k = (component(axis, case)[f"w_{name}"] for name in "ijk")
    np.testing.assert_array_equal(np.cross(i, j), k)


def test_symmetric_rotor_has_one_set_of_coefficients_for_both_axes():
    x, y = (
        STANDARDS["gyroscope", f"ieee813.{p.axis}"].to_general(p)
        for p in _rotor(direct=3e-7, quadrature=2e-7)
    )
    assert x["g_i"] == y["g_i"] == 3e-7
    assert x["g_k"] == y["g_k"] == -2e-7


def test_drift_of_a_symmetric_rotor_turns_with_the_case():
    """Direct and quadrature unbalance are isotropic: turn the inputs about the spin, the drift turns."""
    case, angle = _case(np.random.default_rng(2)), 0.7
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    drift = np.array(indicated_pair(*_rotor(0.3, 0.2), case, ROWS)) - [case["w_x"], case["w_y"]]
    f_x, f_y = turn @ [case["f_x"], case["f_y"]]
    turned = {**case, "f_x": f_x, "f_y": f_y}
    after = np.array(indicated_pair(*_rotor(0.3, 0.2), turned, ROWS)) - [case["w_x"], case["w_y"]]
    np.testing.assert_allclose(after, turn @ drift, rtol=0.0, atol=1e-14)


def test_symbols_name_the_axis_they_belong_to():
    assert [symbol.symbol for symbol in SYMBOLS["y"]][2:] == [
        "m_yx", "m_yz", "D_yy", "D_yx", "D_yz", "D_yyz", "D_yxz", "D_yzz",
    ]  # fmt: skip
