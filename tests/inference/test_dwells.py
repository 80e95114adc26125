"""Dwells: a partition of the rows, and averages with their covariance; what the inputs drove."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import imubayes as ib
from imubayes.inference.dwells import (
    MOST,
    dwell_edges,
    dwells_of,
    pieces_of,
    rows_kept,
    stacked,
    whitened_factor,
)
from imubayes.inference.linear import drive, linear_of, reach_of
from imubayes.inference.whiten import processes, whiten
from imubayes.rig.filtering import PIECES
from imubayes.sensors.noise import Noise
from imubayes.sensors.terms import columns

TACTICAL = ib.sensor("mems_tactical", kind="accelerometer")
LIBRARY = ib.library("accelerometer")
COLOURED = Noise(6e-4, 4e-4, 3e-5)


def tumble(rate=1.0):
    (run,) = ib.simulate(TACTICAL, [ib.tumble(angles=12, planes=1, rate=rate)], seed=1)
    return run


def covariance(rows, parts):
    W = whiten(COLOURED, rows, np.eye(len(rows.t)), parts)[0]
    L = np.linalg.inv(W)
    return L @ L.T


def test_dwells_of_a_tumble_are_its_positions():
    dwells = dwells_of(linear_of(tumble(), LIBRARY))
    np.testing.assert_array_equal(dwells.edges, 30 * np.arange(13))
    # the first sample is at 0 and lasts a second, 5 s pass between dwells
    np.testing.assert_allclose(dwells.start, 35.0 * np.arange(12) - 0.5)
    np.testing.assert_allclose(dwells.stop - dwells.start, 30.0)


def test_means_and_their_covariance_are_those_of_the_averaged_samples():
    rows = linear_of(tumble(), LIBRARY)
    dwells = dwells_of(rows)
    average = np.kron(np.eye(12), np.full(30, 1.0 / 30.0))
    np.testing.assert_allclose(dwells.means.X, average @ rows.columns(0, len(rows)), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(dwells.means.y, average @ rows.y, rtol=1e-12)
    parts = processes(rows.rows)
    of_samples = average @ covariance(rows.rows, parts) @ average.T
    # averages of averages: to rounding of the inverse
    np.testing.assert_allclose(covariance(dwells.means.rows, parts), of_samples, rtol=1e-9)


@pytest.mark.parametrize("parts", [1, 5, 50, 5000])
def test_dwells_partition_the_rows_and_are_never_many(parts):
    rng = np.random.default_rng(parts)
    lengths = rng.integers(1, 40, parts) if parts > 5 else rng.integers(500, 4000, parts)
    t = np.concatenate([1e5 * k + np.arange(float(n)) for k, n in enumerate(lengths)])
    edges = dwell_edges(t, 1.0)
    assert (edges[0], edges[-1]) == (0, len(t))
    assert np.all(np.diff(edges) > 0)
    assert len(edges) - 1 <= MOST
    if parts <= PIECES:  # then none reaches across a gap
        assert all(np.all(np.diff(piece) == 1.0) for piece in np.split(t, edges[1:-1]))


def test_a_log_is_cut_so_that_a_shock_costs_little_of_it():
    edges = dwell_edges(np.arange(36_000.0), 1.0)
    assert np.diff(edges).max() <= 36_000 / PIECES


def test_a_mount_with_ramps_and_levels_is_cut_and_noisy_inputs_are_not():
    plan = ib.centrifuge([1, 5, 20], rate=2.0, ramp=True)
    (run,) = ib.simulate(TACTICAL, [plan], seed=1, truth={})
    dwells = dwells_of(linear_of(run, LIBRARY))
    assert PIECES / 2 < len(dwells) <= 2 * PIECES
    still = tumble(rate=10.0)
    noisy = {
        name: values + 1e-3 * np.random.default_rng(1).normal(size=len(values)) * np.abs(values).max()
        for name, values in still.inputs.channels.items()
    }
    measured = replace(still, inputs=replace(still.inputs, channels=noisy))
    assert len(dwells_of(linear_of(measured, LIBRARY))) == 12


def test_rows_without_a_dwell_are_the_rows_of_the_run_without_it():
    run, mounts = tumble(), np.repeat(np.arange(12), 30)
    run = replace(run, inputs=replace(run.inputs, mount=mounts))
    rows = linear_of(run, LIBRARY)
    bad = np.isin(np.arange(12), [0, 5, 11])
    kept = np.repeat(~bad, np.diff(dwells_of(rows).edges))
    assert np.count_nonzero(kept) == 9 * 30
    few = rows_kept(rows, kept)
    ours = whitened_factor(few, COLOURED)
    less = run.left(kept)
    theirs = whitened_factor(linear_of(less, LIBRARY), COLOURED)
    np.testing.assert_array_equal(ours.R, theirs.R)
    np.testing.assert_array_equal(reach_of(few), reach_of(linear_of(less, LIBRARY)))
    np.testing.assert_array_equal(less.inputs.mount, mounts[kept])
    assert "90 of 360 samples" in less.source.notes[-1]
    assert run.left(np.ones(360, dtype=bool)).source.notes == run.source.notes


@pytest.fixture(scope="module")
def rows():
    return linear_of(tumble(), LIBRARY)


def gram(R):
    return R.T @ R


def test_pieces_stack_to_the_factor_of_the_run(rows):
    whole = whitened_factor(rows, COLOURED)
    pieces = pieces_of(rows, COLOURED)
    again = stacked([pieces])
    assert np.abs(gram(again.R) - gram(whole.R)).max() < 1e-10 * np.abs(gram(whole.R)).max()
    assert again.n == whole.n == len(rows)
    assert again.log_det == pytest.approx(whole.log_det, rel=1e-12)


def test_counts_leave_out_and_double(rows):
    pieces = pieces_of(rows, COLOURED)
    counts = np.ones(len(pieces), dtype=np.int64)
    counts[0], counts[1] = 0, 2
    direct = sum(c * gram(R) for c, R in zip(counts, pieces.R, strict=True))
    made = stacked([pieces], [counts])
    assert np.abs(gram(made.R) - direct).max() < 1e-10 * np.abs(direct).max()
    assert made.n == int(counts @ pieces.rows)


def test_first_dwells_are_a_run_of_their_own(rows):
    """A dwell adds what it says beyond those before it: the first ones alone are a shorter run's factor."""
    pieces = pieces_of(rows, COLOURED)
    stop = int(pieces.rows[:5].sum())
    short = replace(rows, t=rows.t[:stop], duration=rows.duration[:stop], y=rows.y[:stop])
    alone = whitened_factor(short, COLOURED, processes(rows.rows, COLOURED))
    counts = np.where(np.arange(len(pieces)) < 5, 1, 0)
    first, short_gram = gram(stacked([pieces], [counts]).R), gram(alone.R)
    assert np.abs(first - short_gram).max() < 1e-10 * np.abs(short_gram).max()


