"""References under a prior of the g-family: each model's integral over ln g, in arithmetic of 40 digits.

A model of k columns that leaves the share u of the squares has, against the empty one (Liang et al., JASA
2008), ``BF(g) = (1 + g)^((n - k)/2) / (1 + g u)^(n/2)``; with ``s = g/(1 + g)`` its coefficients have the
mean ``s b`` and the covariance ``s (1 + g u)/(1 + g) (X'X)^-1 rss_0/(n - 2)``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from imubayes.inference.prior import GFamily, GPrior, HyperG
from studies.extremes.exact import Averaged, Products, mp

DIGITS = 40

STEP, FIRST, LAST = 0.1, -60.0, 130.0
"""Nodes of ln g: half of the product's steps and more, and beyond its ends."""


@dataclass(frozen=True, slots=True, eq=False)
class _Model:
    """Columns, least squares `b` and unscaled variances `v`, and the share `u` of the squares left."""

    inside: tuple[int, ...]
    b: list[Any]
    v: list[Any]
    u: Any


def posterior(given: Products, prior: GFamily) -> Averaged:
    """Posterior over every submodel, no column forced, under a beta-binomial prior of the models."""
    with mp.workdps(DIGITS):
        p, n = len(given.cross), given.n
        total, shares = mp.mpf(0), [mp.mpf(0)] * p
        first, second = [mp.mpf(0)] * p, [mp.mpf(0)] * p
        for m in _models(given):
            factor, s, square, spread = _integrals(m, n, prior)
            weight = factor / ((p + 1) * math.comb(p, len(m.inside)))
            total += weight
            for b, v, j in zip(m.b, m.v, m.inside, strict=True):
                shares[j] += weight
                first[j] += weight * s * b
                second[j] += weight * (spread * v * given.square / (n - 2) + square * b * b)
        mean = [x / total for x in first]
        sd = [mp.sqrt(x / total - a * a) for x, a in zip(second, mean, strict=True)]
        base = mp.loggamma(mp.mpf(n) / 2) - mp.mpf(n) / 2 * mp.log(mp.pi * given.square) - mp.log(2)
        unit = n * int(given.unit[-1]) * mp.log(2)
        steps = given.unit[-1] - given.unit[:-1]
        return Averaged(
            np.ldexp(np.array(mean, dtype=float), steps),
            np.ldexp(np.array(sd, dtype=float), steps),
            np.array([float(x / total) for x in shares]),
            float(base + mp.log(total) - unit),
        )


def _models(given: Products) -> Iterator[_Model]:
    for chosen in product((False, True), repeat=len(given.cross)):
        inside = tuple(j for j, there in enumerate(chosen) if there)
        gram = mp.matrix([[given.gram[i, j] for j in inside] for i in inside]) if inside else None
        inverse = mp.inverse(gram) if inside else mp.matrix(0, 0)
        cross = [given.cross[j] for j in inside]
        b = [mp.fdot(inverse[i, :], cross) for i in range(len(inside))]
        left = given.square - mp.fdot(b, cross)
        yield _Model(inside, b, [inverse[i, i] for i in range(len(inside))], left / given.square)


def _integrals(m: _Model, n: int, prior: GFamily) -> tuple[Any, Any, Any, Any]:
    """Bayes factor, and the means of ``s``, ``s^2`` and ``s (1 + g u)/(1 + g)``."""
    k = len(m.inside)
    if k == 0:
        return mp.mpf(1), mp.mpf(0), mp.mpf(0), mp.mpf(0)
    sums = [mp.mpf(0)] * 4
    for g, weight in _nodes(prior, n):
        w = weight * mp.exp(mp.mpf(n - k) / 2 * mp.log1p(g) - mp.mpf(n) / 2 * mp.log1p(g * m.u))
        s, r = g / (1 + g), (1 + g * m.u) / (1 + g)
        sums = [a + w * x for a, x in zip(sums, (1, s, s * s, s * r), strict=True)]
    return sums[0], sums[1] / sums[0], sums[2] / sums[0], sums[3] / sums[0]


def _nodes(prior: GFamily, n: int) -> Iterator[tuple[Any, Any]]:
    """(g, prior weight) of the trapezoid rule in ln g."""
    if isinstance(prior, GPrior):
        yield mp.mpf(prior.g), mp.mpf(1)
        return
    step = mp.mpf(STEP)
    for q in range(int(FIRST / STEP), int(LAST / STEP)):
        g = mp.exp(q * step)
        if isinstance(prior, HyperG):
            a = mp.mpf(prior.a)
            yield g, step * g * (a - 2) / 2 * (1 + g) ** (-a / 2)
        else:
            beta = n * mp.mpf(prior.scale) ** 2 / 2
            yield g, step * mp.sqrt(beta / (mp.pi * g)) * mp.exp(-beta / g)
