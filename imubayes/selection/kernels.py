"""Compiled work on submodels: passes over weights, coefficients of chosen models, integrals over g."""

from __future__ import annotations

import math

import numpy as np

from imubayes.algebra import BoolArray, FloatArray, IntArray
from imubayes.algebra.compiled import compiled, inlined, reordered

ROW_BITS = 5
"""Neighbours that are added up side by side, as vectors."""

CHUNK_BITS = 10
"""Numbers that stay in the first cache while functions of them are taken."""

INVERSE_FACTORIALS = tuple(1.0 / math.factorial(k) for k in range(11, -1, -1))

DEEP = 50.0
"""Below the logarithm of the largest share of an integral, where shares no longer count: 2e-22."""

ROOT_OF_HALF = 0x3FE6A09E667F3BCD
"""Bits of the square root of a half."""


def ready() -> None:
    """Load what every decision needs, or compile it while a process beside this one compiles the rest."""
    solutions(np.eye(2), np.ones((1, 1), dtype=bool))


@reordered
def light_sums(weight, limit, sums):
    """Fill the sums (m,) of the weights (m, 2^ROW_BITS) below a limit in each row."""
    for i in range(len(sums)):
        total = 0.0
        for k in range(1 << ROW_BITS):
            total += weight[i, k] if weight[i, k] < limit else 0.0
        sums[i] = total


@compiled
def log_factors(rss, number, sizes, total, dof, nodes, table, links, by_size, room):
    """Put in place of block `number` of rss (2^p,) the log joint probabilities under the g-family.

    Parameters
    ----------
    sizes : (2^bits,) ones in the numbers of the block's models.
    total, dof : residual sum of squares without any candidate; rows minus forced columns.
    nodes, table : as `at` and the first of `cubics` of `evidence.Curves`.
    links : (l, 2) children and parents; a model with a child without its parent gets -inf.
    by_size : (p + 1,) what is added by size.
    room : numbers (2n,), n of `CHUNK_BITS`, the same memory as integers, its first half, and powers (2n,).

    Returns
    -------
    the largest.
    """
    start, above, least, last = number * len(sizes), ones(number), np.exp(nodes[0]), table.shape[1] - 1
    x, bits, half, powers = room
    n, highest = len(half), -np.inf
    for first in range(0, len(sizes), n):
        for i in range(n):
            u = rss[start + first + i] / total
            u = least if u < least else 1.0 if u > 1.0 else u
            x[i], x[n + i] = u, u + nodes[2] * (1.0 - u)
        logarithms(x, bits, powers)
        for i in range(n):
            x[i], rss[start + first + i] = 1.0 - dof * x[i], -0.5 * dof * x[n + i]
        logarithms(half, bits, powers)
        for i in range(n):
            k, place = sizes[first + i] + above, x[i] / nodes[1]
            piece = np.int64(place)
            piece = last if piece > last else piece
            r = place - piece
            value = (table[k, piece, 0] * r + table[k, piece, 1]) * r + table[k, piece, 2]
            value = value * r + table[k, piece, 3] + by_size[k] + rss[start + first + i]
            rss[start + first + i] = value
            highest = value if value > highest else highest
    if len(links) == 0:
        return highest
    highest = -np.inf
    for mask in range(start, start + len(sizes)):
        for n in range(len(links)):
            if (mask >> links[n, 0]) & 1 > (mask >> links[n, 1]) & 1:
                rss[mask] = -np.inf
        highest = rss[mask] if rss[mask] > highest else highest
    return highest


@compiled
def logarithms(x, bits, power):
    """Put the logarithms of normal numbers above zero in their place; `bits` are the same memory.

    ``ln(2^k m) = k ln 2 + 2 artanh((m - 1)/(m + 1))`` with m from 0.7 to 1.4 and ten terms of the series
    (1e-17). A library's logarithm would not be taken of several at once.
    """
    for i in range(len(x)):
        power[i] = (bits[i] - ROOT_OF_HALF) >> 52
        bits[i] -= power[i] << 52
    for i in range(len(x)):
        f = x[i] - 1.0
        s = f / (2.0 + f)
        z = s * s
        t = 1.0 / 21.0
        for term in (1 / 19, 1 / 17, 1 / 15, 1 / 13, 1 / 11, 1 / 9, 1 / 7, 1 / 5, 1 / 3):
            t = t * z + term
        x[i] = power[i] * 0.693147180559945309417 + 2.0 * (s + s * z * t)


