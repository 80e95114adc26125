"""The noise processes that a log can hold, beyond N, B and K: quantization, ramp, Gauss-Markov.

Two-sided densities in the rate (or acceleration) domain, IEEE 952 annex C; `u` is m/s^2 or rad/s, tau the
averaging time, t0 the interval of the samples::

    symbol  process                       density S(f)                       Allan variance
    N       angle or velocity walk        N^2                                N^2 / tau
    B       bias instability (flicker)    B^2 / (2 pi f)                     (2 ln 2 / pi) B^2
    K       rate random walk              (K / (2 pi f))^2                   K^2 tau / 3
    Q       quantization of the angle     (4 Q^2 / t0) sin^2(pi f t0)        3 Q^2 / tau^2
    R       ramp (deterministic)          -                                  R^2 tau^2 / 2
    G       first-order Gauss-Markov      2 G^2 Tc / (1 + (2 pi f Tc)^2)     see `gauss_markov_variance`
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.sensors.catalogue import noise_prior
from imubayes.sensors.noise import FLOOR
from imubayes.sensors.sensor_class import SensorClass

LogNormal = tuple[float, float]

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

_CORRELATION = (100.0, math.log(10.0) / 1.6448536269514722)
"""Prior of the Gauss-Markov time constant: median in s, sd of the logarithm; 90 % are from 10 s to 1000 s."""

_SPREAD = math.log(5.0) / 1.6448536269514722
"""Prior sd of ln G: 90 % within a factor of 5 of the class's bias instability."""

_VAGUE = math.log(30.0)
"""Prior sd of a logarithm without a class: a factor of 30 either way."""


@dataclass(frozen=True, slots=True)
class NoiseProcesses:
    """Sizes of the processes of one component, SI; zero where the component has no such process.

    Attributes
    ----------
    N : white noise, u/sqrt(Hz), two-sided: a data sheet's one-sided density over sqrt(2).
    B : bias instability, u: the flat part of the Allan deviation over 0.664.
    K : random walk, u/sqrt(s).
    Q : quantization of the integrated output, u s: a least significant bit over sqrt(12).
    R : ramp, u/s, with its sign.
    G, tau : sd in u and time constant in s of a Gauss-Markov process.
    """

    N: float
    B: float = 0.0
    K: float = 0.0
    Q: float = 0.0
    R: float = 0.0
    G: float = 0.0
    tau: float = 1.0

    @property
    def present(self) -> tuple[str, ...]:
        """Symbols of the optional processes that are not zero."""
        return tuple(name for name in OPTIONAL if getattr(self, name) != 0.0)


def shares(noise: NoiseProcesses, tau: FloatArray) -> dict[str, FloatArray]:
    """Allan variance (k,) of each process at averaging times `tau` (k,) s, in u^2.

    Examples
    --------
    >>> parts = shares(NoiseProcesses(N=2.0, Q=1.0), np.array([1.0, 2.0]))
    >>> {name: part.tolist() for name, part in parts.items()}
    {'N': [4.0, 2.0], 'Q': [3.0, 0.75]}
    """
    parts = {
        "N": noise.N**2 / tau,
        "B": (FLOOR * noise.B) ** 2 * np.ones_like(tau),
        "K": noise.K**2 * tau / 3.0,
        "Q": 3.0 * noise.Q**2 / tau**2,
        "R": noise.R**2 * tau**2 / 2.0,
        "G": gauss_markov_variance(noise.G, noise.tau, tau),
    }
    return {name: part for name, part in parts.items() if name == "N" or name in noise.present}


def gauss_markov_variance(sd: float, constant: float, tau: FloatArray) -> FloatArray:
    """Allan variance of a first-order Gauss-Markov process, at most ``(0.617 sd)^2`` at 1.893 Tc.

    ``(2 sd^2 Tc/tau) (1 - (Tc/(2 tau)) (3 - 4 exp(-tau/Tc) + exp(-2 tau/Tc)))`` (IEEE 952 annex C).
    """
    x = tau / constant
    series = x / 3.0 - x**2 / 4.0 + 7.0 * x**3 / 60.0
    closed = (2.0 / x) * (1.0 - (3.0 - 4.0 * np.exp(-x) + np.exp(-2.0 * x)) / (2.0 * x))
    return sd**2 * np.where(x < 1e-2, 2.0 * series, closed)


@dataclass(frozen=True, slots=True)
class ProcessPrior:
    """What is known of the processes before the log.

    Attributes
    ----------
    log_normal : (median in SI, sd of the logarithm) of N, B, K, Q, G and tau.
    ramp : sd of R, u/s; its mean is zero.
    source : in words.
    """

    log_normal: Mapping[str, LogNormal]
    ramp: float
    source: str


def class_prior(sensor_class: SensorClass, interval: float) -> ProcessPrior:
    """Return the priors of a class.

    Parameters
    ----------
    sensor_class : its low and high figures are the 5 % and 95 % points of N, B, K and Q.
    interval : of the samples, s: an accelerometer's quantum is catalogued over the sampling interval.

    Notes
    -----
    A Gauss-Markov process is as large as the class's bias instability within a factor of 5, and a ramp drifts
    in an hour as far as the class's random walk: assumptions, as no class gives either.
    """
    white, floor, walk = noise_prior(sensor_class)
    quantum = _quantum(sensor_class, interval) or (white[0] * math.sqrt(interval / 3.0), math.log(30.0))
    known = {"N": white, "B": floor, "K": walk, "Q": quantum, "G": (floor[0], _SPREAD), "tau": _CORRELATION}
    return ProcessPrior(known, walk[0] / math.sqrt(_DRIFT), f"class {sensor_class.id}")


def vague_prior(white: float, span: float, interval: float) -> ProcessPrior:
    """Return wide priors around what would just show beside the white noise, where no class is known.

    Parameters
    ----------
    white : white noise, u/sqrt(Hz), as the samples scatter.
    span : of the log, s.
    interval : of the samples, s.
    """
    middle = math.sqrt(interval * span)
    medians = {"N": white, "B": white / math.sqrt(middle), "K": white / middle}
    medians |= {"Q": white * math.sqrt(interval / 3.0), "G": medians["B"]}
    known = {name: (median, _VAGUE) for name, median in medians.items()} | {"tau": _CORRELATION}
    return ProcessPrior(known, white * span**-1.5, "no class is named: what would just show")


def _quantum(sensor_class: SensorClass, interval: float) -> LogNormal | None:
    """Prior of Q, u s."""
    key, scale = ("Q", interval) if sensor_class.kind == "accelerometer" else ("Qang", 1.0)
    if key not in sensor_class.coefficients:
        return None
    low, typical, high = sensor_class.coefficients[key]
    return typical * scale, math.log(high / low) / (2.0 * 1.6448536269514722)
