import numpy as np

from imubayes.inference.mcmc.engine import Target
from imubayes.inference.mcmc.ensembles import Limits
from imubayes.ladder.sampled import run_slowly

NORMAL = Target(
    names=("x", "y"),
    log_prob=lambda c: -0.5 * np.sum(c**2, axis=1),
    moves=(("stretch", None, 1.0),),
    start=lambda rng, size: rng.standard_normal((size, 2)),
    readable=lambda c: c,
)


def test_chains_that_are_cut_short_say_that_their_steps_are_too_few():
    done = run_slowly(NORMAL, Limits(ess=10.0, time_limit=0.0, seed=1), lambda message: None)
    assert not done.converged
    assert "steps are fewer than 50 autocorrelation times" in done.text


def test_chains_that_are_long_enough_say_so():
    done = run_slowly(NORMAL, Limits(ess=400.0, time_limit=60.0, seed=1), lambda message: None)
    assert done.converged
    assert done.text == "every parameter has mixed"
    assert len(done.chains[0]) >= 50.0 * done.tau.max()
