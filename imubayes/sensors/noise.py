"""The noise that inertial sensors have: N, B, K, and what a log may hold beyond.

Two-sided densities in the rate (or acceleration) domain, IEEE 952 annex C; `u` is m/s^2 or rad/s, tau the
averaging time, t0 the interval of the samples::

    symbol  process                       density S(f)                       Allan variance
    N       angle or velocity walk        N^2                                N^2 / tau
    B       bias instability (flicker)    B^2 / (2 pi f)                     (2 ln 2 / pi) B^2
    K       rate random walk              (K / (2 pi f))^2                   K^2 tau / 3
    Q       quantization of the angle     (4 Q^2 / t0) sin^2(pi f t0)        3 Q^2 / tau^2
    R       ramp (deterministic)          -                                  R^2 tau^2 / 2
    G       first-order Gauss-Markov      2 G^2 Tc / (1 + (2 pi f Tc)^2)     see `gauss_markov_variance`

Bias instability is a sum of first-order Gauss-Markov processes with time constants in a geometric row;
with a ratio ``r`` of neighbours each has the variance ``B^2 ln(r) / pi``. The Allan deviation of the sum
is flat at ``sqrt(2 ln 2 / pi) B`` to 1 % for a ratio of 10 and to 0.1 % for 4, away from the ends of the row.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import FloatArray
from imubayes.sensors import SensorClass

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

    Over averaging times from the shortest to the longest, s, the sum is flicker noise: time constants, in
    that ratio, run one step beyond on both sides. Variances (m,) are in u^2, time constants (m,) in s.

    Examples
    --------
    >>> variance, tau = flicker(1.0, 1.0, 100.0)
    >>> tau.tolist(), round(float(variance[0]), 4)
    ([0.1, 1.0, 10.0, 100.0, 1000.0], 0.7329)
    """
    steps = math.ceil(round(math.log(longest / shortest) / math.log(ratio), 9))
    tau = shortest * ratio ** np.arange(-1.0, max(steps, 0) + 2.0)
    return np.full(tau.shape, B * B * math.log(ratio) / math.pi), tau


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


Sizes = Mapping[str, float]
"""Sizes of the processes that a component has, SI, by symbol.

N, u/sqrt(Hz), is two-sided: a data sheet's one-sided density over sqrt(2). B, u, is the flat part of the
Allan deviation over 0.664. K is in u/sqrt(s). Q, u s, of the integrated output, is a least significant bit
over sqrt(12). R, u/s, has a sign. G, u, is the sd of the Gauss-Markov process, tau its time constant, s.
"""

NoisePrior = Mapping[str, tuple[float, float]]
"""What is known of processes beforehand, by symbol: (median in SI, sd of the logarithm).

The ramp R, which has a sign, is normal: (mean, which is zero, and sd), u/s.
"""

Process = Literal["B", "K", "Q", "R", "G"]
OPTIONAL: tuple[Process, ...] = get_args(Process)
"""Processes that a sensor may or may not have; white noise every sensor has."""

NAMES: Mapping[str, str] = {
    "N": "white noise",
    "B": "bias instability",
    "K": "random walk",
    "Q": "quantization",
    "R": "ramp",
    "G": "Gauss-Markov process",
}

_DRIFT = 3600.0
"""s: over so long a ramp drifts as far as the class's random walk does (assumed: no class gives ramps)."""

_SIDE = 1.6448536269514722
"""Of a standard normal number, within which 90 % are."""

_CORRELATION = (100.0, math.log(10.0) / _SIDE)
"""Prior of the Gauss-Markov time constant: median in s, sd of the logarithm; 90 % are from 10 s to 1000 s."""

_SPREAD = math.log(5.0) / _SIDE
"""Prior sd of ln G: 90 % within a factor of 5 of the class's bias instability."""

_VAGUE = math.log(30.0)
"""Prior sd of a logarithm without a class: a factor of 30 either way."""


