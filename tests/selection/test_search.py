"""The search over models against full enumeration, and its bound against the truth."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imubayes.algebra.factor import with_prior_rows
from imubayes.errors import TermError
from imubayes.selection.kernels import solutions, walk
from imubayes.selection.search import search
from imubayes.selection.spaces import fold, sizes
from imubayes.sensors.terms import columns, library

NEEDS = ((3, 1), (4, 3), (5, 2))
KINDS = ("random", "correlated", "collinear", "silent")


def _beta_binomial(p: int) -> np.ndarray:
    return -math.log(p + 1) - np.array([math.log(math.comb(p, k)) for k in range(p + 1)])


def _factor(X: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.linalg.qr(np.column_stack((X, y)), mode="r")


def _problem(kind: str, p: int, seed: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Factor with prior rows, log width and scale of a regression with unequal units, priors and noise."""
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(3 * p, p)) * 10.0 ** rng.uniform(-1.0, 2.0, p)
    if kind == "correlated":
        X = X @ (np.eye(p) + rng.normal(size=(p, p)))
    if kind == "collinear":
        X[:, -1], X[:, -2], X[:, -3] = X[:, 0], X[:, 1] - X[:, 2], (1.0 + 1e-9) * X[:, 3]
    if kind == "silent":
        X[:, p // 2 :] = 0.0
    scale = float(rng.uniform(0.5, 2.0))
    sd = 10.0 ** rng.uniform(-0.5, 0.5, p)
    y = X @ (sd * rng.normal(size=p) * (rng.random(p) < 0.4)) + scale * rng.normal(size=len(X))
    return with_prior_rows(_factor(X, y), scale / sd), np.log(scale / sd), scale


def _enumerated(
    problem: tuple[np.ndarray, np.ndarray, float], needs: tuple[tuple[int, int], ...]
) -> np.ndarray:
    """Log joint probability of all models, by mask."""
    T, log_width, scale = problem
    p = len(log_width)
    rss, log_det = walk(T)
    inside = (np.arange(1 << p)[:, None] >> np.arange(p)) & 1
    log_joint = -rss / (2.0 * scale**2) - log_det + inside @ log_width + _beta_binomial(p)[sizes(p)]
    for child, parent in needs:
        log_joint[(inside[:, child] == 1) & (inside[:, parent] == 0)] = -math.inf
    return log_joint


def _masks(inside: np.ndarray) -> np.ndarray:
    return inside @ (1 << np.arange(inside.shape[1]))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("p", "needs"), [(8, ()), (12, NEEDS), (15, ())])
def test_certified_search_is_enumeration_but_for_what_it_says_is_missing(kind, p, needs):
    problem = _problem(kind, p, seed=p)
    found = search(*problem, _beta_binomial(p), needs=needs, effort=60.0, rng=np.random.default_rng(1))
    exact, masks = _enumerated(problem, needs), _masks(found.inside)
    peak = exact.max()
    sums, total = fold(np.exp(exact - peak), p)
    assert found.certified
    assert len(np.unique(masks)) == len(masks)
    np.testing.assert_allclose(found.log_joint, exact[masks], rtol=0.0, atol=1e-9 * (1.0 + abs(peak)))
    np.testing.assert_allclose(found.frequency, sums / total, rtol=0.0, atol=1.1e-6)


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from(KINDS), st.integers(2, 11), st.integers(0, 2**32 - 1), st.floats(-9.0, 0.0), st.booleans()
)
def test_bound_is_never_below_what_is_missing(kind, p, seed, log_tolerance, hierarchy):
    needs = NEEDS if hierarchy and p > 5 else ()
    problem = _problem(kind, max(p, 5), seed)
    p = max(p, 5)
    exact = _enumerated(problem, needs)
    found = search(
        *problem,
        _beta_binomial(p),
        needs=needs,
        tolerance=math.exp(log_tolerance),
        rng=np.random.default_rng(1),
    )
    exact[_masks(found.inside)] = -math.inf
    missing = np.logaddexp.reduce(exact)
    assert found.certified
    # rounding: what enumeration itself cannot resolve beside the total
    assert missing <= np.logaddexp(found.log_missing + 1e-9, np.logaddexp.reduce(found.log_joint) - 34.0)


def test_bound_holds_where_the_search_is_stopped_at_once():
    problem = _problem("correlated", 14, seed=3)
    found = search(*problem, _beta_binomial(14), most=40, effort=1.0, rng=np.random.default_rng(1))
    exact = _enumerated(problem, ())
    total = np.logaddexp.reduce(exact)
    exact[_masks(found.inside)] = -math.inf
    assert not found.certified
    assert len(found.log_joint) <= 40
    assert np.logaddexp.reduce(exact) <= found.log_missing
    assert np.exp(found.log_joint - total).sum() <= 1.0


