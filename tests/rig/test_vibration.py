"""Vibration: means by moments, by quadrature and by sampling."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from imubayes.errors import InputError
from imubayes.rig.inputs import Inputs
from imubayes.rig.scene_ranges import scene_named
from imubayes.rig.scenes import Scene
from imubayes.rig.trajectories import generated
from imubayes.rig.vibration import burst, mean_columns
from imubayes.sensors.terms import columns, library

LEVELS = {"f_i": 3.0, "f_j": -1.0, "f_k": 9.8, "w_i": 0.2, "w_j": 0.5, "w_k": -0.3}


def still(n=1):
    return Inputs(np.arange(float(n)), {name: np.full(n, value) for name, value in LEVELS.items()}, 1.0)


@pytest.mark.parametrize("level", [-7.0, 0.0, 0.4, 30.0])
def test_mean_of_every_power_is_the_integral_over_the_normal_density(level) -> None:
    rms, lib = 2.5, library("accelerometer", powers=6, asymmetry=5)
    found = mean_columns(lib, Inputs(np.zeros(1), {"f_i": np.array([level])}, 1.0), rms)[0]
    for name, value in zip(lib.names, found.tolist(), strict=True):
        if name[0] == "b":
            power, signed = int(name[1]), name.endswith("p")
            integrand = lambda x, n=power, s=signed: (  # noqa: E731
                (np.sign(x) if s else 1.0) * x**n * norm.pdf(x, level, rms)
            )
            ends = (level - 12.0 * rms, level + 12.0 * rms)
            places = [0.0] if ends[0] < 0.0 < ends[1] else None
            direct = quad(integrand, *ends, points=places, epsabs=1e-9, epsrel=1e-11)[0]
            assert value == pytest.approx(direct, rel=1e-8, abs=1e-8)


def test_rectification_of_the_square_is_the_variance_and_products_of_axes_have_none() -> None:
    lib = library("accelerometer", set="extended", temperature=0)
    rms = 5.0
    rectified = dict(zip(lib.names, (mean_columns(lib, still(), rms) - mean_columns(lib, still(), 0.0))[0]))  # noqa: B905
    assert [rectified[name] for name in ("b2", "c_jj", "c_kk")] == pytest.approx([rms**2] * 3)
    assert rectified["b3"] == pytest.approx(3.0 * LEVELS["f_i"] * rms**2)
    assert all(abs(rectified[name]) < 1e-12 for name in ("b0", "b1", "m_j", "c_ij", "c_ik", "c_jk", "S_ij"))


@pytest.mark.parametrize("kind", ["accelerometer", "gyroscope"])
def test_mean_over_a_sampled_burst_is_the_mean_by_moments(kind) -> None:
    """A flat band of W Hz gives 2 W T independent values to the mean of a square, more to other powers."""
    lib, seconds, band, rms = library(kind, powers=4, asymmetry=3, set="extended"), 60.0, (50.0, 400.0), 5.0
    scene = Scene("bench", still(3), 3.0, rms, band, still(3))
    shaken = burst(scene, seconds, np.random.default_rng(3))
    X = columns(lib, shaken.channels, len(shaken))
    error = X.std(axis=0) / np.sqrt(2.0 * (band[1] - band[0]) * seconds)
    expected = mean_columns(lib, still(), rms)[0]
    assert (np.abs(X.mean(axis=0) - expected) <= 4.0 * error + 1e-9 * np.abs(expected)).all()


def test_burst_has_the_rms_and_the_band_of_its_scene() -> None:
    scene = generated(scene_named("quadrotor"), np.random.default_rng(1))
    shaken = burst(scene, 10.0, np.random.default_rng(2))
    motion = np.interp(shaken.t, scene.mean_motion.t, scene.mean_motion.channels["f_k"])
    added = shaken.channels["f_k"] - motion
    power = np.abs(np.fft.rfft(added)) ** 2
    frequency = np.fft.rfftfreq(len(added), shaken.interval)
    low, high = scene.band
    outside = (frequency < low - 0.2) | (frequency > high + 0.2)
    assert power[outside].sum() < 1e-20 * power.sum()
    assert abs(added.std() / scene.vibration - 1.0) < 4.0 / np.sqrt(2.0 * 2.0 * (high - low) * 10.0)


def test_burst_without_vibration_is_refused() -> None:
    with pytest.raises(InputError, match="holds no period of a vibration"):
        burst(Scene("bench", still(3), 3.0), 1.0, np.random.default_rng(1))
