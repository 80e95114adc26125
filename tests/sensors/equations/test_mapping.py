"""Every equation against the generalized library, and there and back."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imubayes.sensors.equations import STANDARDS
from imubayes.sensors.equations.mapping import alignment, row
from imubayes.sensors.terms import columns, library

ROWS = 300
ALL = list(STANDARDS.values())
NEEDS_CONSTANT_EPS = ("eps_T", "eps_1", "eps_2", "eps_1p")
BY_ID = pytest.mark.parametrize("known", ALL, ids=lambda known: f"{known.kind}-{known.id}")


def _inputs(rng):
    """Inputs of both signs, a tenth of them exactly zero, at moderate scale, with temperature."""
    scale = {"f": 30.0, "w": 3.0, "dw": 20.0}
    channels = {
        f"{name}_{axis}": rng.normal(0.0, size, ROWS) * (rng.random(ROWS) > 0.1)
        for name, size in scale.items()
        for axis in "ijk"
    }
    return {**channels, "T": rng.uniform(250.0, 340.0, ROWS), "dT": rng.normal(0.0, 0.05, ROWS)}


def _wide(kind):
    heated = ("b0", "b1", "m_j", "m_k") + (("g_i", "g_j", "g_k") if kind == "gyroscope" else ())
    return library(kind, powers=12, asymmetry=3, set="extended", temperature=2, temperature_of=heated)


def _largest(known):
    """Random sizes of the parameters: each at most about 1e-3 of full scale in the inputs above."""
    return {
        row.field: 1e-3 / 100.0 ** max(int(row.field[1:]) - 1, 0) if row.field[1:].isdigit() else 1e-3
        for row in known.symbols
        if row.term
    }


def _parameters(known, rng, *, without=()):
    sizes = {field: size * rng.normal() for field, size in _largest(known).items() if field not in without}
    return replace(known.from_general({}), **sizes)


def theta_of(coefficients, lib):
    """Vector of a library's terms, of coefficients that all have one."""
    assert coefficients.keys() <= set(lib.names)
    return np.array([coefficients.get(name, 0.0) for name in lib.names])


@BY_ID
def test_equation_and_library_give_the_same_output_where_the_mapping_is_exact(known):
    rng, lib = np.random.default_rng(1), _wide(known.kind)
    without = () if known.id == "ieee1431" else NEEDS_CONSTANT_EPS
    own = "f_i" if known.kind == "accelerometer" else "w_i"
    for _ in range(20):
        p, channels = _parameters(known, rng, without=without), _inputs(rng)
        theta = theta_of(known.to_general(p), lib)
        output = known.indicated(p, channels, ROWS)
        modelled = channels[own] + columns(lib, channels, ROWS) @ theta
        np.testing.assert_allclose(modelled, output, rtol=0.0, atol=1e-12 * np.abs(output).max())


@BY_ID
def test_map_and_map_back_returns_the_parameters(known):
    rng = np.random.default_rng(3)
    for _ in range(100):
        p = _parameters(known, rng)
        back = known.from_general(known.to_general(p))
        for symbol in known.symbols:
            if symbol.term:
                truth, found = getattr(p, symbol.field), getattr(back, symbol.field)
                # two products of about 1e-6 are subtracted from 1e-3: 1e-16 grows to 1e-13 at the worst draw
                assert math.isclose(found, truth, rel_tol=1e-12, abs_tol=1e-18), symbol.symbol


@BY_ID
def test_implied_terms_are_exactly_those_that_the_mapping_makes_beside_the_tables(known):
    made = set(known.to_general(_parameters(known, np.random.default_rng(5))))
    assert made == {symbol.term for symbol in known.symbols if symbol.term} | set(known.implied)


@pytest.mark.parametrize("size", [0.3, 1e-6])
def test_angles_and_linear_row_convert_both_ways(size):
    rng = np.random.default_rng(6)
    for s, a_X, a_Y in rng.normal(0.0, (0.1, size, size), (200, 3)):
        b1, m_j, m_k = row(s, a_X, a_Y)
        np.testing.assert_allclose(alignment(b1, m_j, m_k), (s, a_X, a_Y), rtol=1e-12, atol=1e-15)
        rotated = (1.0 + s) * Rotation.from_rotvec([0.0, a_X, a_Y]).apply([1.0, 0.0, 0.0])
        np.testing.assert_allclose([1.0 + b1, m_j, m_k], rotated, atol=1e-15)


def test_small_scale_errors_keep_their_digits():
    """Through 1 + b1 in double precision 1e-9 would lose seven of its sixteen digits."""
    b1, m_j, m_k = row(1e-9, 3e-8, -4e-8)
    assert alignment(b1, m_j, m_k)[0] == pytest.approx(1e-9, rel=1e-13)
