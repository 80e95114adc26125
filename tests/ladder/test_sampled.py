import numpy as np
from ladders import ground, problem

from imubayes.inference.mcmc.density import condition, density_of, log_joint
from imubayes.inference.mcmc.ensembles import Limits, Target
from imubayes.ladder.problem import prepared
from imubayes.ladder.sampled import log_density, run_slowly
from imubayes.progress import silent
from imubayes.sensors.noise import Noise, NoiseRule

NORMAL = Target(
    names=("x", "y"),
    log_prob=lambda c: -0.5 * np.sum(c**2, axis=1),
    moves=(("stretch", None, 1.0),),
    start=lambda rng, size: rng.standard_normal((size, 2)),
    readable=lambda c: c,
)


def _given(noise: Noise):
    ready = prepared(ground(problem(dwell=4.0, rule=NoiseRule("fixed", noise))))
    return ready, density_of(ready.summary, ready.rows, ready.prior.sd, np.random.default_rng(1))


def test_log_density_of_all_rows_is_that_of_the_factor_where_the_noise_is_known():
    ready, density = _given(Noise(6e-4, 4e-4, 3e-6))
    phi = 2.0 * np.random.default_rng(2).standard_normal((5, density.p))
    known = condition(density, np.empty((1, 0)))
    expected = [float(log_joint(density, known, row[None])[0]) for row in phi]
    np.testing.assert_allclose(log_density(ready, density)(phi), expected, rtol=1e-10)


def test_log_density_of_all_rows_is_interpolated_to_what_the_chains_say():
    ready = prepared(ground(problem()))
    density = density_of(ready.summary, ready.rows, ready.prior.sd, np.random.default_rng(1))
    rng = np.random.default_rng(4)
    x = density.runs[0].top + np.array([0.02, 0.1, 0.5]) * rng.standard_normal((6, 3))
    phi = rng.standard_normal((6, density.p))
    apart = log_density(ready, density)(np.column_stack((phi, x))) - log_joint(
        density, condition(density, x), phi
    )
    # polynomials that are right to a hundredth of a nat, each way
    assert np.max(np.abs(apart - np.median(apart))) < 0.1


def test_chains_that_are_cut_short_say_that_their_steps_are_too_few():
    done = run_slowly(NORMAL, Limits(ess=10.0, time_limit=0.0, seed=1), silent)
    assert not done.found.converged
    assert "steps are fewer than 50 autocorrelation times" in done.found.text


def test_chains_that_are_long_enough_say_so():
    done = run_slowly(NORMAL, Limits(ess=100.0, time_limit=60.0, seed=1), silent)
    assert done.found.converged
    assert done.found.text == "every parameter has mixed"
    assert len(done.chains[0]) >= 50.0 * done.found.tau.max()
