"""Draws of the noise against dense normals and quadrature; chains on every row."""

from dataclasses import replace

import numpy as np
import pytest
from campaigns import drifting_log, walkless
from ladders import ground, in_memory_and_streamed, problem
from scipy.stats import multivariate_normal

from imubayes.campaign import SensorSpec
from imubayes.inference.mcmc import at_noise, ensembles, noises_at
from imubayes.inference.mcmc.density import density_of, log_joint
from imubayes.inference.mcmc.ensembles import Limits, Target, run_ensembles
from imubayes.ladder.posteriors import log_density, proposed, weighted
from imubayes.ladder.problem import prepared, problem_of
from imubayes.rig.recordings import RunSpec
from imubayes.sensors.noise import Noise, NoiseRule

NORMAL = Target(
    names=("x", "y"),
    log_prob=lambda c: -0.5 * np.sum(c**2, axis=1),
    moves=((None, 1.0),),
    start=lambda rng, size: rng.standard_normal((size, 2)),
    readable=lambda c: c,
    long=True,
)


def test_probability_of_the_rows_at_a_noise_is_that_of_a_dense_normal():
    ready = prepared(ground(problem(dwell=1.0, rule=NoiseRule("fixed", Noise(6e-4, 0.0, 2e-5)))))
    rows = ready.rows[0]
    N, K = 7e-4, 3e-5
    start = rows.t - rows.t[0] + 0.5 * rows.duration[0]
    walk = K**2 * (np.minimum.outer(start, start) - np.diag(rows.duration) / 6.0)
    X = rows.columns(0, len(rows)) * ready.prior.sd
    cov = np.diag(N**2 / rows.duration) + walk + X @ X.T
    found = at_noise(ready.summary, ready.rows, np.array([[N, 0.0, K]]), ready.prior.sd).log_marginal
    np.testing.assert_allclose(found, multivariate_normal.logpdf(rows.y, cov=cov), rtol=1e-8)


def test_evidence_and_noise_are_those_of_a_quadrature_over_the_noise():
    g = ground(problem(dwell=4.0, rule=NoiseRule("white")))
    ready = prepared(g)
    (median, width) = ready.summary.runs[0].found.steering["N"]
    x = np.log(ready.summary.runs[0].noise.N) + np.linspace(-0.2, 0.2, 81)
    logs = np.array(
        [
            at_noise(ready.summary, ready.rows, noise, ready.prior.sd).log_marginal
            for noise in noises_at(ready.summary.runs, x[:, None])
        ]
    )
    logs += -0.5 * ((x - np.log(median)) / width) ** 2 - np.log(width * np.sqrt(2.0 * np.pi))
    share = np.exp(logs - logs.max())
    evidence, mean = logs.max() + np.log(np.sum(share) * (x[1] - x[0])), np.average(x, weights=share)
    sd = np.sqrt(np.average((x - mean) ** 2, weights=share))
    drawn = weighted(g)
    error = 1.0 / np.sqrt(drawn.count)
    assert abs(drawn.log_evidence - evidence) < 4.0 * error
    assert abs(drawn.weight @ np.log(drawn.noises[:, 0, 0]) - mean) < 4.0 * error * sd


def test_draws_have_the_bias_instability_that_passes_for_a_random_walk_too():
    """The peak has the random walk; beside it a third of the posterior has bias instability alone."""
    gyro, lib, runs = drifting_log(11)
    spec = SensorSpec("gx", "gyroscope", gyro, lib, (RunSpec("static", "static"),), {})
    one = problem_of(spec, runs)
    ready, every = prepared(ground(one)), [weighted(ground(one, seed)) for seed in range(8)]
    density = density_of(ready.summary, ready.rows, ready.prior.sd, np.random.default_rng(1))
    N = np.log(every[0].weight @ every[0].noises[:, 0, 0]) + 0.02 * np.linspace(-3.0, 3.0, 13)
    evidence, expected = walkless(density, N)
    found = [one.weight @ (np.log(one.noises[:, 0, 2]) < -17.0) for one in every]
    assert 0.2 < expected < 0.4
    assert np.mean(found) == pytest.approx(expected, abs=0.12)
    assert np.mean([one.log_evidence for one in every]) == pytest.approx(evidence, abs=0.25)


