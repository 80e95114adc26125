"""How far two estimates are apart, and from where on that is more than chance allows.

Two estimates differ where ``|a - b| / sqrt(sd_a^2 + sd_b^2)`` is above a threshold that all comparisons
together exceed by chance in 5 % of cases at most (Bonferroni).
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import combinations
from statistics import NormalDist

LEVEL = 0.05
"""Probability that anything at all is said to differ where nothing does."""

LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ"
"""Labels of the results."""

QUANTILE = NormalDist().inv_cdf(0.95)
"""Half the width of a normal's 90 % interval, in sd."""


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


def largest(found: Mapping[str, tuple[float, float]]) -> Pull | None:
    """Largest difference over its sd between two of some estimates (mean, sd), by label.

    Examples
    --------
    >>> largest({"A": (5.0, 0.3), "B": (3.0, 0.4), "C": (5.0, 3.0)})
    Pull(pair=('A', 'B'), size=4.0, beyond=False)
    """
    pulls = [
        Pull((a, b), abs(found[a][0] - found[b][0]) / math.hypot(found[a][1], found[b][1]))
        for a, b in combinations(found, 2)
        if math.hypot(found[a][1], found[b][1]) > 0.0
    ]
    finite = [pull for pull in pulls if math.isfinite(pull.size)]
    return max(finite, key=lambda pull: pull.size, default=None)


def largest_of_shares(found: Mapping[str, tuple[int, int]]) -> Pull | None:
    """Largest difference between shares (count, of), by Fisher's exact test as a normal's two-sided size."""
    pulls = [Pull((a, b), fisher(*found[a], *found[b])) for a, b in combinations(found, 2)]
    return max(pulls, key=lambda pull: pull.size, default=None)


def fisher(a: int, n: int, b: int, m: int) -> float:
    """Size of a normal whose two-sided tail is Fisher's exact test of a of n against b of m.

    Examples
    --------
    >>> round(fisher(8, 8, 0, 8), 2), fisher(4, 8, 4, 8)
    (3.78, 0.0)
    """
    both = a + b
    ways = {k: math.comb(n, k) * math.comb(m, both - k) for k in range(max(0, both - m), min(n, both) + 1)}
    tail = sum(count for count in ways.values() if count <= ways[a])
    half = max(tail / (2 * sum(ways.values())), sys.float_info.min)
    return -NormalDist().inv_cdf(half) if half < 0.5 else 0.0


def threshold_of(tests: int) -> float:
    """Difference over its sd from which one of so many is beyond uncertainty."""
    return NormalDist().inv_cdf(1.0 - LEVEL / (2.0 * max(tests, 1)))


def judged(pull: Pull | None, threshold: float) -> Pull | None:
    """Mark a difference that is beyond uncertainty."""
    return replace(pull, beyond=pull.size > threshold) if pull else None


def is_beyond(pull: Pull | None) -> bool:
    """Whether there is a difference, and it is beyond uncertainty."""
    return pull is not None and pull.beyond


def normal_of(low: float, high: float) -> float:
    """Standard deviation of a normal with this 90 % interval."""
    return (high - low) / (2.0 * QUANTILE)


def method_sentence(threshold: float, tests: int, how: str) -> str:
    """Say what counts as a difference."""
    return (
        f"A difference counts from {threshold:.1f} sd on: in {tests} comparisons chance reaches that with"
        f" {100.0 * LEVEL:.0f} % at most (Bonferroni). {how}"
    )
