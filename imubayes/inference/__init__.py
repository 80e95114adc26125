"""What the runs say: noise, whitening, factor, moments, residual checks; here values with 90 % intervals."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from imubayes.algebra import FloatArray

TAIL = 0.05
"""Posterior probability on either side of an interval."""

SIDE = 1.6448536269514722
"""Sds from its middle at which the interval of a normal distribution ends."""

BISECTIONS = 50
"""Halvings of a bracket of +-12 sd: to rounding."""


class Share(NamedTuple):
    """A value with its 90 % interval."""

    value: float
    low: float
    high: float


UNKNOWN = Share(math.nan, math.nan, math.nan)
"""In place of a value that the data say nothing of."""


def frequency(count: int, n: int) -> Share:
    """Share of n with its 90 % interval: Jeffreys' beta posterior, open to the end that was met.

    Examples
    --------
    >>> frequency(0, 10).low, round(frequency(0, 10).high, 2), frequency(5, 10).value
    (0.0, 0.17, 0.5)
    """
    from scipy.special import betaincinv

    if n == 0:
        return Share(math.nan, 0.0, 1.0)
    low, high = betaincinv(count + 0.5, n - count + 0.5, np.array([TAIL, 1.0 - TAIL])).tolist()
    return Share(count / n, low if count else 0.0, high if count < n else 1.0)


class Rate(NamedTuple):
    """How often something happened, out of how many, with the 90 % interval of its share."""

    events: int
    of: int
    share: Share


def rate(events: int, of: int) -> Rate:
    """Count of so many, with its share."""
    return Rate(events, of, frequency(events, of))


def of_mixture(weight: FloatArray, mean: FloatArray, sd: FloatArray) -> Share:
    """Median and interval of a mixture of m normals, by bisection; the weights (m,) sum to one."""
    from scipy.special import ndtr

    goal = np.array([TAIL, 0.5, 1.0 - TAIL])
    low = np.full(3, (mean - 12.0 * sd).min())
    high = np.full(3, (mean + 12.0 * sd).max())
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        below = ndtr((middle[:, None] - mean) / sd) @ weight < goal
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    left, half, right = (0.5 * (low + high)).tolist()
    return Share(half, left, right)


def of_cells(value: FloatArray, weight: FloatArray) -> Share:
    """Median and interval of weighted points, such as the cells of a grid.

    Examples
    --------
    >>> found = of_cells(np.arange(101.0), np.full(101, 1 / 101))
    >>> round(found.low, 2), round(found.value, 2), round(found.high, 2)
    (4.55, 50.0, 95.45)
    """
    order = np.argsort(value, axis=None)
    points, mass = value.ravel()[order], weight.ravel()[order]
    reached = np.cumsum(mass) - 0.5 * mass
    low, half, high = np.interp([TAIL, 0.5, 1.0 - TAIL], reached / mass.sum(), points).tolist()
    return Share(half, low, high)
