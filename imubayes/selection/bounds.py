"""A certified bound on all submodels below a node of the tree, and the algebra of a node's block.

A node of the tree has decided some columns. What is left to it is a triangular block: the free columns, with
the included ones projected out, beside z. With G the block's Gram matrix, b its least-squares coefficients,
S the columns that a descendant adds, and every column scaled so that its prior row is 1, the descendant's
joint probability is, up to what the node fixes, ``exp(-rss_S / 2 s^2) |G_SS|^-1/2 prior(size)``.

**rss.** Let ``G >= diag(m)``. For any point t, with q(x) the residual of coefficients x and 2h its gradient
at t,
``q(x) = q(t) + 2 h'(x - t) + (x - t)' G (x - t) >= q(t) + sum_j [2 h_j (x_j - t_j) + m_j (x_j - t_j)^2]``.
With t the fit of some of the free columns (the *anchors*, h = 0 there) and zero elsewhere::

    rss_S >= q(t) + sum_{anchors not in S} m_j t_j^2 - sum_{others in S} min(h_j^2 / m_j, q(t) - rss_all)

The anchors are the columns that the data want, so the bound is exact at the node's best model and nearly so
around it. The best m for all models at once solves a small semidefinite programme (`curvature`). It stays
valid below: including a column leaves a principal block of G^-1, excluding one a principal block of G.

**Occam.** ``|G_SS| = prod_{j in S}`` (distance of column j from the earlier columns *in S*)^2, and that is at
least its distance from *all* earlier free columns: the block's own diagonal, ``|G_SS| >= prod_S r_jj^2``.

Both bounds are products over the columns, so a prior that depends on the size alone is summed exactly over
all 2^r descendants through the coefficients of a polynomial, r^2/2 multiplications.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import FloatArray
from imubayes.algebra.compiled import compiled, inner
from imubayes.selection.kernels import invert

SWEEPS = 8
"""Sweeps over the columns in the semidefinite programme; what they leave, the slack makes up."""

SLACK = 1e-3
"""First relative slack of the programme's solution; it doubles until a Cholesky factor proves it."""

PIVOT = 1e-9
"""Smallest pivot, relative to 1, that counts as proof."""

FAR = -700.0
"""Logarithm below which an exponential is rounded up to this one."""


class TreeProblem(NamedTuple):
    """What is common to all nodes: ``2 scale^2``, log prior by size (p + 1,), words of all parents (p, 2)."""

    spread: float
    log_prior: FloatArray
    parents: NDArray[np.uint64]


@inner
def put_bit(words, column):
    """Note a column in the two words of a model."""
    words[column >> 6] |= np.uint64(1) << np.uint64(column & 63)


@inner
def put_words(words, to):
    """Write the two words of a model."""
    to[0], to[1] = words[0], words[1]


@inner
def has_bit(words, column):
    """Whether a column is in the two words of a model."""
    return ((words[column >> 6] >> np.uint64(column & 63)) & np.uint64(1)) != 0


@compiled
def within(words, others):
    """Whether all columns of a model are in another."""
    return (words[0] & ~others[0]) == 0 and (words[1] & ~others[1]) == 0


