"""The IMU's forward model: axes, signs, the size effect."""

import numpy as np
import pytest
from imu_units import drawn_imu

from imubayes.sensors.imu import (
    COMPONENTS,
    Component,
    Imu,
    component_channels,
    forward,
    imu_of,
    kind_of,
    signals,
    without_lever,
)
from imubayes.sensors.terms import columns, library

OPTIONS = {"powers": 4, "asymmetry": 3, "set": "extended", "temperature": 2}
LIBRARIES = {kind: library(kind, **OPTIONS) for kind in ("accelerometer", "gyroscope")}
IDENTITY = 1e-12
"""Relative; two orders of the same sums."""


def one(name: str, **coefficients: float) -> Component:
    lib = LIBRARIES[kind_of(name)]
    return Component(lib, np.array([coefficients.get(term, 0.0) for term in lib.names]))


def tactical(seed: int) -> Imu:
    return drawn_imu(seed, **OPTIONS)


def motion(seed: int, n: int = 1000):
    rng = np.random.default_rng(seed)
    T = 298.15 + 20.0 * rng.uniform(-1.0, 1.0, n)
    f, w, dw = (size * rng.normal(size=(n, 3)) for size in (20.0, 2.0, 5.0))
    return signals(f, w, dw=dw, T=T, warming=0.01 * rng.normal(size=n))


def test_the_compiled_model_is_the_matrix_of_regressors_times_the_coefficients():
    imu, inputs = tactical(1), motion(2)
    outputs = forward(imu, inputs)
    for c, (name, component) in enumerate(zip(COMPONENTS, imu.components, strict=True)):
        X = columns(component.library, component_channels(name, inputs), len(inputs.f))
        truth = (inputs.f, inputs.w)[c // 3][:, c % 3] + X @ component.theta
        found = (outputs.f, outputs.w)[c // 3][:, c % 3]
        np.testing.assert_allclose(found, truth, rtol=0.0, atol=IDENTITY * np.abs(truth).max())


@pytest.mark.parametrize(
    ("name", "term", "column"),
    [
        ("ax", "m_j", 1), ("ax", "m_k", 2), ("ay", "m_j", 2), ("ay", "m_k", 0), ("az", "m_j", 0),
        ("az", "m_k", 1), ("gx", "m_j", 1), ("gy", "m_k", 0), ("gz", "m_j", 0), ("gz", "m_k", 1),
    ],
)  # fmt: skip
def test_a_misalignment_couples_the_case_axis_of_the_cyclic_order(name, term, column):
    unit = np.eye(3)
    outputs = forward(imu_of({name: one(name, **{term: 1e-3})}), signals(unit, unit))
    response = (outputs.f, outputs.w)[COMPONENTS.index(name) // 3] - unit
    expected = np.zeros((3, 3))
    expected[column, "xyz".index(name[1])] = 1e-3
    np.testing.assert_allclose(response, expected, rtol=0.0, atol=1e-16)


def test_the_size_effect_is_the_vector_formula_at_each_sense_point():
    rng = np.random.default_rng(3)
    levers, inputs = rng.normal(size=(3, 3)), motion(4)
    found = forward(imu_of({}, levers), inputs).f - inputs.f
    for c in range(3):
        exact = np.cross(inputs.w, np.cross(inputs.w, levers[c])) + np.cross(inputs.dw, levers[c])
        np.testing.assert_allclose(found[:, c], exact[:, c], rtol=0.0, atol=1e-12)


def test_a_lever_arm_that_was_taken_out_of_the_coefficients_is_not_counted_twice():
    # what differs is the gain error and the nonlinearity of the size effect: of second order
    imu, inputs, lever = tactical(6), motion(7), np.array([0.02, 0.01, -0.03])
    levers = np.zeros((3, 3))
    levers[1] = lever
    taken = dict(zip(COMPONENTS, imu.components, strict=True))
    taken["ay"] = without_lever("ay", imu.components[1], lever)
    split, whole = forward(imu_of(taken, levers), inputs).f, forward(imu, inputs).f
    size = np.abs(np.cross(inputs.w, np.cross(inputs.w, lever)) + np.cross(inputs.dw, lever)).max()
    assert np.abs(split - whole).max() < 0.01 * size
