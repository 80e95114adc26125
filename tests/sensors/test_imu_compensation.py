"""Compensation: forward and back over the catalogue, and an error outside of the range. The error model:
first order against exact draws."""

from itertools import product

import numpy as np
import pytest
from imu_units import TACTICAL, drawn_imu
from scipy.linalg import block_diag

from imubayes.errors import InputError
from imubayes.scenes.trajectories import Ranges, catalogue_scenes
from imubayes.sensors.catalogue import classes, prior_sd
from imubayes.sensors.imu import COMPONENTS, Component, Imu, Signals, forward, imu_of, kind_of, signals
from imubayes.sensors.imu_compensation import compensate, error_covariance, jacobian, sensed, split_jumps
from imubayes.sensors.imu_range import UNLIMITED, contraction, input_range, rounds, scaled, slopes
from imubayes.sensors.terms import Library, library

ACCELEROMETERS, GYROSCOPES = classes("accelerometer"), classes("gyroscope")
PAIRS = [(ACCELEROMETERS[k % len(ACCELEROMETERS)], gyro) for k, gyro in enumerate(GYROSCOPES)]
"""Every class of the catalogue in an IMU, at least once."""

ROUND_TRIP = 1e-12
OPTIONS = {"set": "extended", "temperature": 1}


def tactical(seed: int, levers=None) -> Imu:
    return drawn_imu(seed, levers, **OPTIONS)


def box(scene: Ranges):
    return input_range(
        scene.load[1] + 3.0 * scene.vibration[1], scene.rate[1], dw=scene.slope[1], T=scene.temperature,
        warming=scene.warming,
    )  # fmt: skip


def inside(within, seed: int, n: int = 300) -> Signals:
    rng = np.random.default_rng(seed)
    f, w, dw = (rng.uniform(-1.0, 1.0, (n, 3)) * size for size in (within.f, within.w, within.dw))
    warming = within.warming * rng.uniform(-1.0, 1.0, n)
    return signals(f, w, dw=dw, T=rng.uniform(*within.T, n), warming=warming)


def away_from_overlaps(imu: Imu, inputs: Signals) -> np.ndarray:
    """Rows whose output near zero belongs to one input: |x| > |b0p| wherever b0p < 0, with a margin."""
    _, jumps = split_jumps(imu)
    x = np.hstack([*(sensed(imu, c, inputs).f[:, [c]] for c in range(3)), inputs.w])
    size = np.array([max(0.0, -component.theta.sum()) for component in jumps.components])
    return (np.abs(x) > 3.0 * size).all(axis=1)


def _back(imu: Imu, within, seed: int) -> tuple[np.ndarray, int]:
    """Largest error over the largest input of its kind, and how many rows."""
    inputs = inside(within, seed)
    found = compensate(imu, forward(imu, inputs), within)
    kept = away_from_overlaps(imu, inputs)
    errors = [np.abs(a - b)[kept].max(initial=0.0) for a, b in ((found.f, inputs.f), (found.w, inputs.w))]
    return np.array(errors) / [np.abs(inputs.f).max(), np.abs(inputs.w).max()], int(kept.sum())


def test_forward_and_compensation_return_the_input_over_every_class_and_scene_that_is_valid():
    """Every other pair: each class meets seven scenes, each scene six classes."""
    valid, tried = 0, [*product(enumerate(PAIRS), catalogue_scenes())][::2]
    for (k, pair), scene in tried:
        imu, within = drawn_imu(k, classes={entry.kind: entry for entry in pair}, **OPTIONS), box(scene)
        if contraction(split_jumps(imu)[0], within) >= 0.99:
            with pytest.raises(InputError, match=r"invertible for \|f\| up to|lies outside"):
                compensate(imu, forward(imu, inside(scaled(within, 3.0), k)), within)
            continue
        errors, rows = _back(imu, within, k)
        assert errors.max() < ROUND_TRIP, (pair[0].id, pair[1].id, scene.id)
        valid += rows > 100  # else inputs are no larger than a negative b0p: no output tells them apart
    assert valid > 0.8 * len(tried)


def test_lever_arms_are_compensated_too():
    imu = tactical(1, levers=[[0.05, 0.02, -0.01], [0.01, -0.05, 0.02], [0.0, 0.03, 0.04]])
    errors, _ = _back(imu, input_range(100.0, 5.0, dw=50.0, T=(273.15, 323.15)), 2)
    assert errors.max() < ROUND_TRIP


def test_the_bound_holds_the_slopes_of_the_model_at_every_input_of_the_range():
    levers = 0.05 * np.random.default_rng(3).normal(size=(3, 3))
    imu, within = tactical(4, levers), input_range(100.0, 5.0, dw=50.0, T=(273.15, 323.15), warming=0.05)
    found = np.abs(jacobian(imu, inside(within, 5, 3000)) - np.eye(6)).max(axis=0)
    bound = slopes(imu, within)
    assert (found <= bound * (1.0 + 1e-12)).all()
    # it is a bound, not a guess: at the diagonal it is reached within a factor
    assert (np.diag(bound) < 4.0 * np.diag(found)).all()


def test_the_number_of_steps_brings_the_slowest_contraction_to_rounding():
    lib = library("accelerometer", powers=1, asymmetry=-1)
    slow = imu_of({"ax": Component(lib, np.array([0.9 if n == "b1" else 1e-9 for n in lib.names]))})
    within = input_range(100.0, 1.0)
    inputs = inside(within, 6)
    found = compensate(slow, forward(slow, inputs), within)
    assert rounds(slow, within) > 300
    np.testing.assert_allclose(found.f, inputs.f, rtol=0.0, atol=1e-11)


