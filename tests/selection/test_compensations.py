"""What is exported: models against refits by least squares, and against positions that nobody has seen. The
smallest model that predicts as well as the posterior, against brute force over all subsets."""

import math
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

import imubayes as ib
from imubayes.algebra.factor import factor_of
from imubayes.inference.linear import linear_of
from imubayes.inference.prior import ScalePrior
from imubayes.inference.summary import summarize
from imubayes.rig.inputs import Inputs, Run
from imubayes.selection.compensations import compensations, design_factor, project, reduced, subsets_by_size
from imubayes.selection.decision import select
from imubayes.sensors.noise import Noise, NoiseRule
from imubayes.sensors.terms import library

LIB = library("accelerometer", powers=3, asymmetry=-1)
TIED = replace(LIB, ties=(("c_ik", "c_ij"),))
G, N = 9.81, 1e-3
TRUTH = {"b0": 0.05, "b1": 2e-3, "m_j": 1e-3, "b2": 6e-6, "c_ij": 8e-6, "c_jk": 7e-6}


def positions(count, rng):
    """Two samples in each of some directions, with gaps between: every position is a dwell."""
    u = rng.standard_normal((count, 3))
    u = np.repeat(G * u / np.linalg.norm(u, axis=1, keepdims=True), 2, axis=0)
    t = np.add.outer(10.0 * np.arange(count), [0.0, 1.0]).ravel()
    inputs = Inputs(t, dict(zip(("f_i", "f_j", "f_k"), u.T, strict=True)), 1.0)
    bare = linear_of(Run("tumble", "tumble", inputs, u[:, 0]), LIB)
    theta = np.array([TRUTH.get(name, 0.0) for name in LIB.names])
    return Run("tumble", "tumble", inputs, u[:, 0] + bare.X @ theta + N * rng.standard_normal(len(t)))


def found(run, sd, lib=LIB):
    rows = linear_of(run, lib)
    rules = {"tumble": NoiseRule("fixed", Noise(N, 0.0, 0.0))}
    summary = summarize([run], lib, rules=rules, rows=[rows])
    prior = ScalePrior(sd)
    chosen = select(summary, prior, lib)
    return chosen, {one.model: one for one in compensations(summary, prior, [rows], chosen)}


@pytest.mark.parametrize("lib", [LIB, TIED], ids=["", "tied"])
def test_every_tested_term_misses_a_position_as_a_refit_without_it_does(lib):
    run = positions(40, np.random.default_rng(1))
    rows = linear_of(run, lib)
    tested = np.abs(rows.X).max(axis=0) > 0.0
    X, y, sd = rows.X[:, tested], rows.y, np.where(LIB.names == np.array("b0"), 1.0, 1e-2)
    _, models = found(run, sd, lib)
    errors = []
    for k in range(40):
        out = np.arange(2 * k, 2 * k + 2)
        left = np.delete(np.arange(80), out)
        A = np.vstack((X[left] / N, np.diag(1.0 / sd[tested])))
        theta = np.linalg.lstsq(A, np.append(y[left] / N, np.zeros(tested.sum())), rcond=None)[0]
        errors.append(np.mean(y[out] - X[out] @ theta))
    assert models["full"].held_out == pytest.approx(np.sqrt(np.mean(np.square(errors))), rel=0.02)
    assert models["full"].positions == 40
    assert models["basic"].terms == ("b0", "b1", "m_j", "m_k")
    sizes = dict(zip(models["full"].terms, models["full"].mean.tolist(), strict=True))
    assert (sizes["c_ik"] == sizes["c_ij"]) is (lib is TIED)


def test_under_a_wide_prior_what_is_exported_predicts_new_positions_at_least_as_well_as_the_averaged_model():
    sums = np.zeros(2)
    for seed in range(8):
        rng = np.random.default_rng(seed)
        reach = linear_of(positions(20, rng), LIB)
        sd = 20.0 / np.maximum(np.abs(reach.X).max(axis=0), 1e-9)
        chosen, models = found(positions(16, rng), sd)
        best = next(iter(models.values()))
        new = linear_of(positions(200, rng), LIB)
        used = {t.name: t.mean for t in chosen.terms if t.name in chosen.model and t.verdict != "unresolved"}
        for k, theta in enumerate((used, dict(zip(best.terms, best.mean.tolist(), strict=True)))):
            left = new.y - new.X @ np.array([theta.get(name, 0.0) for name in LIB.names])
            sums[k] += np.mean(left**2) - N**2
    assert sums[1] < 0.5 * sums[0]


