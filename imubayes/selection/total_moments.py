"""Moments of the coefficients over every submodel, under a prior of the g-family.

By the law of total variance, up the tree that `lanes` goes down. What a subtree hands up is its
weight, and mean and scatter of ``x = s (b, 1)``: the shrinkage ``s = g/(1 + g)``, uncertain itself, and with
it the least squares b of the columns that the subtree decides. A column that is included has the coefficient
``x_d = (z_d s - sum_k t_dk x_k) / t_dd`` by its row of the triangular factor, and one that is excluded has 0,
both linear in x. Where the two meet, the scatter between their means joins that within. Nothing cancels.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import invert_triangular
from imubayes.selection.evidence import Curves
from imubayes.selection.kernels import cubic, ones
from imubayes.selection.lanes import LANE_BITS, decide, prefix, ready, shape_of, started
from imubayes.selection.mixture import Candidates
from imubayes.selection.model_sets import pieces


def total_moments(c: Candidates, curves: Curves, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean and sd of every column (a + p,), averaged over all models.

    Parameters
    ----------
    c : the candidates, at least `lanes.FEWEST`; the columns that are always in are flat.
    curves : the shrinkage by size and share of unexplained squares.
    weight : (2^p,) posterior probability of each model, up to a factor.
    """
    a, p = len(c.always), len(c.names)
    R, unit = ready(np.ascontiguousarray(c.whole[a:, a:]), np.ones(p))
    kernel, given = shape_of(p), (float(c.dof), float(np.sum(c.whole[a:, -1] ** 2)))
    found = pieces(
        lambda k: _subtrees(R, k, kernel, weight, given, curves.at, curves.shrinkage), 1 << kernel[0]
    )
    share, mean, scatter, forced = (np.concatenate(parts) for parts in zip(*found, strict=True))
    whole = share.sum()
    middle = share @ mean / whole
    off = mean - middle
    spread = (scatter.sum(axis=0) + (share[:, None] * off).T @ off) / whole
    theta, covariance = (unit * middle[:p])[::-1], (unit[:, None] * spread[:p, :p] * unit)[::-1, ::-1]
    inverse = invert_triangular(c.whole[:a, :a])
    moved = inverse @ c.whole[:a, a:-1]
    alone = forced.sum() / whole * np.sum(inverse**2, axis=1)
    first = np.concatenate((inverse @ c.whole[:a, -1] - moved @ theta, theta))
    second = np.concatenate((alone + np.sum((moved @ covariance) * moved, axis=1), np.diag(covariance)))
    return c.given(first), c.given(np.sqrt(second))


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _subtrees(R, piece, kernel, weight, given, at, table):
    """Sums over the subtrees of one piece, a lane each, handed up to all columns.

    `given` are the degrees of freedom, and the squares of the response that the forced columns leave.

    Returns
    -------
    weight (lanes,), mean (lanes, p + 1) and scatter (lanes, p + 1, p + 1) of x, and the sum (lanes,) of the
    weights times the variance of the noise.
    """
    piece_bits, _, p = kernel
    lanes, top = 1 << LANE_BITS, LANE_BITS + piece_bits
    m, (dof, total) = p - top, given
    state, width, variance = started(R, np.ones(p), piece, kernel, 1.0), np.ones(m), total / (dof - 2.0)
    sums, mean = np.zeros((m + 1, 2, lanes)), np.zeros((m + 1, m + 1, lanes))
    scatter, noise = np.zeros((m + 1, m + 1, m + 1, lanes)), np.zeros(lanes)
    room = np.zeros((5, m + 1, lanes))
    for mask in range((1 << m) - 1, -1, -1):
        decide(state, width, mask, 0, m)
        for lane in range(lanes):
            number = (((lane << piece_bits) | piece) << m) | mask
            u, w = min(state[3][m, lane] / total, 1.0), weight[number]
            s, wide, shrunk, left = _shrinkage(u, ones(number), dof, at, table)
            sums[0, 0, lane], sums[0, 1, lane] = w, w * variance * shrunk
            mean[0, m, lane], scatter[0, m, m, lane] = s, w * wide
            noise[lane] += w * variance * left
        d = m
        while d > 0 and (mask >> (m - d)) & 1 == 0:
            d -= 1
            _join(sums, mean, scatter, state, d, room)
        if d > 0:
            sums[d], mean[d, d:], scatter[d, d:, d:] = sums[0], mean[0, d:], scatter[0, d:, d:]
    out, around = np.zeros((lanes, p + 1)), np.zeros((lanes, p + 1, p + 1))
    for lane in range(lanes):
        out[lane, top:] = mean[0, :, lane]
        for j in range(m + 1):
            for k in range(j, m + 1):
                around[lane, top + j, top + k] = around[lane, top + k, top + j] = scatter[0, j, k, lane]
        _hand_up(R, (lane << piece_bits) | piece, top, sums[0, 1, lane], out[lane], around[lane])
    return sums[0, 0].copy(), out, around, noise


@njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _shrinkage(u, size, dof, at, table):
    """Posterior mean of s in one model, its variance, and the means of s r and r = (1 + g u)/(1 + g)."""
    if table.shape[1] == 0:
        s, r = at[0] / (1.0 + at[0]), (1.0 + at[0] * u) / (1.0 + at[0])
        return s, 0.0, s * r, r
    log_u = max(math.log(u), at[0])
    x, near, pieces_of = math.log1p(-dof * log_u) / at[1], math.exp(log_u), table[size]
    return (
        cubic(pieces_of[:, 0], x),
        near * near * cubic(pieces_of[:, 1], x),
        near * cubic(pieces_of[:, 2], x),
        near * cubic(pieces_of[:, 3], x),
    )


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, inline="always")
def _join(sums, mean, scatter, state, d, room):
    """Add to the models without column d, the last that were summed, those with it, which are at d + 1.

    Of the scatter only the upper triangle is kept.
    """
    blocks, inverse, source, m = state[0], state[1], state[2][d], mean.shape[1] - 1
    row, along, apart, share, both = room
    for lane in range(mean.shape[2]):
        out, within = sums[0, 0, lane], sums[d + 1, 0, lane]
        each = inverse[source, d, lane]
        share[0, lane] = within / (out + within) if within > 0.0 else 0.0
        both[0, lane] = out * share[0, lane]
        sums[0, 0, lane] += within
        scatter[0, d, d, lane] = sums[d + 1, 1, lane] * each * each
        sums[0, 1, lane] += sums[d + 1, 1, lane]
        mean[0, d, lane] = apart[d, lane] = 0.0
    for k in range(d + 1, m + 1):
        sign = 1.0 if k == m else -1.0
        for lane in range(mean.shape[2]):
            row[k, lane] = sign * blocks[source, d, k, lane] * inverse[source, d, lane]
            along[k, lane] = 0.0
            apart[d, lane] += row[k, lane] * mean[d + 1, k, lane]
            apart[k, lane] = mean[d + 1, k, lane] - mean[0, k, lane]
    for j in range(d + 1, m + 1):
        for k in range(j, m + 1):
            for lane in range(mean.shape[2]):
                inside = scatter[d + 1, j, k, lane]
                along[j, lane] += inside * row[k, lane]
                if k > j:
                    along[k, lane] += inside * row[j, lane]
                scatter[0, j, k, lane] += inside + both[0, lane] * apart[j, lane] * apart[k, lane]
    for k in range(d, m + 1):
        for lane in range(mean.shape[2]):
            mean[0, k, lane] += share[0, lane] * apart[k, lane]
            if k > d:
                scatter[0, d, d, lane] += row[k, lane] * along[k, lane]
                scatter[0, d, k, lane] = along[k, lane]
            scatter[0, d, k, lane] += both[0, lane] * apart[d, lane] * apart[k, lane]


@njit(cache=True, nogil=True, error_model="numpy")
def _hand_up(R, mask, top, noise, mean, scatter):
    """Fill in the first `top` columns of mean (p + 1,) and scatter (p + 1, p + 1), decided by a mask."""
    p = R.shape[0] - 1
    A = prefix(R, np.ones(p), mask, top)[0]
    for d in range(top - 1, -1, -1):
        if (mask >> (top - 1 - d)) & 1:
            row = -A[d] / A[d, d]
            row[: d + 1], row[p] = 0.0, -row[p]
            along = scatter @ row
            scatter[d], scatter[:, d], mean[d] = along, along, row @ mean
            scatter[d, d] = row @ along + noise / A[d, d] ** 2
