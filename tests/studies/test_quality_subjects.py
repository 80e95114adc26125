import numpy as np
import pytest

from imubayes.rig.bench import true_inputs
from imubayes.sensors.terms import columns, library
from studies.decision_quality.subjects import runs_of, subject


def test_number_of_true_terms_is_uniform():
    # the beta-binomial model prior with a uniform share: every size from 0 to p is equally likely
    lib = library("accelerometer", powers=1, asymmetry=-1)
    drawn = [subject(lib, k, seed=3) for k in range(1500)]
    assert all(one.truth[name] == one.truth[leader] for one in drawn for name, leader in one.library.tied)
    sizes = [sum(one.truth[name] != 0.0 for name in {*one.library.carriers}) for one in drawn]
    p = len({*drawn[0].library.carriers})
    expected = len(sizes) / (p + 1)
    chi2 = float(np.sum((np.bincount(sizes, minlength=p + 1) - expected) ** 2) / expected)
    assert abs(chi2 - p) < 4.0 * np.sqrt(2.0 * p)


@pytest.mark.parametrize("kind", ["accelerometer", "gyroscope"])
def test_misplaced_reference_changes_the_output_by_what_it_applies_alone(kind):
    one = subject(library(kind), 0, seed=5)
    theta = np.array(list(one.truth.values()))
    for right, wrong, plan in zip(runs_of(one), runs_of(one, misplaced=True), one.plans, strict=True):
        true = true_inputs(plan, one.errors)
        told, applied = plan.inputs.channels, true.channels
        n = len(true)
        own = applied.get(one.library.own, np.zeros(n)) - told.get(one.library.own, np.zeros(n))
        more = (columns(one.library, applied, n) - columns(one.library, told, n)) @ theta
        assert wrong.inputs is plan.inputs
        size = np.abs(right.output).max()
        np.testing.assert_allclose(wrong.output - right.output, own + more, atol=1e-12 * size)


def test_errors_of_the_reference_have_the_catalogues_size():
    lib = library("accelerometer")
    sizes = np.array([list(subject(lib, k, seed=2).errors.values()) for k in range(300)])
    arcsec = np.pi / 180.0 / 3600.0
    assert sizes.shape == (300, 3)
    # 2 arcsec; the sd of 900 normal numbers is known to 1/sqrt(1800)
    assert abs(sizes.std() / (2.0 * arcsec) - 1.0) < 4.0 / np.sqrt(1800.0)
