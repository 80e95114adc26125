"""Minimum of a smooth cost of a few logarithms, and its curvature there.

Steps are of Newton, with a curvature by differences of the slope that secants keep up to date (BFGS). The
last one is by a curvature that was taken where it begins.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from imubayes.algebra import FloatArray

STEP = 1e-4
"""Step in a logarithm of the differences of gradients."""

FARTHEST = 1.0
"""Largest change of a logarithm in one step."""

CLOSE = 2e-4
"""Error bars from the minimum at which the last step is taken."""

FALL = 1e-4
"""Share of the fall along the slope that a step must bring."""

STEPS, HALVINGS = 200, 50
"""Most steps, and most halvings of one."""

Cost = Callable[[FloatArray], tuple[float, FloatArray]]
"""Gives cost and slope (k,) of some logarithms (k,)."""


def minimum(
    cost: Cost,
    start: FloatArray,
    width: FloatArray,
    ends: tuple[FloatArray, FloatArray],
    near: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Minimum (k,) between two `ends` (k,), and the covariance (k, k) of the curvature there.

    Along no direction is the covariance wider than `width` (k,), the prior's sds. `near` (k, k) is about what
    it will be, where that is known.

    Examples
    --------
    >>> def cost(x):
    ...     return float(np.cosh(x[0] - 1.0) + x[1] ** 2), np.array([np.sinh(x[0] - 1.0), 2.0 * x[1]])
    >>> wide = np.full(2, 9.0)
    >>> best, covariance = minimum(cost, np.array([3.0, -2.0]), wide, (-wide, wide))
    >>> (best + 0.0).round(6).tolist(), covariance.round(3).tolist()
    ([1.0, 0.0], [[1.0, 0.0], [0.0, 0.5]])
    """
    x = np.clip(start, *ends)
    level, slope = cost(x)
    H, anew = (_curvature(cost, x, slope, width), True) if near is None else (_inverse(near), False)
    step, close = np.zeros_like(x), True
    for _ in range(STEPS):
        step = _step(x, slope, H, ends)
        close = -float(slope @ step) < CLOSE**2
        found = None if close else _fallen(cost, x, (level, slope), step, ends)
        if found is None and anew:
            break
        if found is None:
            H, anew = _curvature(cost, x, slope, width), True
            continue
        to, level, slope_there = found
        H, anew = _secant(H, to - x, slope_there - slope), False
        x, slope = to, slope_there
    return np.clip(x + close * step, *ends), _inverse(H)


def _fallen(
    cost: Cost,
    x: FloatArray,
    here: tuple[float, FloatArray],
    step: FloatArray,
    ends: tuple[FloatArray, FloatArray],
) -> tuple[FloatArray, float, FloatArray] | None:
    """Where a step (k,), or a part of it, leads down, with cost and slope; None if only rounding is left."""
    level, slope = here
    step = step * min(1.0, FARTHEST / float(np.max(np.abs(step))))
    for _ in range(HALVINGS):
        to = np.clip(x + step, *ends)
        there, slope_there = cost(to)
        if there <= level + FALL * float(slope @ (to - x)):
            return to, there, slope_there
        step = 0.5 * step
    return None


def _step(x: FloatArray, slope: FloatArray, H: FloatArray, ends: tuple[FloatArray, FloatArray]) -> FloatArray:
    """Newton's step (k,) among the logarithms that do not press against their ends."""
    free = ~((x <= ends[0]) & (slope > 0.0) | (x >= ends[1]) & (slope < 0.0))
    step = np.zeros_like(x)
    step[free] = -np.linalg.solve(H[np.ix_(free, free)], slope[free])
    return step


def _secant(H: FloatArray, moved: FloatArray, turned: FloatArray) -> FloatArray:
    """Curvature that explains how a move (k,) turned the slope; as it was where the cost bends down."""
    curved, was = float(moved @ turned), H @ moved
    if not curved > 0.0:
        return H
    return H + np.outer(turned, turned) / curved - np.outer(was, was) / float(moved @ was)


def _curvature(cost: Cost, x: FloatArray, slope: FloatArray, width: FloatArray) -> FloatArray:
    H = np.array([(cost(x + step)[1] - slope) / STEP for step in STEP * np.eye(len(x))])
    # in prior sds a curvature below 1 would say less than the prior alone
    values, vectors = np.linalg.eigh(0.5 * (H + H.T) * np.outer(width, width))
    scaled = vectors / width[:, None]
    return (scaled * np.maximum(np.abs(values), 1.0)) @ scaled.T


def _inverse(A: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.inv(A), dtype=np.float64)
