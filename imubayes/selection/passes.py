"""Passes over the weights of all 2^p models, compiled."""

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
    """Put in place of a block of residual sums of squares the log joint probabilities under the g-family.

    Parameters
    ----------
    rss : (2^p,), overwritten.
    number, sizes : the block, and the ones in the numbers of its models (2^bits,).
    total : residual sum of squares without any candidate.
    dof : rows minus forced columns.
    nodes : least ln u and step of the table, or ``(g, log weight)`` of a single g where it is empty.
    table : (p + 1, points - 1, 4) cubics in ``ln(1 - dof ln u)`` by size, of the log Bayes factor plus
        ``dof/2 ln u``.
    links : (l, 2) children and parents; a model with a child without its parent gets -inf.
    by_size : (p + 1,) what is added by size.

    Returns
    -------
    the largest.
    """
    highest, single, start, above = -np.inf, table.shape[1] == 0, number * len(sizes), ones(number)
    log_g = np.log1p(nodes[0])
    for i in range(len(sizes)):
        mask, k = start + i, sizes[i] + above
        u = min(max(rss[mask] / total, 0.0), 1.0)
        if single:
            value = 0.5 * (dof - k) * log_g - 0.5 * dof * np.log1p(nodes[0] * u) + nodes[1]
        else:
            log_u = max(np.log(u), nodes[0])
            value = cubic(table[k], np.log1p(-dof * log_u) / nodes[1]) - 0.5 * dof * log_u
        for n in range(len(links)):
            if (mask >> links[n, 0]) & 1 > (mask >> links[n, 1]) & 1:
                value = -np.inf
        rss[mask] = value + by_size[k]
        highest = max(highest, rss[mask])
    return highest


@njit(cache=True, nogil=True, inline="always", error_model="numpy")
def cubic(pieces, x):
    """Value at x >= 0 of a piecewise cubic with nodes 0, 1, ...."""
    i = min(int(x), len(pieces) - 1)
    r = x - i
    return ((pieces[i, 0] * r + pieces[i, 1]) * r + pieces[i, 2]) * r + pieces[i, 3]


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
