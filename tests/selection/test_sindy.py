"""Sparse regressions beside the evidence: paths, ensembles, stable terms. Resampled campaigns: whitened
dwells, drawn and halved. Detectable effects, the evidence of a support, pysindy on a triangle."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pysindy as ps
import pytest
from decisions import dwells
from scipy.stats import multivariate_normal

import imubayes as ib
from imubayes.algebra import factor as algebra
from imubayes.algebra.factor import factor_of
from imubayes.inference.dwells import pieces_of, stacked
from imubayes.inference.linear import linear_of
from imubayes.selection import sindy
from imubayes.selection.optimizers import PATHS
from imubayes.selection.sindy import (
    best_of,
    dwelled,
    effects_of,
    halves,
    log_evidence,
    refitted,
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


COLUMNS = ("bias", "a", "b", "c", "d")
SD = np.array([3.0, 2.0, 0.5, 40.0, 1.0])
SCALE = 0.7
CANDIDATES = ("c", "a", "d", "b")  # another order than the factor's; "bias" is in every model


@pytest.fixture(scope="module")
def rows():
    rng = np.random.default_rng(5)
    X = rng.normal(size=(30, 5)) * np.array([1.0, 1.0, 5.0, 0.01, 0.3])
    X[:, 0] = 1.0
    X[:, 2] += 4.0 * X[:, 1]
    theta = np.array([2.0, 1.0, 0.0, 30.0, 0.0])
    return X, X @ theta + SCALE * rng.normal(size=30)


@pytest.fixture(scope="module")
def effects(rows):
    return effects_of(factor_of(*rows, COLUMNS), SD, CANDIDATES, SCALE)


def every_support(p):
    return (np.arange(1 << p)[:, None] >> np.arange(p) & 1).astype(bool)


def columns_of(support):
    return [0, *(COLUMNS.index(name) for name, inside in zip(CANDIDATES, support, strict=True) if inside)]


def test_evidence_is_the_density_of_the_rows(rows, effects):
    """The other columns integrated out with their prior: a normal density in as many dimensions as rows."""
    X, y = rows
    direct = []
    for support in every_support(4):
        A = X[:, columns_of(support)] * SD[columns_of(support)]
        direct.append(multivariate_normal(cov=SCALE**2 * np.eye(30) + A @ A.T).logpdf(y))
    found = log_evidence(effects, every_support(4))
    assert found - found[0] == pytest.approx(np.array(direct) - direct[0], abs=1e-8)


def test_refit_is_the_posterior_mean_in_effects(rows, effects):
    X, y = rows
    for support, theta in zip(every_support(4), refitted(effects, every_support(4)), strict=True):
        inside = columns_of(support)
        A = np.vstack((X[:, inside], np.diag(SCALE / SD[inside])))
        direct = np.linalg.lstsq(A, np.concatenate((y, np.zeros(len(inside)))))[0][1:]
        assert theta[support] * effects.unit[support] == pytest.approx(direct, rel=1e-9)
        assert not theta[~support].any()


def test_effect_is_the_posterior_sd_of_the_full_library(rows, effects):
    X, _ = rows
    covariance = np.linalg.inv(X.T @ X / SCALE**2 + np.diag(SD**-2.0))
    sd = np.sqrt(np.diag(covariance))
    assert effects.unit == pytest.approx([sd[COLUMNS.index(name)] for name in CANDIDATES], rel=1e-10)
    inverse = np.linalg.inv(effects.R[:-1, :-1])
    assert np.linalg.norm(inverse, axis=1) == pytest.approx(np.ones(4), rel=1e-12)


def test_null_direction_has_the_effect_that_the_prior_leaves():
    """Of two equal columns only the sum is seen: each is as unknown as their difference, sd/sqrt(2)."""
    x = np.linspace(1.0, 2.0, 50)
    twins = effects_of(factor_of(np.column_stack((x, x)), x, ("a", "b")), np.full(2, 5.0), ("a", "b"), 1e-6)
    assert twins.unit == pytest.approx([5.0 / np.sqrt(2.0)] * 2, rel=1e-6)


def test_term_that_was_not_excited_is_no_candidate(rows):
    X, y = rows
    without = np.where(np.arange(5) == 2, 0.0, X)
    assert effects_of(factor_of(without, y, COLUMNS), SD, CANDIDATES, SCALE).names == ("c", "a", "d")


def test_of_equal_scores_the_smallest_support_is_taken_in_the_middle_of_its_stretch():
    supports = np.array([[1, 1], [1, 0], [1, 0], [1, 0], [0, 0]], dtype=bool)
    assert best_of(supports, np.array([-1.0, -1.0, -1.0, -1.0, -9.0])) == 2
    assert best_of(supports, np.array([-0.5, -1.0, -1.0, -1.0, -9.0])) == 0


TRUTH = np.array([9.0, 0.0, -3.0, 0.4, 0.0, 1.5, 0.0, 0.0])


def regression_rows(seed=0, n=90):
    """White rows over columns of which the first three are alike."""
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(n, len(TRUTH)))
    X[:, 1:3] += 2.0 * X[:, :1]
    return X, X @ TRUTH + rng.normal(size=n)


def triangle(X, y):
    R = factor_of(X, y, tuple(f"x{j}" for j in range(X.shape[1]))).R
    return R[:-1, :-1], R[:-1, -1]


@pytest.mark.parametrize(("b", "reached"), [([2.0, 0, 0, 0, 0], 1), ([1.0, 0.0, 2.0, 0.0, 0.0], 2)])
def test_a_path_that_ends_where_nothing_is_left_keeps_its_largest_support(b, reached):
    """pysindy's FROLS goes on to nothing once the residual is zero."""
    A = np.triu(np.random.default_rng(1).normal(size=(5, 5))) + 3.0 * np.eye(5)
    supports = PATHS["frols"](A, A @ np.array(b), np.arange(6.0))
    assert supports.sum(axis=1).tolist() == [min(k, reached) for k in range(5)] + [5]
    assert (supports[reached] == (np.array(b) != 0.0)).all()


