"""The noise that inertial sensors have: white N, bias instability B, random walk K.

Two-sided densities in the rate (or acceleration) domain, as in IEEE 952 annex C::

    S(f) = N^2 + B^2 / (2 pi f) + (K / (2 pi f))^2

Bias instability is a sum of first-order Gauss-Markov processes with time constants in a geometric row;
with a ratio ``r`` of neighbours each has the variance ``B^2 ln(r) / pi``. The Allan deviation of the sum
is flat at ``sqrt(2 ln 2 / pi) B`` to 1 % for a ratio of 10 and to 0.1 % for 4, away from the ends of the row.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FLOOR = math.sqrt(2.0 * math.log(2.0) / math.pi)
"""Allan deviation of bias instability over its coefficient B: 0.664, at every averaging time."""

FLICKER_RATIO = 10.0
"""Ratio of neighbouring time constants in the model that is fitted."""


@dataclass(frozen=True, slots=True)
class Noise:
    """Noise of one component in one run, in SI units (u is m/s^2 or rad/s).

    Attributes
    ----------
    N : white noise, u/sqrt(Hz), two-sided.
    B : bias instability, u.
    K : random walk, u/sqrt(s).
    """

    N: float
    B: float
    K: float


def flicker(
    B: float, shortest: float, longest: float, ratio: float = FLICKER_RATIO
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Gauss-Markov processes whose sum has the bias instability `B`.

    Parameters
    ----------
    B : bias instability, u.
    shortest, longest : range of averaging times, s, over which the sum must be flicker noise; the time
        constants run one step beyond it on both sides.
    ratio : ratio of neighbouring time constants.

    Returns
    -------
    (variance, tau) : arrays (m,), u^2 and s.

    Examples
    --------
    >>> variance, tau = flicker(1.0, 1.0, 100.0)
    >>> tau.tolist(), round(float(variance[0]), 4)
    ([0.1, 1.0, 10.0, 100.0, 1000.0], 0.7329)
    """
    steps = math.ceil(round(math.log(longest / shortest) / math.log(ratio), 9))
    tau = shortest * ratio ** np.arange(-1.0, max(steps, 0) + 2.0)
    return np.full(tau.shape, B * B * math.log(ratio) / math.pi), tau


def allan_variance(noise: Noise, tau: NDArray[np.float64]) -> NDArray[np.float64]:
    """Allan variance of the three processes at averaging times `tau` (s), in u^2.

    ``N^2/tau + (2 ln 2/pi) B^2 + K^2 tau/3`` (IEEE 952 annex C).
    """
    return noise.N**2 / tau + (FLOOR * noise.B) ** 2 + noise.K**2 * tau / 3.0


@dataclass(frozen=True, slots=True)
class NoiseRule:
    """How the noise of a run is to be known.

    Attributes
    ----------
    rule : ``estimate`` by REML, ``white`` (no B, no K: an option to compare with, rarely the truth), or
        ``fixed`` at `value`.
    value : the fixed noise, from a data sheet.
    like : name of the run (a static log) whose estimate is taken, with ``fixed``.
    """

    rule: str = "estimate"
    value: Noise | None = None
    like: str | None = None
