"""Proposals that fit the problem: noise from a fitted Student distribution, coefficients exactly.

The proposal does not depend on where a walker is. Given the noise the coefficients come from their exact
conditional posterior, so that they cancel from the acceptance, which is as good as the fit to the noise's own
posterior, in few dimensions.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.errors import ConvergenceError
from imubayes.inference.importance import Student
from imubayes.inference.mcmc.density import (
    Density,
    conditioner,
    draw_conditional,
    log_conditional,
    log_marginal,
)

TAIL = 6.0
"""Degrees of freedom of the Student distribution: its tails are heavier than the posterior's."""

SAMPLE = 2000
"""Points of each round of the fit."""

ROUNDS = 40
"""Most rounds of the fit by importance sampling; three or four are usual."""

GOOD = 0.5
"""Share of the points that must count for the fit to be good enough."""

SETTLED = 1.1
"""Growth of that share below which a round made nothing better: in many dimensions few points ever count."""

FEWEST = 10.0
"""Points for each dimension that must count for their covariance to be of use."""

STEPS = 60
"""Powers that are tried, from 1 to a thousandth."""

FLOOR = 1e-3
"""Smallest sd of the fit relative to the prior's."""


def fit_noise(density: Density, start: FloatArray, sd: FloatArray, rng: np.random.Generator) -> Student:
    """Student distribution with the moments of the noise's posterior, by repeated importance sampling.

    Parameters
    ----------
    density : of the problem.
    start, sd : (d,) logarithms to start from, and how far to look.
    rng : of the points.

    Raises
    ------
    ConvergenceError : if no noise that was looked at has any probability.
    """
    q, before = Student(_maximum(density, start, sd), np.diag(sd), TAIL), 0.0
    for _ in range(ROUNDS):
        x = q.draw(SAMPLE, rng)
        log_weight = log_marginal(density, x) - q.log_density(x)
        if not np.isfinite(log_weight).any():
            raise ConvergenceError(
                "the noise of the runs cannot be told together: by themselves they agree with none that suits"
                " all; look at the residuals with the method exact",
                dict(zip(density.parameters, np.exp(q.center).tolist(), strict=True)),
            )
        weight, power = _tempered(log_weight, FEWEST * x.shape[1])
        count = 1.0 / float(np.sum(weight**2))
        center = weight @ x
        spread = ((x - center) * weight[:, None]).T @ (x - center)
        # where even so too few count, keep some of the covariance before
        enough = min(count / (FEWEST * x.shape[1]), 1.0)
        spread = enough * spread + (1.0 - enough) * q.L @ q.L.T
        q = Student(center, np.linalg.cholesky(spread + np.diag((FLOOR * density.width) ** 2)), TAIL)
        if power == 1.0 and (count > GOOD * SAMPLE or count < SETTLED * before):
            break
        before = count if power == 1.0 else 0.0
    return q


def _tempered(log_weight: FloatArray, fewest: float) -> tuple[FloatArray, float]:
    """Weights (m,) to a power of at most 1, so small that at least so many points count; and the power.

    Few points that count give a poor covariance; the power leads there step by step.
    """
    log_weight = log_weight - log_weight.max()

    def weights(power: float) -> FloatArray:
        found = np.exp(power * log_weight)
        return found / found.sum()

    powers = np.geomspace(1.0, 1e-3, STEPS)
    power = next((p for p in powers.tolist() if 1.0 / np.sum(weights(p) ** 2) >= fewest), 1e-3)
    return weights(power), power


def _maximum(density: Density, start: FloatArray, sd: FloatArray) -> FloatArray:
    """Noise (d,) at the maximum of the posterior, or near it."""
    from scipy.optimize import minimize

    corners = start + np.vstack((np.zeros(len(start)), np.diag(sd)))
    options = {"initial_simplex": corners, "xatol": 1e-2, "fatol": 0.1, "maxiter": 100 * len(start)}

    def cost(x: FloatArray) -> float:
        return -float(np.nan_to_num(log_marginal(density, x[None])[0], neginf=-1e300))

    return minimize(cost, start, method="Nelder-Mead", options=options).x


def independent(density: Density, q: Student):
    """Proposal of noise and coefficients at once, for emcee's Metropolis-Hastings move in (phi, x).

    Returns
    -------
    function of (random, coordinates (m, p + d)), in emcee's order: (new coordinates, log q(old)/q(new)).
    """
    given = conditioner(density)

    def log_q(phi: FloatArray, x: FloatArray) -> FloatArray:
        return log_conditional(given(x), phi) + (q.log_density(x) if density.d else 0.0)

    def propose(coords: FloatArray, random: Any) -> tuple[FloatArray, FloatArray]:
        x = q.draw(len(coords), random) if density.d else np.empty((len(coords), 0))
        phi = draw_conditional(given(x), random.standard_normal((len(coords), density.p)))
        old = log_q(coords[:, : density.p], coords[:, density.p :])
        return np.column_stack((phi, x)), old - log_q(phi, x)

    return propose


def independent_noise(q: Student):
    """Proposal of the noise alone, for the collapsed sampler in x."""

    def propose(coords: FloatArray, random: Any) -> tuple[FloatArray, FloatArray]:
        x = q.draw(len(coords), random)
        return x, q.log_density(coords) - q.log_density(x)

    return propose
