"""How time grows with size: a power law, and how sure its exponent is."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import FloatArray
from studies.speed.contests import Ladder

FEWEST = 3
"""Sizes that an exponent and its error are fitted to, at least."""

OVERHEAD = 3.0
"""Times of the smallest size from which on a size counts: below, what does not grow hides the law."""


@dataclass(frozen=True, slots=True, eq=False)
class Law:
    """Time against size: ``at_one size^exponent``, fitted to the sizes that `used` (m,) marks.

    `seconds` (m, repeats) are those of the ladder's `sizes` (m,); `sd` is that of the exponent.
    """

    ladder: Ladder
    sizes: FloatArray
    seconds: FloatArray
    exponent: float
    sd: float
    at_one: float
    used: NDArray[np.bool_]

    @property
    def fastest(self) -> FloatArray:
        """Shortest time of each size (m,)."""
        return self.seconds.min(axis=1)


def fitted(ladder: Ladder, seconds: FloatArray) -> Law:
    """Fit ``seconds = at_one size^exponent`` to the shortest times (m, repeats) of a ladder's sizes.

    Where time is mostly overhead it does not grow, so that the smallest sizes are left out up to three times
    the shortest time, as long as three sizes stay. The error is that of the straight line's scatter, from as
    few points as it has (Student's t is left to the reader).
    """
    sizes = np.array([size for size, _ in ladder.steps], dtype=float)
    fastest = seconds.min(axis=1)
    used = fastest >= OVERHEAD * fastest[0]
    if used.sum() < FEWEST:
        used = np.arange(len(sizes)) >= len(sizes) - FEWEST
    x, y = np.log(sizes[used]), np.log(fastest[used])
    spread = float(np.sum((x - x.mean()) ** 2))
    exponent = float((x - x.mean()) @ y) / spread
    at_one = float(y.mean() - exponent * x.mean())
    left = y - at_one - exponent * x
    sd = math.sqrt(float(left @ left) / max(len(x) - 2, 1) / spread)
    return Law(ladder, sizes, seconds, exponent, sd, math.exp(at_one), used)
