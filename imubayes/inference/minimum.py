"""Minimum of a smooth cost of a few logarithms, and its curvature there."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from imubayes.algebra import FloatArray

STEP = 1e-4
"""Step in a logarithm of the differences of gradients."""

SHARPEST = {"maxiter": 200, "ftol": 1e-14, "gtol": 1e-4}
"""Where a search ends: the gradient by error bars is then below a ten thousandth."""

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

    It is sought in units of about the error bars. Along no direction is the covariance wider than `width`
    (k,), the prior's sds. `near` (k, k) is about what it will be, where that is known.

    Examples
    --------
    >>> def cost(x):
    ...     return float(np.cosh(x[0] - 1.0) + x[1] ** 2), np.array([np.sinh(x[0] - 1.0), 2.0 * x[1]])
    >>> wide = np.full(2, 9.0)
    >>> best, covariance = minimum(cost, np.array([3.0, -2.0]), wide, (-wide, wide))
    >>> (best + 0.0).round(4).tolist(), covariance.round(3).tolist()
    ([1.0, 0.0], [[1.0, 0.0], [0.0, 0.5]])
    """
    from scipy.optimize import minimize

    start = np.clip(start, *ends)
    unit = np.sqrt(np.diag(_covariance(cost, start, width) if near is None else near))

    def scaled(z: FloatArray) -> tuple[float, FloatArray]:
        level, slope = cost(start + unit * z)
        return level, unit * slope

    bounds, nowhere = [*zip(*((end - start) / unit for end in ends), strict=True)], np.zeros_like(start)
    found = minimize(scaled, nowhere, jac=True, method="L-BFGS-B", bounds=bounds, options=SHARPEST)
    best = np.clip(start + unit * found.x, *ends)
    return best, _covariance(cost, best, width)


def _covariance(cost: Cost, x: FloatArray, width: FloatArray) -> FloatArray:
    """Inverse of the curvature at some logarithms, by differences of slopes."""
    steps = STEP * np.eye(len(x))
    H = np.array([cost(x + step)[1] - cost(x - step)[1] for step in steps]) / (2.0 * STEP)
    # in prior sds a curvature below 1 would say less than the prior alone
    values, vectors = np.linalg.eigh(0.5 * (H + H.T) * np.outer(width, width))
    wide = vectors * width[:, None]
    return (wide / np.maximum(np.abs(values), 1.0)) @ wide.T
