from dataclasses import replace

import numpy as np
import pytest
from lot_studies import TUMBLE, small

from imubayes.algebra.factor import noise_scale
from imubayes.campaign.preparation import prepare
from imubayes.inference.at_noise import at_found_noise
from imubayes.inference.linear import linear_of
from imubayes.inference.prior import class_sd
from imubayes.population.lots import lot_of, spec_of, unit_of
from imubayes.population.records import simulate_unit
from imubayes.selection.decision import LOOSE, loose_fit, select
from imubayes.sensors.catalogue import coupled
from imubayes.sensors.noise import Noise

STUDY = small()
LOT = lot_of(STUDY, 0)
SPEC = replace(spec_of(STUDY, LOT.sensor_class), library=STUDY.library, truth=LOT.truth(0))


@pytest.fixture(scope="module")
def ready():
    runs = simulate_unit(SPEC, LOT, 0, np.random.default_rng(1))
    return prepare(SPEC, runs, lambda message: None, np.random.default_rng(2))


def test_estimates_without_shrinkage_are_ridge_regression_with_the_bench_held_to_its_prior(ready):
    """By the singular values of scaled columns; the condition, below 1e6, takes six digits of sixteen."""
    summary, prior = ready.summary, ready.prior
    mean, cov = loose_fit(summary, prior)
    p, scale = len(STUDY.library.terms), noise_scale(summary.factor, prior.sd)
    sd = prior.sd * np.where(np.arange(len(prior.sd)) < p, LOOSE, 1.0)
    assert summary.extras
    rows = np.vstack((summary.factor.R[:, :-1], np.diag(scale / sd)))
    size = np.linalg.norm(rows, axis=0)
    U, s, Vt = np.linalg.svd(rows / size, full_matrices=False)
    root = Vt.T / s / size[:, None]
    seen = np.concatenate((summary.factor.R[:, -1], np.zeros(len(sd))))
    np.testing.assert_allclose(mean, root @ (U.T @ seen), rtol=1e-8, atol=1e-8 * np.abs(mean).max())
    np.testing.assert_allclose(np.diag(cov), scale**2 * np.sum(root**2, axis=1), rtol=1e-8)
    np.testing.assert_allclose(cov, cov.T, rtol=1e-12)


def test_a_noise_that_is_held_hardly_moves_an_inclusion(ready):
    held = select(ready.summary, ready.prior, noises=(at_found_noise(ready.summary, ready.prior),))
    averaged = select(ready.summary, ready.prior)
    inclusions = np.array([[term.inclusion for term in one.terms] for one in (held, averaged)])
    # n rows know the scale to 1/sqrt(2 n), here 3 %, and log odds of a term near one half, of about 3, to 0.2
    np.testing.assert_allclose(inclusions[0], inclusions[1], atol=0.07)
    assert held.log_evidence == pytest.approx(averaged.log_evidence, abs=5.0)


def test_truths_lie_within_what_the_test_says_of_them():
    """Squares of the standardised errors of all terms of a unit are chi-squared of its degrees."""
    study = small(units=6)
    lot = lot_of(study, 0)
    lib, sizes = coupled(study.library, study.classes[0]), []
    own = [name == carrier for name, carrier in zip(lib.names, lib.carriers, strict=True)]
    for number in range(6):
        unit = unit_of(study, 0, number, lot)
        # untested terms have a prior a thousand times as wide as they are
        left = (unit.full_mean - unit.truth)[own]
        loose = np.diag(1.0 / (LOOSE * class_sd(study.classes[0], lib)) ** 2)
        cov = np.linalg.inv(unit.R[:-1, :-1].T @ unit.R[:-1, :-1] + loose)
        sizes.append(float(left @ np.linalg.solve(cov[np.ix_(own, own)], left)))
    p = sum(own)
    assert 0.3 * p < np.mean(sizes) < p + 4.0 * np.sqrt(2.0 * p / 6.0)


def test_errors_of_the_bench_move_the_output_and_not_what_the_rig_says():
    study = small(runs=(TUMBLE,), reference={"gravity": 1.0, "turn_on": 100.0})
    lot = replace(LOT, noise=tuple(Noise(0.0, 0.0, 0.0) for _ in LOT.noise), theta=np.zeros_like(LOT.theta))
    (run,) = simulate_unit(
        replace(spec_of(study, lot.sensor_class), truth=lot.truth(0)), lot, 0, np.random.default_rng(4)
    )
    own = linear_of(run, study.library)
    drawn = np.random.default_rng(4).standard_normal(2) * [1.0, 100.0]
    up = run.inputs.channels["f_i"] / 9.80665
    np.testing.assert_allclose(own.y, drawn[0] * up + drawn[1], atol=1e-9)


def test_units_differ_and_each_is_the_same_whenever_it_is_tested():
    first, again, second = (unit_of(STUDY, 0, number, LOT) for number in (0, 0, 1))
    np.testing.assert_array_equal(first.draws, again.draws)
    assert (first.name, first.number) == ("mems_tactical", 0)
    excited = np.array(first.verdicts) != "untested"
    assert not np.any(first.full_mean[excited] == second.full_mean[excited])
    np.testing.assert_array_equal(second.truth, LOT.theta[1])
