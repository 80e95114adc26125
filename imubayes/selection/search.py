"""Models beyond enumeration: branch and bound with a certified bound, and a walk over the models."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """Models that carry the posterior, at one noise scale.

    Attributes
    ----------
    inside : (m, p) which candidates are in each model; no model twice.
    log_joint : (m,) log of p(data | model) p(model), as `search` defines it.
    log_missing : log of a bound on the summed joint probability of all models that are not listed; +inf where
        there is none.
    certified : whether that bound is below the tolerance asked for.
    frequency : (p,) inclusion by the model-space walk where it was needed; else that of the listed models.
    error : (p,) standard error of `frequency` by the walk; the certified bound else.
    visited : how many models or nodes were looked at.
    """

    inside: BoolArray
    log_joint: FloatArray
    log_missing: float
    certified: bool
    frequency: FloatArray
    error: FloatArray
    visited: int
