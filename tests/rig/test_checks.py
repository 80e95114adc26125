"""What the checks of a recorded run find."""

from itertools import pairwise

import numpy as np

from imubayes.rig.checks import GAP, pace_notes, pace_of
from imubayes.rig.inputs import sampling_interval


def notes(t, *cuts):
    """What is said of the time, which is looked at in parts that end at the cuts."""
    usual, edges = sampling_interval(t), [0, *cuts, len(t)]
    parts = [t[max(a - 1, 0) : b] for a, b in pairwise(edges)]
    return pace_notes([pace_of(part, usual) for part in parts], usual)


NOISE = np.random.default_rng(1).standard_normal(500)


def test_even_sampling_has_neither_gap_nor_jump():
    t = np.arange(500) * 0.01
    assert notes(t) == notes(t, 100, 300) == ()


def test_jitter_below_a_missing_sample_is_no_gap():
    t = np.arange(500) * 0.01 + 0.004 * (GAP - 1.0) * np.tanh(NOISE)
    assert notes(t) == ()


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
