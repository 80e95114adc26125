"""How fast the IMU's forward model is on one thread: ``pytest -m benchmark``."""

from __future__ import annotations

import numpy as np
import pytest
from imu_units import drawn_imu

from imubayes.sensors.imu import COMPONENTS, forward, signals
from imubayes.sensors.imu_compensation import compensate
from imubayes.sensors.imu_range import input_range

pytestmark = pytest.mark.benchmark

ROWS = 200_000
COMPONENT_SAMPLES_A_SECOND = 5e6
WITHIN = input_range(60.0, 6.0, dw=30.0)


def tactical():
    """Six components of 26 and 29 terms each, with lever arms."""
    return drawn_imu(1, 0.02 * np.random.default_rng(3).normal(size=(3, 3)), set="extended", temperature=1)


def motion():
    rng = np.random.default_rng(2)
    f, w, dw = (rng.uniform(-end, end, (ROWS, 3)) for end in (WITHIN.f[0], WITHIN.w[0], WITHIN.dw[0]))
    return signals(f, w, dw=dw)


def test_forward_gives_5e6_component_samples_a_second(benchmark, measured):
    imu, inputs = tactical(), motion()
    forward(imu, inputs)  # compiles, or reads what was compiled
    benchmark.pedantic(forward, args=(imu, inputs), rounds=10)
    rate = len(COMPONENTS) * ROWS / benchmark.stats.stats.min
    measured("million component samples a second, forward", round(rate / 1e6, 1))
    assert rate >= COMPONENT_SAMPLES_A_SECOND


def test_compensation_takes_as_many_forward_steps_as_it_needs_to_settle(benchmark, measured):
    imu, outputs = tactical(), forward(tactical(), motion())
    compensate(imu, outputs, WITHIN)
    benchmark.pedantic(compensate, args=(imu, outputs, WITHIN), rounds=3)
    rate = len(COMPONENTS) * ROWS / benchmark.stats.stats.min
    measured("million component samples a second, compensation", round(rate / 1e6, 2))
    # two passes (a negative asymmetry) of about ten steps each
    assert rate >= COMPONENT_SAMPLES_A_SECOND / 30.0
