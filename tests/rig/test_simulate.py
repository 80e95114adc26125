"""Simulated runs: the exact covariance of their noise, its Allan variance, and the output of the model."""

import math

import numpy as np
import pytest
from quiet_logs import quiet_log

from imubayes.inference.allan import allan_deviation, log_covariance
from imubayes.rig.rotations import centrifuge
from imubayes.rig.simulate import Drawn, drawn_errors, simulate, synthesise
from imubayes.rig.tumbles import static, tumble
from imubayes.sensors.catalogue import draw_unit, sensor
from imubayes.sensors.noise import Noise, allan_variance
from imubayes.sensors.terms import columns, library

SILENT = Noise(0.0, 0.0, 0.0)
TACTICAL = sensor("mems_tactical", kind="accelerometer")


class _Impulses:
    """Stands for a generator whose normal draws are all zero but one."""

    def __init__(self, index: int) -> None:
        self.index, self.drawn = index, 0

    def standard_normal(self, n: int | None = None) -> np.ndarray:
        values = np.zeros(size := 1 if n is None else n)
        if self.drawn <= self.index < self.drawn + size:
            values[self.index - self.drawn] = 1.0
        self.drawn += size
        return values[0] if n is None else values

    def spawn(self, n: int) -> list["_Impulses"]:
        return [self] * n


def _covariance_of_draws(noise: Noise, t: np.ndarray, interval: float, cuts=()) -> np.ndarray:
    """Covariance of what is drawn, which is linear in independent normal draws: sum of outer products."""

    def drawn(rng) -> np.ndarray:
        if not cuts:
            return synthesise(noise, t, interval, rng)
        one = Drawn(noise, interval, t[-1] - t[0], rng)
        return np.concatenate([one.next(part) for part in np.split(t, cuts)])

    counter = _Impulses(-1)
    drawn(counter)
    responses = [drawn(_Impulses(index)) for index in range(counter.drawn)]
    return np.array(responses).T @ np.array(responses)


NODES, WEIGHTS = np.polynomial.legendre.leggauss(40)
LAGS = 0.5 + 0.5 * NODES


def _dense_covariance(noise: Noise, t: np.ndarray, interval: float) -> np.ndarray:
    """Of averages over the interval; B as processes in ratio 4 from a sixteenth of it to ten spans.

    Those that are faster add ``2 variance tau / interval`` each to the variance of a row.
    """
    gap = np.maximum(np.abs(t[:, None] - t[None, :]) - interval, 0.0)
    covariance = noise.N**2 / interval * np.eye(len(t))
    begun = np.minimum(t[:, None] - t[0], t[None, :] - t[0])
    covariance += noise.K**2 * (begun + interval * np.where(np.eye(len(t)), 1.0 / 3.0, 0.5))
    tau = interval / 16.0
    faster = sum(2.0 * tau / 4.0**k / interval for k in range(1, 40))
    covariance += noise.B**2 * math.log(4.0) / math.pi * faster * np.eye(len(t))
    while True:
        # the integrals of exp(-|u - v| / tau) over u and v in two rows, and in one
        x = interval / tau
        apart = (np.expm1(-x) / x) ** 2 * np.exp(-gap / tau)
        same = WEIGHTS @ ((1.0 - LAGS) * np.exp(-x * LAGS))
        covariance += noise.B**2 * math.log(4.0) / math.pi * np.where(np.eye(len(t)), same, apart)
        if tau >= 10.0 * (t[-1] - t[0]) * (1.0 - 1e-9):
            return covariance
        tau *= 4.0


@pytest.mark.parametrize(
    "noise",
    [Noise(2.0, 0.0, 0.0), Noise(0.0, 2.0, 0.0), Noise(0.0, 0.0, 2.0), Noise(1.0, 0.5, 0.1)],
    ids=["N", "B", "K", "all"],
)
@pytest.mark.parametrize(
    "t",
    [np.arange(8.0) * 0.5, np.array([3.0, 3.5, 4.2, 10.0, 10.5, 60.0, 1000.0]), np.array([0.0, 2.5])],
    ids=["even", "with gaps", "two"],
)
def test_noise_has_the_dense_covariance_at_any_time_stamps_at_once_and_in_parts(noise, t):
    expected = _dense_covariance(noise, t, interval=0.5)
    for cuts in ((), (1,), (1, len(t) - 1) if len(t) > 2 else (1,)):
        found = _covariance_of_draws(noise, t, 0.5, cuts)
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


