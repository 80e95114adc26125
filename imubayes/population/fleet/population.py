"""What the units of a fleet say together: populations, shares of verdicts, units that stand out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra.arrays import FloatArray
from imubayes.inference.intervals import Share, frequency
from imubayes.population.fleet.plan import FleetStudy
from imubayes.population.fleet.reduction import VERDICTS, Tally
from imubayes.population.fleet.units import Broken
from imubayes.population.lots.answers import PopulationTerm
from imubayes.population.lots.needs import OPEN
from imubayes.population.lots.population import lot_sizes, spread
from imubayes.sensors.lots import Lot

RANGE = (0.5, 0.05, 0.95)
"""Quantiles over units: median and 90 % range."""

ALARM = 0.01
"""Probability that any unit of a fleet of one population stands out in any term."""

WORST = 20
"""Units that are named, those farthest from the population first."""

NOISE = ("N", "B", "K")

MAD_TO_SD = 1.0 / NormalDist().inv_cdf(0.75)
"""Standard deviation of a normal over its median absolute deviation."""


@dataclass(frozen=True, slots=True)
class Pull:
    """How far a unit is from the others, in the term in which it is farthest.

    Attributes
    ----------
    unit : its name.
    term : of the library, or ``N``.
    value : that was found of it, SI.
    pull : distance from the population's mean over the sd that the population and the unit's error give;
        for ``N``, of its logarithm from the median, over the fleet's scatter.
    outlier : whether so far a unit is not expected anywhere in the fleet.
    """

    unit: str
    term: str
    value: float
    pull: float
    outlier: bool


@dataclass(frozen=True, slots=True, eq=False)
class FleetAnswer:
    """What the units say together.

    Attributes
    ----------
    units : number of units that could be read.
    samples : rows that were used.
    terms : population of each term, SI; true values are NaN for recorded units.
    counts : (6, p) units with each verdict, in the order of `reduction.VERDICTS`.
    order : number of needed terms of a unit, median and 90 % range.
    noise : N, B, K over the units, SI: median and 90 % range.
    worst : the units that are farthest from the population, farthest first.
    outliers : number of units that are farther than expected.
    limit : pull from which that is.
    broken : units that could not be read.
    """

    units: int
    samples: int
    terms: tuple[PopulationTerm, ...]
    counts: NDArray[np.int64]
    order: Share
    noise: tuple[Share, Share, Share]
    worst: tuple[Pull, ...]
    outliers: int
    limit: float
    broken: tuple[Broken, ...]


def answer(whole: Tally, study: FleetStudy, lot: Lot | None) -> FleetAnswer:
    """Put the units of a fleet together.

    Parameters
    ----------
    whole : tally of all units.
    study : of the fleet.
    lot : that simulated units are of: the truth to set beside.
    """
    terms = _terms(whole, study, lot)
    N, B, K = (over_units(whole.noise[:, k]) for k in range(3))
    pulls = _pulls(whole, terms)
    limit = NormalDist().inv_cdf(1.0 - 0.5 * ALARM / pulls.size)
    farthest = np.abs(pulls).max(axis=1)
    order = np.argsort(-farthest, kind="stable")[:WORST]
    return FleetAnswer(
        units=len(whole.names),
        samples=whole.samples,
        terms=terms,
        counts=whole.counts,
        order=over_units(whole.order),
        noise=(N, B, K),
        worst=tuple(_pull(whole, study.spec.library.names, pulls, int(k), limit) for k in order),
        outliers=int(np.sum(farthest > limit)),
        limit=limit,
        broken=whole.broken,
    )


def over_units(values: Sequence[float] | NDArray[np.generic]) -> Share:
    """Median and 90 % range over units."""
    return Share(*np.quantile(np.asarray(values), RANGE).tolist())


def _terms(whole: Tally, study: FleetStudy, lot: Lot | None) -> tuple[PopulationTerm, ...]:
    low, high = lot_sizes(study.sensor_class, study.spec.library)
    n = len(whole.names)
    shares = dict(zip(VERDICTS, whole.counts, strict=True))
    found = []
    for j, name in enumerate(study.spec.library.names):
        sizes = (low[j] / math.sqrt(2.0), high[j])
        of_all = spread(whole.estimate[:, j], whole.variance[:, j], sizes)
        found.append(
            PopulationTerm(
                name=name,
                needed=frequency(int(shares["needed"][j]), n),
                open=sum(int(shares[verdict][j]) for verdict in VERDICTS if verdict in OPEN) / n,
                mean=of_all.mean,
                spread=of_all.spread,
                true_mean=math.nan if lot is None else float(lot.mean[j]),
                true_spread=math.nan if lot is None else float(lot.sd[j]),
            )
        )
    return tuple(found)


def _pulls(whole: Tally, terms: Sequence[PopulationTerm]) -> FloatArray:
    """Pull (n, p + 1) of each unit in each term, and in its white noise."""
    mean = np.array([term.mean.value for term in terms])
    spreads = np.array([term.spread.value for term in terms])
    of_terms = (whole.estimate - mean) / np.sqrt(spreads**2 + whole.variance)
    log_noise = np.log(whole.noise[:, 0])
    away = log_noise - np.median(log_noise)
    scatter = MAD_TO_SD * float(np.median(np.abs(away))) or math.inf
    return np.column_stack((of_terms, away / scatter))


def _pull(whole: Tally, names: Sequence[str], pulls: FloatArray, k: int, limit: float) -> Pull:
    j = int(np.argmax(np.abs(pulls[k])))
    at_noise = j == len(names)
    return Pull(
        unit=whole.names[k],
        term=NOISE[0] if at_noise else names[j],
        value=float(whole.noise[k, 0] if at_noise else whole.estimate[k, j]),
        pull=float(pulls[k, j]),
        outlier=bool(abs(pulls[k, j]) > limit),
    )
