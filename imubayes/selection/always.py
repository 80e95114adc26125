"""Posterior of the columns that are in every model, given what the mixture says of the candidates.

The columns that are always in come first in the factor and are integrated out before the candidates are
looked at. Given the candidates' coefficients they are ``u - B theta`` with ``u = T_aa^-1 z_a`` and
``B = T_aa^-1 T_ap``, and noise of covariance ``sigma^2 (T_aa' T_aa)^-1``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import solve_triangular
from imubayes.selection.mixture import Candidates, Components
from imubayes.selection.moments import submodel


def always_moments(c: Candidates, parts: Components) -> tuple[FloatArray, FloatArray]:
    """Mean and sd (a,) of the columns that are always in, averaged over the components.

    Parameters
    ----------
    c : the candidates, under physical priors.
    parts : the mixture of their coefficients.
    """
    a = len(c.always)
    back = np.broadcast_to(c.unit, len(c.whole))[:-1] - c.response_unit
    theta = np.ldexp(parts.mean[:, a:], back[a:])
    middle = parts.weight @ theta
    scales, which = np.unique(parts.scale, return_inverse=True)
    nodes = [_node(c, math.ldexp(float(scale), -c.response_unit)) for scale in scales]
    shares = np.bincount(which, parts.weight)
    levels = np.array([node.u - node.B @ middle for node in nodes])
    moved = [(parts.weight * (which == q)) @ (theta - middle) for q in range(len(nodes))]
    steps = np.array([node.B @ step for node, step in zip(nodes, moved, strict=True)])
    mean = shares @ levels - steps.sum(axis=0)
    variance = np.zeros(a)
    for q, node in enumerate(nodes):
        mine, off = which == q, levels[q] - mean
        variance += shares[q] * (off**2 + node.alone) - 2.0 * off * steps[q]
        variance += _around(node, theta[mine] - middle, parts.weight[mine], parts.inside[mine])
    given = c.given(np.pad((mean, np.sqrt(variance)), ((0, 0), (0, len(c.names)))))[:, :a]
    return given[0], given[1]


@dataclass(frozen=True, slots=True, eq=False)
class _Node:
    """What holds at one noise scale: u (a,), B (a, p), variance given the candidates (a,), their factor S."""

    scale: float
    u: FloatArray
    B: FloatArray
    alone: FloatArray
    S: FloatArray


def _node(c: Candidates, scale: float) -> _Node:
    a, p, T = len(c.always), len(c.names), c.at(scale)
    solved = solve_triangular(T[:a, :a], np.column_stack((T[:a, a:], np.eye(a))))
    alone = scale**2 * np.sum(solved[:, p + 1 :] ** 2, axis=1)
    return _Node(scale, solved[:, p], solved[:, :p], alone, np.ascontiguousarray(T[a:, a:]))


def _around(node: _Node, off: FloatArray, weight: FloatArray, inside: NDArray[np.bool_]) -> FloatArray:
    """Weighted second moment (a,) of ``B theta`` about a centre that the means (m, p) are `off` from."""
    second = (off * weight[:, None]).T @ off + node.scale**2 * _covariance(node.S, inside, weight)
    return np.sum((node.B @ second) * node.B, axis=1)


@njit(cache=True, nogil=True, error_model="numpy")
def _covariance(R, inside, weight):
    """Weighted sum (p, p) of ``(T'T)^-1`` over submodels (m, p), zero where a column is out."""
    p = R.shape[0] - 1
    total = np.zeros((p, p))
    for m in range(len(inside)):
        T, columns = submodel(R, inside[m])
        k = len(columns)
        inverse = np.zeros((k, k))
        for c in range(k):
            inverse[c, c] = 1.0 / T[c, c]
            for r in range(c - 1, -1, -1):
                inverse[r, c] = -np.sum(T[r, r + 1 : c + 1] * inverse[r + 1 : c + 1, c]) / T[r, r]
        for r in range(k):
            for s in range(k):
                shared = np.sum(inverse[r, max(r, s) :] * inverse[s, max(r, s) :])
                total[columns[r], columns[s]] += weight[m] * shared
    return total
