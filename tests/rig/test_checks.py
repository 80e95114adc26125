"""What the checks of a recorded run find."""

import numpy as np

from imubayes.rig.checks import GAP, gaps, interval_jump

NOISE = np.random.default_rng(1).standard_normal(500)


def test_even_sampling_has_neither_gap_nor_jump():
    t = np.arange(500) * 0.01
    assert gaps(t) == "" and interval_jump(t) == ""


def test_jitter_below_a_missing_sample_is_no_gap():
    t = np.arange(500) * 0.01 + 0.004 * (GAP - 1.0) * np.tanh(NOISE)
    assert gaps(t) == ""


def test_gaps_are_counted_and_the_longest_is_placed():
    t = np.arange(500) * 0.01
    t[100:] += 0.02
    t[300:] += 5.0
    assert gaps(t) == "2 gaps in time, the longest 5.01 s at t = 3.01 s"


def test_change_of_the_sampling_interval_is_placed():
    step = np.where(np.arange(640) < 448, 0.01, 0.02)
    t = np.concatenate(([0.0], np.cumsum(step)))
    assert interval_jump(t) == (
        "the sampling interval is 0.02 s around t = 4.48 s where it is 0.01 s over most of the run"
    )
