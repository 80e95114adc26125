"""How far mounts, or runs, of one test differ: sds of errors of the bench that the data themselves tell.

An error that comes anew with each mount is normal with one sd s for all of them, and ln s is normal
beforehand about that of the size that the catalogue holds for typical. Given the factor of all rows, with
columns for the errors, the evidence of the full library is a function of s alone.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import Factor
from imubayes.inference.linear import Extra
from imubayes.inference.mcmc.chains import NoiseDraw, log_marginal

WIDTH = 1.0
"""Prior sd of ln s about the typical size: a factor of three either way with 73 %."""

REACH = 5.0
"""Widths about the typical size that the grid of ln s spans."""

SIZES = 61
"""Cells of that grid."""

FEWEST = 3
"""Errors of a kind that tell an sd."""


@dataclass(frozen=True, slots=True, eq=False)
class Spread:
    """Sd from one mount, or run, to the next, of one kind of error of the bench.

    Attributes
    ----------
    kind : of error, by its key in `imubayes.rig.reference.KINDS`.
    count : errors of this kind.
    size, weight : (k,) sds, SI, and their posterior probabilities.
    """

    kind: str
    count: int
    size: FloatArray
    weight: FloatArray

    @property
    def mean(self) -> float:
        """Posterior mean, SI."""
        return float(self.weight @ self.size)

    @property
    def sd(self) -> float:
        """Posterior sd, SI."""
        return math.sqrt(float(self.weight @ (self.size - self.mean) ** 2))


def spreads(
    factor: Factor, sd: FloatArray, extras: Sequence[Extra], typical: Mapping[str, float]
) -> tuple[Spread, ...]:
    """Sds of kinds of errors, given the factor of all rows at their noise.

    Parameters
    ----------
    factor : of terms and, after them, errors; whitened, its noise scale taken out.
    sd : (p + q,) prior sds of both, SI; those of the other kinds are held.
    extras : the q errors.
    typical : size of each kind that is estimated, SI.
    """
    return tuple(_spread(factor, sd, extras, kind, size) for kind, size in typical.items())


def _spread(factor: Factor, sd: FloatArray, extras: Sequence[Extra], kind: str, typical: float) -> Spread:
    z = np.linspace(-REACH, REACH, SIZES)
    sizes, own = typical * np.exp(WIDTH * z), np.array([extra.kind == kind for extra in extras], dtype=bool)
    there = np.append(np.zeros(len(sd) - len(extras), dtype=bool), own)
    log = np.array([log_marginal(factor, np.where(there, size, sd)) for size in sizes.tolist()]) - 0.5 * z**2
    weight = np.exp(log - log.max())
    return Spread(kind, int(own.sum()), sizes, weight / weight.sum())


def over_spreads(
    draws: Sequence[NoiseDraw], found: Sequence[Spread], extras: Sequence[Extra], rng: np.random.Generator
) -> tuple[NoiseDraw, ...]:
    """Draws of the noise, each with a draw of the sds: the columns of the errors are as much larger.

    So errors of another sd have the prior sd that all of them were given, which is the posterior mean.
    """
    drawn = np.array([_systematic(one, len(draws), rng) / one.mean for one in found]).T
    return tuple(_scaled(draw, found, extras, ratio) for draw, ratio in zip(draws, drawn, strict=True))


def _systematic(one: Spread, count: int, rng: np.random.Generator) -> FloatArray:
    ticks = (np.arange(count) + rng.random()) / count
    return rng.permutation(one.size[np.searchsorted(np.cumsum(one.weight)[:-1], ticks)])


def _scaled(
    draw: NoiseDraw, found: Sequence[Spread], extras: Sequence[Extra], ratio: FloatArray
) -> NoiseDraw:
    by_kind = dict(zip((one.kind for one in found), ratio.tolist(), strict=True))
    by_name = {extra.name: by_kind.get(extra.kind, 1.0) for extra in extras}
    scale = np.array([*(by_name.get(name, 1.0) for name in draw.factor.names), 1.0])
    f = draw.factor
    return draw._replace(factor=replace(f, R=f.R * scale, rest=f.rest * scale))
