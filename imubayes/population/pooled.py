"""What the units of a class say of a term together, where each by itself may not tell.

A share q of the units has the term. In lot l those that have it are ``theta_i ~ N(mu_l, tau_l^2)``, with
``mu_l ~ N(0, tau_l^2)`` and tau_l log-uniform over what the catalogue gives a lot of the class, as in
`spreads`; in the others it is zero. A unit's test gives ``t_i ~ N(theta_i, v_i)``, without the prior. So::

    p(t | q) = prod_l E_tau,mu prod_i [(1 - q) N(t_i; 0, v_i) + q N(t_i; mu, tau^2 + v_i)]

That no unit has it (q = 0) and that some have (q uniform) are equally likely beforehand.

Of recorded units a lot is one component (ax) of all of them. Their t and v depend on what sessions do to
them, which these tell but roughly: the likelihood of a lot is then the mean over several versions of both
(`levels.of_units`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.inference import Share, frequency, of_cells
from imubayes.selection.mixture import Components, limit

SHARES = tuple((k + 0.5) / 30 for k in range(30))
"""Shares of the units that may have a term, each as likely."""

ALL = (1.0,)
"""Share of them where all have it or none, as components of one case."""

SIZES = 30
"""Cells of the grid of ln tau."""

NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(15)
"""Points of the Gauss-Hermite rule over mu, and their weights: of a standard normal variable."""

OF_MEAN = _WEIGHTS / _WEIGHTS.sum()

FINE = 500
"""Cells of the share of a class over its lots."""

TOGETHER = 16
"""Units whose likelihoods are multiplied before the logarithm is taken: of so many it is no zero."""

SURE = 0.95
"""Probability with which the size of a further unit's coefficient is below its limit."""

FAINTEST = -36.0
"""Least log likelihood of a unit that has the term over one that has not: to rounding."""

NOTHING = 1e-18
"""Sd, over the smallest tau, of a coefficient that is zero."""


@dataclass(frozen=True, slots=True)
class Pooled:
    """One term over all units of a class.

    `inclusion` is the probability that units of the class have it, `share` that of the units that do, if any
    does. A further unit's coefficient stays below `limit` with 95 %, SI; zero where it then has none.
    """

    inclusion: float
    share: Share
    limit: float


def pooled(
    estimates: Sequence[FloatArray],
    variances: Sequence[FloatArray],
    sizes: tuple[float, float],
    weights: Sequence[FloatArray] = (),
    shares: Sequence[float] = SHARES,
) -> Pooled:
    """Put the units of a class together.

    Estimates and variances, without the prior, SI and squared, are those of each lot's units (n,), or m
    versions of both (m, n) whose `weights` (m,) sum to one. `sizes` are the smallest and the largest spread
    that a lot of the class can have, `shares` those of the units that may have the term.

    Examples
    --------
    >>> scatter = np.linspace(-2.0, 2.0, 24)
    >>> faint, none = (pooled([size * scatter], [np.ones(24)], (0.1, 10.0)) for size in (1.6, 0.7))
    >>> faint.inclusion > 0.95, none.inclusion < 0.3, faint.limit > none.limit
    (True, True, True)
    """
    edges = np.linspace(math.log(sizes[0]), math.log(sizes[1]), SIZES + 1)
    tau = np.exp(0.5 * (edges[1:] + edges[:-1]))
    q = np.array(shares)
    versions = weights or [np.ones(1)] * len(estimates)
    likelihoods = [_lot(*each, tau, q) for each in zip(versions, estimates, variances, strict=True)]
    lots, absent = [lot for lot, _ in likelihoods], sum(nothing for _, nothing in likelihoods)
    log = np.sum([np.logaddexp.reduce(lot, axis=(0, 1)) for lot in lots], axis=0)
    present = float(np.logaddexp.reduce(log)) - math.log(len(q))
    inclusion = 1.0 / (1.0 + math.exp(min(absent - present, 700.0)))
    weight = np.exp(log - log.max())
    weight /= weight.sum()
    return Pooled(inclusion, of_cells(q, weight), _limit(lots, weight, tau, q, inclusion))


def _normal(t: FloatArray, variance: FloatArray) -> FloatArray:
    """Log density of a normal variable about zero."""
    return -0.5 * (t**2 / variance + np.log(2.0 * math.pi * variance))


