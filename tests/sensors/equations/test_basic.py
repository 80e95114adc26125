"""The basic triad: exact one way, a projection over inputs the other."""

import numpy as np
import pytest

from imubayes.algebra.factor import factor_of
from imubayes.sensors.equations.basic import TERMS, project
from imubayes.sensors.terms import columns, library

ROWS = 500
LIB = library("accelerometer", powers=3, asymmetry=2)
BASIC = [LIB.names.index(name) for name in TERMS]


def _scene(rng):
    """A boost along the input axis with vibration: f_i never changes sign, so K2 looks like scale."""
    channels = {f"f_{axis}": rng.normal(0.0, 5.0, ROWS) for axis in "jk"}
    return {**channels, "f_i": rng.uniform(20.0, 80.0, ROWS)}


def _factor(channels, rows=ROWS):
    return factor_of(columns(LIB, channels, rows), np.zeros(rows), LIB.names)


def _theta(**values):
    return np.array([values.get(name, 0.0) for name in LIB.names])


def test_projection_is_least_squares_on_the_rows_of_the_scene():
    rng = np.random.default_rng(1)
    channels, theta = _scene(rng), rng.normal(size=len(LIB.terms)) * 1e-4
    X = columns(LIB, channels, ROWS)
    fit, rss, _, _ = np.linalg.lstsq(X[:, BASIC], X @ theta, rcond=None)
    p, projection = project(LIB, theta, _factor(channels))
    np.testing.assert_allclose([p.b, p.s, p.m_j, p.m_k], fit, rtol=1e-9)
    assert projection.lost == pytest.approx(np.sqrt(rss[0] / ROWS), rel=1e-9)


def test_projection_loses_less_than_leaving_the_terms_out():
    """K2 over a boost from 20 to 80 m/s^2: of its effect the scale factor takes nearly all.

    For f uniform over a width h about a mean the line that fits f^2 leaves h^2 / (6 sqrt(5)).
    """
    f_i = 20.0 + 60.0 * (np.arange(4000) + 0.5) / 4000
    K2 = 1e-5
    p, projection = project(LIB, _theta(b2=K2), _factor({"f_i": f_i}, 4000))
    # the sum over 4000 midpoints differs from the integral by about 1/4000^2
    assert p.m_j == p.m_k == 0.0  # nothing excites them
    assert projection.rms == pytest.approx(K2 * np.sqrt((80.0**5 - 20.0**5) / 300.0), rel=1e-6)
    assert projection.lost == pytest.approx(K2 * 60.0**2 / (6.0 * np.sqrt(5.0)), rel=1e-6)
    assert p.s == pytest.approx(K2 * 100.0, rel=1e-6)
    assert p.b == pytest.approx(K2 * (60.0**2 / 12.0 - 50.0**2), rel=1e-6)