@pytest.mark.parametrize("name", ["stlsq", "sr3"])
def test_path_over_thresholds_is_a_fit_at_each_of_them(name):
    A, b = triangle(*regression_rows(1))
    thresholds = np.geomspace(0.1, 20.0, 15)
    one_by_one = {
        "stlsq": lambda t: ps.STLSQ(threshold=t, alpha=0.0, unbias=False),
        "sr3": lambda t: ps.SR3(ps.SR3.calculate_l0_weight(t, 1.0), "l0", 1.0, tol=1e-3, max_iter=500),
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        single = [one_by_one[name](float(t)).fit(A, b).coef_[0] != 0.0 for t in thresholds]
    path = PATHS[name](A, b, thresholds)
    assert len(np.unique(path, axis=0)) > 4
    assert np.array_equal(path, single)


@pytest.mark.parametrize("name", ["ssr", "frols"])
def test_path_over_sizes_is_what_pysindy_goes_through(name):
    A, b = triangle(*regression_rows(4))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        whole = {"ssr": ps.SSR, "frols": ps.FROLS}[name](alpha=0.0, max_iter=8, unbias=False).fit(A, b)
    visited = {int(np.sum(c != 0.0)): c[0] != 0.0 for c in whole.history_[1:]}
    path = PATHS[name](A, b, np.arange(9.0))
    assert len(visited) >= 7
    assert all(np.array_equal(path[k], support) for k, support in visited.items())


def test_frols_says_that_columns_are_dependent():
    with pytest.raises(ValueError, match="dependent"):
        PATHS["frols"](np.ones((3, 3)), np.arange(3.0), np.arange(4.0))


def test_ssr_drops_the_smallest_coefficient_at_each_step():
    A, b = triangle(*regression_rows(2))
    inside, expected = np.ones(8, dtype=bool), []
    for _ in range(8):
        theta = np.zeros(8)
        theta[inside] = np.linalg.lstsq(A[:, inside], b)[0]
        inside = inside & (np.arange(8) != np.argmin(np.where(inside, np.abs(theta), np.inf)))
        expected.append(inside)
    assert np.array_equal(PATHS["ssr"](A, b, np.arange(9.0)), [*expected[::-1], np.ones(8, dtype=bool)])


def test_frols_adds_what_lowers_the_residual_most():
    A, b = triangle(*regression_rows(3))
    inside, expected = [], [[]]

    def residual(j):
        return float(np.linalg.lstsq(A[:, [*inside, j]], b)[1].sum())

    for _ in range(7):  # the last column leaves no residual to compare
        inside.append(min((j for j in range(8) if j not in inside), key=residual))
        expected.append(list(inside))
    path = PATHS["frols"](A, b, np.arange(8.0))
    assert [sorted(np.flatnonzero(s)) for s in path] == [sorted(s) for s in expected]


def test_ssr_ends_its_path_where_no_effect_is_left():
    # columns of which the data say nothing keep exactly the zero of their prior
    path = PATHS["ssr"](np.eye(4), np.array([3.0, 0.0, 0.0, 1.0]), np.arange(5.0))
    assert path.tolist() == [
        [False, False, False, False],
        [True, False, False, False],
        [True, False, False, True],
        [True, False, False, True],
        [True, True, True, True],
    ]
