"""Importance sampling with Student's t, and the integral under a density whose samples are known.

The draws go on until enough of them count. The proposal begins with humps that are given. Where a draw weighs
most the proposal is too thin: a hump is added there, shaped like the weighted draws nearest to it. All draws
of all rounds are kept, and weighed by the whole mixture: incremental mixture importance sampling (Raftery and
Bao, Biometrics 66 (2010) 1162).

The integral is by bridge sampling (Meng and Wong, Statistica Sinica 6, 1996): with N1 samples of the target p
and N2 of a normal distribution q that was fitted to other samples of p, it is the fixed point of
``r = mean_q[l/(s1 l + s2 r)] / mean_p[1/(s1 l + s2 r)]``, ``l = p/q``, ``s1 = N1/(N1 + N2)``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from imubayes.algebra import FloatArray, IntArray

BATCH = 64
"""Draws of each hump, and neighbours that shape a new one."""

MOST = 48
"""Most humps: what is left thin then has a weight that more draws would hardly mend."""

FREEDOM = 5.0
"""Degrees of freedom of a hump: tails heavier than a posterior's."""

ROUND = 0.05
"""Share of the first hump's covariance that a new one has at least: no hump is flat."""


@dataclass(frozen=True, slots=True, eq=False)
class Student:
    """Multivariate Student distribution about a center (d,); the square of L (d, d) is the scale matrix."""

    center: FloatArray
    L: FloatArray
    freedom: float = FREEDOM

    def draw(self, size: int, random: Any) -> FloatArray:
        """Draws (size, d); `random` has numpy's `standard_normal` and `chisquare`."""
        z = random.standard_normal((size, len(self.center)))
        return (
            self.center + (z / np.sqrt(random.chisquare(self.freedom, (size, 1)) / self.freedom)) @ self.L.T
        )

    def draw_evenly(self, size: int, rng: np.random.Generator) -> FloatArray:
        """Draws (size, d) of which each coordinate has one from every slice of equal probability."""
        from scipy.special import ndtri

        d = len(self.center)
        slices = np.argsort(rng.random((d, size)), axis=1).T
        z = ndtri((slices + rng.random((size, d))) / size)
        z *= np.sqrt(self.freedom / rng.chisquare(self.freedom, size))[:, None]
        return self.center + z @ self.L.T

    def share(self, x: FloatArray) -> FloatArray:
        """How much points (m, d) count in a fit (m,): those far out, where tails are heavy, count less."""
        z = np.linalg.solve(self.L, (x - self.center).T)
        return (self.freedom + len(z)) / (self.freedom + np.sum(z * z, axis=0))

    def log_density(self, x: FloatArray) -> FloatArray:
        """Logarithm of the density (m,) at points (m, d)."""
        d, freedom = len(self.center), self.freedom
        z = np.linalg.solve(self.L, (x - self.center).T)
        level = math.lgamma(0.5 * (freedom + d)) - math.lgamma(0.5 * freedom)
        level -= 0.5 * d * math.log(freedom * math.pi) + float(np.sum(np.log(np.diag(self.L))))
        return level - 0.5 * (freedom + d) * np.log1p(np.sum(z * z, axis=0) / freedom)


@dataclass(frozen=True, slots=True, eq=False)
class Mixture:
    """Humps (h) that count by their `share` (h,), which adds up to 1."""

    humps: tuple[Student, ...]
    share: FloatArray

    def draw(self, size: int, random: Any) -> FloatArray:
        """Draws (size, d); `random` has numpy's `choice`, too."""
        drawn = np.array([hump.draw(size, random) for hump in self.humps])
        return drawn[random.choice(len(self.humps), size, p=self.share), np.arange(size)]

    def log_densities(self, x: FloatArray) -> FloatArray:
        """What each hump (h, m) has of the density at points (m, d), as logarithms."""
        return np.array([h.log_density(x) for h in self.humps]) + np.log(self.share)[:, None]

    def log_density(self, x: FloatArray) -> FloatArray:
        """Logarithm of the density (m,) at points (m, d)."""
        return np.logaddexp.reduce(self.log_densities(x), axis=0)


class MixtureDraws(NamedTuple):
    """Draws (m, k), what the target said of each, (m, q), and the log density (m,) of the proposal there.

    The first column of what the target said is its log density. Of each of the `humps` there are as many.
    """

    draws: FloatArray
    told: FloatArray
    log_proposal: FloatArray
    humps: tuple[Student, ...]

    @property
    def weights(self) -> FloatArray:
        """Weights (m,) that add up to 1."""
        logs = self.told[:, 0] - self.log_proposal
        weights = np.exp(logs - logs.max())
        return np.asarray(weights / weights.sum(), dtype=np.float64)

    @property
    def effective(self) -> float:
        """Effective number of draws."""
        return 1.0 / float(self.weights @ self.weights)

    @property
    def log_integral(self) -> float:
        """Logarithm of the integral of the target."""
        logs = self.told[:, 0] - self.log_proposal
        return float(np.logaddexp.reduce(logs)) - math.log(len(logs))


