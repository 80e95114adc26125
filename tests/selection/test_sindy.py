"""Sparse regressions beside the evidence: paths, ensembles, stable terms. Resampled campaigns: whitened
dwells, drawn and halved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from decisions import dwells

import imubayes as ib
from imubayes.algebra import factor as algebra
from imubayes.inference.dwells import pieces_of, stacked
from imubayes.inference.linear import linear_of
from imubayes.selection import sindy
from imubayes.selection.sindy import (
    dwelled,
    effects_of,
    halves,
    resampled,
    sparse_regressions,
    with_replacement,
)

P = 8
NAMES = tuple(f"x{j}" for j in range(P))
EFFECTS = np.array([40.0, 15.0, -10.0, 0.0, 0.0, 0.0, 0.0, 0.0])


def campaign(seed, theta=EFFECTS, q=40, m=5):
    """White dwells of two runs over columns of unit sd; `theta` in effects of about 1/sqrt(q m)."""
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(q, m, len(theta)))
    X[..., 1] += 0.7 * X[..., 0]
    y = X @ theta / np.sqrt(q * m) + rng.normal(size=(q, m))
    names = tuple(f"x{j}" for j in range(len(theta)))
    pieces = [dwells(np.concatenate((X, y[..., None]), axis=2)[part], names) for part in halves_of(q)]
    return stacked(pieces), pieces


def halves_of(q):
    return slice(0, q // 2), slice(q // 2, q)


def regressions(factor, pieces, sd=None, candidates=NAMES, resamples=20, seed=0):
    prior = np.full(factor.p, 5.0) if sd is None else sd
    return sparse_regressions(
        factor, pieces, prior, candidates, rng=np.random.default_rng(seed), resamples=resamples
    )


@pytest.fixture(scope="module")
def clear():
    return campaign(1)


@pytest.fixture(scope="module")
def found(clear):
    return regressions(*clear)


def test_each_optimizer_finds_the_terms_that_stand_out(found):
    assert [s.optimizer for s in found] == ["stlsq", "sr3", "ssr", "frols"]
    for s in found:
        assert s.model == s.stable == ("x0", "x1", "x2")
        assert [s.inclusion[name] for name in s.model] == [1.0] * 3
        assert max(s.inclusion[name] for name in NAMES[3:]) < 0.5


def test_units_of_the_columns_change_nothing(clear, found):
    factor, pieces = clear
    units = 10.0 ** np.array([3.0, -6.0, 0.0, 5.0, -2.0, 1.0, 9.0, -4.0, 0.0])
    other = replace(factor, R=factor.R * units)
    scaled = [replace(p, R=p.R * units) for p in pieces]
    for a, b in zip(found, regressions(other, scaled, 5.0 / units[:-1]), strict=True):
        assert (a.model, a.stable, a.inclusion) == (b.model, b.stable, b.inclusion)
        assert np.abs(a.path - b.path).max() < 1e-8 * np.abs(a.path).max()


def test_columns_that_are_no_candidates_are_in_every_model(clear, found):
    """With every candidate in, coefficients are those of the full library."""
    rest = NAMES[3:]
    for s, full in zip(regressions(*clear, candidates=rest)[2:], found[2:], strict=True):
        assert s.names == rest
        assert s.model == ()
        assert s.path[-1] == pytest.approx(full.path[-1][3:], rel=1e-9)


def test_part_of_the_path_near_the_choice_gives_the_frequencies_of_the_whole(monkeypatch):
    """Terms between clear and hidden, so that campaigns differ in their choice."""
    blurred = campaign(2, np.array([9.0, 3.0, 2.5, 2.0, 1.5, 0.0, 0.0, 0.0]))
    near = regressions(*blurred, resamples=25)
    monkeypatch.setattr(sindy, "REACH", 100)
    for a, b in zip(near, regressions(*blurred, resamples=25), strict=True):
        assert max(abs(a.inclusion[name] - b.inclusion[name]) for name in NAMES) <= 2 / 25
        assert a.inclusion["x1"] < 1.0


def test_term_of_a_single_dwell_is_found_as_often_as_that_dwell_is_drawn():
    """It is drawn with probability 1 - (1 - 1/q)^q; two such terms leave halves with neither."""
    q, draws = 10, 60
    rng = np.random.default_rng(6)
    X = np.zeros((q, 20, 3))
    X[..., 0], X[0, :, 1], X[1, :, 2] = 1.0, 1.0, 1.0
    y = X @ np.array([3.0, 30.0, -30.0]) + rng.normal(size=(q, 20))
    names = ("x0", "x1", "x2")
    pieces = [dwells(np.concatenate((X, y[..., None]), axis=2), names)]
    share = 1.0 - (1.0 - 1.0 / q) ** q
    error = np.sqrt(share * (1.0 - share) / draws)
    for s in regressions(stacked(pieces), pieces, np.full(3, 50.0), names, resamples=draws):
        assert s.model == names
        assert s.inclusion["x0"] == 1.0
        for name in ("x1", "x2"):
            assert s.inclusion[name] == pytest.approx(share, abs=4.0 * error)
        assert s.stable == ("x0",)


def test_without_dwells_there_are_paths_and_no_frequencies(clear):
    factor, pieces = clear
    one = replace(pieces[0], rows=pieces[0].rows[:1], R=pieces[0].R[:1])
    for none in ([], [one]):
        for s in regressions(factor, none):
            assert s.model == ("x0", "x1", "x2")
            assert np.isnan(list(s.inclusion.values())).all()
            assert np.isnan(s.false_bound)
            assert s.stable == ()


def test_nothing_to_choose_from_is_no_regression(clear):
    assert regressions(*clear, candidates=()) == ()


def test_simulated_sensor_keeps_what_is_far_above_its_effect_and_nothing_that_is_zero():
    """Coloured noise, columns up to (20 g)^3 beside ones: a threshold means the same for each.

    Only FROLS may add a term: it takes b3 before b1 and b1p have their share, and never lets go of it.
    """
    lib = ib.library("accelerometer", set="extended")
    sensor = ib.sensor("mems_tactical", kind="accelerometer")
    prior = ib.prior(sensor, lib)
    truth = dict(zip(lib.names, prior.sd * (np.arange(len(lib.names)) % 2 == 0), strict=True))
    runs = ib.simulate(sensor, [ib.tumble(angles=24), ib.centrifuge([1, 5, 20])], seed=5, truth=truth)
    summary = ib.summarize(runs, lib, sensor=sensor)
    tested = tuple(np.array(lib.names)[summary.factor.column_norms > 0.0].tolist())
    sd = prior.sd[summary.factor.column_norms > 0.0]
    factor = algebra.reorder(summary.factor, tested)
    unit = effects_of(factor, sd, tested, algebra.noise_scale(factor, sd)).unit
    clear = {name for name, u in zip(tested, unit, strict=True) if abs(truth[name]) > 8.0 * u}
    assert len(clear) >= 5
    zero = {name for name in tested if not truth[name]}
    false = {
        s.optimizer: set(s.model) & zero for s in regressions(factor, [], sd, tested) if clear <= set(s.model)
    }
    assert false == {"stlsq": set(), "sr3": set(), "ssr": set(), "frols": {"b3"}}


@pytest.mark.slow
def test_false_terms_among_the_stable_ones_stay_within_their_bound():
    """Fourteen terms are zero, and two near the noise: means over 40 campaigns, with 4 standard errors."""
    theta = np.array([30.0, 10.0, 3.0, 2.0, *np.zeros(14)])
    names = tuple(f"x{j}" for j in range(len(theta)))
    false, bound = [], []
    for seed in range(40):
        factor, pieces = campaign(100 + seed, theta, q=60)
        out = regressions(factor, pieces, candidates=names, resamples=80, seed=seed)
        false.append([len(set(s.stable) - set(names[:4])) for s in out])
        bound.append([s.false_bound for s in out])
    error = np.std(false, axis=0) / np.sqrt(len(false))
    assert (np.mean(false, axis=0) - 4.0 * error <= np.mean(bound, axis=0)).all()
    assert np.mean(bound) < 2.0


NOISE = ib.Noise(1e-3, 5e-4, 1e-5)


@pytest.fixture(scope="module")
def pieces():
    lib = ib.library("accelerometer", powers=2, asymmetry=0)
    sensor = ib.sensor("mems_tactical", kind="accelerometer")
    runs = ib.simulate(sensor, [ib.tumble(angles=6), ib.centrifuge([1, 5])], seed=3)
    return [pieces_of(linear_of(run, lib), NOISE) for run in runs]


def gram(R):
    return R.T @ R


@pytest.mark.parametrize("kept", [False, True])
def test_resampled_factor_is_the_stack_of_the_counted_dwells(pieces, kept):
    """Fewer rows, fewer columns in another order, and the same factor; what is kept is in each once."""
    names = ("c_ij", "b0", "m_k", "b1")
    drawn = dwelled([pieces[0], replace(pieces[1], kept=kept)], names)
    assert drawn.sizes == tuple(len(p) for p in pieces[: 1 if kept else 2])
    assert len(drawn.rows) < sum(p.R.shape[0] * p.R.shape[1] for p in pieces) / 3
    once = [np.ones(len(pieces[1]), dtype=np.int64)] if kept else []
    for counts in with_replacement(drawn.sizes, 3, np.random.default_rng(1)):
        by_run = [*np.split(counts, np.cumsum(drawn.sizes)[:-1]), *once]
        direct = gram(algebra.reorder(stacked(pieces, by_run), names).R)
        found = gram(resampled(drawn, counts).R)
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
