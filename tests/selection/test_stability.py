"""Resampled campaigns: whitened dwells, drawn and halved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import imubayes as ib
from imubayes.algebra import factor as algebra
from imubayes.inference.dwells import Pieces, stacked
from imubayes.inference.linear import linear_of
from imubayes.inference.whitened import pieces_of
from imubayes.selection.sindy import dwelled, halves, resampled, with_replacement

NOISE = ib.Noise(1e-3, 5e-4, 1e-5)


@pytest.fixture(scope="module")
def pieces():
    lib = ib.library("accelerometer", powers=2, asymmetry=0)
    sensor = ib.sensor("mems_tactical", kind="accelerometer")
    runs = ib.simulate(sensor, [ib.tumble(angles=6), ib.centrifuge([1, 5])], seed=3)
    return [pieces_of(linear_of(run, lib), NOISE) for run in runs]


def gram(R):
    return R.T @ R


def test_resampled_factor_is_the_stack_of_the_counted_dwells(pieces):
    """Fewer rows, fewer columns in another order, and the same factor."""
    names = ("c_ij", "b0", "m_k", "b1")
    dwells = dwelled(pieces, names)
    assert len(dwells.rows) < sum(p.R.shape[0] * p.R.shape[1] for p in pieces) / 3
    for counts in with_replacement(dwells.sizes, 3, np.random.default_rng(1)):
        by_run = np.split(counts, np.cumsum(dwells.sizes)[:-1])
        direct = gram(algebra.reorder(stacked(pieces, by_run), names).R)
        found = gram(resampled(dwells, counts).R)
        size = np.sqrt(np.diag(direct))
        assert (np.abs(found - direct) <= 1e-10 * np.outer(size, size)).all()


def test_pieces_that_are_always_there_are_in_every_campaign_once(pieces):
    names = ("c_ij", "b0", "m_k", "b1")
    dwells = dwelled([pieces[0], replace(pieces[1], kept=True)], names)
    assert dwells.sizes == (len(pieces[0]),)
    (counts,) = with_replacement(dwells.sizes, 1, np.random.default_rng(1))
    once = np.ones(len(pieces[1]), dtype=np.int64)
    direct = gram(algebra.reorder(stacked(pieces, [counts, once]), names).R)
    found = gram(resampled(dwells, counts).R)
    size = np.sqrt(np.diag(direct))
    assert (np.abs(found - direct) <= 1e-10 * np.outer(size, size)).all()


def test_each_run_keeps_its_number_of_dwells():
    draws = list(with_replacement((5, 1, 9), 20, np.random.default_rng(2)))
    assert {tuple(np.add.reduceat(c, [0, 5, 6]).tolist()) for c in draws} == {(5, 1, 9)}
    assert len({tuple(c.tolist()) for c in draws}) == 20


def test_two_halves_share_no_dwell_and_leave_none():
    drawn = list(halves((6, 5), 10, np.random.default_rng(3)))
    assert len(drawn) == 20
    for first, second in zip(drawn[::2], drawn[1::2], strict=True):
        assert np.array_equal(first + second, np.ones(11))
        assert first[:6].sum() == 3
        assert first[6:].sum() in (2, 3)


def test_half_without_any_row_is_a_factor_of_nothing(pieces):
    dwells = dwelled(pieces, ("b0", "b1"))
    assert not resampled(dwells, np.zeros(sum(dwells.sizes), dtype=np.int64)).R.any()


def drifting(seed, q=40, m=25, drift=2.0):
    """Dwells of m rows with a drift in common: whitened as dwells, and their raw rows taken for white."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=q)
    raw = np.empty((q, m, 3))
    raw[..., 0], raw[..., 1] = 1.0, x[:, None]
    raw[..., 2] = 0.5 * x[:, None] + drift * rng.normal(size=(q, 1)) + rng.normal(size=(q, m))
    whitening = np.linalg.inv(np.linalg.cholesky(np.eye(m) + drift**2))
    return as_pieces(whitening @ raw), as_pieces(raw.reshape(q * m, 1, 3))


def as_pieces(blocks):
    R = np.array([algebra.triangular([block], 3) for block in blocks])
    rows = np.full(len(R), blocks.shape[1])
    return Pieces("run", ("bias", "slope"), 0.0 * rows, 1.0 + rows, rows, R, 0.0 * rows)


def spread(pieces, draws=150):
    """Sd of the least-squares slope over resampled campaigns."""
    dwells = dwelled([pieces], ("bias", "slope"))
    factors = (resampled(dwells, c) for c in with_replacement(dwells.sizes, draws, np.random.default_rng(4)))
    return np.std([algebra.least_squares(f).mean[1] for f in factors])


def test_dwells_drawn_whole_spread_as_the_coefficient_does_and_single_rows_do_not():
    """Eight campaigns of 40 dwells, in quadrature: their sd is known to 1/sqrt(2 40 8), 4 %.

    Single rows believe the drift that they have in common: they are sqrt((1 + drift^2 m)/(1 + drift^2)), 4.5
    times, too sure.
    """
    ratios = []
    for seed in range(8):
        by_dwell, by_row = drifting(seed)
        truth = np.sqrt(np.linalg.inv(gram(stacked([by_dwell]).R[:2, :2]))[1, 1])
        ratios.append([spread(by_dwell) / truth, spread(by_row) / truth])
    found = np.sqrt(np.mean(np.square(ratios), axis=0))
    error = 1.0 / np.sqrt(2.0 * 40 * 8)
    assert found == pytest.approx([1.0, np.sqrt(5.0 / 101.0)], rel=4.0 * error)


def test_counts_of_rows_do_not_change_what_dwells_say(pieces):
    """A dwell cut in two names two dwells and the same whole."""
    first = pieces[0]
    halved = replace(
        first,
        start=np.repeat(first.start, 2),
        stop=np.repeat(first.stop, 2),
        rows=np.repeat(first.rows // 2, 2),
        R=np.repeat(first.R / np.sqrt(2.0), 2, axis=0),
        log_det=np.repeat(first.log_det / 2.0, 2),
    )
    whole = resampled(dwelled([first], ("b0", "b1")), np.ones(len(first), dtype=np.int64))
    cut = resampled(dwelled([halved], ("b0", "b1")), np.ones(2 * len(first), dtype=np.int64))
    assert np.abs(gram(cut.R) - gram(whole.R)).max() < 1e-10 * gram(whole.R).max()
