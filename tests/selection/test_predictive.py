"""Predictive scores: closed forms against refits, draws, and R's loo."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from decisions import dwells, records, table
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from imubayes.algebra.factor import factor_of
from imubayes.inference.dwells import Pieces
from imubayes.selection.mixture import candidates
from imubayes.selection.model_sets import Space
from imubayes.selection.predictive import RELIABLE, by_dwell, by_run, leave_out, psis_loo, waic

NAMES = ("a", "b", "c", "bench")
SD = np.array([1.0, 0.3, 2.0, 0.5])
SCALE = 0.7
SIZES = (7, 3, 9, 5, 4, 6)
RUNS = ((0, 1, 2), (3, 4, 5))
DRAWS = 4000
"""Draws of R's posterior."""


@pytest.fixture(scope="module")
def rows() -> list[tuple[np.ndarray, np.ndarray]]:
    """Regressors and response of each dwell."""
    rng = np.random.default_rng(4)
    X = [rng.normal(size=(n, 4)) for n in SIZES]
    return [(x, x @ [0.8, 0.0, -1.0, 0.2] + SCALE * rng.normal(size=len(x))) for x in X]


def _pieces(rows: list[tuple[np.ndarray, np.ndarray]], run: tuple[int, ...]) -> Pieces:
    """Dwells of a run, with a column that nobody asks for and in another order."""
    names = ("bench", "unexcited", "b", "c", "a")
    order = [3, 0, 1, 2, 0]
    blocks = [np.column_stack((x[:, order], y)) for x, y in (rows[d] for d in run)]
    for block in blocks:
        block[:, 1] = 0.0
    return dwells(blocks, names, run=str(run), log_det=0.1)


@pytest.fixture(scope="module")
def pieces(rows) -> list[Pieces]:
    return [_pieces(rows, run) for run in RUNS]


@pytest.fixture(scope="module")
def field(rows):
    """Three candidates, and an error of the bench that is in every model."""
    f = factor_of(np.concatenate([x for x, _ in rows]), np.concatenate([y for _, y in rows]), NAMES)
    return candidates(f, NAMES[:3], NAMES[3:], SD[[3, 0, 1, 2]])


def _log_density(rows, columns: list[int]) -> float:
    """Log density of some rows by their dense covariance; each carries 0.1 of log determinant."""
    if not rows:
        return 0.0
    X = np.concatenate([x for x, _ in rows])[:, columns] * SD[columns]
    y = np.concatenate([y for _, y in rows])
    return multivariate_normal.logpdf(y, cov=X @ X.T + SCALE**2 * np.eye(len(y))) - 0.05 * len(y)


def _refitted(rows, parts: tuple[tuple[int, ...], ...], mask: int) -> float:
    columns = [j for j in range(3) if mask >> j & 1] + [3]
    everything = _log_density(rows, columns)
    others = [[row for d, row in enumerate(rows) if d not in part] for part in parts]
    return -2.0 * sum(everything - _log_density(left, columns) for left in others)


@pytest.mark.parametrize(
    ("leaving_out", "parts"),
    [(by_dwell, tuple((d,) for d in range(6))), (by_run, RUNS)],
    ids=["dwell", "run"],
)
def test_leaving_parts_out_in_closed_form_equals_refitting_without_them(
    rows, pieces, field, leaving_out, parts
):
    found = leave_out(leaving_out(pieces, field, SCALE), Space(3))
    assert found == pytest.approx([_refitted(rows, parts, mask) for mask in range(8)], rel=1e-10)


@pytest.mark.parametrize("leaving_out", [by_dwell, by_run])
def test_pieces_that_are_always_there_are_known_when_the_others_are_predicted(
    rows, pieces, field, leaving_out
):
    kept = [pieces[0], replace(pieces[1], kept=True)]
    found = leave_out(leaving_out(kept, field, SCALE), Space(3))
    parts = tuple((d,) for d in RUNS[0]) if leaving_out is by_dwell else (RUNS[0],)
    assert found == pytest.approx([_refitted(rows, parts, mask) for mask in range(8)], rel=1e-10)


