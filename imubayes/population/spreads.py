"""Mean and spread of the population that units are of: one term over the units of a class.

*Units of one session, or drawn* (`spread`). Unit i of n has the coefficient ``theta_i ~ N(mu, tau^2)``, of
which its test gives ``t_i ~ N(theta_i, v_i)`` without the term's own prior, with the variance v_i of what it
leaves open. With theta_i integrated out, ``t_i ~ N(mu, tau^2 + v_i)``: units that were measured badly count
less, and their scatter is not taken for the population's, which an average of point estimates would do. What
a test sees only beside other terms is off by what these are, in the unit by itself and in the lot
(`levels.of_tests`), both of the size that the others have in the lot, which is integrated over.
tau is log-uniform, the reference prior of a scale, over what the catalogue gives a lot of the class (low to
high, and by a factor of sqrt(2) below it, as what units share is not in their spread); given tau,
``mu ~ N(0, tau^2)``: what units share is of the size of their spread. Where they are more alike than units of
any lot of the class, tau and mu are uniform. mu is integrated out exactly, tau lies on a grid.

*Recorded units, session by session* (`spreads`). The coefficient of unit u in session s is
``mu + a_u + c_s + d_us`` (see `levels`), with a for the unit, c for what a session does to all units, and d
for what a turn-on does to one by itself. mu is flat. The sd of a, and that of a turn-on (c and d together),
have half-Cauchy priors of the class's size (Gelman, Bayesian Analysis 2006), and the arc tangent of the sd of
c over that of d is uniform: few sessions say little of c, and where d is nothing, c is hardly much. The sds
lie on a grid that closes in on where the posterior is. With one session a turn-on is not seen, with units
that share no session c is not.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import FloatArray
from imubayes.inference import TAIL, UNKNOWN, Share, of_cells, of_mixture
from imubayes.inference.prior import class_sd
from imubayes.population import Record
from imubayes.population.levels import (
    Block,
    Likelihoods,
    Version,
    block_of,
    of_tests,
    of_versions,
    over_sessions,
    scatter_p,
)
from imubayes.population.needs import NEEDED, OPEN, InLot, PopulationTerm
from imubayes.population.pooled import pooled
from imubayes.sensors import SensorClass
from imubayes.sensors.catalogue import coupled
from imubayes.sensors.lots import SHARED_BY_DESIGN, SHARED_TRIMMED, TRIMMED, Lot, lot_sizes
from imubayes.sensors.terms import Library

RANGE = (0.5, 0.05, 0.95)
"""Quantiles over units: median and 90 % range."""

FINE = 400
"""Cells of the grid of ln tau: a class's range is a factor of 100 or so, a cell 1 %."""

SUSPECT = 0.01
"""Probability of a false alarm among all parameters of which the scatter is tested."""

FEWEST = 4
"""Units from which they say something of their population."""

SIZES = 5
"""Sizes that the other terms may have beside one, evenly over the logarithm of their own ranges. Of three in
a range for all, 90 % intervals of b2 and c_jj seen by their difference held the mean of a lot in 0.76 of the
cases and its spread in 0.74; of these they do in 0.82 and 0.89."""

CELLS = 20
"""Cells along each sd in a pass over the grid."""

PASSES = 4
"""Passes over the grid, each within what the one before has left."""

FINER = 8
"""Points for each cell of the last pass, between which the logarithm of the density is a cubic spline."""

DEEPEST = -40.0
"""Logarithm of a density, over its peak, that stands for less."""

CUT = 1e-4
"""Density of a marginal, over its peak, below which the next pass leaves a cell out."""

LIGHT = 1e-5
"""Weight of a cell, over the heaviest, below which a mixture does without it."""

CHANCE = 1e-3
"""Probability of so small a scatter below which units are more alike than the catalogue lets them be."""

DUST = 1e-3
"""Smallest spread that is then looked for, over the smallest error of a unit."""

REACH = 1e3
"""How far the first pass reaches below the smallest error and above the largest size."""


