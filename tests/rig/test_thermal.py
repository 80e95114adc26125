"""Soaks and ramps of a chamber, and the rate of a temperature as thermometers record it."""

import numpy as np
import pytest

import imubayes as ib
from imubayes.algebra.factor import posterior
from imubayes.inference.prior import class_sd
from imubayes.rig.recordings import temperature_rate

G = 9.80665
UP_AND_DOWN = [253.0, 293.0, 333.0, 293.0, 253.0]


def chamber(**options):
    return ib.thermal(UP_AND_DOWN, **{"dwell": 30.0, "soak": 600.0, "rate": 0.5, **options}).inputs


def test_temperature_is_the_integral_of_its_rate():
    inputs = chamber()
    T, dT = inputs.channels["T"], inputs.channels["dT"]
    # the rate holds from a sample to the next, except where a ramp starts or ends between them
    steps = np.diff(T) - dT[:-1] * np.diff(inputs.t)
    assert np.max(np.abs(steps)) <= np.max(np.abs(dT)) * 2.0
    inside = (dT[1:] == dT[:-1]) & (dT[:-1] != 0.0)
    assert np.max(np.abs(steps[inside])) < 1e-10
    assert sorted(set(np.round(T[dT == 0.0], 9))) == [253.0, 293.0, 333.0]
    np.testing.assert_allclose(np.abs(dT[dT != 0.0]), 1.0 / 60.0, rtol=1e-15)


def test_sensor_is_at_rest_under_gravity_in_as_many_directions_as_asked():
    for positions in (1, 2, 6, 9):
        channels = chamber(positions=positions).channels
        f = np.array([channels.get(f"f_{axis}", np.zeros(len(channels["T"]))) for axis in "ijk"])
        np.testing.assert_allclose(np.linalg.norm(f, axis=0), G, rtol=1e-15)
        # during ramps the input axis points both ways, whatever the positions
        assert len(np.unique(f.T.round(6), axis=0)) == max(positions, 2)


def test_terms_by_temperature_and_its_rate_come_back_from_a_simulated_chamber():
    entry = ib.sensor("mems_tactical", kind="accelerometer")
    lib = ib.library("accelerometer", powers=1, asymmetry=-1, temperature=2, rate_of=("b0", "b1"))
    truth = {"b0": 5e-3, "b0*T": 4e-4, "b0*T2": 5e-6, "b1*T": 2e-5, "b0*dT": 0.1, "b1*dT": 8e-3}
    plan = ib.thermal(UP_AND_DOWN, dwell=30.0, soak=600.0, rate=0.5)
    runs = ib.simulate(entry, [plan], seed=3, truth=truth)
    wide = 10.0 * class_sd(entry, lib)  # the true coefficients are up to nine times the class's typical sizes
    mean, sd = posterior(ib.summarize(runs, lib, sensor=entry).factor, wide)
    pull = (mean - np.array([truth.get(name, 0.0) for name in lib.names])) / sd
    seen = np.isin(lib.names, [*truth, "b1", "b1*T2", "m_j", "m_k"])
    assert np.max(np.abs(pull[seen])) < 4.0
    strong = dict(zip(lib.names, np.abs(mean) / sd, strict=True))
    assert strong["b0*dT"] > 8.0 and strong["b1*dT"] > 8.0


def test_second_thermometer_follows_with_its_time_constant():
    """Against its differential equation, solved by steps a hundred times as fine."""
    fine, lag = 100, 400.0
    plan = ib.thermal(UP_AND_DOWN, dwell=60.0, soak=1200.0, rate=0.5, lag=lag)
    channels, second = plan.inputs.channels, UP_AND_DOWN[0]
    expected = np.empty(len(plan.inputs.t))
    for k, (T, rate) in enumerate(zip(channels["T"], channels["dT"], strict=True)):
        expected[k] = second - T
        for j in range(fine):
            second += 2.0 / fine / lag * (T + rate * 2.0 * j / fine - second)
    # a ramp that starts or ends between samples changes T by no more than its rate times one
    np.testing.assert_allclose(channels["gT"], expected, atol=2.0 / 60.0)
    assert np.max(np.abs(channels["gT"])) > 5.0


def recorded(noise, step, seed=1):
    """Record a chamber's trapezoid at 2 Hz: time, true temperature and rate, and what a thermometer read."""
    t = np.arange(0.0, 4200.0, 0.5)
    corners = np.array([0.0, 600.0, 1500.0, 2400.0, 3000.0, 4200.0])
    levels = np.array([300.0, 300.0, 345.0, 345.0, 320.0, 320.0])
    slopes = np.diff(levels) / np.diff(corners)
    rate = slopes[np.searchsorted(corners, t, side="right") - 1]
    T = np.interp(t, corners, levels)
    read = T + noise * np.random.default_rng(seed).standard_normal(len(t))
    return t, T, rate, np.round(read / step) * step if step else read


@pytest.mark.parametrize(("noise", "step"), [(0.0, 0.0), (0.2, 0.0), (0.1, 0.25)])
def test_coefficient_of_a_derived_rate_is_neither_shortened_by_noise_nor_stretched_by_smoothing(noise, step):
    """Noise may shorten it by RATE_NOISE^2 = 0.25 %; rounded corners may stretch it by twice that."""
    t, T, rate, read = recorded(noise, step)
    derived = temperature_rate(t, read)
    X = np.column_stack((np.ones(len(t)), T - T.mean(), derived))
    coefficient = np.linalg.lstsq(X, rate, rcond=None)[0][2]
    assert coefficient == pytest.approx(1.0, abs=0.0075)


def test_rate_of_a_parabola_is_exact_also_beside_gaps():
    t = np.concatenate((np.arange(0.0, 300.0), np.arange(2000.0, 2500.0)))
    T = 290.0 + 0.01 * t - 3e-6 * t**2
    rate = 0.01 - 6e-6 * t
    # between averages the rate is interpolated, which is exact for a straight line
    np.testing.assert_allclose(temperature_rate(t, T), rate, rtol=0.0, atol=1e-9 * np.max(np.abs(rate)))


def test_constant_temperature_has_no_rate():
    assert not temperature_rate(np.arange(100.0), np.full(100, 300.0)).any()
