"""The walk over models against enumeration: its odds, its balance, its hierarchy."""

from __future__ import annotations

import math

import numpy as np
import pytest

from imubayes.selection.bounds import Problem
from imubayes.selection.kernels import walk
from imubayes.selection.model_walk import Record, begin, moves, take_steps
from imubayes.selection.spaces import fold, sizes


def _problem(
    p: int, silent: int, needs: tuple[tuple[int, int], ...]
) -> tuple[np.ndarray, Problem, np.ndarray]:
    """Factor with prior rows of 1, the last columns without data; and the log joint of all models."""
    rng = np.random.default_rng(p)
    X = rng.normal(size=(2 * p, p)) @ (np.eye(p) + 0.7 * rng.normal(size=(p, p)))
    X[:, p - silent :] *= 0.02
    y = X @ (rng.normal(size=p) * (rng.random(p) < 0.4)) + rng.normal(size=2 * p)
    T = np.linalg.qr(np.vstack((np.column_stack((X, y)), np.eye(p, p + 1))), mode="r")
    log_prior = -math.log(p + 1) - np.array([math.log(math.comb(p, k)) for k in range(p + 1)])
    parents = np.zeros((p, 2), dtype=np.uint64)
    rss, log_det = walk(T)
    exact = -rss / 2.0 - log_det + log_prior[sizes(p)]
    masks = np.arange(1 << p)
    for child, parent in needs:
        parents[child, 0] |= np.uint64(1 << parent)
        exact[(masks >> child & 1 == 1) & (masks >> parent & 1 == 0)] = -math.inf
    return T, Problem(2.0, log_prior, parents), exact


def test_probabilities_of_flipping_are_those_of_enumeration():
    T, problem, exact = _problem(10, 2, ())
    inside = np.random.default_rng(1).random(10) < 0.5
    state = begin(T, inside, problem)
    mask = int(inside @ (1 << np.arange(10)))
    expected = [1.0 / (1.0 + math.exp(exact[mask] - exact[mask ^ (1 << j)])) for j in state.column.tolist()]
    np.testing.assert_allclose(state.flip, expected, rtol=1e-9)
    np.testing.assert_allclose(state.log_joint[0], exact[mask], rtol=1e-11)


@pytest.mark.parametrize(("silent", "needs"), [(0, ()), (6, ()), (5, ((3, 1), (8, 3), (9, 2)))])
def test_long_walk_visits_models_as_often_as_they_are_probable(silent, needs):
    p, steps, batches = 10, 4_000, 40
    T, problem, exact = _problem(p, silent, needs)
    state, how = begin(T, np.zeros(p, dtype=bool), problem), moves(T)
    rng = np.random.default_rng(4)
    inclusion, logs, stays = [], [], np.zeros(1 << p)
    for _ in range(batches):
        words, sums = np.empty((steps + 1, 2), np.uint64), np.empty((2, steps + 1))
        record = Record(words, *sums, np.empty(p), np.zeros(1, dtype=np.int64))
        take_steps(problem, state, how, rng.random((steps, 4 + p)), record)
        n = record.count[0]
        inclusion.append(record.inclusion)
        np.add.at(stays, record.words[:n, 0].astype(np.int64), record.stay[:n])
        logs.append(np.abs(record.log_joint[:n] - exact[record.words[:n, 0].astype(np.int64)]).max())
    assert stays.sum() == steps * batches
    assert np.abs(fold(stays, p)[0] / stays.sum() - np.mean(inclusion, axis=0)).max() < 0.02
    sums, total = fold(np.exp(exact - exact.max()), p)
    settled = np.array(inclusion)
    error = settled.std(axis=0, ddof=1) / math.sqrt(batches)
    assert (len(how.loose) > 1) == (silent > 0)
    assert max(logs) < 1e-9 * (1.0 + abs(exact.max()))
    assert (np.abs(settled.mean(axis=0) - sums / total) < 4.5 * error + 1e-6).all()
    assert error.max() < 0.01
