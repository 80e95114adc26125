"""IEEE 1293: signs and factors as the standard has them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imubayes.sensors.equations.ieee1293 import Accelerometer, indicated, to_general


def _at(p, **inputs):
    return float(indicated(p, {name: np.array([value]) for name, value in inputs.items()}, 1)[0])


def test_trap_bias_asymmetry_is_the_full_difference_and_b0p_half_of_it():
    p = Accelerometer(s=0.1, K0p=0.02)
    tiny = 1e-15
    assert _at(p, f_i=tiny) - _at(p, f_i=-tiny) == pytest.approx(1.1 * 0.02, rel=1e-10)
    assert to_general(p)["b0p"] == pytest.approx(1.1 * 0.02 / 2.0, rel=1e-15)


def test_trap_scale_asymmetry_is_the_full_difference_of_slopes_and_b1p_half_of_it():
    p = Accelerometer(K1p=1e-3)
    up, down = _at(p, f_i=2.0) - _at(p, f_i=1.0), _at(p, f_i=-1.0) - _at(p, f_i=-2.0)
    assert up - down == pytest.approx(1e-3, rel=1e-10)
    assert to_general(p)["b1p"] == 0.5e-3


def test_trap_sign_of_zero_is_zero():
    assert _at(Accelerometer(K0=0.01, K0p=0.02, K1p=0.1), f_i=0.0) == 0.01


@pytest.mark.parametrize(
    ("about", "field", "term", "sign"), [(2, "d_o", "m_j", 1.0), (1, "d_p", "m_k", -1.0)]
)
def test_trap_misalignment_turns_the_input_axis_right_handed(about, field, term, sign):
    """An angle about o tilts the input axis towards +p, one about p towards -o: the rotation says so."""
    angle = 1e-6
    vector = np.zeros(3)
    vector[about] = angle
    axis = Rotation.from_rotvec(vector).apply([1.0, 0.0, 0.0])
    p = Accelerometer(**{field: angle})
    f = {"f_i": 0.0, "f_j": 2.0, "f_k": 5.0}
    # the linear angle differs from the rotation by its cube
    assert _at(p, **f) == pytest.approx(axis @ list(f.values()), rel=1e-11)
    assert to_general(p)[term] == sign * angle


def test_trap_every_coefficient_sits_inside_the_gain():
    p = Accelerometer(s=1.0, K0=1e-3, K2=1e-5, Kspin=1e-4)
    theta = to_general(p)
    assert (theta["b1"], theta["b0"], theta["b2"], theta["S_ij"]) == (1.0, 2e-3, 2e-5, 2e-4)


def test_tumble_in_the_plane_of_input_and_pendulous_axis_has_the_published_harmonics():
    """K0 + (K2 + Kpp)/2, K1 + 3 K3/4, (K2 - Kpp)/2, K3/4, d_o and Kip/2, at 1 unit of gravity."""
    p = Accelerometer(K0=1e-2, K2=3e-3, K3=2e-3, Kpp=5e-4, d_o=4e-3, Kip=7e-4)
    n = 64
    angle = 2.0 * np.pi * np.arange(n) / n
    spectrum = np.fft.rfft(indicated(p, {"f_i": np.cos(angle), "f_j": np.sin(angle)}, n)) * 2.0 / n
    expected_cos = [2.0 * (1e-2 + 1.75e-3), 1.0 + 1.5e-3, 1.25e-3, 5e-4]
    np.testing.assert_allclose(spectrum.real[:4], expected_cos, rtol=1e-12)
    np.testing.assert_allclose(-spectrum.imag[1:4], [4e-3, 3.5e-4, 0.0], rtol=1e-11, atol=1e-15)
