"""Weights by products against weights by logarithms, and models that stand for all against all. Integrals
over g: curves against each model's own integral, stated digits against closed forms, and posteriors over
all models of the g-family against each model's closed form, one by one."""

from __future__ import annotations

import math
from itertools import combinations
from typing import Any

import numpy as np
import pytest
from mpmath import mp as _mp
from scipy.special import hyp2f1, logsumexp

from imubayes.algebra.factor import Factor
from imubayes.inference.prior import GPrior, HyperG, ScalePrior, ZellnerSiow
from imubayes.inference.summary import Summary
from imubayes.selection import enumerate, lanes
from imubayes.selection.enumerate import enumerate_models
from imubayes.selection.models import average, components_given, inclusion_given

P = 11
NAMES = tuple(f"x{j}" for j in range(P))


@pytest.fixture
def summary() -> Summary:
    rng = np.random.default_rng(4)
    X = rng.normal(size=(60, P))
    return Summary.from_arrays(X, X[:, :4] @ [1.0, -0.3, 0.3, 0.2] + rng.normal(size=60), NAMES)


@pytest.mark.parametrize("scale", [None, 1.0])
@pytest.mark.parametrize("sd", [1.0, 1e-40, 1e40])
def test_products_and_logarithms_give_the_same_posterior(summary, scale, sd, monkeypatch):
    """At a prior sd of 1e40 the widths of ten columns multiply to 1e-400, which no product holds."""
    options = {"scale": scale, "needs": [("x1", "x0"), ("x5", "x9")]}
    found = enumerate_models(summary, ScalePrior(sd), always=["x10"], **options)
    monkeypatch.setattr(lanes, "storable", lambda R, width: False)
    logs = enumerate_models(summary, ScalePrior(sd), always=["x10"], **options)
    assert found.log_evidence == pytest.approx(logs.log_evidence, rel=1e-11)
    np.testing.assert_allclose(found.inclusion, logs.inclusion, rtol=1e-9)
    np.testing.assert_allclose(found.weight, logs.weight, rtol=1e-9, atol=1e-300)
    np.testing.assert_allclose(found.by_size, logs.by_size, rtol=1e-10)
    assert found.best[0][1] == pytest.approx(logs.best[0][1], rel=1e-9)


def test_a_mountain_of_evidence_for_every_column_is_left_to_logarithms(summary, monkeypatch):
    """Twelve widths of 1e-30 each: the best model's product, 1e-360, is below what a number can hold."""
    rng = np.random.default_rng(5)
    X = rng.normal(size=(60, 12))
    s = Summary.from_arrays(X, 1e3 * X.sum(axis=1) + 1e-6 * rng.normal(size=60), [f"x{j}" for j in range(12)])
    found = enumerate_models(s, ScalePrior(1e24), scale=1e-6)
    monkeypatch.setattr(lanes, "storable", lambda R, width: False)
    logs = enumerate_models(s, ScalePrior(1e24), scale=1e-6)
    assert found.best[0][0] == s.names
    assert found.log_evidence == pytest.approx(logs.log_evidence, rel=1e-12)


@pytest.mark.parametrize("prior", [ScalePrior(1.0), HyperG(3.0)])
def test_models_that_stand_for_all_keep_what_is_told_of_all(summary, prior, monkeypatch):
    monkeypatch.setattr(enumerate, "CURVES", P)  # fewer candidates of a g-prior are looked at one by one
    every = enumerate_models(summary, prior)
    monkeypatch.setattr(enumerate, "STORED_BITS", 8)
    monkeypatch.setattr(enumerate, "STORED", 400)
    few = enumerate_models(summary, prior)
    assert len(few.space) < len(every.space) == few.n_models
    np.testing.assert_array_equal(few.inclusion, every.inclusion)
    assert few.log_evidence == every.log_evidence
    assert few.best == every.best
    np.testing.assert_array_equal(few.by_size, every.by_size)
    inside = every.weight < 1.0 / 400
    level = 4.0 * 0.5 * every.weight[inside].sum() / np.sqrt(400)  # of a systematic draw, 4 sd
    given = [inclusion_given(m, ("x1",)) for m in (few, every)]
    assert np.max(np.abs(given[0] - given[1])) < level / every.inclusion[1]


def test_averages_over_models_that_stand_for_all_are_those_over_all(summary, monkeypatch):
    def averaged():
        drawn = [enumerate_models(summary, ScalePrior(1.0), scale=scale) for scale in (0.9, 1.0, 1.1)]
        return average(drawn, np.zeros(3), [("x1",)])

    every = averaged()
    monkeypatch.setattr(enumerate, "STORED_BITS", 8)
    monkeypatch.setattr(enumerate, "STORED", 400)
    few = averaged()
    np.testing.assert_allclose(few.inclusion, every.inclusion, rtol=1e-12)
    np.testing.assert_allclose(few.by_size, every.by_size, rtol=1e-12)
    assert (few.log_evidence, few.n_models, few.error) == (pytest.approx(every.log_evidence), 2**P, 0.0)
    parts = components_given(few, ("x1",))
    assert parts.inside[:, 1].all()


