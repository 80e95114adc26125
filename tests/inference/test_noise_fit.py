"""Posterior of a set of processes against a grid, and detection limits: where they lie, and how they move."""

import math

import made
import numpy as np
import pytest
from quiet_logs import quiet_log

from imubayes.inference.noise_fit import (
    Spectrum,
    detection_limits,
    fit_draws,
    fit_mode,
    information,
    parameters,
    spectrum,
)
from imubayes.inference.noise_fit import density as density_of
from imubayes.inference.noise_model import likelihood, noise_rows, piece_edges, process_model
from imubayes.sensors.catalogue import sensor
from imubayes.sensors.noise import OPTIONAL, class_prior

INTERVAL = 1.0
PRIOR = class_prior(sensor("mems_consumer", kind="gyroscope"), INTERVAL)
NAMES = parameters(("G",))
CENTER = np.log([PRIOR[n][0] for n in NAMES])
WIDTH = np.array([PRIOR[n][1] for n in NAMES])


def data_of(size, tau, samples=800, seed=1):
    noise = {"N": PRIOR["N"][0], "G": size * PRIOR["G"][0], "tau": tau}
    y = quiet_log(noise, samples, INTERVAL, np.random.default_rng(seed))
    return process_model(*noise_rows(made.rows_of(y, duration=INTERVAL)), PRIOR)


def fitted(data, seed=2):
    starts = [CENTER, CENTER - np.array([0.0, 2.0, 0.0])]
    return fit_draws(data, fit_mode(data, NAMES, starts), np.random.default_rng(seed), enough=200.0)


def density(data, points):
    """Posterior density without a ramp, up to a constant, at logarithms (m, 3)."""
    levels = np.array([likelihood(data, NAMES, x).levels[0] for x in points])
    levels -= 0.5 * np.sum(((points - CENTER) / WIDTH) ** 2, axis=1)
    return np.exp(levels - levels.max()), levels.max()


@pytest.mark.parametrize(("size", "tau"), [(0.6, 100.0), (3.0, 1500.0)], ids=["hidden", "slow"])
def test_time_constant_has_the_quantiles_of_a_grid(size, tau):
    """A hidden process has a tail to small sizes; a slow one a ridge, along which only G^2/tau is known."""
    data = data_of(size, tau)
    fit = fitted(data)
    weights = fit.weights[:, 0] / fit.weights[:, 0].sum()
    effective = 1.0 / float(weights @ weights)
    middle = weights @ fit.draws
    spread = np.sqrt(weights @ (fit.draws - middle) ** 2)
    cells = np.linspace(-5.0, 5.0, 25)
    axes = [middle[0] + spread[0] * cells[::4], middle[1] + spread[1] * cells, middle[2] + spread[2] * cells]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    heights, peak = density(data, points)
    along = heights.reshape([len(axis) for axis in axes]).sum(axis=(0, 1))
    below = np.concatenate(([0.0], np.cumsum(0.5 * (along[1:] + along[:-1]))))
    order = np.argsort(fit.draws[:, 2])
    reached = np.cumsum(weights[order])
    for p in (0.05, 0.5, 0.95):
        at = fit.draws[order, 2][np.searchsorted(reached, p)]
        found = np.interp(at, axes[2], below / below[-1])
        # sampling of the draws, and of the grid, whose cells of 0.4 sd are off by 0.02 at most
        assert found == pytest.approx(p, abs=4.0 * math.sqrt(p * (1.0 - p) / effective) + 0.02)
    cell = math.prod(axis[1] - axis[0] for axis in axes)
    expected = peak + math.log(heights.sum() * cell) - np.log(WIDTH).sum() - 1.5 * math.log(2.0 * math.pi)
    assert fit.log_evidence[0] == pytest.approx(expected, abs=4.0 / math.sqrt(effective) + 0.05)


FOG = sensor("fog_tactical", kind="gyroscope")
SAMPLING = 0.1
KNOWN = class_prior(FOG, SAMPLING)
WHITE = {"N": KNOWN["N"][0]}


def gapless(samples):
    """Rows of a gapless log without its samples: limits depend on nothing else."""
    t = SAMPLING * np.arange(samples)
    edges, levels = piece_edges(t, SAMPLING)
    duration = SAMPLING * np.diff(np.append(edges, samples))
    center = t[edges] + 0.5 * duration
    return made.rows_of(np.arange(float(len(edges))), t=center, duration=duration, interval=SAMPLING), levels


def limits(samples, candidates=OPTIONAL, noise=WHITE):
    return detection_limits(process_model(*gapless(samples), KNOWN), noise, candidates)


def test_information_is_the_mean_log_likelihood_ratio_of_periodograms():
    rng = np.random.default_rng(1)
    there, instead = np.array([2.0, 1.0, 0.5]), np.array([1.0, 1.5, 0.6])
    power = there * rng.exponential(size=(200_000, 3))
    ratio = (np.log(instead) - np.log(there) + power / instead - power / there).sum(axis=1)
    expected = information(there, instead, np.ones(3))
    assert ratio.mean() == pytest.approx(expected, abs=4.0 * ratio.std() / math.sqrt(len(ratio)))


def test_frequencies_stand_for_all_fourier_frequencies_of_every_length():
    grid = spectrum(((0.1, 1000), (5.0, 301)))
    for length, number in ((0.1, 1000), (5.0, 301)):
        assert grid.count[grid.length == length].sum() == number // 2
        assert grid.f[grid.length == length].max() <= 0.5 / length + 1e-9


def test_density_of_quantized_samples_is_the_transform_of_their_covariance():
    T, Q = 0.1, 0.3
    f = np.linspace(0.1, 5.0, 7)
    expected = T * (2.0 * Q**2 / T**2 - 2.0 * Q**2 / T**2 * np.cos(2.0 * np.pi * f * T))
    found = density_of({"Q": Q}, Spectrum(f, np.ones(7), np.full(7, T)))
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
    wide = {**KNOWN, "Q": (KNOWN["Q"][0], 4.0)}
    data = process_model(*gapless(36_000), wide)
    moved = {name: (10.0 * median if name in "NBKQG" else median, sd) for name, (median, sd) in wide.items()}
    other = process_model(*gapless(36_000), moved)
    one = detection_limits(data, WHITE, ("Q",))["Q"]
    ten = detection_limits(other, {"N": 10.0 * WHITE["N"]}, ("Q",))["Q"]
    assert ten / one == pytest.approx(10.0, rel=1e-3)


def test_ramp_limit_beside_white_noise_is_about_four_sds_of_its_estimate():
    """Least squares in white noise: sd(R)^2 = 12 N^2 / T^3; 19 to 1 in 19 of 20 logs is 4 to 6 sds."""
    samples = 36_000
    found = limits(samples, ("R",))["R"]
    sd = math.sqrt(12.0 * WHITE["N"] ** 2 / (samples * SAMPLING) ** 3)
    assert 4.0 < found / sd < 6.0
