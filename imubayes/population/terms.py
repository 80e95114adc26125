"""What a class is like: a hierarchical posterior over its units, term by term.

Unit i of n has the coefficient ``theta_i ~ N(mu, tau^2)``, of which its test gives ``t_i ~ N(theta_i, v_i)``
without shrinkage, with the variance v_i of what it leaves open. With theta_i integrated out,
``t_i ~ N(mu, tau^2 + v_i)``: units that were measured badly count less, and their scatter is not taken for
the population's, which an average of point estimates would do.

Priors: tau is log-uniform, the reference prior of a scale, over what the catalogue gives a lot of the class
(low to high, and by a factor of sqrt(2) below it, as what units share is not in their spread); given tau,
``mu ~ N(0, tau^2)``: what units share is of the size of their spread. mu is integrated out exactly, tau lies
on a grid.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from imubayes.algebra.arrays import FloatArray, IntArray
from imubayes.inference.intervals import TAIL, Share, frequency, of_mixture
from imubayes.population.tally import OPEN, VERDICTS, Tally
from imubayes.sensors.catalogue import prior_sd
from imubayes.sensors.lots import Lot
from imubayes.sensors.sensor_class import SensorClass
from imubayes.sensors.terms import Library

CELLS = 400
"""Cells of the grid of ln tau: a class's range is a factor of 100 or so, a cell 1 %."""


@dataclass(frozen=True, slots=True)
class PopulationTerm:
    """One term over the units of a class, SI.

    Attributes
    ----------
    name : of the term.
    needed : share of the units in which it is needed.
    open : share of the units whose test cannot tell, or leaves it undecided.
    mean, spread : of the population: a hierarchical posterior over units.
    true_mean, true_spread : of the lot that was simulated.
    """

    name: str
    needed: Share
    open: float
    mean: Share
    spread: Share
    true_mean: float
    true_spread: float


@dataclass(frozen=True, slots=True)
class Spread:
    """Mean mu and spread tau of a population: posterior medians, with 90 % intervals."""

    mean: Share
    spread: Share


def population(
    whole: Tally, entry: SensorClass, lib: Library, lot: Lot | None = None
) -> tuple[PopulationTerm, ...]:
    """Put the units of a class together.

    Parameters
    ----------
    whole : tally of the units.
    entry : their class: it gives the priors.
    lib : their library.
    lot : that simulated units are of: the truth to set beside.
    """
    low, high = lot_sizes(entry, lib)
    n = len(whole.names)
    shares: dict[str, IntArray] = dict(zip(VERDICTS, whole.counts, strict=True))
    found: list[PopulationTerm] = []
    for j, name in enumerate(lib.names):
        of_all = spread(whole.estimate[:, j], whole.variance[:, j], (low[j] / math.sqrt(2.0), high[j]))
        found.append(
            PopulationTerm(
                name=name,
                needed=frequency(int(shares["needed"][j]), n),
                open=sum(int(shares[verdict][j]) for verdict in OPEN) / n,
                mean=of_all.mean,
                spread=of_all.spread,
                true_mean=math.nan if lot is None else float(lot.mean[j]),
                true_spread=math.nan if lot is None else float(lot.sd[j]),
            )
        )
    return tuple(found)


def lot_sizes(entry: SensorClass, lib: Library) -> tuple[FloatArray, FloatArray]:
    """Smallest and largest size (p,) that the coefficients of a lot of a class may have, SI."""
    ends: list[FloatArray] = []
    for place in (0, 2):
        sizes = {key: _filled(values)[place] for key, values in entry.coefficients.items()}
        narrowed = replace(entry, coefficients={key: (size, size, size) for key, size in sizes.items()})
        ends.append(np.array([prior_sd(narrowed, term)[0] for term in lib.terms]))
    return ends[0], ends[1]


def _filled(values: tuple[float, float, float]) -> tuple[float, float, float]:
    """Figure with the places that are zero filled as `sensors.lots` fills them."""
    low, typical, high = values
    typical = typical or high / 10.0
    return low or typical * typical / high, typical, high


def spread(estimate: FloatArray, variance: FloatArray, sizes: tuple[float, float]) -> Spread:
    """Mean and spread of the population that units are of.

    Parameters
    ----------
    estimate, variance : (n,) of each unit, SI and squared.
    sizes : (smallest, largest) spread that can be.

    Examples
    --------
    >>> found = spread(np.array([1.0, 3.0, 5.0, 7.0]), np.full(4, 1e-6), (1e-2, 1e2))
    >>> round(found.mean.value, 1), found.spread.low < 2.6 < found.spread.high
    (3.2, True)
    """
    edges = np.linspace(math.log(sizes[0]), math.log(sizes[1]), CELLS + 1)
    tau = np.exp(0.5 * (edges[1:] + edges[:-1]))
    log_density, mean, sd = _given(tau, estimate, variance)
    weight = np.exp(log_density - log_density.max())
    weight /= weight.sum()
    reached = np.concatenate(([0.0], np.cumsum(weight)))
    low, half, high = np.exp(np.interp((TAIL, 0.5, 1.0 - TAIL), reached, edges)).tolist()
    return Spread(of_mixture(weight, mean, sd), Share(half, low, high))


def _given(
    tau: FloatArray, estimate: FloatArray, variance: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Log density of the estimates at each tau (m,), and mean and sd (m,) of mu there."""
    precision = 1.0 / (tau[:, None] ** 2 + variance)
    of_mu = 1.0 / tau**2 + precision.sum(axis=1)
    pull = precision @ estimate
    log_det = np.log(precision).sum(axis=1) - np.log(of_mu) - 2.0 * np.log(tau)
    return 0.5 * (log_det - precision @ estimate**2 + pull**2 / of_mu), pull / of_mu, 1.0 / np.sqrt(of_mu)
