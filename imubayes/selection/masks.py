"""Sums over all 2^p models, which are numbered by masks: bit j is set where candidate j is in the model."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def fold(weight: FloatArray, p: int) -> tuple[FloatArray, float]:
    """Sum of the weights (2^p,) of the masks that contain each bit, and of all: 2^(p+1) additions in all.

    Examples
    --------
    >>> fold(np.array([1.0, 2.0, 3.0, 4.0]), 2)
    (array([6., 7.]), 10.0)
    """
    sums = np.zeros(p)
    for j in range(p - 1, -1, -1):
        half = len(weight) // 2
        sums[j] = weight[half:].sum()
        weight = weight[:half] + weight[half:]
    return sums, float(weight[0])


def sizes(p: int) -> NDArray[np.int64]:
    """Return the number of included columns of each mask: (2^p,)."""
    count = np.zeros(1, dtype=np.int64)
    for _ in range(p):
        count = np.concatenate((count, count + 1))
    return count