def over_units(values: Sequence[float] | NDArray[np.generic]) -> Share:
    """Median and 90 % range over units."""
    return Share(*np.quantile(np.asarray(values), RANGE).tolist())


def population(
    lots: Sequence[Sequence[Record]],
    entry: SensorClass,
    lib: Library,
    drawn: Sequence[Lot] = (),
    prior: Mapping[str, float] | None = None,
) -> tuple[PopulationTerm, ...]:
    """Put the units of a class together, lot by lot; simulated ones beside the truth of their lots.

    Where a study has a `prior` of its own, sds by name, lots may be as much larger as that is.
    """
    prior = prior or {}
    priors, low, high = _sizes(entry, lib, prior)
    part = (np.arange(SIZES) + 0.5) / SIZES
    sizes = low * (high / low) ** part[:, None]
    shared = np.array([SHARED_TRIMMED if name in TRIMMED else SHARED_BY_DESIGN for name in lib.names])
    told = [of_tests([record.R / record.scale for record in units], priors, shared, sizes) for units in lots]
    truths = drawn or [None] * len(lots)
    terms, ends = list[PopulationTerm](), lot_spreads(entry, lib, prior)
    for j, (name, carrier) in enumerate(zip(lib.names, coupled(lib, entry).carriers, strict=True)):
        versions = [columns[lib.names.index(carrier)] for columns in told]
        own: list[InLot] = []
        for units, said, truth in zip(lots, versions, truths, strict=True):
            verdicts = [unit.verdicts[j] for unit in units]
            counts = verdicts.count(NEEDED), sum(verdict in OPEN for verdict in verdicts)
            true = (float(truth.mean[j]), float(truth.sd[j])) if truth else ()
            own.append(InLot(*counts, *spread(said, ends[name]), *true))
        weights, estimates, variances = zip(*map(of_versions, versions), strict=True)
        together = pooled(estimates, variances, ends[name], weights)
        terms.append(PopulationTerm(name, len(lots[0]), tuple(own), together))
    return tuple(terms)


def lot_spreads(
    entry: SensorClass, lib: Library, prior: Mapping[str, float]
) -> dict[str, tuple[float, float]]:
    """Smallest and largest spread of each term that units of a lot of the class can have, by name, SI.

    Where a study has a `prior` of its own, they are as much larger as that is.
    """
    _, low, high = _sizes(entry, lib, prior)
    return dict(zip(lib.names, zip((low / math.sqrt(2.0)).tolist(), high.tolist(), strict=True), strict=True))


