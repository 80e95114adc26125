"""More candidates than are enumerated: the decision's own path against enumeration and a known truth, and the
walk over models: its odds, its balance, its hierarchy."""

from __future__ import annotations

import math

import numpy as np
import pytest

import imubayes as ib
from imubayes import ScalePrior, Summary
from imubayes.algebra.factor import with_prior_rows
from imubayes.selection import enumerate
from imubayes.selection.enumerate import enumerate_models
from imubayes.selection.kernels import solutions
from imubayes.selection.lanes import walk
from imubayes.selection.model_sets import Listed, fold, sizes
from imubayes.selection.model_walk import Problem, Record, begin, moves, take_steps
from imubayes.selection.models import components_given, inclusion_given, inclusion_of_any
from imubayes.selection.search import walk_models
from imubayes.sensors.terms import columns, library


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


@pytest.mark.parametrize("problem", [_problem("random", 100, seed=11), _thermal(3e-3, EXPANDED)])
def test_any_number_of_candidates_is_walked_over(problem):
    """Two walks agree within their errors, and each log joint is its model's own."""
    T, log_width, scale = problem
    p = len(log_width)
    around = Problem(2.0 * scale**2, _beta_binomial(p), np.zeros((p, p), dtype=bool))
    found, other = (walk_models(T, log_width, around, 100_000, np.random.default_rng(k)) for k in (1, 2))
    _, _, rss, log_det = solutions(np.ascontiguousarray(T), found.inside)
    again = -rss / (2.0 * scale**2) - log_det + found.inside @ log_width
    again += _beta_binomial(p)[found.inside.sum(axis=1)]
    np.testing.assert_allclose(found.log_joint, again, rtol=1e-9)
    assert len(np.unique(found.inside, axis=0)) == len(found.inside)
    apart = np.abs(found.inclusion - other.inclusion)
    assert (apart < 5.0 * np.hypot(found.error, other.error) + 0.01).all()


NAMES = tuple(f"x{k}" for k in range(14))


@pytest.fixture(scope="module")
def problem():
    rng = np.random.default_rng(8)
    X = rng.normal(size=(60, 14)) + 0.7 * rng.normal(size=(60, 1))
    theta = np.where(rng.random(14) < 0.4, rng.normal(0.0, 0.5, 14), 0.0)
    return Summary.from_arrays(X, X @ theta + rng.normal(size=60), NAMES), ScalePrior(0.5)


@pytest.mark.parametrize("needs", [(), (("x3", "x1"), ("x5", "x3"))])
def test_searched_posterior_is_the_enumerated_one_within_its_error(problem, monkeypatch, needs):
    exact = enumerate_models(*problem, always=("x0",), scale=1.0, needs=needs)
    monkeypatch.setattr(enumerate, "LARGEST", 10)
    found = enumerate_models(*problem, always=("x0",), scale=1.0, needs=needs)
    assert isinstance(found.space, Listed)
    assert not found.every
    assert 0.0 < found.error < 0.005
    assert np.abs(found.inclusion - exact.inclusion).max() < 4.0 * found.error
    assert found.log_evidence == pytest.approx(exact.log_evidence, abs=0.05)
    assert np.all(np.abs(found.mean - exact.mean)[1:] < 0.03 * exact.sd[1:])
    np.testing.assert_allclose(found.sd[1:], exact.sd[1:], rtol=0.05)
    given = inclusion_given(found, ("x5",)) - inclusion_given(exact, ("x5",))
    assert np.abs(given).max() < 0.05  # x5 itself is in a sixth of the models
    assert inclusion_of_any(found, ("x2", "x4")) == pytest.approx(
        inclusion_of_any(exact, ("x2", "x4")), abs=0.01
    )
    full, alike = (components_given(m, NAMES[1:]).moments() for m in (found, exact))
    np.testing.assert_allclose(np.array(full)[:, 1:], np.array(alike)[:, 1:], rtol=1e-9)


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
    assert chosen.models.error < 0.01
    for term in chosen.terms:
        true = truth[term.name]
        assert term.verdict != "needed" or true != 0.0
        assert term.verdict != "not needed" or abs(true) < 0.1 * term.prior_sd
        if term.verdict not in ("untested", "inseparable"):
            assert abs(term.full_mean - true) < 4.0 * term.full_sd


def _walked_problem(
    p: int, silent: int, needs: tuple[tuple[int, int], ...]
) -> tuple[np.ndarray, Problem, np.ndarray]:
    """Factor with prior rows of 1, the last columns without data; and the log joint of all models."""
    rng = np.random.default_rng(p)
    X = rng.normal(size=(2 * p, p)) @ (np.eye(p) + 0.7 * rng.normal(size=(p, p)))
    X[:, p - silent :] *= 0.02
    y = X @ (rng.normal(size=p) * (rng.random(p) < 0.4)) + rng.normal(size=2 * p)
    T = np.linalg.qr(np.vstack((np.column_stack((X, y)), np.eye(p, p + 1))), mode="r")
    log_prior = -math.log(p + 1) - np.array([math.log(math.comb(p, k)) for k in range(p + 1)])
    needed = np.zeros((p, p), dtype=bool)
    rss, log_det = walk(T)
    exact = -rss / 2.0 - log_det + log_prior[sizes(p)]
    masks = np.arange(1 << p)
    for child, parent in needs:
        needed[child, parent] = True
        exact[(masks >> child & 1 == 1) & (masks >> parent & 1 == 0)] = -math.inf
    return T, Problem(2.0, log_prior, needed), exact


@pytest.mark.parametrize(("silent", "needs"), [(0, ()), (6, ()), (5, ((3, 1), (8, 3), (9, 2)))])
def test_long_walk_visits_models_as_often_as_they_are_probable(silent, needs):
    p, steps, batches = 10, 4_000, 40
    T, problem, exact = _walked_problem(p, silent, needs)
    state, how = begin(T, np.zeros(p, dtype=bool), problem), moves(T)
    rng = np.random.default_rng(4)
    inclusion, logs, stays = [], [], np.zeros(1 << p)
    for _ in range(batches):
        inside, sums = np.empty((steps + 1, p), dtype=bool), np.empty((2, steps + 1))
        record = Record(inside, *sums, np.empty(p), np.zeros(1, dtype=np.int64))
        take_steps(problem, state, how, rng.random((steps, 4 + p)), record)
        n = record.count[0]
        inclusion.append(record.inclusion)
        masks = record.inside[:n] @ (1 << np.arange(p))
        np.add.at(stays, masks, record.stay[:n])
        logs.append(np.abs(record.log_joint[:n] - exact[masks]).max())
    assert stays.sum() == steps * batches
    assert np.abs(fold(stays, p)[0] / stays.sum() - np.mean(inclusion, axis=0)).max() < 0.02
    sums, total = fold(np.exp(exact - exact.max()), p)
    settled = np.array(inclusion)
    error = settled.std(axis=0, ddof=1) / math.sqrt(batches)
    assert (len(how.loose) > 1) == (silent > 0)
    assert max(logs) < 1e-9 * (1.0 + abs(exact.max()))
    assert (np.abs(settled.mean(axis=0) - sums / total) < 4.5 * error + 1e-6).all()
    assert error.max() < 0.01