def test_peak_is_as_wide_as_the_white_noise_of_so_many_rows_leaves_it():
    ready = prepared(ground(problem()))
    (peak, *_), prior = proposed(ready)
    sd = np.sqrt(np.diag(peak.L @ peak.L.T))
    n = ready.summary.factor.n
    # drift takes some of what the rows say of N, never adds to it; B and K are no better known than N
    assert 1.0 <= sd[0] * np.sqrt(2.0 * n) < 3.0
    assert (sd[1:] > sd[0]).all()
    assert (sd <= prior[:, 1] * (1.0 + 1e-9)).all()


def test_a_streamed_run_tells_its_white_noise_as_well_as_its_rows_in_memory(tmp_path):
    one = in_memory_and_streamed(tmp_path, 4000)[1]
    runs = tuple(replace(run, noise=NoiseRule("white")) for run in one.spec.runs)
    (peak,), _ = proposed(prepared(ground(replace(one, spec=replace(one.spec, runs=runs)))))
    np.testing.assert_allclose(peak.L, 1.0 / np.sqrt(2.0 * 4000.0), rtol=1e-12)


def _given(noise: Noise):
    ready = prepared(ground(problem(dwell=4.0, rule=NoiseRule("fixed", noise))))
    return ready, density_of(ready.summary, ready.rows, ready.prior.sd, np.random.default_rng(1))


def test_log_density_of_all_rows_is_that_of_the_factor_where_the_noise_is_known():
    ready, density = _given(Noise(6e-4, 4e-4, 3e-6))
    phi = 2.0 * np.random.default_rng(2).standard_normal((5, density.p))
    known = np.empty((1, 0))
    expected = [float(log_joint(density, row[None], known)[0]) for row in phi]
    np.testing.assert_allclose(log_density(ready, density)(phi), expected, rtol=1e-10)


def test_log_density_of_rows_that_are_read_in_parts_is_that_of_the_same_rows_in_memory(tmp_path):
    whole, part = (prepared(ground(one)) for one in in_memory_and_streamed(tmp_path, 20_000))
    density = density_of(whole.summary, whole.rows, whole.prior.sd, np.random.default_rng(1))
    rng = np.random.default_rng(4)
    x = density.runs[0].top + np.array([0.02, 0.5, 1.0]) * rng.standard_normal((6, 3))
    c = np.column_stack((rng.standard_normal((6, density.p)), x))
    # rows are all that differs: processes and coordinates are those of the noise as it is found in memory
    streamed = replace(part, summary=whole.summary)
    assert part.rows[0].stream is not None
    assert len(part.rows[0]) < part.rows[0].samples == len(whole.rows[0]) == 20_000
    np.testing.assert_allclose(log_density(streamed, density)(c), log_density(whole, density)(c), rtol=1e-9)


def test_log_density_of_all_rows_is_interpolated_to_what_the_chains_say():
    ready = prepared(ground(problem()))
    density = density_of(ready.summary, ready.rows, ready.prior.sd, np.random.default_rng(1))
    rng = np.random.default_rng(4)
    x = density.runs[0].top + np.array([0.02, 0.1, 0.5]) * rng.standard_normal((6, 3))
    phi = rng.standard_normal((6, density.p))
    apart = log_density(ready, density)(np.column_stack((phi, x))) - log_joint(density, phi, x)
    # polynomials that are right to a hundredth of a nat, each way
    assert np.max(np.abs(apart - np.median(apart))) < 0.1


def test_chains_say_whether_their_steps_are_enough(monkeypatch):
    monkeypatch.setattr(ensembles, "TURN", 100)
    short = run_ensembles(NORMAL, Limits(ess=10.0, time_limit=0.0, seed=1))
    assert not short.found.converged
    assert "steps are fewer than 50 autocorrelation times" in short.found.text
    done = run_ensembles(NORMAL, Limits(ess=100.0, time_limit=60.0, seed=1))
    assert done.found.converged
    assert done.found.text == "every parameter has mixed"
    assert len(done.chains[0]) >= 50.0 * done.found.tau.max()