def test_covariance_of_a_smaller_model_is_that_of_the_projected_draws():
    run = positions(40, np.random.default_rng(3))
    _, models = found(run, np.where(LIB.names == np.array("b0"), 1.0, 1e-2))
    full, basic = models["full"], models["basic"]
    X = linear_of(run, LIB).X[:, [LIB.names.index(name) for name in full.terms]]
    kept = [full.terms.index(name) for name in basic.terms]
    draws = np.random.default_rng(1).multivariate_normal(full.mean, full.covariance, 20_000)
    projected = np.linalg.lstsq(X[:, kept], X @ draws.T, rcond=None)[0]
    assert np.std(projected, axis=1) == pytest.approx(np.sqrt(np.diag(basic.covariance)), rel=0.03)
    assert np.linalg.lstsq(X[:, kept], X @ full.mean, rcond=None)[0] == pytest.approx(basic.mean, rel=1e-6)


def upper(n, p, *, seed, alike=0.0):
    """Upper triangular factor of a design whose columns differ in size and share a direction."""
    rng = np.random.default_rng(seed)
    X = (rng.normal(size=(n, p)) + alike * rng.normal(size=(n, 1))) * 10.0 ** rng.uniform(-2, 2, size=p)
    return np.linalg.qr(X, mode="r"), rng.normal(size=p) / np.linalg.norm(X, axis=0)


def lost(S, theta, kept):
    """What the best coefficients of some columns lose, by a singular value decomposition."""
    target = S @ theta
    if not kept:
        return float(np.linalg.norm(target))
    U = np.linalg.svd(S[:, kept] / np.linalg.norm(S[:, kept], axis=0), full_matrices=False)[0]
    return float(np.linalg.norm(target - U @ (U.T @ target)))


@pytest.mark.parametrize("alike", [0.0, 3.0])
@pytest.mark.parametrize("seed", range(5))
def test_the_best_subset_of_each_size_is_that_of_brute_force(seed, alike):
    S, theta = upper(40, 6, seed=seed, alike=alike)
    whole = float(np.linalg.norm(S @ theta))
    for k, (kept, loss) in enumerate(subsets_by_size(S, theta)):
        every = {subset: lost(S, theta, list(subset)) for subset in combinations(range(6), k)}
        assert loss == pytest.approx(min(every.values()), rel=1e-9, abs=1e-12 * whole)
        assert every[tuple(kept)] == pytest.approx(loss, rel=1e-9, abs=1e-12 * whole)


def test_elimination_takes_one_of_two_columns_that_are_alike_for_both():
    S, theta = upper(60, 22, seed=4)
    S = np.linalg.qr(np.column_stack((S, S[:, 0], np.zeros(22))), mode="r")
    S, theta = np.pad(S, ((0, 24 - len(S)), (0, 0))), np.append(theta, [2.0 * theta[0], 1.0])
    path = subsets_by_size(S, theta)
    kept, loss = path[22]  # without the column of zeros and one of the pair nothing is lost
    assert 23 not in kept and not {0, 22} <= set(kept)
    assert loss < 1e-9 * path[0][1]
    alone = 0 if 0 in kept else 22
    assert project(S, theta, kept)[kept.index(alone)] == pytest.approx(3.0 * theta[0], rel=1e-6)


