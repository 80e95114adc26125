from dataclasses import replace

import numpy as np
import pytest
from fleet_studies import TUMBLE, first_part, fleet, recorded
from lot_studies import record

from imubayes import population as records
from imubayes.algebra.factor import posterior
from imubayes.campaign.preparation import prepare
from imubayes.errors import StudyError
from imubayes.inference.mcmc import at_found_noise
from imubayes.inference.prior import class_sd
from imubayes.population import Broken, Record, of_terms, part_found, parts_of, simulate_unit, unit_record
from imubayes.population.fleet import ALARM, together
from imubayes.population.levels import Version
from imubayes.population.spreads import population, spread
from imubayes.rig import streams
from imubayes.rig.recordings import RunSpec
from imubayes.sensors.catalogue import coupled
from imubayes.sensors.lots import draw_lot, lot_sizes
from imubayes.sensors.noise import Noise, NoiseRule
from imubayes.work import silent

KNOWN = NoiseRule("fixed", Noise(1e-3, 0.0, 0.0))

OSCILLATING = replace(
    fleet().spec,
    runs=(
        RunSpec(
            "tumble",
            "tumble",
            simulate={"profile": "tumble", "angles": 12, "planes": 3, "dwell": 10.0, "rate": 0.5},
        ),
    ),
    reference={"plane_zero": 1e-4, "gravity": 1e-5},
)


def _lot(study):
    return draw_lot(study.sensor_class, study.spec.library, len(study.units), np.random.default_rng([5, 0]))


def test_factor_of_the_terms_has_their_posterior_with_the_benchs_errors_integrated_out():
    study = fleet(2)
    spec = replace(OSCILLATING, truth=_lot(study).truth(0))
    runs = simulate_unit(spec, _lot(study), 0, np.random.default_rng(1))
    ready = prepare(spec, runs, silent, np.random.default_rng(2))
    p = len(spec.library.terms)
    assert len(ready.summary.names) > p
    whole = posterior(at_found_noise(ready.summary, ready.prior).factor, ready.prior.sd)
    alone = posterior(of_terms(ready.summary, ready.prior), ready.prior.sd[:p])
    for mine, theirs, sd in zip(alone, whole, (alone[1], alone[1]), strict=True):
        # in sds: a tumble leaves combinations open that only the prior holds
        np.testing.assert_allclose((mine - theirs[:p]) / sd, 0.0, atol=1e-7)


def test_fault_in_one_unit_leaves_the_others(monkeypatch):
    study, usual = fleet(3), records.unit_record

    def faulty(study, unit):
        if unit.number == 1:
            raise StudyError("no such thing")
        if unit.number == 2:
            raise ZeroDivisionError("oh")
        return usual(study, unit)

    monkeypatch.setattr(records, "unit_record", faulty)
    found = part_found(study, first_part(study))
    assert [isinstance(one, Broken) for one in found] == [False, True, True]
    assert [(one.number, one.error.partition(";")[0]) for one in found[1:]] == [
        (1, "no such thing"),
        (2, "ZeroDivisionError: oh"),
    ]
    assert "fault of imubayes" in found[2].error
    bare = fleet(3, spec=replace(study.spec, runs=(RunSpec("x", "tumble"),)))
    with pytest.raises(StudyError, match="'x'"):
        usual(bare, first_part(bare)[0])


def test_random_numbers_of_recorded_units_hang_on_their_names_and_differ(tmp_path, monkeypatch):
    study, drawn = recorded(tmp_path, ("A1", "A2")), dict[tuple[str, int], float]()

    def note(spec, runs, tell, rng):
        drawn[spec.id, len(drawn)] = rng.random()
        return prepare(spec, runs, tell, rng)

    monkeypatch.setattr(records, "prepare", note)
    (part,) = parts_of(study, None)
    for unit in (*part, replace(part[0], number=7)):
        unit_record(study, unit)
    assert drawn["A1", 0] == drawn["A1", 2] != drawn["A2", 1]


def test_long_file_of_a_unit_is_read_a_part_at_a_time_and_says_the_same(tmp_path, monkeypatch):
    fast = replace(TUMBLE, simulate={**(TUMBLE.simulate or {}), "rate": 50.0})
    study = recorded(tmp_path, ("A1", "A2"), fast)
    study = replace(study, spec=replace(study.spec, runs=(replace(study.spec.runs[0], noise=KNOWN),)))
    (part,) = parts_of(study, None)
    # a filter is looked for in a stretch without a gap, which of a file in parts is one dwell of these twelve
    monkeypatch.setattr("imubayes.rig.runs.as_means", lambda run, kind: run)
    whole = unit_record(study, part[0])
    monkeypatch.setattr(streams, "STREAMED", 1000)
    streamed = unit_record(study, part[0])
    assert streamed.samples == whole.samples == 6000
    assert streamed.verdicts == whole.verdicts
    np.testing.assert_allclose((streamed.full_mean - whole.full_mean) / whole.full_sd, 0.0, atol=1e-4)
    # of 6000 rows, ten stand for columns that were not excited; whether they count for the noise is open
    np.testing.assert_allclose(streamed.full_sd / whole.full_sd, 1.0, rtol=1e-2)


