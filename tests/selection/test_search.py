"""The search over models against full enumeration, and its bound against the truth. More candidates than are
enumerated: the decision's own path, against enumeration and a known truth. The walk over models against
enumeration: its odds, its balance, its hierarchy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import imubayes as ib
from imubayes import ScalePrior, Summary
from imubayes.algebra.factor import with_prior_rows
from imubayes.errors import TermError
from imubayes.selection import enumerate
from imubayes.selection import search as module
from imubayes.selection.bounds import TreeProblem
from imubayes.selection.enumerate import enumerate_models
from imubayes.selection.kernels import solutions
from imubayes.selection.lanes import walk
from imubayes.selection.model_sets import Space, log_model_prior, sizes
from imubayes.selection.model_walk import Record, begin, moves, take_steps
from imubayes.selection.models import components_given, inclusion_given, inclusion_of_any
from imubayes.selection.search import search
from imubayes.sensors.terms import columns, library

NEEDS = ((3, 1), (4, 3), (5, 2))
KINDS = ("random", "correlated", "collinear", "silent")


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
    log_joint = (
        -rss / (2.0 * scale**2) - log_det + inside @ log_width + log_model_prior("beta-binomial", p)[sizes(p)]
    )
    for child, parent in needs:
        log_joint[(inside[:, child] == 1) & (inside[:, parent] == 0)] = -math.inf
    return log_joint


def _masks(inside: np.ndarray) -> np.ndarray:
    return inside @ (1 << np.arange(inside.shape[1]))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("p", "needs"), [(12, NEEDS), (15, ())])
def test_certified_search_is_enumeration_but_for_what_it_says_is_missing(kind, p, needs):
    problem = _problem(kind, p, seed=p)
    found = search(
        *problem, log_model_prior("beta-binomial", p), needs=needs, effort=60.0, rng=np.random.default_rng(1)
    )
    exact, masks = _enumerated(problem, needs), _masks(found.inside)
    peak = exact.max()
    sums, total = Space(p).sums(np.exp(exact - peak))
    assert found.certified
    assert len(np.unique(masks)) == len(masks)
    np.testing.assert_allclose(found.log_joint, exact[masks], rtol=0.0, atol=1e-9 * (1.0 + abs(peak)))
    np.testing.assert_allclose(found.frequency, sums / total, rtol=0.0, atol=1.1e-6)


@settings(max_examples=25, deadline=None)
@given(
    st.sampled_from(KINDS), st.integers(2, 11), st.integers(0, 2**32 - 1), st.floats(-9.0, 0.0), st.booleans()
)
def test_bound_is_never_below_what_is_missing(kind, p, seed, log_tolerance, hierarchy):
    needs = NEEDS if hierarchy and p > 5 else ()
    problem = _problem(kind, max(p, 5), seed)
    p = max(p, 5)
    exact = _enumerated(problem, needs)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "TOLERANCE", math.exp(log_tolerance))
        found = search(
            *problem,
            log_model_prior("beta-binomial", p),
            needs=needs,
            effort=10.0,
            rng=np.random.default_rng(1),
        )
    exact[_masks(found.inside)] = -math.inf
    missing = np.logaddexp.reduce(exact)
    assert found.certified
    # rounding: what enumeration itself cannot resolve beside the total
    assert missing <= np.logaddexp(found.log_missing + 1e-9, np.logaddexp.reduce(found.log_joint) - 34.0)


def test_too_many_candidates_are_refused():
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
    found = search(*problem, log_model_prior("beta-binomial", p), effort=120.0, rng=np.random.default_rng(1))
    assert p == 45
    assert found.certified
    assert found.log_missing - np.logaddexp.reduce(found.log_joint) < math.log(1.01e-6)


def test_candidates_of_more_than_one_word_are_searched(monkeypatch):
    p = 70
    monkeypatch.setattr(module, "MOST", 20_000)
    problem = _problem("random", p, seed=11)
    found = search(*problem, log_model_prior("beta-binomial", p), effort=1.0, rng=np.random.default_rng(1))
    T, log_width, scale = problem
    _, _, rss, log_det = solutions(np.ascontiguousarray(T), found.inside)
    again = -rss / (2.0 * scale**2) - log_det + found.inside @ log_width
    again += log_model_prior("beta-binomial", p)[found.inside.sum(axis=1)]
    np.testing.assert_allclose(found.log_joint, again, rtol=1e-12)
    assert ((found.frequency >= 0.0) & (found.frequency <= 1.0 + 1e-12)).all()


NAMES = tuple(f"x{k}" for k in range(14))


@pytest.fixture(scope="module")
def problem():
    rng = np.random.default_rng(8)
    X = rng.normal(size=(60, 14)) + 0.7 * rng.normal(size=(60, 1))
    theta = np.where(rng.random(14) < 0.4, rng.normal(0.0, 0.5, 14), 0.0)
    return Summary.from_arrays(X, X @ theta + rng.normal(size=60), NAMES), ScalePrior(0.5)


def test_searched_posterior_is_the_enumerated_one(problem, monkeypatch):
    """What is missing is 1e-6 at most, so that no probability differs by more."""
    needs = (("x3", "x1"), ("x5", "x3"))
    exact = enumerate_models(*problem, always=("x0",), scale=1.0, needs=needs)
    monkeypatch.setattr(enumerate, "LARGEST", 10)
    found = enumerate_models(*problem, always=("x0",), scale=1.0, needs=needs)
    assert not found.space.every
    assert 0.0 < found.missing <= 1e-6
    assert found.error == 0.0
    np.testing.assert_allclose(found.inclusion, exact.inclusion, atol=2e-6)
    assert found.log_evidence == pytest.approx(exact.log_evidence, abs=2e-6)
    # moments are those of a systematic sample of the models, 2,000 of them
    assert np.all(np.abs(found.mean - exact.mean)[1:] < 0.02 * exact.sd[1:])
    np.testing.assert_allclose(found.sd[1:], exact.sd[1:], rtol=0.05)
    given = inclusion_given(found, ("x5",)) - inclusion_given(exact, ("x5",))
    assert np.abs(given).max() < 1e-3
    assert inclusion_of_any(found, ("x2", "x4")) == pytest.approx(
        inclusion_of_any(exact, ("x2", "x4")), abs=3e-6
    )
    full, alike = (components_given(m, NAMES[1:]).moments() for m in (found, exact))
    np.testing.assert_allclose(np.array(full)[:, 1:], np.array(alike)[:, 1:], rtol=1e-9)


def test_sampled_posterior_is_the_enumerated_one_within_its_error(problem, monkeypatch):
    exact = enumerate_models(*problem, scale=1.0)
    monkeypatch.setattr(enumerate, "LARGEST", 10)
    monkeypatch.setattr(module, "TOLERANCE", 1e-300)
    monkeypatch.setattr(module, "EFFORT", 2.0)
    found = enumerate_models(*problem, scale=1.0)
    assert math.isnan(found.missing)
    assert 0.0 < found.error < 0.02
    assert np.abs(found.inclusion - exact.inclusion).max() < 4.0 * found.error
    assert found.log_evidence == pytest.approx(exact.log_evidence, abs=0.1)


def test_unknown_noise_scale_is_held_at_what_the_library_leaves(problem, monkeypatch):
    """60 rows know the scale to 9 %, which moves the log odds of a term t sd away by 0.09 t^2."""
    exact = enumerate_models(*problem)
    monkeypatch.setattr(enumerate, "LARGEST", 10)
    found = enumerate_models(*problem)
    assert np.abs(found.inclusion - exact.inclusion).max() < 0.1


@pytest.mark.slow
def test_temperature_expanded_accelerometer_is_decided():
    """44 excited terms of 47, and which of them are not zero is found, wherever the test can tell."""
    sensor = ib.sensor("mems_tactical", kind="accelerometer")
    heated = ("b0", "b1", "b2", "b3", "m_j", "m_k", "c_ij", "c_ik", "c_jk", "c_jj", "c_kk")
    lib = ib.library(
        "accelerometer", set="extended", temperature=2, temperature_of=heated, rate_of=("b0", "b1")
    )
    plans = (
        ib.thermal([233.0, 273.0, 298.0, 343.0], positions=9, dwell=60.0, soak=900.0, ramp=2.0 / 60.0),
        ib.centrifuge([1, 5, 10, 20], mounts=12, dwell=20.0, rate=2.0),
    )
    rng = np.random.default_rng(2)
    sd = ib.prior(sensor, lib).sd
    inside = rng.random(len(sd)) < 0.35
    truth = dict(zip(lib.names, (inside * sd * rng.standard_normal(len(sd))).tolist(), strict=True))
    summary = ib.summarize(ib.simulate(sensor, plans, seed=3, truth=truth), lib, sensor=sensor)
    chosen = ib.select(summary, ib.prior(sensor, lib))
    assert len(chosen.models.candidates.names) == 44
    assert chosen.models.missing <= 1e-6 or chosen.models.error < 0.01
    for term in chosen.terms:
        true = truth[term.name]
        assert term.verdict != "needed" or true != 0.0
        assert term.verdict != "not needed" or abs(true) < 0.1 * term.prior_sd
        if term.verdict not in ("untested", "inseparable"):
            assert abs(term.full_mean - true) < 4.0 * term.full_sd


@pytest.mark.parametrize(
    ("kind", "needs"), [("correlated", ()), ("silent", ()), ("silent", ((3, 1), (8, 3), (9, 2)))]
)
def test_long_walk_visits_models_as_often_as_they_are_probable(kind, needs):
    p, steps, batches = 10, 4_000, 40
    T, log_width, scale = _problem(kind, p, seed=p)
    exact, T = _enumerated((T, log_width, scale), needs), T / np.append(np.exp(log_width), 1.0)
    parents = np.zeros((p, 2), dtype=np.uint64)
    for child, parent in needs:
        parents[child, 0] |= np.uint64(1 << parent)
    problem = TreeProblem(2.0 * scale**2, log_model_prior("beta-binomial", p), parents)
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
    assert np.abs(Space(p).sums(stays)[0] / stays.sum() - np.mean(inclusion, axis=0)).max() < 0.02
    sums, total = Space(p).sums(np.exp(exact - exact.max()))
    settled = np.array(inclusion)
    error = settled.std(axis=0, ddof=1) / math.sqrt(batches)
    assert (len(how.loose) > 1) == (kind == "silent")
    assert max(logs) < 1e-9 * (1.0 + abs(exact.max()))
    assert (np.abs(settled.mean(axis=0) - sums / total) < 4.5 * error + 1e-6).all()
    assert error.max() < 0.01
