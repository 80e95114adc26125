"""Each fault of a test is where it should be in what a sensor says, and nowhere in what the rig says."""

import math
from dataclasses import replace

import numpy as np
import pytest

from imubayes.sensors.noise import Noise
from imubayes.sensors.terms import library
from studies.decision_quality import faults
from studies.decision_quality.subjects import as_read, runs_of, subject, walked

KINDS = ("accelerometer", "gyroscope")


def said(kind, treatment, number=0):
    """A sensor, what it says without the fault, and with it, in noise sds, and the input of each row."""
    one = subject(library(kind), number, seed=5)
    right, wrong = runs_of(one), runs_of(one, treatment)
    assert all(run.inputs is plan.inputs for run, plan in zip(wrong, one.plans, strict=True))
    good, bad = (np.concatenate([run.output for run in runs]) / one.sigma for runs in (right, wrong))
    return one, good, bad, np.concatenate([one.own(plan) for plan in one.plans])


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("treatment", faults.FAULTS)
def test_every_fault_changes_what_a_sensor_says(kind, treatment):
    one, good, bad, _ = said(kind, treatment)
    assert (np.abs(bad - good).max() > 1.0) == faults.applies(one.plans, treatment)


@pytest.mark.parametrize("kind", KINDS)
def test_steps_are_the_last_of_all(kind):
    _, good, bad, _ = said(kind, faults.COARSE)
    np.testing.assert_allclose(bad / 8.0, np.round(bad / 8.0), atol=1e-9)
    assert np.abs(bad - good).max() <= 4.0 + 1e-9


@pytest.mark.parametrize("kind", KINDS)
def test_range_ends_ten_sds_short_of_the_largest_response(kind):
    _, good, bad, _ = said(kind, faults.CLIPPED)
    end = np.abs(bad).max()
    np.testing.assert_allclose(bad, np.clip(good, -end, end))
    assert 5.0 < np.abs(good).max() - end < 60.0


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_at_the_end_of_the_range_is_not_read_and_all_else_is(kind):
    one = subject(library(kind), 0, seed=5)
    for good, bad in zip(runs_of(one), runs_of(one, faults.CLIPPED), strict=True):
        assert as_read(good) is good
        read, at_end = as_read(bad), np.abs(bad.output) == np.abs(bad.output).max()
        assert read.samples == len(read.inputs)
        assert read.samples <= bad.samples - (at_end.sum() if at_end.sum() > 1 else 0)


@pytest.mark.parametrize("kind", KINDS)
def test_mean_of_a_walk_is_that_of_what_it_adds_to_outputs_without_other_noise(kind):
    one = subject(library(kind), 0, seed=5)
    walking, still = (
        np.concatenate([run.output for run in runs_of(replace(one, noise=Noise(0.0, 0.0, K)))])
        for K in (1e-3, 0.0)
    )
    found = walked(replace(one, noise=Noise(0.0, 0.0, 1e-3)))
    assert found == pytest.approx((walking - still).mean(), rel=1e-6)
    assert found != 0.0


@pytest.mark.parametrize("kind", KINDS)
def test_dead_band_gives_nothing_inside_and_less_and_less_is_lost_beyond(kind):
    one, good, bad, x = said(kind, faults.BAND)
    lost = (good - bad) * np.sign(x) * one.sigma
    # coefficients of the response change what is lost by thousandths
    d2 = 2.0 * one.largest / 30.0 * 10.0 * one.sigma - (10.0 * one.sigma) ** 2
    beyond = np.abs(x) > math.sqrt(d2)
    expected = np.abs(x) - np.sqrt(np.clip(x**2 - d2, 0.0, None))
    assert beyond.any()
    np.testing.assert_allclose(lost[beyond], expected[beyond], rtol=0.2, atol=1e-9 * one.largest)


def test_power_that_is_missing_is_of_the_next_order_and_even():
    one, good, bad, x = said("accelerometer", faults.POWER)
    more = (bad - good) * one.sigma / x.clip(1e-9, None) ** 4
    large = x > 0.2 * one.largest
    np.testing.assert_allclose(more[large], more[large][0], rtol=1e-6)
    assert "b4" not in one.library.names


def test_mounts_of_a_centrifuge_are_turned_each_by_itself_about_every_axis():
    one, good, bad, _ = said("accelerometer", faults.MOUNTED)
    off = ((bad - good) * one.sigma)[-len(one.plans[1].inputs) :] / one.largest
    mounts = one.plans[1].inputs.mount
    means = [np.abs(off[mounts == m]).max() for m in np.unique(mounts)]
    assert len(set(np.round(means, 12))) == len(means)
    assert 5.0 < np.max(means) / math.radians(1.0 / 3600.0) < 100.0


def test_radius_scales_what_turning_adds_by_five_typical_errors():
    one, good, bad, x = said("accelerometer", faults.RADIUS)
    most = np.argmax(np.abs(x))
    assert abs((bad - good)[most] * one.sigma / x[most]) == pytest.approx(2.5e-4, rel=0.05)
    tumbled = len(one.plans[0].inputs)
    np.testing.assert_array_equal(bad[:tumbled], good[:tumbled])


@pytest.mark.parametrize("kind", KINDS)
def test_warm_up_falls_by_e_in_a_quarter_of_an_hour_after_each_turn_on(kind):
    one, good, bad, _ = said(kind, faults.WARM)
    first = 0
    for plan in one.plans:
        t = plan.inputs.t - plan.inputs.t[0]
        added = (bad - good)[first : first + len(t)]
        np.testing.assert_allclose(np.abs(added), 10.0 * np.exp(-t / 900.0), atol=1e-6)
        first += len(t)


@pytest.mark.parametrize("kind", KINDS)
def test_noise_grows_with_the_input_and_stays_where_there_is_none(kind):
    _, good, bad, x = said(kind, faults.LEVEL)
    np.testing.assert_allclose((bad - good)[x == 0.0], 0.0, atol=1e-6)
    large = np.abs(x) == np.abs(x).max()
    assert np.std((bad - good)[large]) == pytest.approx(9.0, rel=4.0 / math.sqrt(2.0 * large.sum()))