@compiled
def exponentials(x, slope, origin, bits, power):
    """Put ``exp(slope (x - origin))``, no more than 1e304, in the place of numbers (n,).

    ``exp(x) = 2^k exp(r)`` with ``|r| <= ln(2)/2`` and thirteen terms of the series (2e-16); `bits` and
    `power` (n,) are the same memory, for 2^k. A library's exponential would not be taken of several at once.
    """
    for i in range(len(x)):
        exponent = slope * (x[i] - origin)
        own = -708.0 if exponent < -708.0 else 700.0 if exponent > 700.0 else exponent
        k = np.floor(own * 1.4426950408889634 + 0.5)
        r = own - k * 0.693147180369123816490 - k * 1.90821492927058770002e-10
        s = 1 / 479001600
        for term in INVERSE_FACTORIALS:
            s = s * r + term
        x[i] = s if exponent > -708.0 else 0.0
        bits[i] = (np.int64(k) + 1023) << 52
    for i in range(len(x)):
        x[i] *= power[i]


@inlined
def ones(number):
    """Ones of a number."""
    ones = 0
    while number:
        number &= number - 1
        ones += 1
    return ones


def submodel(R: FloatArray, inside: BoolArray) -> tuple[FloatArray, IntArray]:
    """Triangular factor of the columns that are `inside` (p,).

    Returns ``(T, columns)``: T is (k + 1, k + 1) upper triangular with z in its last column, and `columns`
    holds the k column numbers.
    """
    A, columns = _places(R)
    k = _reduce(R, inside, A, columns)
    return np.triu(A[: k + 1, : k + 1]), columns[:k]


def _places(R: FloatArray) -> tuple[FloatArray, IntArray]:
    """Room for a submodel of a factor: its own with a column to work in, and the numbers of its columns."""
    return np.empty((len(R), len(R) + 1)), np.empty(len(R) - 1, dtype=np.int64)


@compiled
def _reduce(R, inside, A, columns):
    """Fill the upper triangle of A and the columns of a `submodel`, by Householder reflections; return k."""
    p, v, k = R.shape[0] - 1, R.shape[0], 0
    for c in range(p):
        if inside[c]:
            columns[k] = c
            k += 1
    for i in range(p + 1):
        for c in range(k):
            A[i, c] = R[i, columns[c]]
        A[i, k] = R[i, p]
    for c in range(k):
        last, square = columns[c] + 1, 0.0  # below its own row, a column of R is zero
        for i in range(c, last):
            A[i, v] = A[i, c]
            square += A[i, v] * A[i, v]
        if square == 0.0:
            continue
        norm = np.sqrt(square)
        square += norm * (2.0 * abs(A[c, v]) + norm)
        A[c, v] += norm if A[c, v] >= 0.0 else -norm
        for d in range(c, k + 1):
            along = 0.0
            for i in range(c, last):
                along += A[i, v] * A[i, d]
            for i in range(c, last):
                A[i, d] -= 2.0 / square * along * A[i, v]
    square = 0.0
    for i in range(k, p + 1):
        square += A[i, k] * A[i, k]
    A[k, k] = np.sqrt(square)
    return k


@compiled
def invert(A, r, W):
    """Write the inverse of the leading r columns of the triangular factor A to the upper triangle of W."""
    for j in range(r):
        W[j, j] = 1.0 / A[j, j]
        for i in range(j - 1, -1, -1):
            total = 0.0
            for k in range(i + 1, j + 1):
                total += A[i, k] * W[k, j]
            W[i, j] = -total / A[i, i]