@pytest.mark.parametrize("p", [6, 22])
def test_of_columns_that_stand_for_each_other_the_first_are_kept_however_the_factor_was_rounded(p):
    rng = np.random.default_rng(p)
    X, theta = rng.normal(size=(60, p)), rng.normal(size=p)
    X[30:, 1], X[30:, 4] = X[:30, 4], X[:30, 1]  # columns 1 and 4 change places with the halves of the test
    for j in {*range(p)} - {1, 4}:
        X[30:, j] = X[:30, j]
    theta[4] = theta[1]
    turned = (np.linalg.qr(rng.normal(size=(60, 60)))[0] @ X for _ in range(20))
    found = [[kept for kept, _ in subsets_by_size(np.linalg.qr(Y, mode="r"), theta)] for Y in turned]
    assert all(path == found[0] for path in found)
    one_of_two = [kept for kept in found[0] if (1 in kept) != (4 in kept)]
    assert one_of_two and all(1 in kept for kept in one_of_two)


def predictions(rows, selection, values):
    """Output (n,) that coefficients by name make of all rows."""
    theta = np.array([values.get(name, 0.0) for name in selection.columns])
    return np.concatenate([run.columns(0, len(run)) @ theta for run in rows])


def mean_of(selection):
    names = selection.models.candidates.names
    return {name: selection.models.mean[selection.models.names.index(name)] for name in names}


def test_rms_of_the_design_is_that_of_the_rows(campaign):
    _, _, rows, selection = campaign
    design = design_factor(rows)
    theta = np.random.default_rng(1).normal(size=len(selection.columns))
    values = dict(zip(selection.columns, theta, strict=True))
    output = predictions(rows, selection, values)
    assert design.n == len(output)
    assert np.linalg.norm(design.R[:-1, :-1] @ theta) == pytest.approx(np.linalg.norm(output), rel=1e-12)


def test_what_a_reduced_model_loses_is_what_its_predictions_differ_by(campaign):
    _, _, rows, selection = campaign
    told = reduced(selection, design_factor(rows), rng=np.random.default_rng(1))
    assert 0 < len(told.terms) < len(selection.models.candidates.names)
    whole = predictions(rows, selection, mean_of(selection))
    few = predictions(rows, selection, dict(zip(told.terms, told.coefficients, strict=True)))
    assert told.lost == pytest.approx(math.sqrt(np.mean((whole - few) ** 2)), rel=1e-6)
    assert told.lost <= told.budget < told.path[len(told.terms) - 1][1]


def test_a_reduced_model_has_both_of_two_terms_that_are_tied():
    run = positions(40, np.random.default_rng(1))
    lib = replace(LIB, ties=(("m_k", "m_j"),))
    chosen, _ = found(run, np.where(LIB.names == np.array("b0"), 1.0, 1e-2), lib)
    told = reduced(chosen, design_factor([linear_of(run, lib)]), rng=np.random.default_rng(1))
    size = dict(zip(told.terms, told.coefficients.tolist(), strict=True))
    assert size["m_k"] == size["m_j"] != 0.0


def test_the_usual_budget_is_the_error_that_the_posterior_leaves_in_the_output():
    """Four terms that are all certain: the posterior is normal, and its error in the output has a formula."""
    rng, lib = np.random.default_rng(5), ib.library("accelerometer", powers=1, asymmetry=0)
    X, scene = np.zeros((400, len(lib.names))), rng.normal(size=(300, 4))
    X[:, :4] = rng.normal(size=(400, 4))
    y = X[:, :4] @ np.array([3.0, -2.0, 4.0, 2.0]) + rng.normal(size=400)
    selection = select(ib.Summary.from_arrays(X, y, lib.names), ib.ScalePrior(np.full(X.shape[1], 10.0)), lib)
    assert all(term.inclusion > 0.9999 for term in selection.terms if term.verdict != "untested")
    rss = np.linalg.lstsq(X[:, :4], y, rcond=None)[1][0]
    covariance = rss / 396.0 * np.linalg.inv(X[:, :4].T @ X[:, :4])
    expected = math.sqrt(np.trace(scene @ covariance @ scene.T) / 300.0)
    told = reduced(selection, factor_of(scene, np.zeros(300), lib.names[:4]), rng=rng)
    # 4000 draws of a sum of four squares: at most 1/sqrt(2 * 4000) for its root; and the prior's 1e-3
    assert told.budget == pytest.approx(expected, rel=4.0 / math.sqrt(8000.0) + 0.01)
