"""What the checks of a recorded run find."""

import numpy as np
import pytest

from imubayes.rig.checks import GAP, LEVELS, RAIL, gaps, interval_jump, saturation

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


def test_clipping_is_told_with_its_share():
    clipped = np.clip(np.repeat(NOISE, 4), -1.0, 1.0)
    share = np.mean(np.abs(clipped) == 1.0)
    assert f"{100.0 * share:.2g} % of the time" in saturation("output", clipped)


@pytest.mark.parametrize(
    "healthy",
    [NOISE, np.round(NOISE * 3.0), np.repeat([5.0, *NOISE, 6.0], RAIL - 1)],
    ids=["noise", "few levels", "shorter than a rail"],
)
def test_healthy_output_is_not_called_saturated(healthy):
    assert saturation("output", healthy) == ""


def test_coarse_output_of_enough_levels_at_a_rail_is_called_saturated():
    ramp = np.minimum(np.arange(2 * LEVELS), LEVELS)
    assert saturation("ax", ramp.astype(float)).startswith("ax rests at")