def solutions(R: FloatArray, inside: BoolArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Least-squares coefficients and unscaled variances of submodels (m, p); zero where a column is out.

    Returns ``(mean, variance, rss, log_det)``: arrays (m, p) of ``T^-1 z`` and the diagonal of ``(T'T)^-1``,
    and (m,) of the residual sum of squares and of ``ln |T|``.
    """
    p = len(R) - 1
    mean, variance = np.zeros((2, len(inside), p))
    rss, log_det = np.zeros((2, len(inside)))
    _solve(R, inside, (*_places(R), np.empty((p, p))), mean, variance, rss, log_det)
    return mean, variance, rss, log_det


@compiled
def _solve(R, inside, room, mean, variance, rss, log_det):
    """Fill the `solutions`; `room` is `_places` and (p, p)."""
    T, columns, inverse = room
    for m in range(len(inside)):
        k = _reduce(R, inside[m], T, columns)
        rss[m] = T[k, k] ** 2
        invert(T, k, inverse)
        for r in range(k):
            log_det[m] += np.log(abs(T[r, r]))
            for c in range(r, k):
                mean[m, columns[r]] += inverse[r, c] * T[c, k]
                variance[m, columns[r]] += inverse[r, c] ** 2


def covariance(R: FloatArray, inside: BoolArray, weight: FloatArray) -> FloatArray:
    """Weighted sum (p, p) of ``(T'T)^-1`` over submodels (m, p), zero where a column is out."""
    p = R.shape[0] - 1
    total = np.zeros((p, p))
    _add_covariances(R, inside, weight, (*_places(R), np.empty((p, p))), total)
    return total


@compiled
def _add_covariances(R, inside, weight, room, total):
    """Add up the `covariance`; `room` as `_solve` has it."""
    T, columns, inverse = room
    for m in range(len(inside)):
        k = _reduce(R, inside[m], T, columns)
        invert(T, k, inverse)
        for r in range(k):
            for s in range(k):
                shared = 0.0
                for c in range(r if r > s else s, k):
                    shared += inverse[r, c] * inverse[s, c]
                total[columns[r], columns[s]] += weight[m] * shared


def g_integrals(
    unexplained: FloatArray, size: IntArray, dof: float, g: FloatArray, log_weight: FloatArray
) -> FloatArray:
    """Integrals over g of each model's Bayes factor against the null.

    ``log BF = (dof - k)/2 log(1 + g) - dof/2 log(1 + g u)``, u = 1 - R^2.

    Parameters
    ----------
    unexplained, size : arrays (m,), u and k of each model; those of the same u cost least side by side.
    dof : rows minus forced columns.
    g, log_weight : arrays (q,), nodes and prior weights.

    Returns
    -------
    array (m, 5) : log BF; posterior mean of ``s = g/(1+g)``, its variance, and the means of ``s r`` and
    ``r = (1 + g u)/(1 + g)``.
    """
    out = np.zeros((len(size), 5))
    over = g, np.log1p(g), 1.0 / (1.0 + g), log_weight
    _integrate(unexplained, size, dof, over, tuple(np.empty((2, len(g)))), out)
    return out


@compiled
def _integrate(unexplained, size, dof, over, room, out):
    """Fill the `g_integrals` over g, ``log(1 + g)``, ``1/(1 + g)`` and log weights; `room` is two of (q,)."""
    g, log_g1, free, log_weight = over
    share, fall = room
    for m in range(len(size)):
        u, peak = unexplained[m], -np.inf
        if m == 0 or u != unexplained[m - 1]:
            for q in range(len(g)):
                fall[q] = 0.5 * dof * np.log1p(g[q] * u)
        for q in range(len(g)):
            share[q] = 0.5 * (dof - size[m]) * log_g1[q] - fall[q] + log_weight[q]
            if share[q] > peak:
                peak = share[q]
        total = rest = 0.0
        for q in range(len(g)):
            if share[q] < peak - DEEP:
                share[q] = 0.0
                continue
            share[q] = np.exp(share[q] - peak)
            s, r = g[q] * free[q], (1.0 + g[q] * u) * free[q]
            total += share[q]
            rest += share[q] * free[q]
            out[m, 1] += share[q] * s
            out[m, 3] += share[q] * s * r
            out[m, 4] += share[q] * r
        out[m, 0] = peak + np.log(total)
        for k in range(1, 5):
            out[m, k] /= total
        for q in range(len(g)):  # of 1 - s about its mean: under strong signals s is 1 to all digits
            if share[q] > 0.0:
                out[m, 2] += share[q] / total * (free[q] - rest / total) ** 2
