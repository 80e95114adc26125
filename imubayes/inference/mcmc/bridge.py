"""Evidence by bridge sampling: the integral under a density whose samples are known.

Meng and Wong (Statistica Sinica 6, 1996): with N1 samples of the target p and N2 of a normal distribution q
that was fitted to other samples of p, the evidence r is the fixed point of
``r = mean_q[l/(s1 l + s2 r)] / mean_p[1/(s1 l + s2 r)]``, ``l = p/q``, ``s1 = N1/(N1 + N2)``.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from imubayes.algebra.arrays import FloatArray

TURNS = 200
"""Most fixed-point steps; ten are usual."""

SETTLED = 1e-10
"""Change of the log evidence at which the fixed point is reached."""


def log_evidence(
    samples: FloatArray,
    log_prob: FloatArray,
    density: Callable[[FloatArray], FloatArray],
    *,
    tau: float,
    rng: np.random.Generator,
) -> tuple[float, float]:
    """Log of the integral of a density, and its Monte Carlo standard error.

    Parameters
    ----------
    samples : (m, d) draws from the density, in the order in which they were drawn.
    log_prob : (m,) its logarithm there.
    density : its logarithm elsewhere: (k, d) -> (k,).
    tau : autocorrelation time of the draws: so many of them count as one.
    rng : of the normal distribution's draws.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> x = rng.standard_normal((4000, 2))
    >>> value, error = log_evidence(x, -0.5 * (x**2).sum(1), lambda x: -0.5 * (x**2).sum(1), tau=1.0, rng=rng)
    >>> abs(value - math.log(2.0 * math.pi)) < 4.0 * error + 1e-9
    True
    """
    half = len(samples) // 2
    fitted, kept = samples[:half], samples[half:]
    center = fitted.mean(axis=0)
    L = np.asarray(np.linalg.cholesky(np.atleast_2d(np.cov(fitted.T))), dtype=float)
    drawn = center + rng.standard_normal(kept.shape) @ L.T
    own = log_prob[half:] - _log_normal(kept, center, L)
    other = density(drawn) - _log_normal(drawn, center, L)
    effective = len(kept) / tau
    s1 = effective / (effective + len(drawn))
    middle = float(np.median(own))
    return _fixed_point(own - middle, other - middle, s1, effective, middle)


def _fixed_point(
    own: FloatArray, other: FloatArray, s1: float, effective: float, middle: float
) -> tuple[float, float]:
    l1, l2 = np.exp(np.clip(own, -700.0, 700.0)), np.exp(np.clip(other, -700.0, 700.0))
    log_r = 0.0
    for _ in range(TURNS):
        r = math.exp(log_r)
        new = math.log(np.mean(l2 / (s1 * l2 + (1.0 - s1) * r)) / np.mean(1.0 / (s1 * l1 + (1.0 - s1) * r)))
        log_r, moved = new, abs(new - log_r)
        if moved < SETTLED:
            break
    r = math.exp(log_r)
    above, below = l2 / (s1 * l2 + (1.0 - s1) * r), r / (s1 * l1 + (1.0 - s1) * r)
    variance = (
        np.var(above) / np.mean(above) ** 2 / len(above) + np.var(below) / np.mean(below) ** 2 / effective
    )
    return log_r + middle, math.sqrt(float(variance))


def _log_normal(x: FloatArray, center: FloatArray, L: FloatArray) -> FloatArray:
    z = np.linalg.solve(L, (x - center).T)
    return (
        -0.5 * np.sum(z**2, axis=0)
        - float(np.sum(np.log(np.diag(L))))
        - 0.5 * len(center) * math.log(2.0 * math.pi)
    )