def _units(estimate: np.ndarray, sd: np.ndarray, rng: np.random.Generator) -> list[Record]:
    """Units that need their first term, every second one the last too; of the second term none can tell."""
    n, p = estimate.shape
    noise = np.exp(0.1 * rng.standard_normal((n, 3))) * 1e-3
    said = ["needed", "inseparable", *["not needed"] * (p - 3)]
    return [
        record(
            np.zeros(p),
            number=k,
            name=f"u{k}",
            full_mean=estimate[k],
            full_sd=sd[k],
            verdicts=(*said, "needed" if k % 2 else "untested"),
            noise=tuple(noise[k].tolist()),
            samples=k,
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
    found = together(_units(estimate, sd, rng), study, None)
    low, high = lot_sizes(study.sensor_class, study.spec.library)
    lib = coupled(study.spec.library, study.sensor_class)
    for j, (term, carrier) in enumerate(zip(found.terms, lib.carriers, strict=True)):
        k = lib.names.index(carrier)  # the terms of a lever arm have one coefficient
        told = Version(1.0, estimate[:, k], sd[:, k] ** 2, 0.0)
        own = spread([told], (low[j] / np.sqrt(2.0), high[j]))
        np.testing.assert_allclose((term.mean, term.spread), own, rtol=1e-9, atol=1e-9 * own[1].value)
    assert (found.terms[0].needed.value, found.terms[0].open, found.terms[1].open) == (1.0, 0.0, 1.0)
    assert found.order.value == pytest.approx(1.5)
    assert (found.units, found.samples) == (40, sum(range(40)))
    assert found.counts.sum(axis=0).tolist() == [40] * len(found.terms)
    assert found.counts[:, [0, 1, -1]].T.tolist() == [[40, *[0] * 5], [0, 0, 0, 40, 0, 0], [20, *[0] * 4, 20]]
    assert np.isnan(found.terms[0].true_mean)


def test_a_prior_of_the_study_says_how_large_its_lots_may_be():
    rng = np.random.default_rng(3)
    study, estimate, sd = _alike(40, rng)
    entry, lib = study.sensor_class, study.spec.library
    estimate[:, 0] *= 30.0
    units = [_units(estimate, sd, rng)]
    usual = class_sd(entry, lib)[0]
    wide, narrow = (
        population(units, entry, lib, (), prior)[0].spread for prior in ({"b0": 30.0 * usual}, {})
    )
    assert wide.low < float(np.std(estimate[:, 0])) < wide.high
    assert narrow.high <= lot_sizes(entry, lib)[1][0]


def test_units_may_be_more_alike_than_those_of_any_lot_of_the_class():
    """Of units a tenth of the least spread of a lot apart, by tests 500 times finer, and of equal ones."""
    rng, sizes, error, n = np.random.default_rng(4), (1.0, 30.0), 2e-3, 20
    variance, hits = np.full(n, error**2), 0
    for _ in range(200):
        said = 0.1 * rng.normal(size=n) + error * rng.normal(size=n)
        low, high = spread([Version(1.0, said, variance, 0.0)], sizes)[1][1:]
        hits += low < 0.1 < high
    assert 0.84 <= hits / 200 <= 0.96
    for shared in (0.0, 10.0):
        said = shared + error * rng.normal(size=n)
        mean, alike = spread([Version(1.0, said, variance, 0.0)], sizes)
        assert alike.high < 2.0 * error
        assert abs(mean.value - shared) < error


def test_units_that_are_off_or_noisy_are_named_with_their_term_and_no_others():
    rng = np.random.default_rng(2)
    study, estimate, sd = _alike(100, rng)
    estimate[17, 3] = 12.0 * float(np.sqrt(10.0) * sd[0, 3])
    units = _units(estimate, sd, rng)
    units[5] = replace(units[5], noise=(3.0 * units[5].noise[0], *units[5].noise[1:]))
    found = together(units, study, None)
    assert found.outliers == 2 and [one.outlier for one in found.worst] == [True] * 2 + [False] * 18
    worst = {one.unit: one for one in found.worst[:2]}
    assert (worst["u17"].term, worst["u5"].term) == (study.spec.library.names[3], "N")
    assert worst["u5"].value == units[5].noise[0]
    # 12 spreads off, of a population that the unit itself widens by (1 + 144 / 100)^(1/2) at most
    assert 12.0 / np.sqrt(2.5) < worst["u17"].pull < 12.0


def test_fleets_of_units_that_are_alike_have_no_outlier_as_often_as_they_say():
    rng, fleets = np.random.default_rng(4), 20
    alarms = 0
    for _ in range(fleets):
        study, estimate, sd = _alike(50, rng)
        alarms += together(_units(estimate, sd, rng), study, None).outliers > 0
    # mean and spread of 50 units are themselves uncertain, which lengthens the tails: a few times the nominal
    assert alarms <= 5.0 * ALARM * fleets + 4.0 * np.sqrt(5.0 * ALARM * fleets)