mp: Any = _mp
FEW = 9


def _summary(rows: int) -> Summary:
    """Independent columns of unit variance with effects of 3, 1.5 and 0 sd, in turn."""
    R = math.sqrt(rows) * np.eye(FEW + 1)
    R[:-1, -1] = np.resize([3.0, 1.5, 0.0], FEW)
    return Summary(Factor(tuple(f"x{j}" for j in range(FEW)), R, rows))


@pytest.mark.parametrize("rows", [60, 20_000, 1_000_000])
@pytest.mark.parametrize("prior", [HyperG(3.0), ZellnerSiow(1.0)])
def test_curves_keep_the_digits_that_they_state_however_many_the_rows(rows, prior, monkeypatch):
    """With 1e6 rows a model that matters leaves all but 1e-5 of the squares: where curves are steep."""
    s = _summary(rows)
    exact = enumerate_models(s, prior)
    monkeypatch.setattr(enumerate, "CURVES", 1)
    found = enumerate_models(s, prior)
    assert found.quadrature < 1e-6
    assert abs(found.log_evidence - exact.log_evidence) <= found.quadrature
    np.testing.assert_allclose(found.inclusion, exact.inclusion, atol=2.0 * found.quadrature)


@pytest.mark.parametrize("a", [2.01, 3.0, 40.0])
@pytest.mark.parametrize(("n", "noise"), [(12, 1.0), (60, 1e-4)])
def test_hyper_g_states_no_more_digits_than_the_hypergeometric_function_bears_out(a, n, noise):
    """Liang et al. (2008): ``BF = (a - 2)/(k + a - 2) 2F1(n/2, 1; (k + a)/2; R^2)``, here of one column."""
    rng = np.random.default_rng(5)
    x = rng.normal(size=n)
    y = x + noise * rng.normal(size=n)
    found = enumerate_models(Summary.from_arrays(x[:, None], y, ("x",)), HyperG(a))
    with mp.workdps(40):
        X, Y = [mp.mpf(v) for v in x.tolist()], [mp.mpf(v) for v in y.tolist()]
        share = mp.fdot(X, Y) ** 2 / (mp.fdot(X, X) * mp.fdot(Y, Y))
        factor = (mp.mpf(a) - 2) / (mp.mpf(a) - 1) * mp.hyp2f1(mp.mpf(n) / 2, 1, (1 + mp.mpf(a)) / 2, share)
        inclusion = float(factor / (1 + factor))
    assert abs(found.inclusion[0] - inclusion) <= 10.0**-found.digits.inclusion
    assert abs(found.inclusion[0] - inclusion) <= 1e-10


ROWS = 47
PRIORS = [GPrior(47.0), HyperG(3.0), HyperG(4.0), ZellnerSiow(1.0)]


def _rows(p: int) -> tuple[np.ndarray, np.ndarray]:
    """Correlated columns of which most are open, so that thousands of models share the posterior."""
    rng = np.random.default_rng(15)
    X = rng.normal(size=(ROWS, p)) @ (np.eye(p) + 0.25) + 1.0
    return X, 3.0 + X[:, :6] @ [0.9, -0.5, 0.3, 0.25, -0.2, 0.15] + rng.normal(size=ROWS)


def _of_t(prior, size: int, share: np.ndarray) -> np.ndarray:
    """Log Bayes factor, and posterior means of t and t^2, ``t = g/(1 + g)`` (3, m), of models of one size.

    Liang et al. (JASA 2008): of a hyper-g prior these are Gauss's hypergeometric functions of R^2. Of
    Zellner and Siow's, Gauss-Legendre quadrature over ln g.
    """
    dof = ROWS - 1.0
    if isinstance(prior, GPrior):
        t = prior.g / (1.0 + prior.g)
        log = 0.5 * (dof - size) * math.log1p(prior.g) - 0.5 * dof * np.log1p(prior.g * (1.0 - share))
        return np.array([log, np.full_like(log, t), np.full_like(log, t**2)])
    if isinstance(prior, HyperG):
        half = 0.5 * (size + prior.a)
        whole = [hyp2f1(0.5 * dof, 1 + j, half + j, share) for j in range(3)]
        log = math.log((prior.a - 2.0) / (size + prior.a - 2.0)) + np.log(whole[0])
        t = whole[1] / whole[0] / half
        return np.array([log, t, 2.0 * whole[2] / whole[0] / (half * (half + 1.0))])
    x, w = np.polynomial.legendre.leggauss(20)
    at = (np.arange(-10.0, 50.0)[:, None] + 0.5 * (1.0 + x)).ravel()
    g, beta = np.exp(at), 0.5 * ROWS * prior.scale**2
    logs = np.log(np.tile(0.5 * w, 60)) + 0.5 * math.log(beta / math.pi) - 0.5 * at - beta / g
    logs = logs + 0.5 * (dof - size) * np.log1p(g) - 0.5 * dof * np.log1p(g * (1.0 - share)[:, None])
    total = logsumexp(logs, axis=1)
    given, t = np.exp(logs - total[:, None]), g / (1.0 + g)
    return np.array([total, given @ t, given @ t**2])


