from dataclasses import replace

import numpy as np
import pytest
from fleet_studies import fleet

from imubayes.population.fleet import ALARM, answer
from imubayes.population.tally import Tally
from imubayes.population.terms import lot_sizes, spread


def _tally(estimate: np.ndarray, variance: np.ndarray, rng: np.random.Generator) -> Tally:
    n, p = estimate.shape
    counts = np.zeros((6, p), dtype=np.int64)
    counts[0, 0], counts[2] = n, n
    counts[2, 0] = 0
    return Tally(
        counts=counts,
        names=tuple(f"u{k}" for k in range(n)),
        estimate=estimate,
        variance=variance,
        order=np.arange(n),
        noise=np.exp(0.1 * rng.standard_normal((n, 3))) * 1e-3,
        samples=n,
        broken=(),
    )


def _alike(n: int, rng: np.random.Generator):
    """Units of one population, in sizes that the class may have, each known to a third of the spread."""
    study = fleet(n)
    low, high = lot_sizes(study.sensor_class, study.spec.library)
    tau = np.sqrt(low * high)
    sd = tau / 3.0 * np.ones((n, 1))
    estimate = tau * rng.standard_normal((n, len(tau))) + sd * rng.standard_normal((n, len(tau)))
    return study, estimate, sd**2


def test_population_is_the_hierarchical_posterior_of_each_term():
    rng = np.random.default_rng(1)
    study, estimate, variance = _alike(40, rng)
    found = answer(_tally(estimate, variance, rng), study, None)
    low, high = lot_sizes(study.sensor_class, study.spec.library)
    for j, term in enumerate(found.terms):
        own = spread(estimate[:, j], variance[:, j], (low[j] / np.sqrt(2.0), high[j]))
        assert (term.mean, term.spread) == (own.mean, own.spread)
    assert (found.terms[0].needed.value, found.terms[0].open, found.terms[1].open) == (1.0, 0.0, 1.0)
    assert found.order.value == pytest.approx(19.5)
    assert np.isnan(found.terms[0].true_mean)


def test_unit_that_is_off_is_named_with_its_term_and_only_that_unit():
    rng = np.random.default_rng(2)
    study, estimate, variance = _alike(100, rng)
    tau = float(np.sqrt(10.0 * variance[0, 3]))
    estimate[17, 3] = 12.0 * tau
    found = answer(_tally(estimate, variance, rng), study, None)
    assert found.outliers == 1
    first = found.worst[0]
    assert (first.unit, first.term, first.outlier) == ("u17", study.spec.library.names[3], True)
    # 12 spreads off, of a population that the unit itself widens by (1 + 144 / 100)^(1/2) at most
    assert 12.0 / np.sqrt(2.5) < first.pull < 12.0
    assert [one.outlier for one in found.worst[1:]] == [False] * 19


def test_unit_that_is_noisy_is_named():
    rng = np.random.default_rng(3)
    study, estimate, variance = _alike(60, rng)
    whole = _tally(estimate, variance, rng)
    noise = whole.noise.copy()
    noise[5, 0] *= 3.0
    found = answer(replace(whole, noise=noise), study, None)
    assert (found.worst[0].unit, found.worst[0].term) == ("u5", "N")
    assert found.worst[0].outlier
    assert found.worst[0].value == noise[5, 0]


def test_fleets_of_units_that_are_alike_have_no_outlier_as_often_as_they_say():
    rng, fleets = np.random.default_rng(4), 40
    alarms = 0
    for _ in range(fleets):
        study, estimate, variance = _alike(50, rng)
        alarms += answer(_tally(estimate, variance, rng), study, None).outliers > 0
    # mean and spread of 50 units are themselves uncertain, which lengthens the tails: a few times the nominal
    assert alarms <= 5.0 * ALARM * fleets + 4.0 * np.sqrt(5.0 * ALARM * fleets)
