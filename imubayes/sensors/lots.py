"""Lots: units of one class that are alike, and differ, as units of a production do.

A lot of a class is drawn in three steps:

1. Each figure of the class, ``(low, typical, high)``, gives the lot one magnitude ``m``, whose logarithm is
   normal on either side of the typical value, ``m = typical (high/typical)^(z/1.645)`` above it and
   ``typical (low/typical)^(-z/1.645)`` below, with z standard normal within +-1.645: the median is the
   typical value and no lot leaves its class. A typical value of zero counts as a tenth of the high one, and
   a low one of zero as far below the typical value as the high one is above. With the magnitudes in place
   of its figures the class gives each coefficient the size ``s`` that it has in this lot.
2. A coefficient has a part that all units share, ``mean ~ N(0, r s^2)``, and one of each unit's own with
   ``sd = sqrt(1 - r) s``, so that it is ``N(0, s^2)`` over lots and units. What a factory trims unit by
   unit has the share r = 0.1, what design and technology decide 0.5 (orders of magnitude). A lever arm is one
   coefficient here: the terms that it drives keep their couplings (`imubayes.sensors.catalogue.prior_root`).
3. N, B and K of a unit scatter log-normally about the lot's magnitudes, by 0.1, 0.3 and 0.5 in the
   logarithm (orders of magnitude).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.errors import InputError
from imubayes.sensors import Range, SensorClass
from imubayes.sensors.catalogue import prior_root, prior_sd
from imubayes.sensors.noise import Noise
from imubayes.sensors.terms import Library

TRIMMED = frozenset({"b0", "b1", "b0p", "m_j", "m_k"})
"""Coefficients that a factory trims, or mounts, unit by unit."""

SHARED_TRIMMED, SHARED_BY_DESIGN = 0.1, 0.5
"""Share of the variance that the units of a lot have in common (orders of magnitude)."""

NOISE_SPREAD = {"N": 0.1, "B": 0.3, "K": 0.5}
"""Sd of the logarithm of a noise parameter over the units of a lot (orders of magnitude)."""

_TAIL = 0.05
"""Low and high are the 5 % and 95 % points of a magnitude, as in the noise prior."""

_POINT = NormalDist().inv_cdf(1.0 - _TAIL)


@dataclass(frozen=True, slots=True, eq=False)
class Lot:
    """Units of one class, with the population that they are drawn from.

    Attributes
    ----------
    sensor_class, names : of the units, and of their p coefficients.
    mean, sd : (p,) of the population: what the units share, and their spread about it, SI.
    theta : (n, p) coefficients of each unit, SI.
    typical_noise : median of N, B and K over the population, SI.
    noise : (n,) of each unit.
    """

    sensor_class: SensorClass
    names: tuple[str, ...]
    mean: FloatArray
    sd: FloatArray
    theta: FloatArray
    typical_noise: Noise
    noise: tuple[Noise, ...]

    def __len__(self) -> int:
        """Count the units."""
        return len(self.noise)

    def truth(self, unit: int) -> dict[str, float]:
        """Coefficients of a unit by name, SI."""
        return dict(zip(self.names, self.theta[unit].tolist(), strict=True))


def draw_lot(sensor_class: SensorClass, lib: Library, n: int, rng: np.random.Generator) -> Lot:
    """Draw a lot of n units of a class, and their coefficients of `lib` (see the top of this module).

    It is an `InputError` if there is no unit, a `TermError` if the class's kind lacks a term of `lib`.

    Examples
    --------
    >>> from imubayes.sensors.catalogue import sensor
    >>> from imubayes.sensors.terms import library
    >>> lib = library("gyroscope", powers=1, asymmetry=-1)
    >>> lot = draw_lot(sensor("fog_tactical", kind="gyroscope"), lib, 20, np.random.default_rng(1))
    >>> len(lot), lot.theta.shape == (20, len(lib.terms)), list(lot.truth(0)) == list(lib.names)
    (20, True, True)
    """
    if n < 1:
        raise InputError(f"a lot of {n} units: expected 1 or more")
    # root (p, q) of the coefficients' covariance in one lot, and the lot's median noise
    noise = {name: magnitude(values, rng) for name, values in sensor_class.noise.items()}
    sizes = {key: magnitude(values, rng) for key, values in sensor_class.coefficients.items()}
    root, typical = prior_root(of_sizes(sensor_class, sizes), lib), Noise(**noise)
    trimmed = root[[name in TRIMMED for name in lib.names]].any(axis=0)
    shared = np.where(trimmed, SHARED_TRIMMED, SHARED_BY_DESIGN)
    mean = root @ (np.sqrt(shared) * rng.standard_normal(len(shared)))
    own = root * np.sqrt(1.0 - shared)
    sd = np.sqrt((own**2).sum(axis=1))
    theta = mean + rng.standard_normal((n, len(shared))) @ own.T
    for array in (mean, sd, theta):
        array.setflags(write=False)
    units = tuple(
        Noise(**{k: noise[k] * math.exp(NOISE_SPREAD[k] * rng.standard_normal()) for k in ("N", "B", "K")})
        for _ in range(n)
    )
    return Lot(sensor_class, lib.names, mean, sd, theta, typical, units)


def filled(values: Range) -> Range:
    """Figure whose places that are zero are filled (see the top of this module)."""
    low, typical, high = values
    typical = typical or high / 10.0
    return low or typical * typical / high, typical, high


def of_sizes(entry: SensorClass, sizes: Mapping[str, float]) -> SensorClass:
    """Class whose coefficients have sizes that are certain, by the catalogue's key, SI."""
    return replace(entry, coefficients={key: (size, size, size) for key, size in sizes.items()})


def magnitude(values: Range, rng: np.random.Generator) -> float:
    """Size of a figure in one lot of its class, between low and high, SI.

    Examples
    --------
    >>> 1.0 <= magnitude((1.0, 2.0, 40.0), np.random.default_rng(1)) <= 40.0
    True
    """
    low, typical, high = filled(values)
    z = NormalDist().inv_cdf(rng.uniform(_TAIL, 1.0 - _TAIL)) / _POINT
    return typical * math.exp(z * math.log(high / typical) if z > 0.0 else -z * math.log(low / typical))


def lot_sizes(entry: SensorClass, lib: Library) -> tuple[FloatArray, FloatArray]:
    """Smallest and largest size (p,) that the coefficients of a lot of a class may have, SI."""
    figures = {key: filled(values) for key, values in entry.coefficients.items()}
    low, high = (of_sizes(entry, {key: values[place] for key, values in figures.items()}) for place in (0, 2))
    smallest, largest = (np.array([prior_sd(one, term)[0] for term in lib.terms]) for one in (low, high))
    return smallest, largest
