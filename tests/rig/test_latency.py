"""Inputs a little earlier: exact on lines, third order on curves, and never across a gap."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imubayes.rig.bench import delayed
from imubayes.rig.inputs import Inputs


def sampled(function, t, interval):
    return Inputs(t, {"w_i": function(t), "f_j": 0.0 * t + 9.8}, interval)


@given(st.floats(-3.0, 3.0), st.integers(0, 2**32 - 1))
def test_a_line_is_shifted_exactly_between_samples_and_beyond_the_ends(latency, seed):
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.8, 1.2, 12))
    inputs = sampled(lambda t: 3.0 - 2.0 * t, t, 1.0)
    moved = delayed(inputs, latency, 0, 12)
    np.testing.assert_allclose(moved["w_i"], 3.0 - 2.0 * (t - latency), atol=1e-12)
    np.testing.assert_allclose(moved["f_j"], 9.8, rtol=1e-14)


def test_error_on_a_curve_falls_with_the_third_power_of_the_step():
    errors = []
    for n in (100, 200):
        t = np.linspace(0.0, 10.0, n + 1)
        moved = delayed(sampled(np.sin, t, 10.0 / n), 0.37 * 10.0 / n, 0, n + 1)["w_i"]
        errors.append(np.abs(moved - np.sin(t - 0.37 * 10.0 / n))[3:-3].max())
    assert errors[0] / errors[1] == pytest.approx(8.0, rel=0.15)


@given(st.floats(-2.5, 2.5), st.integers(0, 2**32 - 1))
def test_a_part_of_the_rows_is_what_the_whole_has_there(latency, seed):
    rng = np.random.default_rng(seed)
    t = np.cumsum(1.0 + 4.0 * (rng.random(30) < 0.2))
    inputs = Inputs(t, {"w_i": rng.normal(size=30)}, 1.0)
    start = int(rng.integers(0, 29))
    stop = int(rng.integers(start + 1, 31))
    whole, part = delayed(inputs, latency, 0, 30)["w_i"], delayed(inputs, latency, start, stop)["w_i"]
    np.testing.assert_allclose(part, whole[start:stop], atol=1e-13)


def test_nothing_comes_across_a_gap():
    t = np.concatenate([np.arange(5.0), 100.0 + np.arange(5.0), [300.0]])
    u = np.concatenate([np.zeros(5), np.ones(5), [7.0]])
    moved = delayed(Inputs(t, {"w_i": u}, 1.0), 0.9, 0, 11)["w_i"]
    np.testing.assert_array_equal(moved, u)


def test_a_jump_moves_by_the_latency_as_sample_averages_do():
    """The sum over the samples, which is the integral of the input, shifts by jump times latency."""
    u = np.repeat([0.0, 5.0], 10)
    moved = delayed(Inputs(np.arange(20.0), {"w_i": u}, 1.0), 0.125, 0, 20)["w_i"]
    assert np.sum(u - moved) == pytest.approx(5.0 * 0.125, rel=1e-12)
