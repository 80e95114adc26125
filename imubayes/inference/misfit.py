"""What the library does not contain, and in which input the residuals show it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Dependence:
    """Dependence of a run's residuals on one input.

    Attributes
    ----------
    run : its name.
    input : channel (``f_i`` ... ``T``, ``dT``), ``t`` for time, or ``hysteresis of T``: the same input, met
        while it rises and while it falls.
    p : p-value that chance explains it, corrected for the number of inputs that were looked at.
    share : of the variance of the residuals' block means that the dependence explains.
    size : rms of the dependence, SI of the output.
    x : (k,) where the residual is shown, SI of the input.
    mean, sd : (k,) mean residual there and its standard error, SI of the output.
    branch : (k,) +1 while the input rises, -1 while it falls, 0 where that makes no difference.
    """

    run: str
    input: str
    p: float
    share: float
    size: float
    x: FloatArray
    mean: FloatArray
    sd: FloatArray
    branch: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Misfit:
    """Whether the library misses something.

    Attributes
    ----------
    dependences : of every run on every input, worst first.
    found : those that chance does not explain.
    predictive_p : posterior predictive p-value of each run's residual size, by run.
    text : in words: nothing is missing, or "something the library does not contain", and where it shows.
    """

    dependences: tuple[Dependence, ...]
    found: tuple[Dependence, ...]
    predictive_p: dict[str, float]
    text: str