@inner
def curvature(A, r, low, tight):
    """Write to `low` an m with ``G >= diag(m)``, G the Gram matrix of the first r columns of A.

    Equivalent to ``C <= diag(u)`` with C the correlation matrix of G^-1 and ``u = 1 / (m diag(G^-1))``; the
    trace of u is minimised through the programme's dual in low rank, one unit vector a column, each turned to
    the sum of the others (the mixing method: Wang and Kolter, 2017). `tight` gets 1/u.
    """
    if r == 0:
        return
    variance, C = _correlation(A, r)
    rank = min(r, int(math.sqrt(2.0 * r)) + 2)
    V = np.zeros((r, rank))
    for i in range(r):
        V[i, i % rank] = 1.0
        V[i, (i // rank + i + 1) % rank] += 0.3
        _unit(V[i], V[i])
    u, pull = np.ones(r), np.zeros(rank)
    for _ in range(SWEEPS):
        for i in range(r):
            for k in range(rank):
                pull[k] = -V[i, k]
            for j in range(r):
                for k in range(rank):
                    pull[k] += C[i, j] * V[j, k]
            u[i] = 1.0 + _unit(pull, V[i])
    slack = SLACK
    while not _dominates(C, u, 1.0 + slack):
        slack *= 2.0
    for i in range(r):
        tight[i] = 1.0 / (u[i] * (1.0 + slack))
        low[i] = tight[i] / variance[i]


@compiled
def _correlation(A, r):
    """Diagonal of G^-1 and its correlation matrix."""
    W = np.zeros((r, r))
    invert(A, np.int64(0), r, W)
    C, variance = np.empty((r, r)), np.empty(r)
    for i in range(r):
        size = _unit(W[i], W[i])
        variance[i] = size * size
    for i in range(r):
        for j in range(i, r):
            total = 0.0
            for k in range(j, r):
                total += W[i, k] * W[j, k]
            C[i, j] = C[j, i] = total
    return variance, C


@compiled
def _unit(v, to):
    """Write v at unit length, unless it is zero; return its own."""
    square = 0.0
    for k in range(len(v)):
        square += v[k] * v[k]
    size = math.sqrt(square)
    for k in range(len(v) if size > 0.0 else 0):
        to[k] = v[k] / size
    return size


@inner
def _dominates(C, u, stretch):
    """Whether ``diag(stretch u) - C`` is positive definite, by its Cholesky factor."""
    r = len(u)
    L = np.zeros((r, r))
    for j in range(r):
        pivot = stretch * u[j] - C[j, j]
        for k in range(j):
            pivot -= L[j, k] * L[j, k]
        if pivot < PIVOT:
            return stretch > 1e3  # u is at least 1 and C at most r: this is proof without a factor
        L[j, j] = math.sqrt(pivot)
        for i in range(j + 1, r):
            total = C[i, j]
            for k in range(j):
                total += L[i, k] * L[j, k]
            L[i, j] = -total / L[j, j]
    return True


@inner
def bring(A, r, q, t):
    """Move column q of the block to position t < q, in place, and make it triangular again."""
    for i in range(q + 1):
        moved = A[i, q]
        for k in range(q, t, -1):
            A[i, k] = A[i, k - 1]
        A[i, t] = moved
    for i in range(q - 1, t - 1, -1):
        a, b = A[i, t], A[i + 1, t]
        norm = math.sqrt(a * a + b * b)
        if b == 0.0 or norm == 0.0:
            continue
        c, s = a / norm, b / norm
        A[i, t], A[i + 1, t] = norm, 0.0
        for k in range(i + 1, r + 1):
            x, y = A[i, k], A[i + 1, k]
            A[i, k] = c * x + s * y
            A[i + 1, k] = c * y - s * x


@compiled
def drop(A, r, q, out):
    """Write to `out` the block A of r columns without column q; `out` may be A."""
    carry = A[q, : r + 1].copy()
    for i in range(q):
        for k in range(i, q):
            out[i, k] = A[i, k]
        for k in range(q + 1, r + 1):
            out[i, k - 1] = A[i, k]
    for i in range(q + 1, r):
        a, b = carry[i], A[i, i]
        norm = math.sqrt(a * a + b * b)
        c, s = (b / norm, a / norm) if norm > 0.0 else (1.0, 0.0)
        out[i - 1, i - 1] = norm
        for k in range(i + 1, r + 1):
            x, y = carry[k], A[i, k]
            out[i - 1, k - 1] = c * y + s * x
            carry[k] = c * x - s * y
    out[r - 1, r - 1] = math.sqrt(A[r, r] ** 2 + carry[r] ** 2)


@compiled
def additions(A, r, k, g, norm2):
    """Write ``a_j' z`` and ``|a_j|^2`` of the columns from k on, beside the included ones and the first k."""
    for j in range(k, r):
        dot = square = 0.0
        for i in range(k, j + 1):
            dot += A[i, j] * A[i, r]
            square += A[i, j] * A[i, j]
        g[j], norm2[j] = dot, square


@inner
def log_sum(poly, first, log_prior):
    """Logarithm of ``sum_{k >= first} poly_k exp(log_prior_k)``."""
    peak = -np.inf
    for k in range(first, len(poly)):
        peak = max(peak, log_prior[k])
    if peak == -np.inf:
        return peak
    total = 0.0
    for k in range(first, len(poly)):
        total += (poly[k] + 1e-290) * math.exp(log_prior[k] - peak)
    return peak + math.log(total)
