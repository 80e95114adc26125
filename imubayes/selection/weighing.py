"""Every model's weight, added up over noise scales: by products where doubles hold them, else by logs."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.selection.masks import sizes
from imubayes.selection.mixture import Candidates, log_flat
from imubayes.selection.model_prior import Needs, admissible

FAR = 300.0
"""Logarithm by which a scale may stand above the level of the sums before they are brought to it."""


@dataclass(slots=True, eq=False)
class Products:
    """Sums of products, ``weight * exp(level)`` by model: a few nanoseconds a model and scale.

    Attributes
    ----------
    candidates, by_size, needs : what is weighed, and the log prior probability of a model of each size.
    weight : (2^p,) by mask.
    level : logarithm of what the weights were divided by.
    height : largest logarithm of a model's joint probability at a scale so far.
    held : whether every product was within what a number can hold.
    """

    candidates: Candidates
    by_size: FloatArray
    needs: Needs
    weight: FloatArray = field(init=False)
    level: float = math.nan
    height: float = -math.inf
    held: bool = True

    def __post_init__(self) -> None:
        self.weight = np.zeros(1 << len(self.candidates.names))

    def add(self, scale: float) -> float:
        """Add every model at a noise scale; return the largest logarithm."""
        from imubayes.selection import abreast

        c, a, T = self.candidates, len(self.candidates.always), self.candidates.at(scale)
        R, width = abreast.ready(T[a:, a:] / scale, 1.0 / c.sd[a:])
        self.held &= abreast.storable(R, width)
        if not self.held:
            return -math.inf
        factor = log_flat(c, T, scale) - 0.5 * (float(T[-1, -1]) / scale) ** 2
        self._raise_to(factor)
        largest = abreast.add_weights(
            self.weight, R, width, self.by_size, log_factor=factor - self.level, needs=self.needs
        )
        found = self.level + math.log(largest) if largest > 0.0 else -math.inf
        self.height = max(self.height, found)
        return found

    def _raise_to(self, factor: float) -> None:
        """Take another level where the sums would not hold what comes."""
        if math.isnan(self.level):
            self.level = factor
        if factor > self.level + FAR:
            self.weight *= math.exp(max(self.level - factor, -700.0))
            self.level = factor

    @property
    def trusted(self) -> bool:
        """Whether the models that matter are far from what a number cannot hold."""
        from imubayes.selection.abreast import DEEPEST

        return self.held and self.height > self.level + DEEPEST


@dataclass(slots=True, eq=False)
class Logs:
    """The same sums by logarithms, one tree at a time: an order slower, and never out of range."""

    candidates: Candidates
    by_size: FloatArray
    needs: Needs
    weight: FloatArray = field(init=False)
    log_prior: FloatArray = field(init=False)
    level: float = -math.inf
    trusted: bool = True

    def __post_init__(self) -> None:
        p = len(self.candidates.names)
        self.weight, self.log_prior = np.zeros(1 << p), self.by_size[sizes(p)]
        if self.needs:
            self.log_prior[~admissible(p, self.needs)] = -math.inf

    @property
    def height(self) -> float:
        """Largest logarithm so far."""
        return self.level

    def add(self, scale: float) -> float:
        """Add every model at a noise scale; return the largest logarithm."""
        logs = log_joint(self.candidates, scale) + self.log_prior
        found = float(logs.max())
        if found > self.level:
            self.weight *= math.exp(self.level - found)
            self.level = found
        self.weight += np.exp(logs - self.level)
        return found


def ways(c: Candidates, by_size: FloatArray, needs: Needs) -> Iterator[Products | Logs]:
    """Sums to try, one after the other: the last ones are always to be trusted."""
    from imubayes.selection.abreast import FEWEST

    if len(c.names) >= FEWEST:
        yield Products(c, by_size, needs)
    yield Logs(c, by_size, needs)


def log_joint(c: Candidates, scale: float) -> FloatArray:
    """Log p(data | model, scale) of every model, for theta_j ~ N(0, sd_j^2)."""
    from imubayes.selection.tree import walk

    a, T = len(c.always), c.at(scale)
    rss, log_det = walk(np.ascontiguousarray(T[a:, a:]))
    log_rows = np.zeros(1)
    for width in np.log(scale / c.sd[a:]):
        log_rows = np.concatenate((log_rows, log_rows + width))
    return log_flat(c, T, scale) - rss / (2.0 * scale**2) - log_det + log_rows
