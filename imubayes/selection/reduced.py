"""The smallest model that predicts as well as the whole posterior: a summary of it, not a posterior."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Reduced:
    """Smallest model whose predictions stay within a budget.

    Attributes
    ----------
    terms : what it keeps, strongest first.
    coefficients : (k,) of these, projected, SI.
    budget : rms that may be lost, SI of the output.
    lost : rms that is lost, SI.
    path : for 0, 1, ... terms: (terms, rms that is lost in SI).
    """

    terms: tuple[str, ...]
    coefficients: FloatArray
    budget: float
    lost: float
    path: tuple[tuple[tuple[str, ...], float], ...]
