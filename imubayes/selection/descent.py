"""Better subsets than those of a list: one term added, removed or exchanged, as long as a score falls."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from imubayes.algebra.arrays import BoolArray, FloatArray
from imubayes.selection.spaces import Listed, Space

STEPS = 60
"""Most steps on the way to a score's best subset."""


def descended(
    among: BoolArray,
    scores: Callable[[Space], Mapping[str, FloatArray]],
    mended: Callable[[BoolArray], BoolArray],
) -> BoolArray:
    """Subsets of a list (m, p), and all that lie about the way down from the best of them under each score.

    Parameters
    ----------
    among : subsets to start from.
    scores : of subsets, by name: the smaller, the better.
    mended : makes subsets (m, p) admissible.

    Examples
    --------
    >>> empty = np.zeros((1, 3), dtype=bool)
    >>> found = descended(empty, lambda s: {"terms": -s.sizes() * 1.0}, lambda inside: inside)
    >>> bool(found.all(axis=1).any())
    True
    """
    first = mended(among)
    found = [first]
    for name, values in scores(Listed(first)).items():
        best, least = first[int(np.argmin(values))], float(values.min())
        for _ in range(STEPS):
            near = mended(_neighbours(best))
            found.append(near)
            around = scores(Listed(near))[name]
            if not around.min() < least:
                break
            best, least = near[int(np.argmin(around))], float(around.min())
    return np.unique(np.concatenate(found), axis=0)


def _neighbours(inside: BoolArray) -> BoolArray:
    """Subsets (m, p) with one term more, one less, or one exchanged for another."""
    flips = inside ^ np.eye(len(inside), dtype=bool)
    there, away = np.flatnonzero(inside), np.flatnonzero(~inside)
    swaps = np.tile(inside, (len(there) * len(away), 1))
    rows = np.arange(len(swaps))
    swaps[rows, np.repeat(there, len(away))] = False
    swaps[rows, np.tile(away, len(there))] = True
    return np.concatenate((flips, swaps))