def drawn_until(
    target: Callable[[FloatArray], Sequence[float]],
    begin: Sequence[Student] | MixtureDraws,
    width: FloatArray,
    rng: np.random.Generator,
    *,
    enough: float,
    dear: tuple[int, int] | None = None,
) -> MixtureDraws:
    """Draw from a density, beginning with humps, or with draws of it, until `enough` effective ones count.

    The target gives, at a point (k,), the log density up to a constant and what else is kept of the point;
    `width` (k,) are sizes that make distances along the axes alike. Where it is `dear`, so many draws are
    taken of a hump, evenly, of so many humps at most.
    """
    batch, most = dear or (BATCH, MOST)
    points, told = list[FloatArray](), list[FloatArray]()
    parts = [*(begin.humps if isinstance(begin, MixtureDraws) else begin)]
    if isinstance(begin, MixtureDraws):
        points, told = np.split(begin.draws, len(parts)), np.split(begin.told, len(parts))
    while True:
        for part in parts[len(points) :]:
            points.append(part.draw_evenly(batch, rng) if dear else part.draw(batch, rng))
            told.append(np.array([target(x) for x in points[-1]], dtype=float))
        draws = np.concatenate(points)
        whole = Mixture(tuple(parts), np.full(len(parts), 1.0 / len(parts)))
        drawn = MixtureDraws(draws, np.concatenate(told), whole.log_density(draws), whole.humps)
        if drawn.effective >= enough or len(parts) >= most:
            return drawn
        # where a draw weighs most, of the shape of the weighted draws nearest to it
        weights = drawn.weights
        center = draws[np.argmax(weights)]
        apart = draws - center
        near = np.argsort(np.sum((apart / width) ** 2, axis=1))[:batch]
        share = weights[near] + 1.0 / len(weights)
        covariance = (apart[near] * (share / share.sum())[:, None]).T @ apart[near]
        parts.append(Student(center, np.linalg.cholesky(covariance + ROUND * parts[0].L @ parts[0].L.T)))


TURNS = 200
"""Most fixed-point steps; ten are usual."""

SETTLED = 1e-10
"""Change of the log evidence at which the fixed point is reached."""


def log_integral(
    samples: FloatArray,
    log_prob: FloatArray,
    density: Callable[[FloatArray], FloatArray],
    *,
    tau: float,
    rng: np.random.Generator,
) -> tuple[float, float]:
    """Log of the integral of a density, and its Monte Carlo standard error.

    `samples` (m, d) are draws from it, in the order in which they were drawn, where its logarithm is
    `log_prob` (m,); elsewhere `density` gives that, (k, d) -> (k,). Of the draws, `tau` count as one.
    """
    half = len(samples) // 2
    fitted, kept = samples[:half], samples[half:]
    center = fitted.mean(axis=0)
    L = np.asarray(np.linalg.cholesky(np.atleast_2d(np.cov(fitted.T))), dtype=float)
    z = rng.standard_normal(kept.shape)
    drawn = center + z @ L.T
    level = -float(np.sum(np.log(np.diag(L)))) - 0.5 * len(L) * math.log(2.0 * math.pi)
    around = np.linalg.solve(L, (kept - center).T)
    own = log_prob[half:] + 0.5 * np.sum(around**2, axis=0) - level
    other = density(drawn) + 0.5 * np.sum(z**2, axis=1) - level
    effective = len(kept) / tau
    s1 = effective / (effective + len(drawn))
    middle, log_r = float(np.median(own)), 0.0
    l1, l2 = (np.exp(np.clip(logs - middle, -700.0, 700.0)) for logs in (own, other))
    for _ in range(TURNS):
        r = math.exp(log_r)
        new = math.log(np.mean(l2 / (s1 * l2 + (1.0 - s1) * r)) / np.mean(1.0 / (s1 * l1 + (1.0 - s1) * r)))
        log_r, moved = new, abs(new - log_r)
        if moved < SETTLED:
            break
    r = math.exp(log_r)
    above, below = l2 / (s1 * l2 + (1.0 - s1) * r), r / (s1 * l1 + (1.0 - s1) * r)
    variance = np.var(above) / np.mean(above) ** 2 / len(above)
    variance += np.var(below) / np.mean(below) ** 2 / effective
    return log_r + middle, math.sqrt(float(variance))


def picked(weight: FloatArray, chance: FloatArray) -> IntArray:
    """Numbers (k,) of what has these weights (m,), picked by numbers from 0 to 1 (k,)."""
    sums = np.cumsum(weight)
    return np.minimum(np.searchsorted(sums, chance * sums[-1], side="right"), len(sums) - 1)
