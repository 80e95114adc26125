"""Vibration: means by moments, by quadrature and by sampling."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from imubayes.rig.inputs import Inputs
from imubayes.scenes.effects import mean_columns
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


def burst(rms, band, seconds, rng):
    """Channels of a still case whose force vibrates, flat within the band and nothing outside."""
    n, step = round(4.0 * band[1] * seconds), 0.25 / band[1]
    frequency = np.fft.rfftfreq(n, step)
    inside = (frequency >= band[0]) & (frequency <= band[1])
    # white noise of n rows keeps the share of its variance that lies within the band
    gain = rms * np.sqrt((n // 2 + 1) / inside.sum())
    added = {
        f"f_{axis}": gain * np.fft.irfft(np.fft.rfft(rng.standard_normal(n)) * inside, n) for axis in "ijk"
    }
    return {name: value + added.get(name, np.zeros(n)) for name, value in LEVELS.items()}


@pytest.mark.parametrize("kind", ["accelerometer", "gyroscope"])
def test_mean_over_a_sampled_burst_is_the_mean_by_moments(kind) -> None:
    """A flat band of W Hz gives 2 W T independent values to the mean of a square, more to other powers."""
    lib, seconds, band, rms = library(kind, powers=4, asymmetry=3, set="extended"), 60.0, (50.0, 400.0), 5.0
    shaken = burst(rms, band, seconds, np.random.default_rng(3))
    X = columns(lib, shaken, len(shaken["f_i"]))
    error = X.std(axis=0) / np.sqrt(2.0 * (band[1] - band[0]) * seconds)
    expected = mean_columns(lib, still(), rms)[0]
    assert (np.abs(X.mean(axis=0) - expected) <= 4.0 * error + 1e-9 * np.abs(expected)).all()