def _one_by_one(X, y, prior, forbidden=()) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
    """Log Bayes factor of all models against the null; inclusion, mean and sd, of a constant first."""
    n, p = X.shape
    centre, Xc, yc = X.mean(axis=0), X - X.mean(axis=0), y - y.mean()
    gram, cross, unit = Xc.T @ Xc, Xc.T @ yc, yc @ yc / (n - 3.0)
    logs, inside, first, second = [], [], [], []
    for size in range(p + 1):
        columns = np.array(list(combinations(range(p), size)), dtype=int).reshape(math.comb(p, size), size)
        there = np.zeros((len(columns), p), dtype=bool)
        np.put_along_axis(there, columns, True, axis=1)
        full = np.zeros((len(columns), p, p))
        full[there[:, :, None] & there[:, None, :]] = np.linalg.inv(
            gram[columns[:, :, None], columns[:, None, :]]
        ).ravel()
        b = full @ cross
        share = b @ cross / (yc @ yc)
        log, t, square = _of_t(prior, size, share) if size else np.array([[0.0], [0.5], [0.5]])
        log = log - math.log((p + 1) * math.comb(p, size))
        for child, parent in forbidden:
            log[there[:, child] & ~there[:, parent]] = -math.inf
        # the constant is the mean of y less the columns' means times their coefficients
        b = np.column_stack((-b @ centre, b))
        spread = np.column_stack((centre @ full @ centre, np.diagonal(full, axis1=1, axis2=2)))
        variance = unit * (t - share * square)[:, None] * spread
        variance[:, 0] += unit * (1.0 - share * t) / n
        logs.append(log)
        inside.append(np.column_stack((np.ones(len(there)), there)))
        first.append(t[:, None] * b)
        second.append(variance + square[:, None] * b**2)
    log = np.concatenate(logs)
    weight = np.exp(log - logsumexp(log))
    inclusion, mean, squares = (weight @ np.concatenate(parts) for parts in (inside, first, second))
    sd = np.sqrt(squares - mean**2)
    mean[0] += y.mean()
    return logsumexp(log), inclusion, mean, sd


@pytest.mark.parametrize("prior", PRIORS, ids=str)
@pytest.mark.parametrize(("p", "needs"), [(7, ()), (8, ()), (12, ()), (13, ()), (13, ((6, 0), (7, 1)))])
def test_moments_are_those_of_every_model_however_many_the_candidates(prior, p, needs):
    """On both sides of the counts from which on lanes and curves serve."""
    X, y = _rows(p)
    names = "abcdefghijklm"[:p]
    found = enumerate_models(
        Summary.from_arrays(np.column_stack((X, np.ones(ROWS))), y, [*names, "1"]),
        prior,
        forced=["1"],
        needs=[(names[child], names[parent]) for child, parent in needs],
    )
    order = [p, *range(p)]
    log_factor, inclusion, mean, sd = _one_by_one(X, y, prior, needs)
    assert found.n_models == 2**p
    assert np.count_nonzero(found.weight > 1e-8) > 2 ** (p - 4)
    assert found.log_evidence - found.by_size[0] - math.log(p + 1.0) == pytest.approx(log_factor, rel=1e-9)
    if not needs:
        left, half = float(np.sum((y - y.mean()) ** 2)), 0.5 * (ROWS - 1)
        # density of y about a constant with a flat prior, integrated over ln sigma in closed form
        null = math.lgamma(half) - half * math.log(math.pi * left) - 0.5 * math.log(ROWS) - math.log(2.0)
        assert found.log_evidence == pytest.approx(null + log_factor, abs=1e-7)
    np.testing.assert_allclose(found.inclusion[order], inclusion, rtol=1e-9)
    np.testing.assert_allclose(found.mean[order], mean, rtol=1e-9, atol=1e-9 * sd.min())
    np.testing.assert_allclose(found.sd[order], sd, rtol=1e-9)
