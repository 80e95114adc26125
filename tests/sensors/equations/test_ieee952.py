"""IEEE 952: the denominator, the exact direction, and what the expansion leaves."""

import math
from dataclasses import astuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imubayes.sensors.equations.ieee952 import FiberOpticGyro, indicated, sensed, to_general
from imubayes.sensors.terms import columns, library


def test_trap_scale_factor_error_is_in_the_denominator():
    rate = indicated(FiberOpticGyro(eps_K=100e-6), {"w_i": np.array([1.0])}, 1)[0]
    assert rate == pytest.approx(1.0 / 1.0001, rel=1e-15)
    assert to_general(FiberOpticGyro(eps_K=100e-6))["b1"] == pytest.approx(-100e-6 + 1e-8, rel=1e-8)


def test_input_axis_is_the_rotation_of_the_reference_axis():
    """The sinc form is Rodrigues' formula of the rotation vector (a_X, a_Y); sqrt(1 - ...) is its cosine."""
    a_X, a_Y, w = 0.3, -0.7, np.array([0.4, -1.1, 2.5])
    channels = {f"w_{axis}": np.array([value]) for axis, value in zip("ijk", w, strict=True)}
    axis = Rotation.from_rotvec([0.0, a_X, a_Y]).apply([1.0, 0.0, 0.0])
    assert sensed(a_X, a_Y, channels, 1)[0] == pytest.approx(axis @ w, rel=1e-14)
    a = math.hypot(a_X, a_Y)
    sines = np.array([a_X, a_Y]) * math.sin(a) / a
    assert math.sqrt(1.0 - sines @ sines) == pytest.approx(axis[0], rel=1e-14)


def _inputs(rng, n=400):
    channels = {f"w_{axis}": rng.uniform(-5.0, 5.0, n) for axis in "ijk"}
    return {**channels, "T": rng.uniform(270.0, 330.0, n), "dT": rng.normal(0.0, 0.01, n)}


def _left(p, channels, n=400):
    lib = library("gyroscope", powers=3, asymmetry=1, temperature=1)
    theta = to_general(p)
    assert theta.keys() <= set(lib.names)
    modelled = channels["w_i"] + columns(lib, channels, n) @ [theta.get(name, 0.0) for name in lib.names]
    return np.abs(modelled - indicated(p, channels, n)).max()


def test_what_the_expansion_leaves_is_of_second_order():
    """All errors halved leave a quarter: no product of one error with the rate alone has been dropped."""
    D = {"D_F": 1e-3, "D_T": 2e-5, "D_Tdot": 3e-2, "a_X": 2e-3, "a_Y": -1e-3}
    sizes = FiberOpticGyro(eps_K=1e-3, eps_T=2e-5, eps_1=3e-4, eps_2=-1e-4, eps_1p=4e-4, **D)
    channels = _inputs(np.random.default_rng(3))
    shares = np.array([1.0, 0.5, 0.25, 0.125])
    left = [_left(FiberOpticGyro(*(share * np.array(astuple(sizes)))), channels) for share in shares]
    ratios = np.array(left[:-1]) / left[1:]
    # the next order changes the ratio by about the errors' own size times the rate, below 1 %
    np.testing.assert_allclose(ratios, 4.0, rtol=0.01)


def test_own_rate_expansion_is_exact_to_the_third_power():
    """With the rate halved what is left falls by sixteen, so that its lowest power is the fourth."""
    p = FiberOpticGyro(eps_K=0.1, eps_1=2e-3, eps_2=-1e-4, a_X=0.2)
    left = [_left(p, {"w_i": np.array([rate])}, 1) for rate in (0.4, 0.2, 0.1)]
    # the fifth power over the fourth is about eps_2 w / (2 eps_1) = 1e-2 at the largest rate
    np.testing.assert_allclose(np.array(left[:-1]) / left[1:], 16.0, rtol=0.01)


def test_temperature_gradient_enters_as_a_scalar_product():
    p = FiberOpticGyro(D_grad_i=1.0, D_grad_j=2.0, D_grad_k=3.0)
    rates = {
        f"gradTdot_{axis}": np.array([value]) for axis, value in zip("ijk", (4.0, 5.0, 6.0), strict=True)
    }
    assert indicated(p, rates, 1)[0] == 32.0
