"""Dwells as small factors that add up to the run's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import imubayes as ib
from imubayes.inference.dwells import pieces_of, stacked, whitened_factor
from imubayes.inference.linear import linear_of
from imubayes.inference.whiten import mattering
from imubayes.sensors.noise import Noise

NOISE = Noise(1e-3, 5e-4, 1e-5)


@pytest.fixture(scope="module")
def rows():
    lib = ib.library("accelerometer", powers=2, asymmetry=0)
    run = ib.simulate(ib.sensor("mems_tactical", kind="accelerometer"), [ib.tumble(angles=6)], seed=3)[0]
    return linear_of(run, lib)


def gram(R):
    return R.T @ R


def test_pieces_stack_to_the_factor_of_the_run(rows):
    whole, _ = whitened_factor(rows, NOISE)
    pieces = pieces_of(rows, NOISE)
    again = stacked([pieces])
    assert np.abs(gram(again.R) - gram(whole.R)).max() < 1e-10 * np.abs(gram(whole.R)).max()
    assert again.n == whole.n == len(rows)
    assert again.log_det == pytest.approx(whole.log_det, rel=1e-12)


def test_counts_leave_out_and_double(rows):
    pieces = pieces_of(rows, NOISE)
    counts = np.ones(len(pieces), dtype=np.int64)
    counts[0], counts[1] = 0, 2
    direct = sum(c * gram(R) for c, R in zip(counts, pieces.R, strict=True))
    made = stacked([pieces], [counts])
    assert np.abs(gram(made.R) - direct).max() < 1e-10 * np.abs(direct).max()
    assert made.n == int(counts @ pieces.rows)


def test_first_dwells_are_a_run_of_their_own(rows):
    """A dwell adds what it says beyond those before it: the first ones alone are a shorter run's factor."""
    pieces = pieces_of(rows, NOISE)
    stop = int(pieces.rows[:5].sum())
    short = replace(rows, t=rows.t[:stop], duration=rows.duration[:stop], y=rows.y[:stop])
    alone, _ = whitened_factor(short, NOISE, mattering(NOISE, rows.rows))
    counts = np.where(np.arange(len(pieces)) < 5, 1, 0)
    first, short_gram = gram(stacked([pieces], [counts]).R), gram(alone.R)
    assert np.abs(first - short_gram).max() < 1e-10 * np.abs(short_gram).max()
