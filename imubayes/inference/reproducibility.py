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

from imubayes.algebra import BoolArray, FloatArray
from imubayes.algebra.factor import Factor
from imubayes.inference.importance import picked
from imubayes.inference.known_quantities import Recovered
from imubayes.inference.linear import Extra
from imubayes.inference.mcmc import NoiseDraw, log_marginal
from imubayes.inference.summary import RunSummary

WIDTH = 1.0
"""Prior sd of ln s about the typical size: a factor of three either way with 73 %."""

REACH = 3.0
"""Widths about the typical size that the grid of ln s spans."""

SIZES = 61
"""Cells of that grid."""

GRID = np.linspace(-REACH, REACH, SIZES)
"""Distances of ln s from that of the typical size, in widths of its prior."""

ROUNDS = 50
"""Most rounds in which the sds of several kinds settle beside each other."""

SETTLED = 0.02
"""Change of ln of an sd that is none."""

DWELL = "dwell"
"""What the kind of a spread begins with that is from dwell to dwell of a run."""

TOLD = 0.95
"""Probability that dwells scatter by more than their samples from which that is told."""

STILL = "still"
"""The same from still to still."""

TINY = 0.1
"""Share of the errors' rms from which, and up to whose inverse, the sd between stills may be."""

NONE = 1e-6
"""Share of the typical size that is none."""

LARGEST = 300.0
"""Logarithm of odds that stands for all larger ones."""

SHOWN = 6.0
"""Odds from which errors that nobody stated are there. Of 81 simulated tests without them one had 5.6, all
others at most 0.8; of 32 with rotations of 20 arcsec all had 7 or more."""

FEWEST = 3
"""Errors of a kind that tell an sd."""


@dataclass(frozen=True, slots=True, eq=False)
class Spread:
    """Sd from one mount, or run, to the next, of the errors of one kind, a key of `reference.KINDS`.

    There are `count` errors of it; `size` and `weight` (k,) are sds, SI, and their posterior probabilities.
    Where errors have columns, `names` are these.
    """

    kind: str
    count: int
    size: FloatArray
    weight: FloatArray
    names: tuple[str, ...] = ()

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
    """Sds of kinds of errors, given the factor of all rows at their noise, its scale taken out.

    Its columns are terms and, after them, the q extras, with the prior sds (p + q,), SI, of which those of
    the other kinds are held; `typical` is the size of each kind that is estimated, SI.
    """
    sd, found = sd.copy(), dict[str, Spread]()
    for _ in range(ROUNDS if len(typical) > 1 else 1):
        before = sd.copy()
        for kind, size in typical.items():
            there = _columns_of(kind, sd, extras)
            sizes, log = _at_sizes(factor, sd, there, size)
            weight = np.exp(log - log.max())
            names = tuple(extra.name for extra in extras if extra.kind == kind)
            found[kind] = Spread(kind, len(names), sizes, weight / weight.sum(), names)
            sd[there] = found[kind].mean
        if np.all(np.abs(np.log(sd / before)) < SETTLED):
            break
    return tuple(found.values())


def _columns_of(kind: str, sd: FloatArray, extras: Sequence[Extra]) -> BoolArray:
    """Which columns (p + q,) are errors of a kind."""
    return np.append(np.zeros(len(sd) - len(extras), bool), [extra.kind == kind for extra in extras])


def _at_sizes(
    factor: Factor, sd: FloatArray, there: BoolArray, typical: float
) -> tuple[FloatArray, FloatArray]:
    """Sds of some columns over the grid, and the logarithm of prior times likelihood of each."""
    sizes = typical * np.exp(WIDTH * GRID)
    log = [log_marginal(factor, np.where(there, size, sd)) for size in sizes.tolist()]
    return sizes, np.array(log) - 0.5 * GRID**2


def odds_of(factor: Factor, sd: FloatArray, extras: Sequence[Extra], kind: str) -> float:
    """How much likelier rows are with errors of a kind, their sd integrated out, than without them.

    The problem is as `spreads` takes it; the sd of the kind is the typical one.
    """
    there = _columns_of(kind, sd, extras)
    _, log = _at_sizes(factor, sd, there, sd[there][0])
    without = log_marginal(factor, np.where(there, NONE * sd, sd))
    share = float(np.sum(np.exp(log - log.max()))) / float(np.sum(np.exp(-0.5 * GRID**2)))
    return math.exp(min(log.max() + math.log(share) - without, LARGEST))


def scatter_of(samples: RunSummary, dwells: RunSummary) -> Spread | None:
    """Sd by which the dwells of a run scatter beyond the white noise of its samples.

    None where dwells were not looked at as such, or scatter by no more than that.
    """
    if not dwells.sampling or samples.sampling or dwells.found.origin != "REML":
        return None
    N = dwells.noise.N * np.exp(dwells.found.sd[0] * GRID)
    size = np.sqrt(np.maximum(N**2 - samples.noise.N**2, 0.0) / dwells.interval)
    weight = np.exp(-0.5 * GRID**2)
    count = round(dwells.samples * dwells.sampling / dwells.interval)
    spread = Spread(f"{DWELL}.{dwells.name}", count, size, weight / weight.sum())
    return spread if float(spread.weight[size > 0.0].sum()) >= TOLD else None


def between_stills(one: Recovered, lasting: FloatArray, N: float) -> Spread | None:
    """Sd by which the m stills of a run differ beyond the noise of their samples; None where all are fitted.

    The errors (m, 1) are of the length of what is known of each still, which is `lasting` (m,), s; N is the
    white noise of a sample's component, SI.
    """
    if one.saturated:
        return None
    error, white = one.after[:, 0], N**2 / lasting
    # the fit takes a share of the variance of its own stills
    left = (2.0 * one.fitted**2 / (one.fitted**2 + one.fresh**2))[:, 0]
    size = math.sqrt(float(np.mean(error**2))) * np.geomspace(TINY, 1.0 / TINY, SIZES)
    variance = left * (size[:, None] ** 2 + white)
    log = -0.5 * np.sum(np.log(variance) + error**2 / variance, axis=1)
    weight = np.exp(log - log.max())
    return Spread(f"{STILL}.{one.run}", len(error), size, weight / weight.sum())


def over_spreads(
    draws: Sequence[NoiseDraw], found: Sequence[Spread], sd: FloatArray, rng: np.random.Generator
) -> tuple[NoiseDraw, ...]:
    """Draws of the noise, each with a draw of the sds: the columns of the errors are as much larger.

    So errors of another sd have the prior sd that all of them were given, which is the posterior mean.
    """
    drawn = []
    for spread in found:
        ticks = (np.arange(len(draws)) + rng.random()) / len(draws)
        sizes = rng.permutation(spread.size[picked(spread.weight, ticks)])
        drawn.append(sizes / spread.mean)
    made = []
    for (f, _), ratios in zip(draws, np.array(drawn).T.tolist(), strict=True):
        by_name = {name: ratio for one, ratio in zip(found, ratios, strict=True) for name in one.names}
        scale = np.array([*(by_name.get(name, 1.0) for name in f.names), 1.0])
        scaled = replace(f, R=f.R * scale, rest=f.rest * scale)
        made.append(NoiseDraw(scaled, log_marginal(scaled, sd)))
    return tuple(made)
