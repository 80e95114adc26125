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


def powers_ready() -> None:
    """Load exponentials, or compile them before a process beside this one needs them."""
    exponentials(np.zeros(1), 1.0, 0.0, np.zeros(1, dtype=np.int64), np.zeros(1))


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
    """Triangular factor of the columns that are `inside` (p,), positive on its diagonal.

    Returns ``(T, columns)``: T is (k, k + 1), upper triangular with z in its last column, and `columns` holds
    the k column numbers.
    """
    T, columns = room = places(len(R))
    first, _ = reduce(R, inside, room)
    return np.triu(T[first:-1, first:]), columns[first:-1]


def places(n: int) -> tuple[FloatArray, IntArray]:
    """Room for a submodel of a factor (n, n): its own and a row to work in, the numbers of its columns."""
    return np.empty((n, n)), np.empty(n, dtype=np.int64)


@compiled
def reduce(R, inside, room):
    """Write a `submodel`, T and columns, to the ends of their `places`.

    From the last column up: one inside puts its row on top, the row of another is rotated into those below.
    Returns where it starts, and what leaving columns out adds to the residual sum of squares: on its own, for
    beside that of long records it is small.
    """
    T, columns = room
    p = len(R) - 1
    first, added, columns[p] = p, 0.0, p
    for d in range(p - 1, -1, -1):
        row = p
        if inside[d]:
            row = first = first - 1
            columns[row] = d
        for k in range(first, p + 1):
            T[row, k] = R[d, columns[k]] if R[d, d] >= 0.0 else -R[d, columns[k]]
        if inside[d]:
            continue
        for i in range(first, p):
            a, b = T[row, i], T[i, i]
            norm = math.sqrt(a * a + b * b)
            c, s = (b / norm, a / norm) if norm > 0.0 else (1.0, 0.0)
            for k in range(i, p + 1):
                u, v = T[row, k], T[i, k]
                T[i, k], T[row, k] = c * v + s * u, c * u - s * v
        added += T[row, p] * T[row, p]
    return first, added


@compiled
def invert(A, first, last, W):
    """Write the inverse of columns `first` to `last` of a triangular A to the upper triangle of W."""
    for j in range(first, last):
        W[j, j] = 1.0 / A[j, j]
        for i in range(j - 1, first - 1, -1):
            total = 0.0
            for k in range(i + 1, j + 1):
                total += A[i, k] * W[k, j]
            W[i, j] = -total / A[i, i]


def solutions(R: FloatArray, inside: BoolArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Least-squares coefficients and unscaled variances of submodels (m, p); zero where a column is out.

    Returns ``(mean, variance, rss, log_det)``: arrays (m, p) of ``T^-1 z`` and the diagonal of ``(T'T)^-1``,
    and (m,) of the residual sum of squares and of ``ln |T|``.
    """
    mean, variance, rss, log_det, _ = _solved(R, inside, np.zeros(len(inside)))
    return mean, variance, rss, log_det


def covariance(R: FloatArray, inside: BoolArray, weight: FloatArray) -> FloatArray:
    """Weighted sum (p, p) of ``(T'T)^-1`` over submodels (m, p), zero where a column is out."""
    return _solved(R, inside, weight)[4]


def _solved(
    R: FloatArray, inside: BoolArray, weight: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """The `solutions` and the `covariance` of submodels."""
    m, p = inside.shape
    mean, variance = np.zeros((2, m, p))
    rss, log_det = np.zeros((2, m))
    found = mean, variance, rss, log_det, np.zeros((p, p))
    _solve(R, inside, weight, places(len(R)), np.empty((p, p)), found)
    return found


@compiled
def _solve(R, inside, weight, room, inverse, found):
    """Fill what is `_solved`; `room` is `places`, `inverse` (p, p)."""
    T, columns = room
    mean, variance, rss, log_det, total = found
    p = len(R) - 1
    for m in range(len(inside)):
        first, added = reduce(R, inside[m], room)
        rss[m] = R[p, p] * R[p, p] + added
        invert(T, first, p, inverse)
        for r in range(first, p):
            log_det[m] += np.log(T[r, r])
            for c in range(r, p):
                mean[m, columns[r]] += inverse[r, c] * T[c, p]
                variance[m, columns[r]] += inverse[r, c] * inverse[r, c]
            for s in range(first, p if weight[m] else first):
                shared = 0.0
                for c in range(r if r > s else s, p):
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
                off = free[q] - rest / total
                out[m, 2] += share[q] / total * (off * off)