def test_inputs_that_no_term_depends_on_may_be_of_any_size_and_cost_no_digit():
    affine = {kind: Library(kind, library(kind).terms[:2]) for kind in ("accelerometer", "gyroscope")}
    imu = imu_of({name: Component(affine[kind_of(name)], np.array([0.3, 0.1])) for name in ("ax", "gy")})
    within = input_range([20.0, UNLIMITED, UNLIMITED], [UNLIMITED, 2.0, UNLIMITED], dw=UNLIMITED)
    outputs = signals([[0.3 + 1.1 * 15.0, 1e3, 0.0]], [[0.0, 0.3 - 1.1 * 1.5, 7.0]])
    found = compensate(imu, outputs, within)
    np.testing.assert_allclose(found.f, [[15.0, 1e3, 0.0]], rtol=ROUND_TRIP)
    np.testing.assert_allclose(found.w, [[0.0, -1.5, 7.0]], rtol=ROUND_TRIP)


def jumping(size: float) -> Imu:
    lib = library("accelerometer", powers=2, asymmetry=0)
    named = {"b0p": size, "b2": 1e-5}
    return imu_of({"ax": Component(lib, np.array([named.get(n, 0.0) for n in lib.names]))})


def test_outputs_in_the_gap_of_a_positive_asymmetry_come_from_zero():
    found = compensate(
        jumping(1e-2), signals([[0.004, 0, 0], [-0.009, 0, 0], [0.03, 0, 0]]), input_range(20.0, 1.0)
    )
    np.testing.assert_allclose(found.f[:, 0], [0.0, 0.0, 0.02], atol=1e-6)


def test_near_a_negative_asymmetry_the_output_decides_and_the_error_stays_below_twice_its_size():
    size, imu, within = 1e-2, jumping(-1e-2), input_range(20.0, 1.0)
    x = np.linspace(-3.0 * size, 3.0 * size, 601)
    inputs = signals(np.column_stack([x, 0.0 * x, 0.0 * x]))
    error = np.abs(compensate(imu, forward(imu, inputs), within).f[:, 0] - x)
    assert error[np.abs(x) > 1.001 * size].max() < 1e-14
    assert size < error.max() <= 2.0 * size / (1.0 - contraction(split_jumps(imu)[0], within))


def test_a_polynomial_that_folds_back_is_refused_and_the_part_that_does_not_is_named():
    # y = x - k x^2 has slope 0 at x = 1/(2 k) = 50: half of a range of 100
    lib = library("accelerometer", powers=2, asymmetry=-1)
    fold = imu_of({"az": Component(lib, np.array([-0.01 if n == "b2" else 0.0 for n in lib.names]))})
    with pytest.raises(InputError, match=r"az: .*steepest terms are b2.* 0\.5 of that range"):
        compensate(fold, signals([[0.0, 0.0, 1.0]]), input_range(100.0, 1.0))
    assert _back(fold, input_range(49.0, 1.0), 1)[0].max() < 49.0 * ROUND_TRIP


WITHIN = input_range(50.0, 5.0, dw=20.0)
LEVERS = [[0.02, 0.01, 0.0], [0.0, 0.03, -0.02], [0.01, 0.0, 0.02]]
SHARE = 0.01
"""Of the prior sd, that the posterior's sd is here: the error is then of first order."""


def smooth_tactical(seed: int) -> tuple[Imu, dict[str, np.ndarray]]:
    """A unit without jumps at zero, and the posterior's sd of its coefficients."""
    imu = drawn_imu(seed, LEVERS, set="extended", asymmetry=-1)
    sd = {
        name: SHARE * np.array([prior_sd(TACTICAL[one.library.kind], term)[0] for term in one.library.terms])
        for name, one in zip(COMPONENTS, imu.components, strict=True)
    }
    return imu, sd


def motion(seed: int, n: int):
    rng = np.random.default_rng(seed)
    return signals(*(rng.uniform(-s, s, (n, 3)) for s in (40.0, 4.0)), dw=rng.uniform(-10.0, 10.0, (n, 3)))


def test_the_first_order_covariance_is_the_sum_of_what_each_coefficient_does_to_an_exact_compensation():
    imu, sd = smooth_tactical(3)
    inputs, expected = motion(4, 3), np.zeros((3, 6, 6))
    for c, name in enumerate(COMPONENTS):
        for step in np.diag(sd[name]):
            ends = []
            for sign in (1.0, -1.0):
                moved = Component(imu.components[c].library, imu.components[c].theta + sign * step)
                unit = Imu((*imu.components[:c], moved, *imu.components[c + 1 :]), imu.levers)
                found = compensate(imu, forward(unit, inputs), WITHIN)
                ends.append(np.hstack([found.f, found.w]))
            error = 0.5 * (ends[0] - ends[1])
            expected += error[:, :, None] * error[:, None, :]
    found = error_covariance(imu, block_diag(*(np.diag(s**2) for s in sd.values())), inputs)
    size = np.sqrt(np.einsum("naa->na", expected))
    scale = size[:, :, None] * size[:, None, :]
    # rounding of the compensation, 1e-14, over an sd of 1e-6 of the inputs
    np.testing.assert_allclose(found / scale, expected / scale, rtol=0.0, atol=1e-6)