PLANS = ib.tumble(angles=8, dwell=2.0, rate=1.0), ib.centrifuge([1, 5], dwell=2.0, rate=1.0)


def test_drive_is_the_square_of_the_columns_over_all_samples_whatever_their_noise():
    runs = ib.simulate(TACTICAL, PLANS, seed=1)
    f = drive([linear_of(run, LIBRARY) for run in runs], LIBRARY.names, LIBRARY.names)
    X = np.vstack([columns(LIBRARY, plan.inputs.channels, len(plan.inputs)) for plan in PLANS])
    assert f.n == len(X)
    size = np.linalg.norm(X, axis=0)
    size[size == 0.0] = 1.0
    np.testing.assert_allclose(f.R[:-1, :-1].T @ f.R[:-1, :-1] / np.outer(size, size),
                               X.T @ X / np.outer(size, size), atol=1e-13)  # fmt: skip


def test_share_of_a_component_in_the_rows_of_a_case_does_not_count():
    runs = ib.simulate(TACTICAL, PLANS[:1], seed=1)
    rows = linear_of(runs[0], LIBRARY)
    share = np.random.default_rng(1).uniform(-1.0, 1.0, len(rows))
    share[3] = 0.0
    shared = replace(rows, columns=lambda a, b: share[a:b, None] * rows.columns(a, b))
    kept = np.delete(rows.columns(0, len(rows)), 3, axis=0)
    f = drive([shared], LIBRARY.names, LIBRARY.names)
    assert f.n == len(kept)
    np.testing.assert_allclose(f.column_norms, np.linalg.norm(kept, axis=0), rtol=1e-12)
