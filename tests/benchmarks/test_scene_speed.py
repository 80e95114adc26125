"""How fast errors are followed through an hour at 100 Hz, beside a navigator: ``pytest -m benchmark``."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
from numba import njit
from recorded_scenes import recorded

from imubayes.scenes.effects import budget_effects
from imubayes.scenes.propagation import Budget
from imubayes.sensors.terms import Library, library

pytestmark = pytest.mark.benchmark

ROWS, TERMS = 360_000, 25
MOST = 10.0
"""Passes of the navigator that 25 terms along three axes may take."""


@njit
def navigate(force, rate, step):
    """Position (3,) at the end of a flight by a quaternion strapdown navigator over a round Earth."""
    q, v, r = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), np.zeros(3)
    f = np.zeros(3)
    for i in range(len(force)):
        w, (x, y, z) = q[0], (q[1], q[2], q[3])
        f[0] = (1 - 2 * (y * y + z * z)) * force[i, 0] + 2 * (x * y - w * z) * force[i, 1]
        f[1] = 2 * (x * y + w * z) * force[i, 0] + (1 - 2 * (x * x + z * z)) * force[i, 1]
        f[2] = 2 * (x * z - w * y) * force[i, 0] + 2 * (y * z + w * x) * force[i, 1]
        f[0] += 2 * (x * z + w * y) * force[i, 2]
        f[1] += 2 * (y * z - w * x) * force[i, 2]
        f[2] += (1 - 2 * (x * x + y * y)) * force[i, 2] - 9.80665
        for k in range(3):
            r[k] += step * v[k]
            v[k] += step * (f[k] - 1.54e-6 * r[k] * (k < 2))
        a, b, c = 0.5 * step * rate[i, 0], 0.5 * step * rate[i, 1], 0.5 * step * rate[i, 2]
        size = np.sqrt(a * a + b * b + c * c)
        share, s = np.cos(size), (np.sin(size) / size if size > 0.0 else 1.0)
        a, b, c = a * s, b * s, c * s
        q[0], q[1], q[2], q[3] = (
            share * w - a * x - b * y - c * z,
            share * x + a * w + c * y - b * z,
            share * y + b * w + a * z - c * x,
            share * z + c * w + b * x - a * y,
        )
    return r


def test_an_hour_of_25_terms_on_three_axes_takes_few_passes_of_a_navigator(benchmark, measured):
    t = 0.01 * np.arange(ROWS)
    rate = np.column_stack((0.1 * np.sin(t / 7.0), 0.1 * np.cos(t / 9.0), 0.05 * np.sin(t / 60.0)))
    force = np.tile([0.0, 0.0, 9.8], (ROWS, 1))
    hour = recorded("hour", t, force, rate)
    whole = library("gyroscope", set="extended", powers=5)
    lib = Library("gyroscope", whole.terms[:TERMS])
    assert len(lib.terms) == TERMS

    def followed():
        anew = replace(hour)  # of which nothing is known yet
        return [budget_effects(anew, lib, Budget("position", 1.0), axis) for axis in "xyz"]

    followed()
    navigate(force, rate, 0.01)
    passes = []
    for _ in range(10):
        start = time.perf_counter()
        navigate(force, rate, 0.01)
        passes.append(time.perf_counter() - start)
    benchmark.pedantic(followed, rounds=5)
    ratio = benchmark.stats.stats.min / min(passes)
    measured("passes of a navigator that 25 terms along three axes take", round(ratio, 1))
    assert ratio <= MOST
