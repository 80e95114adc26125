"""Campaigns on which a sampler can go wrong without a word."""

import math
from dataclasses import replace

import numpy as np
import pytest
from campaigns import LIBRARY, SENSOR, campaign_of, drifting_log, walkless

import imubayes as ib
from imubayes.errors import InputError
from imubayes.inference.linear import linear_of
from imubayes.inference.mcmc.density import density_of
from imubayes.inference.mcmc.ensembles import Limits
from imubayes.inference.mcmc.run import sample
from imubayes.inference.prior import ScalePrior
from imubayes.rig.inputs import Inputs, Run
from imubayes.sensors.catalogue import draw_unit


def sampled(runs, rules=None):
    summary = ib.summarize(runs, LIBRARY, sensor=SENSOR, rules=rules)
    rows, sd = [linear_of(run, LIBRARY) for run in runs], ib.prior(SENSOR, LIBRARY).sd
    return sample(summary, rows, sd, limits=Limits(seed=4, ess=400.0))


def unit():
    return draw_unit(SENSOR, LIBRARY, np.random.default_rng(4))


def test_runs_that_share_a_noise_which_suits_neither_are_sampled_where_both_can_be():
    """The log's bias instability is 2.6 times the tumble's, but the study says that they are alike."""
    quiet, loud = ib.Noise(6e-4, 4e-4, 3e-6), ib.Noise(6e-4, 2.6 * 4e-4, 3e-6)
    tumble, arm = ib.tumble(angles=12, dwell=20.0, rate=2.0), ib.centrifuge([1, 10], dwell=20.0, rate=2.0)
    runs = (
        *ib.simulate(SENSOR, [tumble], seed=1, truth=unit(), noise=quiet),
        *ib.simulate(SENSOR, [arm], seed=2, truth=unit(), noise=loud),
    )
    found = sampled(runs, {"centrifuge": ib.NoiseRule("fixed", like="tumble")}).chains
    B = found.noise[..., 0, 1]
    assert found.diagnostics.converged
    assert found.interpolation_error < 0.3
    # between the two, and nowhere cut off: an edge would leave many draws at one value
    assert quiet.B < B.mean() < loud.B
    assert np.ptp(np.log(B)) > 6.0 * np.log(B).std()
    np.testing.assert_array_equal(found.noise[..., 0, :], found.noise[..., 1, :])


def test_bias_instability_that_passes_for_a_random_walk_is_not_missed():
    """One maximum has the random walk; beside it a tenth of the posterior has bias instability alone."""
    gyro, lib, runs = drifting_log(10)
    summary, rows = ib.summarize(runs, lib, sensor=gyro), [linear_of(run, lib) for run in runs]
    sd = ib.prior(gyro, lib).sd
    chains = sample(summary, rows, sd, limits=Limits(seed=4)).chains
    density = density_of(summary, rows, sd, np.random.default_rng(1))
    middle, width = np.log(chains.noise[..., 0, 0]).mean(), np.log(chains.noise[..., 0, 0]).std()
    _, expected = walkless(density, middle + width * np.linspace(-4.0, 4.0, 13))
    assert 0.05 < expected < 0.2
    assert np.mean(np.log(chains.noise[..., 0, 2]) < -17.0) == pytest.approx(expected, abs=0.03)
    assert chains.diagnostics.tau.max() < 20.0


def test_samples_lost_at_random_do_no_harm():
    (run,) = ib.simulate(SENSOR, [ib.tumble(angles=12, dwell=30.0, rate=5.0)], seed=1, truth=unit())
    kept = np.random.default_rng(2).random(len(run.inputs)) < 0.5
    channels = {name: values[kept] for name, values in run.inputs.channels.items()}
    thinned = Run(run.name, run.procedure, Inputs(run.inputs.t[kept], channels, 0.2), run.output[kept])
    assert len(thinned.inputs) > 1500
    found = sampled([thinned]).chains
    assert found.diagnostics.converged
    assert found.interpolation_error < 0.3
    N = found.noise[..., 0, 0]
    assert abs(N.mean() - 60.0 * 9.80665e-6) < 5.0 * N.std()


def test_checkpoint_of_another_given_noise_is_refused(given, tmp_path):
    limits = Limits(seed=1, ess=100.0, checkpoint=tmp_path / "a.h5")
    sample(given.summary, given.rows, given.sd, method="full", limits=limits)
    loud = ib.NoiseRule("fixed", ib.Noise(6e-2, 4e-4, 3e-6))
    other = campaign_of({"tumble": loud, "centrifuge": loud})
    with pytest.raises(InputError, match="another study"):
        sample(other.summary, other.rows, other.sd, method="full", limits=replace(limits, resume=True))


def test_given_noise_is_given_to_the_chains_and_to_the_evidence_alike(given):
    """Three times too small a noise is taken at its word by both."""
    found = sample(given.summary, given.rows, given.sd, limits=Limits(seed=1))
    chosen = ib.select(
        given.summary, ScalePrior(given.sd), noises=found.noises, log_evidence=found.chains.log_evidence[0]
    )
    theta = found.chains.theta.reshape(-1, len(given.sd))
    for k, term in enumerate(chosen.terms):
        assert term.full_sd == pytest.approx(theta[:, k].std(), rel=4.0 / math.sqrt(2.0 * len(theta))), (
            term.name
        )
    assert chosen.plug_in == ()


def test_interpolated_density_is_right_where_bias_instability_and_walk_are_strong():
    strong = ib.Noise(6e-4, 12e-4, 3e-5)
    plans = [ib.tumble(angles=12, dwell=20.0, rate=20.0)]
    runs = ib.simulate(SENSOR, plans, seed=3, truth=unit(), noise=strong)
    assert sampled(runs).chains.interpolation_error < 0.5
