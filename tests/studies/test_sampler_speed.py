"""What the peers of ``studies/sampler_speed.toml`` sample: the posterior of every row, and its slope."""

from __future__ import annotations

import numpy as np
import pytest

from imubayes.inference.mcmc.density import density_of
from imubayes.inference.whiten import processes, whiten
from imubayes.sensors.noise import Noise
from studies.sampler_speed import table
from studies.sampler_speed.full_data import on_factor

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def problems():
    return table.problems()


def test_the_likelihood_of_every_row_is_the_one_that_whitening_gives(problems):
    problem, rng = problems["free"], np.random.default_rng(1)
    density = problem.density
    phi = density.coordinates.parameters(rng.normal(size=len(density.coordinates)))
    theta, logs = phi[:21], phi[21:].reshape(-1, 3)
    for rows, known, run, own in zip(problem.rows, problem.summary.runs, density.runs, logs, strict=True):
        left = (rows.y - rows.columns(0, len(rows)) @ theta)[:, None]
        z, d = whiten(Noise(*np.exp(own).tolist()), rows.rows, left, processes(rows.rows, known.noise))
        expected = -0.5 * float(np.sum(z**2) + np.sum(np.log(d)))
        assert run.value(theta, own) == pytest.approx(expected, rel=1e-10)


def test_the_posterior_on_the_factor_is_that_of_every_row(problems):
    problem, rng = problems["free"], np.random.default_rng(4)
    ours = density_of(problem.summary, problem.rows, problem.sd, rng)
    same = on_factor(problem.density, ours)
    x = rng.normal(size=(20, len(same.coordinates)))
    phi = same.coordinates.parameters(x)
    there = np.linalg.solve(problem.density.coordinates.basis, (phi - problem.density.coordinates.center).T).T
    apart = same.values(x) - problem.density.values(there)
    assert np.std(apart) < 0.5  # nats: of a walk in 27 dimensions; a constant changes nothing


@pytest.mark.parametrize("noise", ["given", "free"])
def test_the_gradient_that_nuts_follows_is_the_slope_of_the_density(problems, noise):
    density, rng = problems[noise].density, np.random.default_rng(2)
    x, step = rng.normal(size=len(density.coordinates)), 1e-3
    value, slope = density.gradient(x)
    assert value == pytest.approx(float(density.values(x[None])[0]), rel=1e-12)
    for along in rng.normal(size=(3, len(x))):
        above, below = density.values(np.array([x + step * along, x - step * along]))
        # rounding of the values, 1e-16 of them, is divided by the step; the third derivative enters squared
        tolerance = 1e-15 * abs(value) / step + step**2 * float(np.sum(np.abs(along)) ** 3)
        assert (above - below) / (2.0 * step) == pytest.approx(float(slope @ along), abs=tolerance)
