"""The fit of the noise's posterior, on a density whose moments are known."""

from types import SimpleNamespace

import numpy as np
import pytest

from imubayes.inference.mcmc import density as of_chains
from imubayes.inference.mcmc.density import SAMPLE, fit_noise


@pytest.mark.parametrize("dimensions", [3, 18])
def test_fit_ends_with_the_moments_as_soon_as_more_rounds_gain_nothing(monkeypatch, dimensions):
    rounds = []
    factor = np.linalg.qr(np.random.default_rng(3).standard_normal((dimensions, dimensions)))[0]
    factor *= np.geomspace(0.1, 1.0, dimensions)

    def normal(density, x):
        rounds.append(len(x))
        return -0.5 * np.sum(np.linalg.solve(factor, x.T) ** 2, axis=0)

    monkeypatch.setattr(of_chains, "log_marginal", normal)
    density = SimpleNamespace(width=np.ones(dimensions), parameters=())
    start = np.full(dimensions, 0.3)
    fit = fit_noise(density, start, np.full(dimensions, 0.5), np.random.default_rng(1))
    # a Student proposal in 18 dimensions never has half of its points count
    assert rounds.count(SAMPLE) <= 12
    away = np.linalg.solve(factor, fit.center)
    scatter = np.linalg.solve(factor, np.linalg.solve(factor, fit.L @ fit.L.T).T)
    # both come from a weighted sample, of which at least a tenth counts
    counted = SAMPLE / 10.0
    assert np.abs(away).max() < 4.0 / np.sqrt(counted)
    np.testing.assert_allclose(scatter, np.eye(dimensions), atol=6.0 / np.sqrt(counted) + 1e-3)
