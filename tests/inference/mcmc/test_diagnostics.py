"""Effective sizes and R-hat against processes whose values are known, and against ArviZ."""

import numpy as np
import pytest

from imubayes.inference.mcmc.ensembles import autocorrelation_time, effective_size, split_rhat


def autoregressive(steps, walkers, correlation, seed, offset=0.0):
    rng = np.random.default_rng(seed)
    x = np.empty((steps, walkers, 1))
    x[0] = rng.standard_normal((walkers, 1))
    for k in range(1, steps):
        x[k] = correlation * x[k - 1] + np.sqrt(1.0 - correlation**2) * rng.standard_normal((walkers, 1))
    return x + offset


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.9])
def test_autocorrelation_time_of_a_first_order_process_is_its_formula(correlation):
    steps, expected = 4000, (1.0 + correlation) / (1.0 - correlation)
    tau = autocorrelation_time(autoregressive(steps, 32, correlation, 1))
    # Sokal's variance of the estimate with a window of five times tau, over the walkers
    error = np.sqrt(2.0 * 11.0 * expected / (steps * 32))
    assert tau[0] == pytest.approx(expected, rel=4.0 * error)


def test_effective_size_of_ensembles_is_that_of_all_their_walkers():
    chains = [autoregressive(2000, 16, 0.5, seed) for seed in range(4)]
    size, tau = effective_size(chains, 16)
    assert tau[0] == pytest.approx(autocorrelation_time(np.concatenate(chains, axis=1))[0])
    assert size[0] == pytest.approx(4 * 2000 * 16 / 3.0, rel=0.1)
    # of walkers that are alike some stand for all
    assert effective_size([chain[:, :8] for chain in chains], 16)[0][0] == pytest.approx(size[0], rel=0.1)


def test_constant_parameter_is_no_reason_to_go_on():
    chain = np.concatenate((autoregressive(200, 8, 0.5, 1), np.ones((200, 8, 1))), axis=2)
    assert autocorrelation_time(chain)[1] == 1.0
    assert split_rhat([chain, chain])[1] == 1.0


@pytest.mark.parametrize("offset", [0.0, 0.3, 3.0])
def test_rhat_is_arviz_split_rhat_of_the_ensembles(offset):
    arviz = pytest.importorskip("arviz")
    chains = [autoregressive(500, 1, 0.3, seed, offset * (seed == 0)) for seed in range(4)]
    expected = arviz.rhat(np.array([chain[:, 0, 0] for chain in chains]), method="split")
    assert split_rhat(chains)[0] == pytest.approx(float(expected), rel=1e-10)


def test_walker_that_has_not_moved_takes_as_long_as_the_chain():
    chain = autoregressive(200, 8, 0.5, 1)
    chain[:, 3] = chain[0, 3]
    assert autocorrelation_time(chain)[0] == 200.0


def test_ensembles_that_drift_are_seen_by_their_halves():
    drift = np.linspace(0.0, 3.0, 400)[:, None, None]
    chains = [autoregressive(400, 8, 0.3, seed) + drift for seed in range(4)]
    assert split_rhat(chains)[0] > 1.2
