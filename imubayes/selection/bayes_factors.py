"""Every model's evidence under a prior of the g-family, the noise scale integrated analytically.

Of the data a model's Bayes factor takes its share u of unexplained squares and its size, so that with a prior
on g one curve by size, over ln u, serves all models.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imubayes.selection.masks import BLOCK_BITS, sizes
from imubayes.selection.mixture import Candidates
from imubayes.selection.model_prior import Needs
from imubayes.selection.threads import pieces

FloatArray = NDArray[np.float64]

CURVES = 13
"""Candidates from which on the integrals over g are read off curves: cheaper than one by one."""

POINTS = 2**12
"""Of a curve: with a step h of ln u its cubics are off by h^4/384 times the degrees of freedom at most."""

FLAT = 1e-12
"""Of g u: below, u no longer changes the Bayes factor."""


def rss_of_all(c: Candidates) -> FloatArray:
    """Residual sum of squares of every model, by mask."""
    from imubayes.selection import abreast
    from imubayes.selection.tree import walk

    a, p = len(c.always), len(c.names)
    R = np.ascontiguousarray(c.whole[a:, a:])
    return abreast.residuals(abreast.ready(R, np.ones(p))[0]) if p >= abreast.FEWEST else walk(R)[0]


def log_bayes_factors(
    rss: FloatArray, c: Candidates, nodes: tuple[FloatArray, FloatArray], by_size: FloatArray, needs: Needs
) -> float:
    """Put the log joint probability of every model, up to the null's evidence, in the place of its rss.

    Parameters
    ----------
    rss : (2^p,) by mask; overwritten.
    c : the candidates.
    nodes : (q,) of g, and the logarithms of their weights.
    by_size : (p + 1,) log prior probability of one model of each size.
    needs : (child, parent): models with a child without its parent get -inf.

    Returns
    -------
    the largest.
    """
    from imubayes.selection.passes import log_factors

    p, total, dof = len(c.names), float(rss[0]), float(c.dof)
    bits, links = min(BLOCK_BITS, p), np.array(needs, dtype=np.int64).reshape(-1, 2)
    if p < CURVES and len(nodes[0]) > 1:
        return _one_by_one(rss, c, nodes, by_size, links)
    if len(nodes[0]) == 1:
        at, table = (float(nodes[0][0]), float(nodes[1][0])), np.empty((p + 1, 0, 4))
    else:
        at, table = _curves(float(rss[-1]) / total, p, dof, nodes)
    ones = sizes(bits)
    return max(
        pieces(lambda k: log_factors(rss, k, ones, total, dof, at, table, links, by_size), 1 << (p - bits))
    )


def weights_of(logs: FloatArray, p: int, peak: float) -> FloatArray:
    """Put ``exp(logs - peak)`` in the place of logarithms (2^p,)."""
    from imubayes.selection.passes import exponentials

    bits = min(BLOCK_BITS, p)
    pieces(lambda k: exponentials(logs, k, bits, peak), 1 << (p - bits))
    return logs


def _one_by_one(
    rss: FloatArray, c: Candidates, nodes: tuple[FloatArray, FloatArray], by_size: FloatArray, links: NDArray
) -> float:
    """Integrate over g for each model."""
    from imubayes.selection.moments import g_integrals

    count = sizes(len(c.names))
    u = np.clip(rss / rss[0], 0.0, 1.0)
    rss[:] = g_integrals(u, count, float(c.dof), *nodes)[:, 0] + by_size[count]
    mask = np.arange(len(rss))
    for child, parent in links:
        rss[(mask >> child & 1) > (mask >> parent & 1)] = -math.inf
    return float(rss.max())


def _curves(
    least: float, p: int, dof: float, nodes: tuple[FloatArray, FloatArray]
) -> tuple[tuple[float, float], FloatArray]:
    """Cubics in ln u of the log Bayes factor, by size, and where they begin and their step."""
    from scipy.interpolate import CubicSpline

    from imubayes.selection.moments import g_integrals

    start = math.log(max(least, FLAT / float(nodes[0].max())) * (1.0 - 1e-9))
    x, step = np.linspace(start, 0.0, POINTS, retstep=True)
    curves = [g_integrals(np.exp(x), np.full(POINTS, size), dof, *nodes)[:, 0] for size in range(p + 1)]
    cubics = CubicSpline(np.arange(POINTS), np.array(curves), axis=1).c
    return (start, float(step)), np.ascontiguousarray(np.moveaxis(cubics, (0, 2), (2, 0)))
