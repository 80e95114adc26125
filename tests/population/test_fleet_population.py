from dataclasses import replace

import numpy as np
import pytest
from fleet_studies import fleet

from imubayes.population.fleet import ALARM, answer
from imubayes.population.records import Record
from imubayes.population.spreads import lot_sizes, spread


def _units(estimate: np.ndarray, sd: np.ndarray, rng: np.random.Generator) -> list[Record]:
    """Units that need their first term, every second one the last too; of the second term none can tell."""
    n, p = estimate.shape
    noise = np.exp(0.1 * rng.standard_normal((n, 3))) * 1e-3
    nothing = np.zeros(p)
    said = ["needed", "inseparable", *["not needed"] * (p - 3)]
    return [
        Record(
            number=k,
            name=f"u{k}",
            mean=nothing,
            sd=nothing,
            full_mean=estimate[k],
            full_sd=sd[k],
            inclusion=nothing,
            verdicts=(*said, "needed" if k % 2 else "untested"),
            noise=tuple(noise[k].tolist()),
            samples=k,
            R=np.eye(p + 1),
            truth=nothing,
        )
        for k in range(n)
    ]


def _alike(n: int, rng: np.random.Generator):
    """Units of one population, in sizes that the class may have, each known to a third of the spread."""
    study = fleet(n)
    low, high = lot_sizes(study.sensor_class, study.spec.library)
    tau = np.sqrt(low * high)
    sd = np.tile(tau / 3.0, (n, 1))
    estimate = tau * rng.standard_normal((n, len(tau))) + sd * rng.standard_normal((n, len(tau)))
    return study, estimate, sd


def test_population_is_the_hierarchical_posterior_of_each_term():
    rng = np.random.default_rng(1)
    study, estimate, sd = _alike(40, rng)
    found = answer(_units(estimate, sd, rng), study, None)
    low, high = lot_sizes(study.sensor_class, study.spec.library)
    for j, term in enumerate(found.terms):
        own = spread(estimate[:, j], sd[:, j] ** 2, (low[j] / np.sqrt(2.0), high[j]))
        assert (term.mean, term.spread) == own
    assert (found.terms[0].needed.value, found.terms[0].open, found.terms[1].open) == (1.0, 0.0, 1.0)
    assert found.order.value == pytest.approx(1.5)
    assert (found.units, found.samples) == (40, sum(range(40)))
    assert found.counts.sum(axis=0).tolist() == [40] * len(found.terms)
    assert found.counts[:, [0, 1, -1]].T.tolist() == [[40, *[0] * 5], [0, 0, 0, 40, 0, 0], [20, *[0] * 4, 20]]
    assert np.isnan(found.terms[0].true_mean)


def test_unit_that_is_off_is_named_with_its_term_and_only_that_unit():
    rng = np.random.default_rng(2)
    study, estimate, sd = _alike(100, rng)
    tau = float(np.sqrt(10.0) * sd[0, 3])
    estimate[17, 3] = 12.0 * tau
    found = answer(_units(estimate, sd, rng), study, None)
    assert found.outliers == 1
    first = found.worst[0]
    assert (first.unit, first.term, first.outlier) == ("u17", study.spec.library.names[3], True)
    # 12 spreads off, of a population that the unit itself widens by (1 + 144 / 100)^(1/2) at most
    assert 12.0 / np.sqrt(2.5) < first.pull < 12.0
    assert [one.outlier for one in found.worst[1:]] == [False] * 19


def test_unit_that_is_noisy_is_named():
    rng = np.random.default_rng(3)
    study, estimate, sd = _alike(60, rng)
    units = _units(estimate, sd, rng)
    units[5] = replace(units[5], noise=(3.0 * units[5].noise[0], *units[5].noise[1:]))
    found = answer(units, study, None)
    assert (found.worst[0].unit, found.worst[0].term) == ("u5", "N")
    assert found.worst[0].outlier
    assert found.worst[0].value == units[5].noise[0]


def test_fleets_of_units_that_are_alike_have_no_outlier_as_often_as_they_say():
    rng, fleets = np.random.default_rng(4), 40
    alarms = 0
    for _ in range(fleets):
        study, estimate, sd = _alike(50, rng)
        alarms += answer(_units(estimate, sd, rng), study, None).outliers > 0
    # mean and spread of 50 units are themselves uncertain, which lengthens the tails: a few times the nominal
    assert alarms <= 5.0 * ALARM * fleets + 4.0 * np.sqrt(5.0 * ALARM * fleets)
