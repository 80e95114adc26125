"""Posteriors over all models of the g-family against each model's closed form, one by one."""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np
import pytest
from scipy.special import hyp2f1, logsumexp

from imubayes.inference.prior import GPrior, HyperG, ZellnerSiow
from imubayes.inference.summary import Summary
from imubayes.selection.enumerate import enumerate_models

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
