"""Posterior of a set of processes against a grid, and the modes of a Gauss-Markov process."""

import math

import made
import numpy as np
import pytest
from quiet_logs import quiet_log

from imubayes.inference.noise_fit import fit_draws, fit_mode, parameters
from imubayes.inference.noise_model import likelihood, process_model
from imubayes.inference.noise_rows import noise_rows
from imubayes.sensors.catalogue import sensor
from imubayes.sensors.noise import class_prior

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
