"""Minimum of a smooth cost of a few logarithms, and its curvature there."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from imubayes.algebra import FloatArray

STEP = 1e-4
"""Step in a logarithm of the differences of slopes."""

MOST = 200
"""Steps that are tried; a minimum is some five away."""

CLOSE = 1e-12
"""Fall that a step promises below which it is not taken: it is 1e-6 of an error bar long."""

ENOUGH = 1e-4
"""Share of the promised fall that a step has to keep."""

ROUNDED = 1e-12
"""Share of a cost to which it is known."""

SHORTER = 0.25
"""What is left of a step that fell by less."""

TOUCHED = 1e-9
"""What is as near to an end is at it."""

Cost = Callable[[FloatArray], tuple[float, FloatArray]]
"""Gives cost and slope (k,) of some logarithms (k,)."""

Ends = tuple[FloatArray, FloatArray]
"""Least and largest logarithms (k,)."""

EVERYWHERE: Ends = (np.array(-np.inf), np.array(np.inf))
"""No ends."""


class Reached(NamedTuple):
    """Logarithms (k,), and cost and slope (k,) there."""

    x: FloatArray
    level: float
    slope: FloatArray


def minimum(
    cost: Cost, start: FloatArray, width: FloatArray, ends: Ends, near: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Minimum (k,) between two `ends` (k,), and the covariance (k, k) of the curvature there.

    From several starts (s, k) it is the lowest that is found. Along no direction is the covariance wider than
    `width` (k,), the prior's sds. `near` (k, k) is about what it will be, where that is known.

    Examples
    --------
    >>> def cost(x):
    ...     return float(np.cosh(x[0] - 1.0) + x[1] ** 2), np.array([np.sinh(x[0] - 1.0), 2.0 * x[1]])
    >>> wide = np.full(2, 9.0)
    >>> best, covariance = minimum(cost, np.array([3.0, -2.0]), wide, (-wide, wide))
    >>> (best.round(4) + 0.0).tolist(), covariance.round(3).tolist()
    ([1.0, 0.0], [[1.0, 0.0], [0.0, 0.5]])
    """
    reached = lowest(cost, start, width, ends, near)
    return reached.x, np.asarray(np.linalg.inv(_curvature(cost, reached, width)), dtype=float)


def lowest(
    cost: Cost, start: FloatArray, width: FloatArray, ends: Ends, near: FloatArray | None = None
) -> Reached:
    """Find the `minimum` alone, of which nobody asks how wide it is."""

    def reached(x: FloatArray) -> Reached:
        begun = Reached(x, *cost(x))
        H = _curvature(cost, begun, width) if near is None else np.asarray(np.linalg.inv(near), dtype=float)
        return descended(cost, begun, H, ends)

    return min(map(reached, np.clip(np.atleast_2d(start), *ends)), key=lambda one: one.level)


def _curvature(cost: Cost, at: Reached, width: FloatArray) -> FloatArray:
    """Curvature (k, k) where a search is: positive definite, along no direction wider than `width` (k,)."""
    H = np.array([cost(at.x + step)[1] - at.slope for step in STEP * np.eye(len(at.x))]) / STEP
    # in prior sds a curvature below 1 would say less than the prior alone
    values, vectors = np.linalg.eigh(0.5 * (H + H.T) * np.outer(width, width))
    wide = vectors / width[:, None]
    return np.asarray((wide * np.maximum(np.abs(values), 1.0)) @ wide.T, dtype=float)


def descended(cost: Cost, begun: Reached, H: FloatArray, ends: Ends, close: float = CLOSE) -> Reached:
    """Minimum between two `ends` (k,) to a fall of `close`.

    It is Newton's method; the curvature H (k, k) where it is begun, positive definite, is put right by the
    slopes that are met (BFGS; Nocedal and Wright, 2006, section 6.1).
    """
    x, level, slope = begun
    step = _step(x, slope, H, ends)
    for _ in range(MOST):
        rounding, promised = ROUNDED * abs(level), -float(slope @ step)
        if promised < max(close, rounding):
            break
        there = np.clip(x + step, *ends)
        with np.errstate(over="ignore", invalid="ignore"):  # a step too far is taken back
            found, turned = cost(there)
        if not found <= level - ENOUGH * promised + rounding:
            step *= SHORTER
            continue
        straight, bent = H @ step, turned - slope
        if bent @ step > 0.0:
            H = H + np.outer(bent, bent) / (bent @ step) - np.outer(straight, straight) / (straight @ step)
        x, level, slope = there, found, turned
        step = _step(x, slope, H, ends)
    return Reached(x, level, slope)


def _step(x: FloatArray, slope: FloatArray, H: FloatArray, ends: Ends) -> FloatArray:
    """Step to the minimum of a parabola, as far as the first end; what is at an end stays, or leaves it."""
    low, high = ends
    free, step = np.ones(len(x), dtype=bool), np.zeros_like(x)
    while True:
        step[:] = 0.0
        step[free] = -np.linalg.solve(H[np.ix_(free, free)], slope[free])
        out = (x - low < TOUCHED) & (step < 0.0) | (high - x < TOUCHED) & (step > 0.0)
        if not out.any():
            break
        free &= ~out
    room = np.where(step > 0.0, high - x, x - low)
    moved = step != 0.0
    return step * min(1.0, float(np.min(room[moved] / np.abs(step[moved]), initial=1.0)))
