"""Compiled work on submodels: passes over weights, coefficients of chosen models, integrals over g."""

from __future__ import annotations

import numpy as np
from numba import njit

ROW_BITS = 5
"""Neighbours that are added up side by side, as vectors."""


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract"})
def block_sums(weight, number, bits):
    """Sums of block `number` of 2^bits weights: of those with each bit (bits,), and by size (bits + 1,)."""
    row = min(ROW_BITS, bits)
    block = weight[number << bits : (number + 1) << bits].copy()
    wide = np.zeros((bits - row + 1, 1 << row))
    for i in range(1 << (bits - row)):
        size = ones(i)
        for k in range(1 << row):
            wide[size, k] += block[(i << row) + k]
    by_size = np.zeros(bits + 1)
    for size in range(wide.shape[0]):
        for k in range(1 << row):
            by_size[size + ones(k)] += wide[size, k]
    having = np.zeros(bits)
    for j in range(bits - 1, -1, -1):
        half, total = 1 << j, 0.0
        for i in range(half):
            total += block[half + i]
        for i in range(half):
            block[i] += block[half + i]
        having[j] = total
    return having, by_size


@njit(cache=True, nogil=True, error_model="numpy")
def drawn(weight, limit, count):
    """Numbers of the weights from `limit` on; a systematic draw of `count` of the others; and their sum."""
    rest, heavy = 0.0, 0
    for w in weight:
        if w >= limit:
            heavy += 1
        else:
            rest += w
    kept, ticks = np.empty(heavy, np.int64), np.empty(count if rest > 0.0 else 0, np.int64)
    step, walked, h, t = rest / count, 0.0, 0, 0
    for i in range(len(weight)):
        if weight[i] >= limit:
            kept[h] = i
            h += 1
            continue
        walked += weight[i]
        while t < len(ticks) and walked > (t + 0.5) * step:
            ticks[t] = i
            t += 1
    return kept, ticks[:t], rest


@njit(cache=True, nogil=True, error_model="numpy")
def log_factors(rss, number, sizes, total, dof, nodes, table, links, by_size):
    """Put in place of block `number` of rss (2^p,) the log joint probabilities under the g-family.

    Parameters
    ----------
    sizes : (2^bits,) ones in the numbers of the block's models.
    total, dof : residual sum of squares without any candidate; rows minus forced columns.
    nodes, table : as `at` and the first of `cubics` of `evidence.Curves`.
    links : (l, 2) children and parents; a model with a child without its parent gets -inf.
    by_size : (p + 1,) what is added by size.

    Returns
    -------
    the largest.
    """
    highest, start, above, least = -np.inf, number * len(sizes), ones(number), np.exp(nodes[0])
    for i in range(len(sizes)):
        mask, k = start + i, sizes[i] + above
        u = min(max(rss[mask] / total, least), 1.0)
        x, pieces = np.log1p(-dof * np.log(u)) / nodes[1], table[k]
        piece = min(int(x), len(pieces) - 1)
        a, b, c, d = pieces[piece]
        r = x - piece
        left = u + nodes[2] * (1.0 - u)
        value = ((a * r + b) * r + c) * r + d - 0.5 * dof * np.log(left)
        for n in range(len(links)):
            if (mask >> links[n, 0]) & 1 > (mask >> links[n, 1]) & 1:
                value = -np.inf
        rss[mask] = value + by_size[k]
        highest = max(highest, rss[mask])
    return highest


@njit(cache=True, nogil=True, error_model="numpy")
def exponentials(logs, number, bits, peak):
    """Put exp(logs - peak) in the place of a block of logs."""
    for i in range(number << bits, (number + 1) << bits):
        logs[i] = np.exp(logs[i] - peak)


@njit(cache=True, nogil=True, inline="always")
def ones(number):
    """Ones of a number."""
    ones = 0
    while number:
        number &= number - 1
        ones += 1
    return ones


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
def invert(A, r, W):
    """Write the inverse of the leading r columns of the triangular factor A to the upper triangle of W."""
    for j in range(r):
        W[j, j] = 1.0 / A[j, j]
        for i in range(j - 1, -1, -1):
            total = 0.0
            for k in range(i + 1, j + 1):
                total += A[i, k] * W[k, j]
            W[i, j] = -total / A[i, i]


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
        invert(T, k, inverse)
        for c in range(k):
            log_det[m] += np.log(abs(T[c, c]))
        for r in range(k):
            for c in range(r, k):
                mean[m, columns[r]] += inverse[r, c] * T[c, k]
                variance[m, columns[r]] += inverse[r, c] ** 2
    return mean, variance, rss, log_det


@njit(cache=True, nogil=True, error_model="numpy")
def covariance(R, inside, weight):
    """Weighted sum (p, p) of ``(T'T)^-1`` over submodels (m, p), zero where a column is out."""
    p = R.shape[0] - 1
    total = np.zeros((p, p))
    for m in range(len(inside)):
        T, columns = submodel(R, inside[m])
        k = len(columns)
        inverse = np.zeros((k, k))
        invert(T, k, inverse)
        for r in range(k):
            for s in range(k):
                shared = np.sum(inverse[r, max(r, s) :] * inverse[s, max(r, s) :])
                total[columns[r], columns[s]] += weight[m] * shared
    return total


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
        for k in range(1, 5):
            out[m, k] /= total
        for q in range(len(g)):  # of 1 - s about its mean: under strong signals s is 1 to all digits
            out[m, 2] += share[q] / total * (1.0 / (1.0 + g[q]) - rest / total) ** 2
    return out
