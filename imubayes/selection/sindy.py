"""Sparse regression: what pysindy's optimizers choose on the triangular factor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Sparse:
    """What one optimizer chooses.

    Attributes
    ----------
    optimizer : ``stlsq``, ``sr3``, ``ssr`` or ``frols``.
    names : candidate columns, p of them.
    model : the support chosen along the path.
    inclusion : share of the resampled campaigns whose chosen support has the term: a frequency, not a
        probability.
    strength : (m,) what the path goes over: the threshold in detectable effects (STLSQ, SR3), or the number
        of terms (SSR, FROLS).
    path : (m, p) coefficients in detectable effects; zero where a term is out.
    score : (m,) log evidence of each support, relative to the best.
    chosen : index of `model` on the path.
    stable : terms whose selection frequency over halves of the dwells is at least `cut`.
    cut : threshold of stability selection.
    false_bound : bound on the expected number of false terms among `stable`.
    """

    optimizer: str
    names: tuple[str, ...]
    model: tuple[str, ...]
    inclusion: Mapping[str, float]
    strength: FloatArray
    path: FloatArray
    score: FloatArray
    chosen: int
    stable: tuple[str, ...]
    cut: float
    false_bound: float
