"""Coefficients of chosen submodels, and the g-family's integrals, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, error_model="numpy")
def submodel(R, inside):
    """Triangular factor of the columns that are `inside` (p,).

    Returns ``(T, columns)``: T is (k + 1, k + 1) upper triangular with z in its last column, and `columns`
    holds the k column numbers. Householder reflections on the selected columns of R.
    """
    p = R.shape[0] - 1
    columns = np.flatnonzero(inside)
    k = len(columns)
    A = np.empty((p + 1, k + 1))
    for i in range(p + 1):
        for c in range(k):
            A[i, c] = R[i, columns[c]]
        A[i, k] = R[i, p]
    for c in range(k):
        last = columns[c] + 1  # below its own row, a column of R is zero
        norm = np.sqrt(np.sum(A[c:last, c] ** 2))
        if norm == 0.0:
            continue
        v = A[c:last, c].copy()
        v[0] += norm if v[0] >= 0.0 else -norm
        scale = 2.0 / np.sum(v * v)
        for d in range(c, k + 1):
            along = 0.0
            for i in range(c, last):
                along += v[i - c] * A[i, d]
            for i in range(c, last):
                A[i, d] -= scale * along * v[i - c]
    T = np.zeros((k + 1, k + 1))
    for i in range(k):
        for c in range(i, k + 1):
            T[i, c] = A[i, c]
    T[k, k] = np.sqrt(np.sum(A[k:, k] ** 2))
    return T, columns


@njit(cache=True, nogil=True, error_model="numpy")
def solutions(R, inside):
    """Least-squares coefficients and unscaled variances of submodels (m, p); zero where a column is out.

    Returns ``(mean, variance, rss, log_det)``: arrays (m, p) of ``T^-1 z`` and the diagonal of ``(T'T)^-1``,
    and (m,) of the residual sum of squares and of ``ln |T|``.
    """
    p = R.shape[0] - 1
    mean, variance = np.zeros((len(inside), p)), np.zeros((len(inside), p))
    rss, log_det = np.zeros(len(inside)), np.zeros(len(inside))
    for m in range(len(inside)):
        T, columns = submodel(R, inside[m])
        k = len(columns)
        rss[m] = T[k, k] ** 2
        inverse = np.zeros((k, k))
        for c in range(k):
            inverse[c, c] = 1.0 / T[c, c]
            log_det[m] += np.log(abs(T[c, c]))
            for r in range(c - 1, -1, -1):
                total = 0.0
                for i in range(r + 1, c + 1):
                    total += T[r, i] * inverse[i, c]
                inverse[r, c] = -total / T[r, r]
        for r in range(k):
            for c in range(r, k):
                mean[m, columns[r]] += inverse[r, c] * T[c, k]
                variance[m, columns[r]] += inverse[r, c] ** 2
    return mean, variance, rss, log_det


@njit(cache=True, nogil=True, error_model="numpy")
def g_integrals(unexplained, size, dof, g, log_weight):
    """Integrals over g of each model's Bayes factor against the null.

    ``log BF = (dof - k)/2 log(1 + g) - dof/2 log(1 + g u)``, u = 1 - R^2.

    Parameters
    ----------
    unexplained, size : arrays (m,), u and k of each model.
    dof : rows minus forced columns.
    g, log_weight : arrays (q,), nodes and prior weights.

    Returns
    -------
    array (m, 5) : log BF; posterior mean of ``s = g/(1+g)``, its variance, and the means of ``s r`` and
    ``r = (1 + g u)/(1 + g)``.
    """
    out = np.zeros((len(size), 5))
    log_g1, share = np.log1p(g), np.zeros(len(g))
    for m in range(len(size)):
        u = unexplained[m]
        for q in range(len(g)):
            share[q] = 0.5 * (dof - size[m]) * log_g1[q] - 0.5 * dof * np.log1p(g[q] * u) + log_weight[q]
        peak = share.max()
        total = rest = 0.0
        for q in range(len(g)):
            share[q] = np.exp(share[q] - peak)
            s, r = g[q] / (1.0 + g[q]), (1.0 + g[q] * u) / (1.0 + g[q])
            total += share[q]
            rest += share[q] / (1.0 + g[q])
            out[m, 1] += share[q] * s
            out[m, 3] += share[q] * s * r
            out[m, 4] += share[q] * r
        out[m, 0] = peak + np.log(total)
        out[m, 1:] /= total
        for q in range(len(g)):  # of 1 - s about its mean: under strong signals s is 1 to all digits
            out[m, 2] += share[q] / total * (1.0 / (1.0 + g[q]) - rest / total) ** 2
    return out