def shares(noise: Sizes, tau: FloatArray) -> dict[str, FloatArray]:
    """Allan variance (k,) of each process at averaging times `tau` (k,) s, in u^2.

    Examples
    --------
    >>> parts = shares({"N": 2.0, "Q": 1.0}, np.array([1.0, 2.0]))
    >>> {name: part.tolist() for name, part in parts.items()}
    {'N': [4.0, 2.0], 'Q': [3.0, 0.75]}
    """
    size = dict.fromkeys(NAMES, 0.0) | {"tau": 1.0} | dict(noise)
    parts = {
        "N": size["N"] ** 2 / tau,
        "B": (FLOOR * size["B"]) ** 2 * np.ones_like(tau),
        "K": size["K"] ** 2 * tau / 3.0,
        "Q": 3.0 * size["Q"] ** 2 / tau**2,
        "R": size["R"] ** 2 * tau**2 / 2.0,
        "G": gauss_markov_variance(size["G"], size["tau"], tau),
    }
    return {name: part for name, part in parts.items() if name in noise}


def allan_variance(noise: Sizes, tau: FloatArray) -> FloatArray:
    """Allan variance (k,) of all processes together at averaging times `tau` (k,) s, in u^2."""
    return np.sum(list(shares(noise, tau).values()), axis=0)


def gauss_markov_variance(sd: float, constant: float, tau: FloatArray) -> FloatArray:
    """Allan variance of a first-order Gauss-Markov process, at most ``(0.617 sd)^2`` at 1.893 Tc.

    ``(2 sd^2 Tc/tau) (1 - (Tc/(2 tau)) (3 - 4 exp(-tau/Tc) + exp(-2 tau/Tc)))`` (IEEE 952 annex C).
    """
    x = tau / constant
    series = x / 3.0 - x**2 / 4.0 + 7.0 * x**3 / 60.0
    closed = (2.0 / x) * (1.0 - (3.0 - 4.0 * np.exp(-x) + np.exp(-2.0 * x)) / (2.0 * x))
    return sd**2 * np.where(x < 1e-2, 2.0 * series, closed)


def noise_prior(sensor_class: SensorClass) -> NoisePrior:
    """Log-normal priors of N, B and K.

    The median is the class's typical value, and its low and high are the 5 % and 95 % points.

    Examples
    --------
    >>> from imubayes.sensors.catalogue import sensor
    >>> median, sd = noise_prior(sensor("mems_industrial", kind="accelerometer"))["N"]
    >>> round(median / 9.80665e-6, 6), round(sd, 4)
    (60.0, 0.6999)
    """
    return {name: _log_normal(sensor_class.noise[name]) for name in "NBK"}


def _log_normal(figures: tuple[float, float, float]) -> tuple[float, float]:
    """Median, and sd of the logarithm, of low, typical and high figures."""
    low, typical, high = figures
    return typical, math.log(high / low) / (2.0 * _SIDE)


def class_prior(sensor_class: SensorClass, interval: float) -> NoisePrior:
    """Return the priors of a class, whose low and high figures are the 5 % and 95 % points of N, B, K and Q.

    An accelerometer's quantum is catalogued over the interval of the samples, s. A Gauss-Markov process is as
    large as the class's bias instability within a factor of 5, and a ramp drifts in an hour as far as the
    class's random walk does: assumptions, as no class gives either.
    """
    known = noise_prior(sensor_class)
    key, scale = ("Q", interval) if sensor_class.kind == "accelerometer" else ("Qang", 1.0)
    quantum = known["N"][0] * math.sqrt(interval / 3.0), _VAGUE
    if key in sensor_class.coefficients:
        typical, spread = _log_normal(sensor_class.coefficients[key])
        quantum = typical * scale, spread
    ramp = 0.0, known["K"][0] / math.sqrt(_DRIFT)
    return {**known, "Q": quantum, "R": ramp, "G": (known["B"][0], _SPREAD), "tau": _CORRELATION}


def vague_prior(white: float, span: float, interval: float) -> NoisePrior:
    """Return wide priors around what would just show beside the white noise, where no class is known.

    The samples of the log, which has a span and an interval in s, scatter by the white noise, u/sqrt(Hz).
    """
    middle = math.sqrt(interval * span)
    medians = {"N": white, "B": white / math.sqrt(middle), "K": white / middle}
    medians |= {"Q": white * math.sqrt(interval / 3.0), "G": medians["B"]}
    known = {name: (median, _VAGUE) for name, median in medians.items()}
    return {**known, "R": (0.0, white * span**-1.5), "tau": _CORRELATION}
