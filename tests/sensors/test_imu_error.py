"""The error model: first order against exact draws."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import block_diag

from imubayes.errors import InputError
from imubayes.sensors.catalogue import draw_unit, prior_sd, sensor
from imubayes.sensors.imu import COMPONENTS, Component, Imu, forward, imu_of, kind_of, signals
from imubayes.sensors.imu_compensation import compensate, error_covariance, jacobian
from imubayes.sensors.imu_range import input_range
from imubayes.sensors.terms import library

WITHIN = input_range(50.0, 5.0, dw=20.0)
LEVERS = [[0.02, 0.01, 0.0], [0.0, 0.03, -0.02], [0.01, 0.0, 0.02]]
SHARE = 0.01
"""Of the prior sd, that the posterior's sd is here: the error is then of first order."""


def tactical(seed: int) -> tuple[Imu, dict[str, np.ndarray]]:
    """A unit without jumps at zero, and the posterior's sd of its coefficients."""
    rng, found, sd = np.random.default_rng(seed), {}, {}
    for name in COMPONENTS:
        entry = sensor("mems_tactical", kind=kind_of(name))
        lib = library(entry.kind, set="extended", asymmetry=-1)
        found[name] = Component(lib, np.array(list(draw_unit(entry, lib, rng).values())))
        sd[name] = SHARE * np.array([prior_sd(entry, term)[0] for term in lib.terms])
    return imu_of(found, LEVERS), sd


def motion(seed: int, n: int):
    rng = np.random.default_rng(seed)
    return signals(*(rng.uniform(-s, s, (n, 3)) for s in (40.0, 4.0)), dw=rng.uniform(-10.0, 10.0, (n, 3)))


def test_the_jacobian_is_the_difference_quotient():
    imu, _ = tactical(1)
    inputs, step = motion(2, 20), 1e-6
    found = jacobian(imu, inputs)
    for d in range(6):
        shift = step * np.eye(6)[d]
        ends = [
            forward(imu, signals(inputs.f + s * shift[:3], inputs.w + s * shift[3:], dw=inputs.dw))
            for s in (1, -1)
        ]
        quotient = np.hstack([ends[0].f - ends[1].f, ends[0].w - ends[1].w]) / (2.0 * step)
        # rounding: 50 eps / step = 1e-8
        np.testing.assert_allclose(found[:, :, d], quotient, rtol=0.0, atol=2e-8)


def test_the_first_order_covariance_is_that_of_exact_draws():
    imu, sd = tactical(3)
    inputs, rng, m = motion(4, 3), np.random.default_rng(5), 600
    draws = {
        name: c.theta + sd[name] * rng.normal(size=(m, len(c.theta)))
        for name, c in zip(COMPONENTS, imu.components, strict=True)
    }
    errors = []
    for k in range(m):
        unit = Imu(
            tuple(Component(c.library, draws[n][k]) for n, c in zip(COMPONENTS, imu.components, strict=True)),
            imu.levers,
        )
        found = compensate(imu, forward(unit, inputs), WITHIN)
        errors.append(np.hstack([found.f - inputs.f, found.w - inputs.w]))
    covariance = error_covariance(imu, block_diag(*(np.diag(s**2) for s in sd.values())), inputs)
    found = np.einsum("mna,mnb->nab", np.array(errors), np.array(errors)) / m
    size = np.sqrt(np.einsum("naa->na", covariance))
    scale = size[:, :, None] * size[:, None, :]
    # a sample covariance over m draws has an sd of sqrt((1 + r^2) / m) at most sqrt(2 / m)
    assert (np.abs(found - covariance) / scale).max() < 4.5 * np.sqrt(2.0 / m)


def test_a_covariance_of_another_size_is_refused():
    imu, _ = tactical(8)
    with pytest.raises(InputError, match=r"expected \(1"):
        error_covariance(imu, np.eye(3), motion(9, 2))
