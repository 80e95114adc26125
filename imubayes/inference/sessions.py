"""Repeatability: the same parameter of the same unit in independent sessions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Repeatability:
    """One parameter of units that were tested in several sessions.

    Attributes
    ----------
    parameter : term, and component of a triad where there is one (``ax.b0``); ``b0`` for all axes together.
    unit : SI unit.
    printed : unit that people use.
    units : u units.
    sessions : s sessions.
    mean, sd : (u, s) posterior of the full library, SI; NaN where a unit lacks a session.
    pulls : (u, s, s) difference of two sessions over the sd of their difference.
    p_value : probability of so large a scatter if nothing but the posteriors' sds separated the sessions.
    between : (mean, q05, q95) of the sd between sessions, SI, from its posterior.
    exceeds : whether the scatter exceeds what the posteriors allow.
    """

    parameter: str
    unit: str
    printed: str
    units: tuple[str, ...]
    sessions: tuple[str, ...]
    mean: FloatArray
    sd: FloatArray
    pulls: FloatArray
    p_value: float
    between: tuple[float, float, float]
    exceeds: bool
