"""How far two estimates are apart, and from where on that is more than chance allows.

Two estimates differ where ``|a - b| / sqrt(sd_a^2 + sd_b^2)`` is above a threshold that all comparisons
together exceed by chance in 5 % of cases at most (Bonferroni).
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations
from statistics import NormalDist
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from imubayes.reporting.result.entries import Interval

LEVEL = 0.05
"""Probability that anything at all is said to differ where nothing does."""

QUANTILE = NormalDist().inv_cdf(0.95)
"""Half the width of a normal's 90 % interval, in sd."""

Estimate = tuple[float, float]
"""Mean and sd, or a count and what it is of."""


@dataclass(frozen=True, slots=True)
class Pull:
    """Largest difference between two of the results.

    Attributes
    ----------
    pair : labels of the two.
    size : difference over its sd.
    beyond : whether it is more than uncertainty and the number of comparisons allow.
    """

    pair: tuple[str, str]
    size: float
    beyond: bool = False


def in_sd(one: Estimate, other: Estimate) -> float:
    """Difference of two means over its sd; nan where it has none."""
    sd = math.hypot(one[1], other[1])
    return abs(one[0] - other[0]) / sd if sd > 0.0 else math.nan


def fisher(one: Estimate, other: Estimate) -> float:
    """Size of a normal whose two-sided tail is Fisher's exact test of a of n against b of m.

    Examples
    --------
    >>> round(fisher((8, 8), (0, 8)), 2), fisher((4, 8), (4, 8))
    (3.78, 0.0)
    """
    (a, n), (b, m) = (map(int, counts) for counts in (one, other))
    both = a + b
    ways = {k: math.comb(n, k) * math.comb(m, both - k) for k in range(max(0, both - m), min(n, both) + 1)}
    tail = sum(count for count in ways.values() if count <= ways[a])
    half = max(tail / (2 * sum(ways.values())), sys.float_info.min)
    return -NormalDist().inv_cdf(half) if half < 0.5 else 0.0


def largest(
    labels: Sequence[str],
    estimates: Sequence[Estimate | None],
    size: Callable[[Estimate, Estimate], float] = in_sd,
) -> Pull | None:
    """Largest difference between two of some estimates; None where no two can be compared.

    Examples
    --------
    >>> largest("ABC", [(5.0, 0.3), (3.0, 0.4), (5.0, 3.0)])
    Pull(pair=('A', 'B'), size=4.0, beyond=False)
    """
    there = [(label, one) for label, one in zip(labels, estimates, strict=True) if one]
    pulls = [Pull((a, b), size(one, other)) for (a, one), (b, other) in combinations(there, 2)]
    finite = [pull for pull in pulls if math.isfinite(pull.size)]
    return max(finite, key=lambda pull: pull.size, default=None)


def threshold_of(tests: int) -> float:
    """Difference over its sd from which one of so many is beyond uncertainty."""
    return NormalDist().inv_cdf(1.0 - LEVEL / (2.0 * max(tests, 1)))


def normal_of(low: float, high: float) -> float:
    """Standard deviation of a normal with this 90 % interval."""
    return (high - low) / (2.0 * QUANTILE)


def log_spread(found: Interval) -> Estimate:
    """Logarithm of a spread, and the sd of it that its 90 % interval has; nan where it is not positive.

    Examples
    --------
    >>> value, sd = log_spread({"value": 1.0, "low": 0.5, "high": 2.0})
    >>> value, round(sd, 3)
    (0.0, 0.421)
    """
    if not found["low"] > 0.0:
        return math.nan, math.nan
    return math.log(found["value"]), normal_of(math.log(found["low"]), math.log(found["high"]))