def test_output_is_input_plus_library_times_coefficients():
    lib = library("accelerometer")
    truth = draw_unit(TACTICAL, lib, np.random.default_rng(3))
    plans = [tumble(dwell=1.0), centrifuge([1, 5], ramp=True, dwell=1.0)]
    for run in simulate(TACTICAL, plans, seed=1, truth=truth, noise=SILENT):
        X = columns(lib, run.inputs.channels, len(run.inputs))
        expected = run.inputs.channels["f_i"] + X @ np.array([truth[name] for name in lib.names])
        np.testing.assert_allclose(run.output, expected, rtol=0.0, atol=1e-13 * np.abs(expected).max())


def test_unit_without_truth_is_drawn_from_the_class_by_the_seed():
    first, again, other = (
        simulate(TACTICAL, [tumble(dwell=1.0)], seed=seed, noise=SILENT)[0].output for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, again)
    truth = draw_unit(TACTICAL, library("accelerometer"), np.random.default_rng(1))
    (same,) = simulate(TACTICAL, [tumble(dwell=1.0)], seed=9, truth=truth, noise=SILENT)
    np.testing.assert_array_equal(first, same.output)
    assert np.abs(first - other).max() > 1e-6


def test_runs_of_one_sensor_have_independent_noise_and_unique_names():
    runs = simulate(TACTICAL, [static(100.0, 10.0)] * 3, seed=4, truth={}, noise=Noise(1.0, 0.0, 0.0))
    assert [run.name for run in runs] == ["static", "static-2", "static-3"]
    correlation = np.corrcoef([run.output for run in runs])[np.triu_indices(3, 1)]
    assert np.abs(correlation).max() < 4.0 / math.sqrt(1000)


def test_a_drawn_bench_moves_what_was_applied_and_not_what_the_rig_says():
    plans = [tumble(angles=4, planes=1, dwell=2.0, rate=5.0)]
    errors = drawn_errors(plans, {"table_zero": 1e-2, "turn_on": 0.5}, np.random.default_rng(1))
    assert errors.keys() == {"table_zero", "turn_on.tumble"}
    asked = {"seed": np.random.default_rng(2), "truth": {}}
    (moved,) = simulate(TACTICAL, plans, errors=errors, **asked)
    asked = {"seed": np.random.default_rng(2), "truth": {}}
    (plain,) = simulate(TACTICAL, plans, **asked)
    np.testing.assert_array_equal(moved.inputs.channels["f_i"], plain.inputs.channels["f_i"])
    # about the plane's normal f_i = g cos(angle) becomes g cos(angle + error): the noise is the same
    angle = np.arctan2(plain.inputs.channels["f_j"], plain.inputs.channels["f_i"])
    shift = 9.80665 * (np.cos(angle + errors["table_zero"]) - np.cos(angle)) + errors["turn_on.tumble"]
    np.testing.assert_allclose(moved.output - plain.output, shift, rtol=0.0, atol=1e-12)


def test_allan_variance_of_flicker_is_the_same_over_one_sample_and_many():
    """``2 ln 2 B^2 / pi``, of the exact covariance: no number of samples shows where it was cut off."""
    covariance = _covariance_of_draws(Noise(0.0, 3.0, 0.0), 0.1 * np.arange(64.0), 0.1)
    for samples in (1, 2, 3, 5, 8, 16, 32):
        weights = np.append(np.full(samples, -1.0), np.full(samples, 1.0)) / samples
        part = covariance[: 2 * samples, : 2 * samples]
        assert 0.5 * weights @ part @ weights == pytest.approx(18.0 * math.log(2.0) / math.pi, rel=0.01)


SAMPLES, INTERVAL, LOGS = 4000, 0.5, 30


@pytest.mark.parametrize(
    "noise",
    [
        {"N": 0.3},
        {"N": 1e-4, "K": 0.2},
        {"N": 1e-4, "Q": 0.4},
        {"N": 1e-4, "G": 0.5, "tau": 20.0},
        {"N": 1e-4, "G": 0.5, "tau": 0.4},
        {"N": 0.2, "Q": 0.3, "K": 0.01, "G": 0.2, "tau": 8.0},
    ],
    ids=["N", "K", "Q", "G", "fast G", "all"],
)
def test_allan_variance_of_simulated_logs_is_that_of_their_processes(noise):
    rng = np.random.default_rng(11)
    t = INTERVAL * np.arange(SAMPLES)
    curves = [allan_deviation(quiet_log(noise, SAMPLES, INTERVAL, rng), t, INTERVAL) for _ in range(LOGS)]
    tau = curves[0][0]
    shown = tau <= 0.1 * SAMPLES * INTERVAL
    mean = np.mean([deviation**2 for _, deviation in curves], axis=0)[shown]
    expected = allan_variance(noise, tau[shown])
    sd = np.sqrt(np.diag(log_covariance(noise, tau[shown], (SAMPLES, INTERVAL))) / LOGS)
    assert np.all(np.abs(mean / expected - 1.0) < 4.0 * sd)