def test_walk_gives_the_inclusion_of_enumeration():
    p = 18
    problem = _problem("correlated", p, seed=5)
    found = search(
        *problem, _beta_binomial(p), tolerance=1e-300, most=200, effort=15.0, rng=np.random.default_rng(2)
    )
    exact = _enumerated(problem, ())
    sums, total = fold(np.exp(exact - exact.max()), p)
    assert not found.certified
    assert np.abs(found.frequency - sums / total).max() < 0.01
    assert (np.abs(found.frequency - sums / total) < 4.0 * found.error + 1e-6).all()
    np.testing.assert_allclose(found.log_joint, exact[_masks(found.inside)], rtol=0.0, atol=1e-8)


def test_search_gives_the_same_twice():
    problem = _problem("correlated", 16, seed=9)
    seeds = (np.random.default_rng(1), np.random.default_rng(1))
    found = [search(*problem, _beta_binomial(16), most=300, effort=1.0, rng=rng) for rng in seeds]
    assert not found[0].certified
    np.testing.assert_array_equal(found[0].frequency, found[1].frequency)
    np.testing.assert_array_equal(found[0].weight, found[1].weight)


def test_circular_needs_and_too_many_candidates_are_refused():
    problem = _problem("random", 5, seed=1)
    with pytest.raises(TermError, match="circle"):
        search(*problem, _beta_binomial(5), needs=((0, 1), (1, 2), (2, 0)), rng=np.random.default_rng(1))
    with pytest.raises(TermError, match="128"):
        search(np.eye(131), np.zeros(130), 1.0, np.zeros(131), rng=np.random.default_rng(1))


def _thermal(noise: float, expanded: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray, float]:
    """Accelerometer on a table at many attitudes and rates to 10 g, over two cycles of 80 K."""
    rng, n = np.random.default_rng(1), 1500
    lib = library("accelerometer", powers=3, asymmetry=2, temperature=2, temperature_of=expanded)
    f = rng.normal(size=(3, n))
    f *= 9.80665 * np.where(rng.random(n) < 0.8, 1.0, rng.choice([5.0, 10.0], n)) / np.linalg.norm(f, axis=0)
    w, dw = 0.5 * rng.normal(size=(3, n)), 0.05 * rng.normal(size=(3, n))
    T = 298.15 + 40.0 * np.sin(4.0 * np.pi * np.arange(n) / n)
    named = zip(("f", "w", "dw"), (f, w, dw), strict=True)
    channels = {f"{q}_{axis}": row for q, rows in named for axis, row in zip("ijk", rows, strict=True)}
    X = columns(lib, channels | {"T": T, "dT": np.gradient(T) / 60.0}, n)
    p = X.shape[1]
    sd = 3e-3 / np.sqrt(np.mean(X**2, axis=0)) * 10.0 ** rng.uniform(-0.5, 0.5, p)
    theta = np.zeros(p)
    strong = rng.choice(p, 12, replace=False)
    theta[strong] = sd[strong] * rng.normal(size=12)
    y = X @ theta + noise * rng.normal(size=n)
    return with_prior_rows(_factor(X / noise, y / noise), 1.0 / sd), -np.log(sd), 1.0


EXPANDED = ("b0", "b1", "b2", "b3", "b0p", "b1p", "b2p", "m_j", "m_k", "c_ij", "c_ik", "c_kk")


def test_temperature_expanded_library_is_certified():
    problem = _thermal(3e-4, EXPANDED)
    p = len(problem[1])
    found = search(*problem, _beta_binomial(p), effort=120.0, rng=np.random.default_rng(1))
    assert p == 45
    assert found.certified
    assert found.log_missing - np.logaddexp.reduce(found.log_joint) < math.log(1.01e-6)


@pytest.mark.slow
def test_walks_of_two_seeds_agree_on_a_temperature_expanded_library():
    problem = _thermal(3e-3, EXPANDED)
    prior = _beta_binomial(len(problem[1]))
    one, two = (search(*problem, prior, effort=50.0, rng=np.random.default_rng(s)) for s in (1, 2))
    assert max(one.error.max(), two.error.max()) < 0.01
    assert (np.abs(one.frequency - two.frequency) < 4.5 * np.hypot(one.error, two.error) + 1e-4).all()


def test_a_hundred_candidates_are_searched():
    problem = _problem("random", 100, seed=11)
    found = search(*problem, _beta_binomial(100), effort=2.0, most=20_000, rng=np.random.default_rng(1))
    T, log_width, scale = problem
    _, _, rss, log_det = solutions(np.ascontiguousarray(T), found.inside)
    again = -rss / (2.0 * scale**2) - log_det + found.inside @ log_width
    again += _beta_binomial(100)[found.inside.sum(axis=1)]
    np.testing.assert_allclose(found.log_joint, again, rtol=1e-12)
    assert ((found.frequency >= 0.0) & (found.frequency <= 1.0 + 1e-12)).all()
