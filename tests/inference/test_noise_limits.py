"""Detection limits: where they lie, and how they move with the log."""

import math

import made
import numpy as np
import pytest

from imubayes.inference.noise_fit import Spectrum, density, detection_limits, information
from imubayes.inference.noise_model import process_model
from imubayes.inference.noise_rows import piece_edges
from imubayes.sensors.catalogue import sensor
from imubayes.sensors.noise import OPTIONAL, class_prior

FOG = sensor("fog_tactical", kind="gyroscope")
INTERVAL = 0.1
PRIOR = class_prior(FOG, INTERVAL)
WHITE = {"N": PRIOR["N"][0]}


def rows_of(samples):
    """Rows of a gapless log without its samples: limits depend on nothing else."""
    t = INTERVAL * np.arange(samples)
    edges, levels = piece_edges(t, INTERVAL)
    duration = INTERVAL * np.diff(np.append(edges, samples))
    center = t[edges] + 0.5 * duration
    return made.rows_of(np.arange(float(len(edges))), t=center, duration=duration, interval=INTERVAL), levels


def limits(samples, candidates=OPTIONAL, noise=WHITE):
    return detection_limits(process_model(*rows_of(samples), PRIOR), noise, candidates)


def test_information_is_the_mean_log_likelihood_ratio_of_periodograms():
    rng = np.random.default_rng(1)
    there, instead = np.array([2.0, 1.0, 0.5]), np.array([1.0, 1.5, 0.6])
    power = there * rng.exponential(size=(200_000, 3))
    ratio = (np.log(instead) - np.log(there) + power / instead - power / there).sum(axis=1)
    expected = information(there, instead, np.ones(3))
    assert ratio.mean() == pytest.approx(expected, abs=4.0 * ratio.std() / math.sqrt(len(ratio)))


def test_density_of_quantized_samples_is_the_transform_of_their_covariance():
    T, Q = 0.1, 0.3
    f = np.linspace(0.1, 5.0, 7)
    expected = T * (2.0 * Q**2 / T**2 - 2.0 * Q**2 / T**2 * np.cos(2.0 * np.pi * f * T))
    found = density({"Q": Q}, Spectrum(f, np.ones(7), np.full(7, T)))
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_a_longer_log_finds_smaller_processes():
    candidates = ("B", "K", "R")
    short, long = limits(36_000, candidates), limits(864_000, candidates)
    assert all(long[name] < short[name] for name in candidates)


def test_a_process_is_found_smaller_where_nothing_else_could_take_its_place():
    alone, among = limits(36_000, ("K",)), limits(36_000)
    assert alone["K"] < among["K"]


def test_limit_of_quantization_scales_with_the_white_noise():
    """White noise and quantization exchange S(f) = N^2 + 4 (Q^2/T) sin^2: only their ratio counts."""
    wide = {**PRIOR, "Q": (PRIOR["Q"][0], 4.0)}
    data = process_model(*rows_of(36_000), wide)
    moved = {name: (10.0 * median if name in "NBKQG" else median, sd) for name, (median, sd) in wide.items()}
    other = process_model(*rows_of(36_000), moved)
    one = detection_limits(data, WHITE, ("Q",))["Q"]
    ten = detection_limits(other, {"N": 10.0 * WHITE["N"]}, ("Q",))["Q"]
    assert ten / one == pytest.approx(10.0, rel=1e-3)


def test_ramp_limit_beside_white_noise_is_about_four_sds_of_its_estimate():
    """Least squares in white noise: sd(R)^2 = 12 N^2 / T^3; 19 to 1 in 19 of 20 logs is 4 to 6 sds."""
    samples = 36_000
    found = limits(samples, ("R",))["R"]
    sd = math.sqrt(12.0 * WHITE["N"] ** 2 / (samples * INTERVAL) ** 3)
    assert 4.0 < found / sd < 6.0