def _sizes(
    entry: SensorClass, lib: Library, prior: Mapping[str, float]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Prior sd (p,) of the terms, and the smallest and largest that they have in a lot, as much wider, SI."""
    usual = class_sd(entry, lib)
    own = np.array([prior.get(name, sd) for name, sd in zip(lib.names, usual, strict=True)])
    low, high = lot_sizes(entry, lib)
    return own, own / usual * low, own / usual * high


def spread(versions: Sequence[Version], sizes: tuple[float, float]) -> tuple[Share, Share]:
    """Mean mu and spread tau of the population that units are of: posterior medians, with 90 % intervals.

    The versions are of what the units' tests say, SI; `sizes` are the smallest and the largest spread that
    can be.

    Examples
    --------
    >>> told = Version(1.0, np.array([1.0, 3.0, 5.0, 7.0]), np.full(4, 1e-6), 0.0)
    >>> mean, tau = spread([told], (1e-2, 1e2))
    >>> round(mean.value, 1), tau.low < 2.6 < tau.high
    (3.2, True)
    """
    alike = _more_alike(versions[0], sizes[0])
    least = DUST * math.sqrt(float(versions[0].variance.min())) if alike else sizes[0]
    edges = np.linspace(math.log(least), math.log(sizes[1]), FINE + 1)
    tau = np.exp(0.5 * (edges[1:] + edges[:-1]))
    densities = [_at(tau, version, alike=alike) for version in versions]
    log_density, mean, sd = (np.array(each) for each in zip(*densities, strict=True))
    weight = np.exp(log_density - log_density.max())
    weight /= weight.sum()
    reached = np.concatenate(([0.0], np.cumsum(weight.sum(axis=0))))
    low, half, high = np.exp(np.interp((TAIL, 0.5, 1.0 - TAIL), reached, edges)).tolist()
    return of_mixture(weight.ravel(), mean.ravel(), sd.ravel()), Share(half, low, high)


def _at(tau: FloatArray, told: Version, *, alike: bool) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Log density of what is told at each tau (m,), and mean and sd (m,) of mu there."""
    precision = 1.0 / (tau[:, None] ** 2 + told.variance)
    # mu and the error that the units share, together: of the size of tau and that error's, or uniform
    of_both = tau**2 + told.common**2
    total = precision.sum(axis=1) + (0.0 if alike else 1.0 / of_both)
    pull = precision @ told.estimate
    log_det = np.log(precision).sum(axis=1) - np.log(total)
    log_density = math.log(told.weight) + 0.5 * (log_det - precision @ told.estimate**2 + pull**2 / total)
    mean = pull / total
    if alike:
        return log_density + np.log(tau), mean, np.sqrt(1.0 / total + told.common**2)
    share = tau**2 / of_both
    variance = share**2 / total + share * told.common**2
    return log_density - 0.5 * np.log(of_both), share * mean, np.sqrt(variance)


def _more_alike(told: Version, least: float) -> bool:
    """Whether units scatter less than chance allows those that differ by the least sd that a lot can have."""
    from scipy.special import gammainc

    precision = 1.0 / (least**2 + told.variance)
    about = told.estimate - float(precision @ told.estimate / precision.sum())
    chance = gammainc(0.5 * (len(about) - 1), 0.5 * float(precision @ about**2))
    return bool(float(np.median(told.variance)) < least**2 and chance < CHANCE)


@dataclass(frozen=True, slots=True, eq=False)
class Spreads:
    """What a population is like; posterior medians with 90 % intervals, SI.

    Attributes
    ----------
    noise, alias : median sd of one session's error, by its noise, and by what it books to the coefficient in
        place of others.
    mean : of the population; unknown for several kinds of component together, which have their own means.
    mean_sd : of its posterior.
    unit_to_unit : sd from unit to unit; with one session each it holds what a turn-on does, too.
    turn_on : sd from session to session of a unit, of which
    turn_on_own : is what the unit does by itself, and
    turn_on_common : is what all units do together.
    common_share : of the variance of a turn-on that all units have in common.
    next_unit : where a further unit is, at a further turn-on.
    p_value : probability of so large a scatter of the sessions about their units' means, if nothing but the
        errors of the tests separated them; NaN with one session each.
    level : of that test, at which all those of the class together have one probability of a false alarm.
    shift, shift_sd : (s,) of all units in each session from the mean of the sessions; empty where
        `turn_on_common` is unknown, or several kinds of component are together.
    """

    noise: float
    alias: float
    mean: Share = UNKNOWN
    mean_sd: float = math.nan
    unit_to_unit: Share = UNKNOWN
    turn_on: Share = UNKNOWN
    turn_on_own: Share = UNKNOWN
    turn_on_common: Share = UNKNOWN
    common_share: Share = UNKNOWN
    next_unit: Share = UNKNOWN
    p_value: float = math.nan
    level: float = SUSPECT
    shift: FloatArray = field(default_factory=lambda: np.zeros(0))
    shift_sd: FloatArray = field(default_factory=lambda: np.zeros(0))


Sizes = tuple[FloatArray, FloatArray, FloatArray]
"""Own, unit and common sds of a grid, each with its own points."""


def spreads(blocks: Sequence[Likelihoods], scale: float) -> Spreads:
    """Mean and spreads of a population.

    The blocks are of one kind of component, or of several that have the same spreads, each with its mean and
    its sessions. `scale`, of the priors of the spreads, is the size that the coefficient has in its class,
    SI.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> value = 5.0 + 2.0 * rng.normal(size=(30, 1)) + 0.1 * rng.normal(size=(30, 4))
    >>> found = spreads([Likelihoods(value, np.full((30, 4), 0.05), np.zeros((30, 4, 0)))], 10.0)
    >>> round(found.unit_to_unit.value, 1), round(found.turn_on_own.value, 2), found.turn_on_common.high < 0.1
    (1.7, 0.08, True)
    """
    told = [likelihood for likelihood in blocks if likelihood.told]
    if sum(likelihood.told for likelihood in told) < FEWEST:
        return Spreads(*_errors(blocks))
    centres = [float(np.nanmean(likelihood.value)) for likelihood in told]
    centred = [
        replace(likelihood, value=likelihood.value - c) for likelihood, c in zip(told, centres, strict=True)
    ]
    explored = _explored(centred, scale)
    known = _of_sizes(*explored[:2], scatter_p(told), _errors(told))
    return known if len(blocks) > 1 else _with_mean(known, explored, centred[0], centres[0])


def _errors(blocks: Sequence[Likelihoods]) -> tuple[float, float]:
    """Median sd of a session's error by noise and by other coefficients; NaN where no session tells."""
    known = [(likelihood, np.isfinite(likelihood.value)) for likelihood in blocks]
    noise = np.concatenate([likelihood.noise[k] for likelihood, k in known])
    alias = np.concatenate([np.linalg.norm(likelihood.alias, axis=-1)[k] for likelihood, k in known])
    return (float(np.median(noise)), float(np.median(alias))) if len(noise) else (math.nan, math.nan)


Explored = tuple[Sizes, FloatArray, list[Block]]
"""Grid of the three sds, weights (own, unit, common) that sum to one, and what each block says there."""


def _explored(blocks: Sequence[Likelihoods], scale: float) -> Explored:
    """Close in on the posterior of the three sds."""
    # whether they tell of what a unit does by itself, of the units, and of what all do together
    known = [np.isfinite(likelihood.value) for likelihood in blocks]
    own = any(np.any(k.sum(axis=1) > 1) for k in known)
    there = own, True, own and any(np.sum(k.sum(axis=0) > 1) > 1 for k in known)
    noise = min(float(np.nanmin(likelihood.noise)) for likelihood in blocks)
    size = max(float(np.nanmax(np.abs(likelihood.value))) for likelihood in blocks)
    ends = (math.log(min(noise, scale) / REACH), math.log(max(noise, scale, size) * REACH))
    ranges = [ends] * 3
    explored = _on_grid(blocks, scale, ranges, there)
    for _ in range(PASSES - 1):
        for k, (low, high) in enumerate(ranges):
            # where the marginal is worth a cell, and a cell on either side
            marginal = explored[1].sum(axis=tuple(axis for axis in range(3) if axis != k))
            kept = np.flatnonzero(marginal > CUT * marginal.max())
            step = (high - low) / len(marginal)
            ranges[k] = max(low + step * (kept[0] - 1), low), min(low + step * (kept[-1] + 2), high)
        explored = _on_grid(blocks, scale, ranges, there)
    return explored


def _on_grid(
    blocks: Sequence[Likelihoods],
    scale: float,
    ranges: Sequence[tuple[float, float]],
    there: tuple[bool, bool, bool],
) -> Explored:
    own, unit, common = (
        np.exp(low + (high - low) * (np.arange(CELLS) + 0.5) / CELLS) if level else np.zeros(1)
        for (low, high), level in zip(ranges, there, strict=True)
    )
    known = [block_of(likelihood, own, unit) for likelihood in blocks]
    log = sum(
        (over_sessions(block, common)[0] for block in known), np.zeros((len(own), len(unit), len(common)))
    )
    log += _log_prior(own, unit, common, scale)
    weight = np.exp(log - log.max())
    return (own, unit, common), weight / weight.sum(), known


def _log_prior(own: FloatArray, unit: FloatArray, common: FloatArray, scale: float) -> FloatArray:
    """Log prior density (own, unit, common) by the logarithms of the sds that are there."""
    log = (np.log(unit) - np.log1p((unit / scale) ** 2))[:, None]
    if len(own) == 1:
        return log
    turn_on = np.hypot(own[:, None, None], common)
    log = log - np.log1p((turn_on / scale) ** 2)
    if len(common) == 1:
        return log + np.log(turn_on)
    return log + np.log(own[:, None, None] * common / turn_on)


def _of_sizes(sizes: Sizes, weight: FloatArray, p_value: float, errors: tuple[float, float]) -> Spreads:
    """What the grid says of the three sds."""
    own, unit, common = sizes
    known = Spreads(*errors, unit_to_unit=of_cells(_points(unit), _finer(weight.sum(axis=(0, 2)))))
    if len(own) == 1:
        return known
    both = _finer(weight.sum(axis=1))
    own, common = _points(own)[:, None], _points(common)
    known = replace(known, p_value=p_value, turn_on=of_cells(np.hypot(own, common), both))
    if len(common) == 1:
        return known
    return replace(
        known,
        turn_on_own=of_cells(own, both.sum(axis=1)),
        turn_on_common=of_cells(common, both.sum(axis=0)),
        common_share=of_cells(common**2 / (own**2 + common**2), both),
    )


def _points(size: FloatArray) -> FloatArray:
    """Finer steps between the first and the last of the cells along one sd."""
    return np.geomspace(size[0], size[-1], FINER * len(size)) if len(size) > 1 else size


def _finer(weight: FloatArray) -> FloatArray:
    """Density at the finer steps along each sd that is there."""
    from scipy.ndimage import zoom

    log = np.log(np.maximum(weight / weight.max(), math.exp(DEEPEST)))
    finer = np.asarray(zoom(log, [FINER if n > 1 else 1 for n in weight.shape], mode="nearest"))
    return np.exp(finer)


def _with_mean(summary: Spreads, explored: Explored, likelihood: Likelihoods, centre: float) -> Spreads:
    """Add what a single kind of component has: its mean, its next unit, and its sessions.

    What the tests book to the coefficient in place of others is of one sign in all units if the others are:
    no number of units averages that out.
    """
    known = np.isfinite(likelihood.value)
    alike = float((likelihood.alias[known].mean(axis=0) ** 2).sum())
    sizes, weight, (block,) = explored
    _, mean, variance = over_sessions(block, sizes[2])
    if len(sizes[2]) > 1:
        shift, shift_sd = _shifts(block, sizes[2], weight)
        summary = replace(summary, shift=shift, shift_sd=shift_sd)
    heavy = weight > LIGHT * weight.max()
    own, unit, common = (size[place] for size, place in zip(sizes, np.nonzero(heavy), strict=True))
    weight = weight[heavy] / weight[heavy].sum()
    mean, variance = mean[heavy] + centre, variance[heavy] + alike
    middle = float(weight @ mean)
    return replace(
        summary,
        mean=of_mixture(weight, mean, np.sqrt(variance)),
        mean_sd=math.sqrt(float(weight @ (variance + (mean - middle) ** 2))),
        next_unit=of_mixture(weight, mean, np.sqrt(variance + own**2 + unit**2 + common**2)),
    )


def _shifts(block: Block, common: FloatArray, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean and sd (s,) of the levels of the sessions about their mean."""
    heavy = np.nonzero(weight > 1e2 * LIGHT * weight.max())
    weight = weight[heavy] / weight[heavy].sum()
    s = block.precision.shape[-1]
    about = np.eye(s) - 1.0 / s
    precision = block.precision[heavy[:2]] + about / common[heavy[2]][:, None, None] ** 2
    cov = about @ np.linalg.inv(precision) @ about
    level = np.linalg.solve(precision, block.information[heavy[:2]][..., None])[..., 0] @ about
    mean = weight @ level
    variance = weight @ (np.diagonal(cov, axis1=1, axis2=2) + (level - mean) ** 2)
    return mean, np.sqrt(variance)
