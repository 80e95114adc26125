"""The include/exclude tree against brute force, and against R's best subsets."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imubayes.algebra.factor import factor_of, with_prior_rows
from imubayes.selection.kernels import walk
from imubayes.selection.spaces import sizes

seeds = st.integers(0, 2**32 - 1)


def _problem(seed: int, p: int, n: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(n, p)) * 10.0 ** rng.uniform(-3, 3, p)
    return X, X @ (rng.normal(size=p) / (np.linalg.norm(X, axis=0) + 1.0)) + rng.normal(size=n)


def _included(mask: int, p: int) -> list[int]:
    return [j for j in range(p) if mask >> j & 1]


def _by_brute_force(X: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Residual sum of squares and ln |det R| of every submodel, each from its own QR."""
    p = X.shape[1]
    rss, log_det = np.empty(1 << p), np.empty(1 << p)
    for mask in range(1 << p):
        Q, R = np.linalg.qr(X[:, _included(mask, p)])
        rss[mask] = np.sum((y - Q @ (Q.T @ y)) ** 2)
        log_det[mask] = np.sum(np.log(np.abs(np.diag(R))))
    return rss, log_det


def _agree(R: np.ndarray, X: np.ndarray, y: np.ndarray) -> None:
    rss, log_det = walk(R)
    brute_rss, brute_log_det = _by_brute_force(X, y)
    np.testing.assert_allclose(rss, brute_rss, rtol=1e-10, atol=1e-13 * (y @ y))
    np.testing.assert_allclose(log_det, brute_log_det, rtol=1e-10, atol=1e-10)


@given(seeds, st.integers(0, 6), st.integers(1, 10))
def test_every_submodel_of_the_tree_is_its_own_qr(seed, p, spare):
    X, y = _problem(seed, p, p + spare)
    _agree(factor_of(X, y, "abcdef"[:p]).R, X, y)


@pytest.mark.parametrize("seed", range(3))
def test_every_submodel_of_eight_columns_is_its_own_qr(seed):
    X, y = _problem(seed, 8, 30)
    _agree(factor_of(X, y, "abcdefgh").R, X, y)


@given(seeds, st.integers(1, 5), st.integers(1, 8))
def test_a_prior_row_leaves_with_its_column(seed, p, n):
    """Stacked under the factor of all columns, prior rows act in a submodel as the rows of its own prior."""
    X, y = _problem(seed, p, n)
    weight = 10.0 ** np.random.default_rng(seed).uniform(-2, 2, p)
    rss, log_det = walk(with_prior_rows(factor_of(X, y, "abcde"[:p]).R, weight))
    for mask in range(1 << p):
        of = _included(mask, p)
        rows = np.vstack((X[:, of], np.diag(weight[of])))
        Q, R = np.linalg.qr(rows)
        response = np.append(y, np.zeros(len(of)))
        own = np.sum((response - Q @ (Q.T @ response)) ** 2)
        assert rss[mask] == pytest.approx(own, rel=1e-10, abs=1e-13 * (y @ y))
        assert log_det[mask] == pytest.approx(np.sum(np.log(np.abs(np.diag(R)))), rel=1e-10, abs=1e-10)


@given(seeds, st.integers(1, 6))
def test_bit_j_of_a_mask_is_column_j(seed, p):
    """With orthogonal columns a column takes its own square off the residual, and brings its own norm."""
    rng = np.random.default_rng(seed)
    norm, z, rest = rng.uniform(0.5, 2.0, p), rng.normal(size=p), 1.0
    R = np.zeros((p + 1, p + 1))
    R[:p, :p], R[:p, p], R[p, p] = np.diag(norm), z, rest
    rss, log_det = walk(R)
    assert len(rss) == len(log_det) == 2**p
    inside = np.array([[mask >> j & 1 for j in range(p)] for mask in range(2**p)])
    np.testing.assert_allclose(rss, rest**2 + (1 - inside) @ z**2, rtol=1e-12)
    np.testing.assert_allclose(log_det, inside @ np.log(norm), rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(sizes(p), inside.sum(axis=1))


def test_without_columns_the_only_model_leaves_everything():
    rss, log_det = walk(np.array([[-3.0]]))
    assert (rss.tolist(), log_det.tolist()) == ([9.0], [0.0])


@given(seeds, st.integers(2, 6))
def test_residuals_never_grow_when_a_column_joins(seed, p):
    X, y = _problem(seed, p, p + 2)
    rss, _ = walk(factor_of(X, y, "abcdef"[:p]).R)
    for j in range(p):
        without = np.flatnonzero((np.arange(1 << p) >> j & 1) == 0)
        assert np.all(rss[without | 1 << j] <= rss[without] * (1.0 + 1e-12) + 1e-13 * (y @ y))


def _leaps(references, name: str) -> tuple[list[dict[str, str]], np.ndarray, np.ndarray]:
    """R's table of subsets; rss and size by mask, from the tree behind the constant."""
    with (references / f"leaps/leaps_{name}.csv").open(newline="") as file:
        table = list(csv.DictReader(file))
    rows = np.loadtxt(references / f"bms/{name}.csv", delimiter=",", skiprows=1)
    X = np.column_stack((np.ones(len(rows)), rows[:, 1:]))
    R = factor_of(X, rows[:, 0], ["1", *(f"X{j}" for j in range(1, X.shape[1]))]).R
    rss, _ = walk(np.ascontiguousarray(R[1:, 1:]))
    return table, rss, sizes(X.shape[1] - 1)


@pytest.mark.parametrize("name", ["attitude", "hald"])
def test_tree_has_the_subsets_of_leaps(references, name):
    """Residual sum of squares of R 4.2.2, leaps, for every subset it lists."""
    table, rss, size = _leaps(references, name)
    assert {int(row["size"]) for row in table} == set(range(1, len(table[0]["gamma"]) + 1))
    for row in table:
        mask = sum(1 << j for j, bit in enumerate(row["gamma"]) if bit == "1")
        assert size[mask] == int(row["size"])
        assert rss[mask] == pytest.approx(float(row["rss"]), rel=1e-10), row["gamma"]


@pytest.mark.parametrize("name", ["attitude", "hald"])
def test_best_subset_of_every_size_is_that_of_leaps(references, name):
    table, rss, size = _leaps(references, name)
    for k in range(1, len(table[0]["gamma"]) + 1):
        best = min((row for row in table if int(row["size"]) == k), key=lambda row: float(row["rss"]))
        ours = int(np.flatnonzero(size == k)[np.argmin(rss[size == k])])
        assert "".join(str(ours >> j & 1) for j in range(len(best["gamma"]))) == best["gamma"]
        assert rss[ours] == pytest.approx(float(best["rss"]), rel=1e-10)
