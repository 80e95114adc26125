"""Every model's evidence under a prior of the g-family, the noise scale integrated analytically.

Of the data a model's Bayes factor takes its share u of unexplained squares and its size, so that with a prior
on g one curve by size, over ln u, serves all models. With many rows all of it happens near u = 1: the curves
are followed in steps of ``ln(1 - dof ln u)``.
"""

from __future__ import annotations

import math
from itertools import product

import numpy as np
from numpy.typing import NDArray

from imubayes.inference.prior import GFamily, g_step_error
from imubayes.selection.masks import BLOCK_BITS, sizes
from imubayes.selection.mixture import Candidates
from imubayes.selection.model_prior import Needs
from imubayes.selection.threads import pieces
from imubayes.trust import HALF_UNIT

FloatArray = NDArray[np.float64]

CURVES = 13
"""Candidates from which on the integrals over g are read off curves: cheaper than one by one."""

POINTS = 2**11
"""Of a curve: its cubics are off by 1e-9 at most."""

BETWEEN = 97
"""Places between the points of a curve at which its error is taken."""

ROUNDINGS = 4.0
"""Of a logarithm of a Bayes factor, in units of half a unit of ``dof ln(1 + g)``."""

LEAST_POWER = 0.5
"""Power of g that the integrand of a model with a candidate falls with at least, at both ends of ln g."""

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
) -> tuple[float, float]:
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
    the largest, and a bound on what curves add to the error of each.
    """
    from imubayes.selection.passes import log_factors

    p, total, dof = len(c.names), float(rss[0]), float(c.dof)
    bits, links = min(BLOCK_BITS, p), np.array(needs, dtype=np.int64).reshape(-1, 2)
    if p < CURVES and len(nodes[0]) > 1:
        return _one_by_one(rss, c, nodes, by_size, links), 0.0
    off = 0.0
    if len(nodes[0]) == 1:
        at, table = (float(nodes[0][0]), float(nodes[1][0])), np.empty((p + 1, 0, 4))
    else:
        at, table, off = _curves(float(rss[-1]) / total, p, dof, nodes)
    ones = sizes(bits)
    highest = max(
        pieces(lambda k: log_factors(rss, k, ones, total, dof, at, table, links, by_size), 1 << (p - bits))
    )
    return highest, off


def integration_error(
    prior: GFamily, nodes: tuple[FloatArray, FloatArray], least: float, columns: int, dof: float
) -> float:
    """Bound on the error of every log Bayes factor: of the steps of g, of where it ends, and of rounding.

    Parameters
    ----------
    prior, nodes : on g, and its nodes with the logarithms of their weights.
    least : smallest share of unexplained squares, that of all candidates.
    columns, dof : candidates, and rows minus forced columns.
    """
    g, log_weight = nodes
    usual = min(float(g.max()), dof / least if least > 0.0 else math.inf)
    rounding = ROUNDINGS * HALF_UNIT * dof * math.log1p(usual)
    if len(g) == 1 or not columns:
        return rounding
    step = math.log(g[1] / g[0])
    ends = 0.0
    for size, u in product((1, columns), (least, 1.0)):
        terms = 0.5 * (dof - size) * np.log1p(g) - 0.5 * dof * np.log1p(g * u) + log_weight
        weights = np.exp(terms - terms.max())
        ends = max(ends, float((weights[0] + weights[-1]) / weights.sum()) / (step * LEAST_POWER))
    return rounding + g_step_error(prior, columns) + ends


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
    found = g_integrals(u, count, float(c.dof), *nodes)[:, 0]
    rss[:] = np.where(count > 0, found, 0.0) + by_size[count]
    mask = np.arange(len(rss))
    for child, parent in links:
        rss[(mask >> child & 1) > (mask >> parent & 1)] = -math.inf
    return float(rss.max())


def _curves(
    least: float, p: int, dof: float, nodes: tuple[FloatArray, FloatArray]
) -> tuple[tuple[float, float], FloatArray, float]:
    """Cubics of the log Bayes factor plus ``dof/2 ln u`` by size, the least ln u and their step, their error.

    The variable is ``t = ln(1 - dof ln u)``.
    """
    from scipy.interpolate import CubicSpline

    from imubayes.selection.moments import g_integrals

    def curve(t: FloatArray, size: int) -> FloatArray:
        log_u = -np.expm1(t) / dof
        found = g_integrals(np.exp(log_u), np.full(len(t), size), dof, *nodes)[:, 0] if size else 0.0
        return found + 0.5 * dof * log_u

    start = math.log(max(least, FLAT / float(nodes[0].max())) * (1.0 - 1e-9))
    t, step = np.linspace(0.0, math.log1p(-dof * start), POINTS, retstep=True)
    spline = CubicSpline(t, np.array([curve(t, size) for size in range(p + 1)]), axis=1)
    between = t[:: POINTS // BETWEEN][:-1] + 0.5 * step
    off = max(float(np.abs(spline(between)[size] - curve(between, size)).max()) for size in (0, 1, p))
    cubics = spline.c * (step ** np.arange(3, -1, -1))[:, None, None]
    return (start, float(step)), np.ascontiguousarray(np.moveaxis(cubics, (0, 2), (2, 0))), off
