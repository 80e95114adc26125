"""The smallest model that predicts as well as the posterior, against brute force over all subsets."""

import math
from itertools import combinations

import numpy as np
import pytest

import imubayes as ib
from imubayes.algebra.factor import factor_of
from imubayes.selection.compensations import design_factor, project, reduced, subsets_by_size
from imubayes.selection.decision import select


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


@pytest.fixture(scope="module")
def campaign():
    """Runs of an accelerometer, their summary and prior, and the decision."""
    lib = ib.library("accelerometer", powers=2, asymmetry=0)
    sensor = ib.sensor("mems_tactical", kind="accelerometer")
    plans = [ib.tumble(angles=12, planes=3), ib.centrifuge([1, 5, 20])]
    runs = ib.simulate(sensor, plans, seed=8, truth={"b0": 0.02, "b1": 4e-4, "b2": 5e-6, "m_j": 1e-3})
    summary, prior = ib.summarize(runs, lib, sensor=sensor), ib.prior(sensor, lib)
    return [ib.linear_of(run, lib) for run in runs], summary, prior, select(summary, prior)


def predictions(rows, selection, values):
    """Output (n,) that coefficients by name make of all rows."""
    theta = np.array([values.get(name, 0.0) for name in selection.columns])
    return np.concatenate([run.columns(0, len(run)) @ theta for run in rows])


def mean_of(selection):
    names = selection.models.candidates.names
    return {name: selection.models.mean[selection.models.names.index(name)] for name in names}


def test_rms_of_the_design_is_that_of_the_rows(campaign):
    rows, _, _, selection = campaign
    design = design_factor(rows)
    theta = np.random.default_rng(1).normal(size=len(selection.columns))
    values = dict(zip(selection.columns, theta, strict=True))
    output = predictions(rows, selection, values)
    assert design.n == len(output)
    assert np.linalg.norm(design.R[:-1, :-1] @ theta) == pytest.approx(np.linalg.norm(output), rel=1e-12)


def test_what_a_reduced_model_loses_is_what_its_predictions_differ_by(campaign):
    rows, _, _, selection = campaign
    told = reduced(selection, design_factor(rows), rng=np.random.default_rng(1))
    assert 0 < len(told.terms) < len(selection.models.candidates.names)
    whole = predictions(rows, selection, mean_of(selection))
    few = predictions(rows, selection, dict(zip(told.terms, told.coefficients, strict=True)))
    assert told.lost == pytest.approx(math.sqrt(np.mean((whole - few) ** 2)), rel=1e-6)
    assert told.lost <= told.budget < told.path[len(told.terms) - 1][1]


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
