"""What the checks of a recorded run find: gaps, saturated samples, and nothing else."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imubayes.rig.checks import GAP, NEAR, OutputLevels, beyond, pace_notes, pace_of
from imubayes.rig.inputs import sampling_interval

NOISE = np.random.default_rng(1).standard_normal(20_000)


def notes(t, *cuts):
    """What is said of the time, which is looked at in parts that end at the cuts."""
    usual, edges = sampling_interval(t), [0, *cuts, len(t)]
    parts = [t[max(a - 1, 0) : b] for a, b in pairwise(edges)]
    return pace_notes([pace_of(part, usual) for part in parts], usual)


def test_even_sampling_with_jitter_below_a_missing_sample_has_neither_gap_nor_jump():
    t = np.arange(500) * 0.01
    assert notes(t) == notes(t, 100, 300) == notes(t + 0.004 * (GAP - 1.0) * np.tanh(NOISE[:500])) == ()


def test_gaps_are_counted_and_the_longest_is_placed():
    t = np.arange(500) * 0.01
    t[100:] += 0.02
    t[300:] += 5.0
    assert notes(t) == notes(t, 300) == ("2 gaps in time, the longest 5.01 s at t = 3.01 s",)


def test_change_of_the_sampling_interval_is_placed():
    step = np.where(np.arange(640) < 448, 0.01, 0.02)
    t = np.concatenate(([0.0], np.cumsum(step)))
    note = "the sampling interval is 0.02 s around t = 4.48 s where it is 0.01 s over most of the run"
    assert notes(t)[1:] == notes(t, 449)[1:] == (note,)


SINE = np.sin(2.0 * np.pi * np.arange(20_000) / 1000.0)
DWELLS = np.repeat(np.linspace(-20.0, 20.0, 40), 500)


def quantised(values, step):
    return np.round(values / step) * step


HEALTHY = {
    "noise": NOISE,
    "quantised noise": quantised(NOISE, 0.05),
    "few levels": quantised(NOISE, 1.0),
    "one level in nearly all rows": quantised(1e-3 * NOISE + 0.4, 1.0),
    "quantised walk": quantised(np.cumsum(NOISE), 1.0),
    "coarse dwells": quantised(DWELLS + 0.01 * NOISE, 0.1),
    "quantised dwells": quantised(DWELLS + 0.01 * NOISE, 0.03),
    "dwells without noise": DWELLS,
    "sine": SINE,
    "quantised sine": quantised(SINE, 1.0 / 163.0),
    "finely quantised sine": quantised(SINE, 1e-3),
    "samples held": np.repeat(NOISE[:2000], 10),
    "a few equal spikes": np.append(NOISE, [50.0] * 5),
    "ramp": np.arange(500.0),
}


@pytest.mark.parametrize("healthy", HEALTHY.values(), ids=HEALTHY)
def test_healthy_output_has_no_end_of_its_range(healthy):
    assert OutputLevels().add(healthy).rails() == ()


@pytest.mark.parametrize("step", [0.0, 0.002], ids=["continuous", "quantised"])
@pytest.mark.parametrize("moved", [DWELLS, 20.0 * SINE, np.zeros(20_000)], ids=["dwells", "sine", "rest"])
def test_clipped_output_shows_the_ends_of_its_range(moved, step):
    output = moved + 0.05 * NOISE
    output = quantised(output, step) if step else output
    low, high = np.quantile(output, [0.05, 0.9])
    assert OutputLevels().add(np.clip(output, low, high)).rails() == (low, high)
    assert OutputLevels().add(np.minimum(output, high)).rails() == (high,)
    assert OutputLevels().add(np.maximum(output, low)).rails() == (low,)


def test_what_noise_brings_back_from_beyond_goes_with_the_saturated_samples():
    straddling = np.minimum(10.0 + 0.1 * NOISE[:5000], 10.0)
    output = np.concatenate((NOISE[:5000], straddling))
    out = beyond(output, OutputLevels().add(output).rails())
    assert not out[:5000].any() and np.mean(out[5000:]) > 0.98


@given(cuts=st.lists(st.integers(1, 2999), max_size=5))
def test_parts_of_an_output_have_the_ends_of_the_whole(cuts):
    output = np.clip(NOISE[:3000], -1.0, 1.5)
    found = OutputLevels()
    for part in np.split(output, sorted(cuts)):
        found.add(part)
    assert found.rails() == (-1.0, 1.5)


@given(st.lists(st.integers(0, 60), min_size=2, unique=True))
def test_samples_closer_than_so_many_at_the_end_of_the_range_go(at):
    output = np.zeros(61)
    output[at] = 1.0
    at, out = sorted(at), beyond(output, (1.0,))
    for a, b in pairwise(at):
        assert out[a : b + 1].all() if b - a <= NEAR else not out[a + 1 : b].any()
