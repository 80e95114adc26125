"""Vibration in dwells: a Gaussian law by its moments, and what rectifies."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import erf

from imubayes.rig.rotations import vibration
from imubayes.sensors.terms import columns, library

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


def moments(f0: float, s: float) -> dict[str, float]:
    """Means over a normal law about f0, from the published formulas."""
    odd = float(erf(f0 / (s * math.sqrt(2.0))))
    bell = s * math.sqrt(2.0 / math.pi) * math.exp(-(f0**2) / (2.0 * s**2))
    return {
        "b0p": odd,
        "b1p": bell + f0 * odd,
        "b2": f0**2 + s**2,
        "b2p": (f0**2 + s**2) * odd + f0 * bell,
        "b3": f0**3 + 3.0 * f0 * s**2,
        "b3p": (f0**3 + 3.0 * f0 * s**2) * odd + (f0**2 + 2.0 * s**2) * bell,
    }


@pytest.mark.parametrize(("mount", "f0"), [(0, G), (1, -G), (2, 0.0)])
@pytest.mark.parametrize("level", [1, 2, 3])
def test_mean_of_a_column_over_a_dwell_is_its_gaussian_moment(mount, f0, level):
    lib = library("accelerometer", asymmetry=3)
    X = in_dwells(columns(lib, PLAN.inputs.channels, len(PLAN.inputs)))[mount, level]
    error = 4.0 * X.std(axis=0) / math.sqrt(INDEPENDENT) + 1e-9
    for name, expected in moments(f0, LEVELS[level] * G).items():
        column = lib.names.index(name)
        assert abs(X[:, column].mean() - expected) < error[column], name


@pytest.mark.parametrize(("mount", "name"), [(5, "c_ij"), (6, "c_ik"), (7, "c_jk")])
def test_mean_of_a_product_halfway_between_two_axes_is_half_the_variance(mount, name):
    lib = library("accelerometer")
    X = in_dwells(columns(lib, PLAN.inputs.channels, len(PLAN.inputs)))[mount, :, :, lib.names.index(name)]
    np.testing.assert_allclose(X.mean(axis=1), 0.5 * (G * np.array(LEVELS)) ** 2, atol=1e-10 * G**2)
