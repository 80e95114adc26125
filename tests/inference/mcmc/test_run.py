"""Both samplers against the exact posterior, against each other, and against a grid."""

import math

import numpy as np
import pytest
from campaigns import campaign_of

import imubayes as ib
from imubayes.algebra.factor import posterior
from imubayes.errors import ConvergenceError
from imubayes.inference.mcmc.density import log_marginal
from imubayes.inference.mcmc.ensembles import Limits
from imubayes.inference.mcmc.run import Sampled, sample


@pytest.fixture(scope="module")
def both(campaign):
    c = campaign
    return {
        method: sample(c.summary, c.rows, c.sd, method=method, limits=Limits(seed=7))
        for method in ("collapsed", "full")
    }


def flat(values):
    return values.reshape(-1, *values.shape[2:])


def test_full_sampler_gives_the_exact_posterior_where_the_noise_is_given(given):
    chains = sample(
        given.summary, given.rows, given.sd, method="full", limits=Limits(seed=3, ess=4000.0)
    ).chains
    mean, sd = posterior(given.summary.factor, given.sd)
    found, d = flat(chains.theta), chains.diagnostics
    error = sd / math.sqrt(min(d.ess.min(), len(found)))
    assert np.all(np.abs(found.mean(axis=0) - mean) < 4.0 * error)
    # sds within 3 %, and what a thousand kept draws can tell of them
    np.testing.assert_allclose(found.std(axis=0) / sd, 1.0, atol=0.03 + 3.0 / math.sqrt(2.0 * len(found)))
    exact = log_marginal(given.density, np.empty((1, 0)))[0]
    assert abs(chains.log_evidence[0] - exact) < 0.1
    assert chains.log_evidence[1] < 0.05


def test_both_samplers_agree(both):
    one, other = (both[method].chains for method in ("collapsed", "full"))
    size = flat(one.theta).shape[0]
    for a, b in ((flat(one.theta), flat(other.theta)), (np.log(flat(one.noise)), np.log(flat(other.noise)))):
        spread = np.hypot(a.std(axis=0), b.std(axis=0))
        # kept draws of the full sampler are correlated by a few steps: every third counts
        assert np.all(np.abs(a.mean(axis=0) - b.mean(axis=0)) < 4.0 * spread / math.sqrt(size / 3.0))
        np.testing.assert_allclose(a.std(axis=0), b.std(axis=0), rtol=4.0 / math.sqrt(2.0 * size / 3.0))
    gap = abs(one.log_evidence[0] - other.log_evidence[0])
    assert gap < 4.0 * math.hypot(one.log_evidence[1], other.log_evidence[1]) + 0.02


def test_noise_has_the_moments_that_a_grid_gives():
    # N and B of one run on a grid, K held: everything else is given
    rules = {"centrifuge": ib.NoiseRule("white"), "tumble": ib.NoiseRule("fixed", ib.Noise(6e-4, 4e-4, 3e-6))}
    c = campaign_of(rules)
    chains = sample(c.summary, c.rows, c.sd, limits=Limits(seed=2)).chains
    level = c.summary.runs[1].noise.N
    grid = math.log(level) + np.linspace(-0.2, 0.2, 2001)
    height = log_marginal(c.density, grid[:, None])
    weight = np.exp(height - height.max())
    weight /= weight.sum()
    mean = float(weight @ grid)
    sd = math.sqrt(float(weight @ (grid - mean) ** 2))
    found = np.log(flat(chains.noise)[:, 1, 0])
    assert abs(found.mean() - mean) < 4.0 * sd / math.sqrt(len(found) / 2.0)
    assert found.std() / sd == pytest.approx(1.0, abs=4.0 / math.sqrt(len(found)))
    evidence = float(height.max() + math.log(np.exp(height - height.max()).sum() * (grid[1] - grid[0])))
    assert chains.log_evidence[0] == pytest.approx(evidence, abs=4.0 * chains.log_evidence[1] + 1e-3)
    assert np.ptp(flat(chains.noise)[:, 0]) == pytest.approx(np.ptp(flat(chains.noise)[:1, 0]))


def test_log_likelihood_by_dwell_adds_up_to_that_of_the_block_averages(campaign, both):
    chains = both["collapsed"].chains
    q = len(chains.dwells)
    assert len(both["collapsed"].noises) == 16
    assert chains.log_likelihood.shape == (*chains.theta.shape[:2], q)
    assert {run for run, _, _ in chains.dwells} == {"tumble", "centrifuge"}
    # 36 positions, and 24 levels: what is left of the mean of a dwell is some sds of its noise, not many
    assert q == 36 + 24
    left = chains.observed - flat(chains.predicted).mean(axis=0)
    assert np.sqrt(np.mean(left**2)) < 3.0 * 6e-4
    # fewer rows than blocks: the sum is the log likelihood of all rows, that is, of draw and noise together
    x = np.log(flat(chains.noise)[0]).ravel()
    prior = np.sum(((x - campaign.density.center) / campaign.density.width) ** 2) / 2.0
    prior += np.log(campaign.density.width).sum() + 0.5 * len(x) * math.log(2.0 * math.pi)
    theta = flat(chains.theta)[0]
    of_theta = np.sum((theta / campaign.sd) ** 2) / 2.0 + np.log(campaign.sd).sum()
    of_theta += 0.5 * len(theta) * math.log(2.0 * math.pi)
    # log_density is per phi, the coefficients' own coordinates: their volume is the difference
    volume = campaign.density.coordinates.log_volume
    total = flat(chains.log_density[..., None])[0, 0] - volume + prior + of_theta
    assert flat(chains.log_likelihood)[0].sum() == pytest.approx(total, abs=0.05)


def test_time_limit_raises_with_the_estimate_so_far(given):
    limits = Limits(seed=1, ess=1e8, time_limit=0.5)
    with pytest.raises(ConvergenceError, match="not converged") as caught:
        sample(given.summary, given.rows, given.sd, method="full", limits=limits)
    estimate = caught.value.estimate
    assert isinstance(estimate, Sampled)
    assert not estimate.chains.diagnostics.converged
    assert np.isfinite(estimate.chains.theta).all()