def _lot(
    weight: FloatArray, t: FloatArray, variance: FloatArray, tau: FloatArray, q: FloatArray
) -> tuple[FloatArray, float]:
    """Log likelihood (tau, mu, q) of the units of a lot, times the prior of tau and mu; and of none."""
    t, variance, log_weight = np.atleast_2d(t), np.atleast_2d(variance), np.log(weight)
    there = [version + _units(x, v, tau, q) for version, x, v in zip(log_weight, t, variance, strict=True)]
    log = np.logaddexp.reduce(there, axis=0) + np.log(OF_MEAN)[:, None] - math.log(len(tau))
    return log, float(np.logaddexp.reduce(_normal(t, variance).sum(axis=1) + log_weight))


def _units(t: FloatArray, variance: FloatArray, tau: FloatArray, q: FloatArray) -> FloatArray:
    """Log likelihood (tau, mu, q) of the units of a lot."""
    mean = tau[:, None] * NODES
    there = _normal(t - mean[..., None], tau[:, None, None] ** 2 + variance)
    log_ratio = np.moveaxis(np.clip(there - _normal(t, variance), FAINTEST, 700.0), 2, 0)[..., None]
    units = np.full((len(tau), len(NODES), len(q)), float(_normal(t, variance).sum()))
    units += np.maximum(log_ratio, 0.0).sum(axis=0)
    product, part = np.ones_like(units), np.empty_like(units)
    for k, ratio in enumerate(log_ratio, 1):
        # the likelihood of a unit over that of the likelier case: a product takes fewer logarithms
        without = np.exp(-np.maximum(ratio, 0.0))
        np.multiply(q, np.exp(np.minimum(ratio, 0.0)) - without, out=part)
        part += without
        product *= part
        if k % TOGETHER == 0 or k == len(t):
            units += np.log(product)
            product[...] = 1.0
    return units


def _limit(
    lots: Sequence[FloatArray], weight: FloatArray, tau: FloatArray, q: FloatArray, inclusion: float
) -> float:
    """Size that a further unit's coefficient stays below; it is zero in a unit that has none."""
    cells = [np.exp(lot - np.logaddexp.reduce(lot, axis=(0, 1))) for lot in lots]
    having = np.mean([(cell * (weight * q)).sum(axis=2) for cell in cells], axis=0) * inclusion
    if having.sum() <= 1.0 - SURE:
        return 0.0
    mass = np.append(having, 1.0 - having.sum())
    mean = np.append(tau[:, None] * NODES, 0.0)[:, None]
    sd = np.append(np.repeat(tau, len(NODES)), NOTHING * tau[0])[:, None]
    return limit(Components(mass, sd > 0.0, mass, mean, sd), 0, SURE)


@cache
def over_lots(counts: tuple[int, ...], units: int | tuple[int, ...]) -> Share:
    """Share of the units of a class by how many of them it is in each lot, with a 90 % interval.

    `units` are those of each lot, a number for all or for each. Lots differ: a lot's own share is
    beta-distributed about the class's, with any correlation between the units of a lot equally likely; open
    to the end that was met. One lot alone has its own interval.

    Examples
    --------
    >>> alike, apart = over_lots((8, 8, 8), 16), over_lots((0, 8, 16), 16)
    >>> alike.value == apart.value, apart.low < alike.low
    (True, True)
    """
    from scipy.special import betaln

    n = np.broadcast_to(units, len(counts))
    if len(counts) == 1:
        return frequency(counts[0], int(n[0]))
    if not n.any():
        return frequency(0, 0)
    k, n = np.array(counts)[:, None, None], n[:, None, None]
    share = ((np.arange(FINE) + 0.5) / FINE)[:, None]
    correlation = np.array(SHARES)
    a, b = share * (1.0 / correlation - 1.0), (1.0 - share) * (1.0 / correlation - 1.0)
    log = (betaln(a + k, b + n - k) - betaln(a, b)).sum(axis=0)
    weight = np.exp(log - log.max()).sum(axis=1)
    interval, value = of_cells(share[:, 0], weight), float(k.sum() / n.sum())
    return Share(value, interval.low if value else 0.0, interval.high if value < 1.0 else 1.0)