@pytest.mark.parametrize("mask", [0, 5, 7])
def test_waic_in_closed_form_is_that_of_draws_of_the_posterior(rows, pieces, field, mask):
    inside = Space(3).members(np.array([mask]))[0]
    columns = [*np.flatnonzero(inside), 3]
    X, y = np.concatenate([x for x, _ in rows])[:, columns], np.concatenate([y for _, y in rows])
    precision = X.T @ X / SCALE**2 + np.diag(1.0 / SD[columns] ** 2)
    covariance = np.linalg.inv(precision)
    mean = covariance @ X.T @ y / SCALE**2
    theta = np.random.default_rng(8).multivariate_normal(mean, covariance, size=(20, DRAWS))
    log_lik = np.stack(
        [
            -0.5 * np.sum((y - theta @ x[:, columns].T) ** 2, axis=2) / SCALE**2
            - 0.5 * len(y) * math.log(2.0 * math.pi * SCALE**2)
            - 0.05 * len(y)
            for x, y in rows
        ],
        axis=2,
    )
    batches = [
        -2.0 * np.sum(logsumexp(one, axis=0) - math.log(len(one)) - np.var(one, axis=0, ddof=1))
        for one in log_lik
    ]
    error = np.std(batches, ddof=1) / math.sqrt(len(batches))
    assert abs(waic(by_dwell(pieces, field, SCALE), inside) - np.mean(batches)) < 4.0 * error


def _reference(references, name: str) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    _, X, y = table(references / f"loo/data_{name}.csv")
    rows = records(references / f"loo/pointwise_{name}.csv")
    return X, y, {key: np.array([float(r[key]) for r in rows]) for key in rows[0]}


def _log_lik(X: np.ndarray, y: np.ndarray, batches: int) -> np.ndarray:
    """(batches, draws, n): log likelihood under draws of the posterior with p(b, s) ~ 1/s."""
    rng = np.random.default_rng(6)
    n, p = X.shape
    Q = np.linalg.qr(X)[0]
    left = y - Q @ (Q.T @ y)
    scale = np.sqrt(np.sum(left**2) / rng.chisquare(n - p, size=(batches, DRAWS, 1)))
    # X (b - mean) = Q R R^-1 e scale
    residual = left - scale * (rng.normal(size=(batches, DRAWS, p)) @ Q.T)
    return -0.5 * (residual / scale) ** 2 - np.log(scale) - 0.5 * math.log(2.0 * math.pi)


@pytest.mark.parametrize("name", ["attitude_m2", "attitude_outlier_full"])
def test_psis_is_that_of_r_loo_within_the_error_of_its_draws(references, name):
    X, y, published = _reference(references, name)
    batches = _log_lik(X, y, 24)
    ours = {
        "elpd_loo": np.array([psis_loo(batch)[0] for batch in batches]),
        "pareto_k": np.array([psis_loo(batch)[1] for batch in batches]),
    }
    calm = published["pareto_k"] < RELIABLE
    for key, found in ours.items():
        error = np.std(found, axis=0, ddof=1)
        z = (np.mean(found, axis=0) - published[key]) / error
        assert np.all(np.abs(z[calm]) < 4.0), key


def test_psis_flags_the_outlier_whose_weights_r_found_at_k_above_one(references):
    X, y, published = _reference(references, "attitude_outlier_full")
    elpd, k = psis_loo(_log_lik(X, y, 1)[0])
    outlier = int(np.argmax(published["pareto_k"]))
    assert published["pareto_k"][outlier] == pytest.approx(1.35, abs=0.01)
    assert int(np.argmax(k)) == outlier
    assert k[outlier] > RELIABLE
    # R's k of the others is known to about 0.1: those that it has well below the limit are below it here
    calm = published["pareto_k"] < RELIABLE - 0.3
    assert np.all(k[calm] < RELIABLE)
    error = np.abs(elpd - published["elpd_loo_exact"])
    assert error[outlier] > 0.3
    assert np.max(error[calm]) < 0.1


@pytest.mark.parametrize("shape", [0.2, 0.5, 0.9])
def test_k_is_the_shape_of_the_tail_of_the_weights(shape):
    u = np.random.default_rng(2).random((20_000, 30))
    k = psis_loo(shape * np.log(u))[1]
    tail = 3.0 * math.sqrt(len(u))
    # asymptotic sd (1 + k)/sqrt(M), of the mean of 30; the prior pulls by 10 draws of 0.5
    expected = (shape * tail + 5.0) / (tail + 10.0)
    assert abs(k.mean() - expected) < 4.0 * (1.0 + shape) / math.sqrt(30.0 * tail)


def test_too_few_draws_for_a_tail_are_not_trusted():
    assert psis_loo(np.random.default_rng(1).normal(size=(15, 1)))[1].tolist() == [math.inf]
