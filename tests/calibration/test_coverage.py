"""Over sensors drawn from the prior, with noise drawn from the class: does 90 % mean 90 %?

Each sensor has a random share of the terms (as the beta-binomial model prior says), coefficients from the
physical prior, and N, B, K from the class's log-normal; the analysis knows the class and nothing else.
"""

import itertools
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest

import imubayes as ib
from imubayes.sensors.noise import noise_prior

CASES = (("accelerometer", "mems_industrial"), ("accelerometer", "mems_tactical"),
         ("gyroscope", "mems_tactical"), ("gyroscope", "fog_navigation"))  # fmt: skip
SENSORS_PER_CASE = 55
RATES = np.radians([0.0, 10.0, 50.0, 150.0, 300.0, -10.0, -50.0, -150.0, -300.0])
EDGES = (0.0, 0.02, 0.1, 0.3, 0.5, 0.7, 0.9, 0.98, 1.0 + 1e-12)


def plans(kind):
    if kind == "gyroscope":
        return [ib.rate_table(RATES, dwell=30.0, rate=2.0)]
    return [ib.tumble(angles=24, dwell=30.0, rate=2.0), ib.centrifuge([1, 5, 20], dwell=30.0, rate=2.0)]


def characterise(job):
    index, kind, class_id = job
    rng = np.random.default_rng([20_261_121, index])
    sensor, library = ib.sensor(class_id, kind=kind), ib.library(kind)
    prior = ib.prior(sensor, library)
    inside = rng.random(len(prior.sd)) < rng.random()
    truth = np.where(inside, rng.standard_normal(len(prior.sd)) * prior.sd, 0.0)
    noise = ib.Noise(
        *(median * np.exp(spread * rng.standard_normal()) for median, spread in noise_prior(sensor).values())
    )
    values = dict(zip(library.names, truth.tolist(), strict=True))
    runs = ib.simulate(sensor, plans(kind), seed=rng, truth=values, noise=noise)
    selection = ib.select(ib.summarize(runs, library, sensor=sensor), prior)
    return [(values[term.name], term) for term in selection.terms if term.verdict != "untested"]


@pytest.fixture(scope="module")
def outcomes():
    """Every true coefficient, and what was said of it."""
    jobs = [(i, *CASES[i % len(CASES)]) for i in range(SENSORS_PER_CASE * len(CASES))]
    with ProcessPoolExecutor(2) as pool:
        return list(itertools.chain.from_iterable(pool.map(characterise, jobs, chunksize=5)))


@pytest.mark.slow
def test_intervals_of_the_full_library_cover_at_their_level(outcomes):
    inside = [abs(term.full_mean - truth) < 1.6449 * term.full_sd for truth, term in outcomes]
    assert 0.86 < np.mean(inside) < 0.94


@pytest.mark.slow
def test_model_averaged_intervals_cover_at_least_at_their_level(outcomes):
    # a point mass at zero covers more than it must, never less
    assert np.mean([term.q05 <= truth <= term.q95 for truth, term in outcomes]) > 0.86


@pytest.mark.slow
@pytest.mark.parametrize(("low", "high"), list(itertools.pairwise(EDGES)))
def test_inclusion_probability_is_frequency_of_truth(outcomes, low, high):
    inside = [(truth != 0.0, term.inclusion) for truth, term in outcomes if low <= term.inclusion < high]
    truth, q = np.array(inside).T
    assert len(inside) > 50
    # binomial spread, doubled because terms of one sensor share its noise and its model size
    spread = np.sqrt(2.0 * np.sum(q * (1.0 - q)) + 1.0)
    assert abs(np.sum(truth - q)) < 3.5 * spread


@pytest.mark.slow
def test_no_zero_term_is_needed_and_no_strong_one_is_missed(outcomes):
    zeros = [term.verdict == "needed" for truth, term in outcomes if truth == 0.0]
    strong = [term.verdict != "needed" for truth, term in outcomes if abs(truth) > 8.0 * term.full_sd]
    assert np.mean(zeros) < 0.01
    assert np.mean(strong) < 0.01
