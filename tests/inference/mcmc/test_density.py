"""The log density against dense normal distributions and its own integrals, and the fit that proposes."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from campaigns import near
from scipy.integrate import quad
from scipy.linalg import solve_triangular
from scipy.optimize import minimize_scalar
from scipy.stats import chi2, norm

from imubayes.inference.mcmc import density as of_chains
from imubayes.inference.mcmc.density import (
    SAMPLE,
    TAIL,
    condition,
    fit_noise,
    log_conditional,
    log_joint,
    log_marginal,
)
from imubayes.inference.whiten import processes, whiten
from imubayes.sensors.noise import Noise


def noises(x):
    return [Noise(*np.exp(part)) for part in np.split(x, len(x) // 3)]


def dense_log_likelihood(campaign, x):
    """Normal density of all whitened rows with the coefficients' covariance in it, n by n."""
    parts, total = [], 0.0
    for rows, run, noise in zip(campaign.rows, campaign.summary.runs, noises(x), strict=True):
        table = np.column_stack((rows.columns(0, len(rows)), rows.y))
        white, d = whiten(noise, rows.rows, table, processes(rows.rows, run.noise))
        parts.append(white)
        total -= 0.5 * float(np.sum(np.log(d)))
    white = np.concatenate(parts)
    C = np.eye(len(white)) + (white[:, :-1] * campaign.sd**2) @ white[:, :-1].T
    L = np.linalg.cholesky(C)
    z = solve_triangular(L, white[:, -1], lower=True)
    return total - float(np.log(np.diag(L)).sum() + 0.5 * (z @ z) + 0.5 * len(z) * math.log(2.0 * math.pi))


def test_marginal_is_the_dense_normal_density_of_the_rows(campaign):
    # fewer rows than blocks: the split into averages and the rest is exact, only the interpolation is not
    x = near(campaign, 3)
    prior = norm(campaign.density.center, campaign.density.width).logpdf(x).sum(axis=1)
    expected = prior + [dense_log_likelihood(campaign, one) for one in x]
    np.testing.assert_allclose(log_marginal(campaign.density, x), expected, atol=0.02)


def test_joint_is_marginal_times_conditional(campaign):
    rng = np.random.default_rng(1)
    x, density = near(campaign, 5), campaign.density
    given = condition(density, x)
    phi = rng.standard_normal((5, density.p))
    product = log_marginal(density, x) + log_conditional(given, phi)
    np.testing.assert_allclose(log_joint(density, phi, x), product, rtol=1e-12)


def test_noise_beyond_what_was_computed_is_refused(campaign):
    x = near(campaign, 2)
    x[1, 1] += 20.0  # B a billion times too large
    assert np.isfinite(log_marginal(campaign.density, x)).tolist() == [True, False]


def test_process_too_weak_to_show_changes_nothing_when_it_gets_weaker(campaign):
    x = np.repeat(near(campaign, 1), 2, axis=0)
    x[:, 2] = [-40.0, -60.0]  # K of the first run, far below what it can show
    prior = norm(campaign.density.center, campaign.density.width).logpdf(x).sum(axis=1)
    likelihood = log_marginal(campaign.density, x) - prior
    assert likelihood[0] == pytest.approx(likelihood[1], abs=1e-6)


def fit_of_a_normal_density(monkeypatch, dimensions):
    """Rounds of a fit, and its center (d,) and scatter (d, d) where the density has sds of one."""
    rounds = []
    factor = np.linalg.qr(np.random.default_rng(3).standard_normal((dimensions, dimensions)))[0]
    factor *= np.geomspace(0.1, 1.0, dimensions)

    def normal(density, x):
        rounds.append(len(x))
        return -0.5 * np.sum(np.linalg.solve(factor, x.T) ** 2, axis=0)

    monkeypatch.setattr(of_chains, "log_marginal", normal)
    density = SimpleNamespace(width=np.ones(dimensions), parameters=(), places=())
    start = np.full(dimensions, 0.3)
    (fit,) = fit_noise(density, start, np.full(dimensions, 0.5), np.random.default_rng(1)).humps
    scatter = np.linalg.solve(factor, np.linalg.solve(factor, fit.L @ fit.L.T).T)
    return rounds.count(SAMPLE), np.linalg.solve(factor, fit.center), scatter


@pytest.mark.parametrize("dimensions", [3, 18])
def test_fit_is_the_nearest_and_ends_as_soon_as_more_rounds_gain_nothing(monkeypatch, dimensions):
    rounds, away, scatter = fit_of_a_normal_density(monkeypatch, dimensions)
    # a Student proposal in 18 dimensions never has half of its points count
    assert rounds <= 12
    # both come from a weighted sample, of which at least a tenth counts
    counted = SAMPLE / 10.0
    assert np.abs(away).max() < 4.0 / np.sqrt(counted)
    scale = nearest_scale(dimensions)
    np.testing.assert_allclose(scatter, scale * np.eye(dimensions), atol=6.0 / np.sqrt(counted) + 1e-3)


def test_fit_ends_where_its_points_never_count_as_they_are(monkeypatch):
    rounds, away, scatter = fit_of_a_normal_density(monkeypatch, 60)
    assert rounds <= 20
    assert np.abs(away).max() < 1.0 and 0.3 < np.diag(scatter).min() < np.diag(scatter).max() < 3.0


def nearest_scale(d):
    """Scale of the Student distribution of largest mean log density over a normal one, by quadrature."""

    def fall(scale):
        over = lambda r: np.log1p(r / (TAIL * scale)) * chi2(d).pdf(r)  # noqa: E731
        return 0.5 * d * np.log(scale) + 0.5 * (TAIL + d) * quad(over, 0.0, 50.0 + 5.0 * d)[0]

    return minimize_scalar(fall, bounds=(0.3, 1.5), method="bounded").x
