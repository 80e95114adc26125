"""One log density for both samplers, of coefficients phi and logarithms x of the noise, and what proposes.

With A(x) the Gram matrix of all rows and of the prior's rows, in blocks ``[[A, b], [b', c]]``::

    log p(y, phi, x) = log p(x) - (log det C(x) + n log 2 pi)/2 + log p0 - (c - 2 b'phi + phi'A phi)/2

and with the coefficients integrated out ``(c - b'A^-1 b + log det A)/2`` stands in the place of the last term
(p0 is the prior's normalisation). Both come from one Cholesky factor of the whole matrix.

The proposal does not depend on where a walker is: noise comes from a fitted mixture of two humps. Given the
noise the coefficients come from their exact conditional posterior, so that they cancel from the acceptance,
which is as good as the fit to the noise's own posterior, in few dimensions.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import FloatArray
from imubayes.algebra.factor import row_blocks
from imubayes.errors import ConvergenceError
from imubayes.inference.importance import Mixture, Student
from imubayes.inference.linear import Linear
from imubayes.inference.mcmc import places_of
from imubayes.inference.mcmc.split import Coordinates, coordinates, packed_of, roots, unpacked
from imubayes.inference.mcmc.whitenings import Whitenings, fixed_whitening, grams, whitenings
from imubayes.inference.summary import Summary

AT_ONCE = 128
"""Noises whose matrices are held at a time."""


@dataclass(frozen=True, slots=True, eq=False)
class Density:
    """Posterior of one component, up to no constant.

    Its coefficients are of p columns, of prior sds (p,); its d noise parameters, such as ``N.tumble``, have a
    normal prior of their logarithms about `center` (d,), of the sds `width` (d,). Of every run `places` says
    where in x its ln N, ln B, ln K are; None where its noise is known.
    """

    coordinates: Coordinates
    names: tuple[str, ...]
    sd: FloatArray
    runs: tuple[Whitenings, ...]
    places: tuple[slice | None, ...]
    parameters: tuple[str, ...]
    center: FloatArray
    width: FloatArray

    @property
    def p(self) -> int:
        """Number of coefficients."""
        return len(self.names)

    @property
    def d(self) -> int:
        """Number of noise parameters."""
        return len(self.parameters)

    def log_prior(self, x: FloatArray) -> FloatArray:
        """Log p(x) (m,) of logarithms of the noise (m, d)."""
        level = -0.5 * np.sum(((x - self.center) / self.width) ** 2, axis=1)
        return level - (float(np.sum(np.log(self.width))) + 0.5 * self.d * math.log(2.0 * math.pi))


class Conditional(NamedTuple):
    """The normal posterior of phi given m noises: Cholesky factors, and what does not depend on phi.

    L (m, p + 1, p + 1) are lower triangular, of the Gram matrix with the response last; `base` (m,) is the
    log density without the quadratic form and log det A.
    """

    L: FloatArray
    base: FloatArray

    @property
    def log_det(self) -> FloatArray:
        """(m,) log det A."""
        return 2.0 * np.sum(np.log(np.diagonal(self.L, axis1=1, axis2=2)[:, :-1]), axis=1)


def density_of(summary: Summary, rows: Sequence[Linear], sd: FloatArray, rng: np.random.Generator) -> Density:
    """Prepare the log density of runs and their rows; sd (p,) are the prior sds of all columns."""
    c, made, places = coordinates(summary.factor, sd), dict[str, Whitenings](), places_of(summary.runs)
    # runs that share their noise are on the same grid
    for name in dict.fromkeys(run.noise_run for run in summary.runs):
        pairs = [(r, s) for r, s in zip(rows, summary.runs, strict=True) if s.noise_run == name]
        if len(pairs[0][1].found.steering) == 3:
            whitened = whitenings([r for r, _ in pairs], [s for _, s in pairs], c, rng)
        else:
            whitened = tuple(fixed_whitening(s, c) for _, s in pairs)
        made |= {s.name: whitening for (_, s), whitening in zip(pairs, whitened, strict=True)}
    steering = {run.noise_run: run.found.steering for run in reversed(summary.runs)}
    prior = [(math.log(median), spread) for name in places for median, spread in steering[name].values()]
    names = [f"{name}.{run}" for run in places for name in steering[run]]
    center, width = np.array(prior).reshape(-1, 2).T
    return Density(
        coordinates=c,
        names=summary.factor.names,
        sd=sd,
        runs=tuple(made[run.name] for run in summary.runs),
        places=tuple(places[run.noise_run] if run.found.steering else None for run in summary.runs),
        parameters=tuple(names),
        center=center,
        width=width,
    )


def condition(density: Density, x: FloatArray) -> Conditional:
    """Condition on m noises x (m, d), logarithms; `base` is -inf where they are beyond what was computed.

    Where nothing of the noise is unknown, one condition stands for all m.
    """
    c, m = density.coordinates, min(len(x), 1) if density.d == 0 else len(x)
    x = x[:m]
    packed = np.repeat(packed_of(c.prior)[None], m, axis=0)
    base = density.log_prior(x)
    base += c.log_volume - float(np.sum(np.log(density.sd))) - 0.5 * density.p * math.log(2.0 * math.pi)
    for run, places in zip(density.runs, density.places, strict=True):
        noise = np.zeros((m, 1)) if places is None else x[:, places]
        gram, log_det, inside = grams(run, noise)
        packed += gram
        base -= 0.5 * (log_det + run.n * math.log(2.0 * math.pi))
        base = np.where(inside, base, -np.inf)
    A = unpacked(packed)
    A[~np.isfinite(base)] = np.eye(len(c.prior))
    L, sound = roots(A)
    return Conditional(L, np.where(sound, base, -np.inf))


def in_parts(found: Callable[..., FloatArray], *of: FloatArray) -> FloatArray:
    """What is found (m, ...) of arrays (m, ...), of `AT_ONCE` rows at a time."""
    blocks = row_blocks(max(len(of[0]), 1), AT_ONCE)
    return np.concatenate([found(*(one[i:j] for one in of)) for i, j in blocks])


def log_marginal(density: Density, x: FloatArray) -> FloatArray:
    """Log p(y, x) (m,), the coefficients integrated out."""

    def found(x: FloatArray) -> FloatArray:
        given = condition(density, x)
        rest = given.L[:, -1, -1] ** 2 + given.log_det
        return given.base - 0.5 * rest + 0.5 * density.p * math.log(2.0 * math.pi)

    return in_parts(found, x)


def log_joint(density: Density, phi: FloatArray, x: FloatArray) -> FloatArray:
    """Log p(y, phi, x) (m,) of coefficients phi (m, p), in the coordinates of the density."""

    def found(phi: FloatArray, x: FloatArray) -> FloatArray:
        given = condition(density, x)
        return given.base - 0.5 * (given.L[:, -1, -1] ** 2 + np.sum(_standard(given, phi) ** 2, axis=1))

    return in_parts(found, phi, x)


def log_conditional(given: Conditional, phi: FloatArray) -> FloatArray:
    """Log p(phi | y, x) (m,)."""
    z = _standard(given, phi)
    return 0.5 * (given.log_det - np.sum(z**2, axis=1) - z.shape[1] * math.log(2.0 * math.pi))


def draw_conditional(given: Conditional, z: FloatArray) -> FloatArray:
    """Coefficients phi (m, p) from standard normal z (m, p): an exact draw for each noise."""
    upper = np.swapaxes(given.L[:, :-1, :-1], 1, 2)
    if len(upper) == 1:
        return np.asarray(np.linalg.solve(upper[0], (z + given.L[:, -1, :-1]).T).T, dtype=float)
    solved = np.linalg.solve(upper, (z + given.L[:, -1, :-1])[:, :, None])[:, :, 0]
    return np.asarray(solved, dtype=float)


def theta_of(density: Density, phi: FloatArray) -> FloatArray:
    """Coefficients in SI of phi (..., p)."""
    return density.coordinates.origin + phi @ density.coordinates.inverse.T


def _standard(given: Conditional, phi: FloatArray) -> FloatArray:
    """L'phi - z: standard normal under the conditional posterior."""
    if len(given.L) == 1:
        return phi @ given.L[0, :-1, :-1] - given.L[:, -1, :-1]
    return np.einsum("mji,mj->mi", given.L[:, :-1, :-1], phi) - given.L[:, -1, :-1]


TAIL = 6.0
"""Degrees of freedom of the Student distribution: its tails are heavier than the posterior's."""

SAMPLE = 2000
"""Points of each round of the fit."""

ROUNDS = 40
"""Most rounds of the fit by importance sampling; three or four are usual."""

GOOD = 0.5
"""Share of the points that must count for the fit to be good enough."""

SETTLED = 1.1
"""Growth of that share, or of the power before, below which a round made nothing better: in many dimensions
few points ever count."""

IDLE = 2
"""Such rounds after which it ends: one alone may have met what all rounds before it missed."""

FEWEST = 10.0
"""Points for each dimension that must count for their covariance to be of use."""

STEPS = 60
"""Powers that are tried, from 1 to a thousandth."""

FLOOR = 1e-3
"""Smallest sd of the fit relative to the prior's."""

LEAST = 0.05
"""Share that a hump has at least: it may be all that goes where the others do not."""

AROUND = np.linspace(-2.5, 2.5, 11)
"""Places at which B and K of a run are looked at before, in sds of their prior."""


def fit_noise(density: Density, start: FloatArray, sd: FloatArray, rng: np.random.Generator) -> Mixture:
    """Mixture of Student distributions nearest to the noise's posterior p, by repeated importance sampling.

    It has the largest mean log density over p, by expectation maximization: far points count
    ``(freedom + d)/(freedom + z'z)`` times for a hump (Cappe et al., Statistics and Computing 18, 2008).

    One hump starts from logarithms `start` (d,), and looks as far as `sd` (d,); another one looks all over
    the prior of B and K. It is a `ConvergenceError` if no noise that was looked at has any probability.
    """
    humps = (Student(start, np.diag(sd), TAIL), *_around(density, start, sd))
    q, best, idle = Mixture(humps, np.full(len(humps), 1.0 / len(humps))), 0.0, 0
    floor = np.diag((FLOOR * density.width) ** 2)
    for _ in range(ROUNDS):
        x = q.draw(SAMPLE, rng)
        logs = q.log_densities(x)
        log_q = np.logaddexp.reduce(logs, axis=0)
        log_weight = log_marginal(density, x) - log_q
        if not np.isfinite(log_weight).any():
            raise ConvergenceError(
                "the noise of the runs cannot be told together: by themselves they agree with none that suits"
                " all; look at the residuals with the method exact",
                dict(zip(density.parameters, np.exp(start).tolist(), strict=True)),
            )
        weight, power = _tempered(log_weight, FEWEST * x.shape[1])
        own = weight * np.exp(logs - log_q)
        humps = tuple(_moved(hump, x, w, floor) for hump, w in zip(q.humps, own, strict=True))
        share = np.maximum(own.sum(axis=1), LEAST)
        q = Mixture(humps, share / share.sum())
        reached = 1.0 / float(np.sum(weight**2)) if power == 1.0 else power
        best, idle = max(best, reached), 0 if reached > SETTLED * best else idle + 1
        if reached > GOOD * SAMPLE or idle == IDLE:
            break
    return q


def _moved(hump: Student, x: FloatArray, weight: FloatArray, floor: FloatArray) -> Student:
    """Hump nearest to weighted points; where too few count, between that and where it was."""
    share = float(weight.sum())
    if share < np.finfo(float).tiny:
        return hump
    weight = weight / share
    less = weight * hump.share(x)
    center = less @ x / less.sum()
    spread = ((x - center) * less[:, None]).T @ (x - center)
    enough = min(1.0 / (float(np.sum(weight**2)) * FEWEST * x.shape[1]), 1.0)
    center = enough * center + (1.0 - enough) * hump.center
    spread = enough * spread + (1.0 - enough) * hump.L @ hump.L.T
    return Student(center, np.linalg.cholesky(spread + floor), TAIL)


def _around(density: Density, start: FloatArray, sd: FloatArray) -> tuple[Student, ...]:
    """Hump with B and K of each run as they are all over their prior; none where nothing differs."""
    mean, spread = start.copy(), sd.copy()
    coloured = [at for at in density.places if at is not None and at.stop > at.start + 1]
    for places in {at.start: at for at in coloured}.values():
        pair = np.arange(places.start + 1, places.stop)
        prior = np.column_stack((density.center[pair], density.width[pair]))
        mean[pair], spread[pair] = over_prior(partial(log_marginal, density), start, sd[pair], prior, pair)
    return () if np.array_equal(mean, start) else (Student(mean, np.diag(spread), TAIL),)


def over_prior(
    log_posterior: Callable[[FloatArray], FloatArray],
    start: FloatArray,
    sd: FloatArray,
    prior: FloatArray,
    pair: NDArray[np.intp],
) -> tuple[FloatArray, FloatArray]:
    """Means and sds (2,) of B and K of a run over all of their `prior` (2, 2), the others being as they are.

    Bias instability passes for a random walk, and the other way round: beside a maximum with the one, of
    which the curvature tells the `sd` (2,), there may be much of the posterior with the other. The log
    posterior (m,) is that of logarithms (m, d), `start` (d,) is its maximum, where it has the `pair`.
    """
    tried = np.vstack((prior[:, 0] + prior[:, 1] * AROUND[:, None], start[pair]))
    x = np.tile(start, (len(tried) ** 2, 1))
    x[:, pair] = [*product(*tried.T)]
    log_weight = log_posterior(x)
    if not np.isfinite(log_weight).any():
        return start[pair], sd
    weight = _weights(log_weight)
    mean = weight @ x[:, pair]
    return mean, np.maximum(sd, np.sqrt(weight @ (x[:, pair] - mean) ** 2))


def _weights(log_weight: FloatArray, power: float = 1.0) -> FloatArray:
    """Weights (m,) to a power, of sum 1."""
    found = np.exp(power * (log_weight - log_weight.max()))
    return found / found.sum()


def _tempered(log_weight: FloatArray, fewest: float) -> tuple[FloatArray, float]:
    """Weights (m,) to a power of at most 1, so small that at least so many points count; and the power.

    Few points that count give a poor covariance; the power leads there step by step.
    """
    powers = np.geomspace(1.0, 1e-3, STEPS).tolist()
    power = next((p for p in powers if 1.0 / np.sum(_weights(log_weight, p) ** 2) >= fewest), 1e-3)
    return _weights(log_weight, power), power


def independent(density: Density, q: Student | Mixture):
    """Proposal of noise and coefficients at once, for emcee's Metropolis-Hastings move in (phi, x).

    Of coordinates (m, p + d) it gives new ones, and log q(old)/q(new).
    """

    def log_q(given: Conditional, phi: FloatArray, x: FloatArray) -> FloatArray:
        return log_conditional(given, phi) + (q.log_density(x) if density.d else 0.0)

    def propose(coords: FloatArray, random: Any) -> tuple[FloatArray, FloatArray]:
        x = q.draw(len(coords), random) if density.d else np.empty((len(coords), 0))
        given = condition(density, x)
        phi = draw_conditional(given, random.standard_normal((len(coords), density.p)))
        before, at = np.hsplit(coords, [density.p])
        old = log_q(condition(density, at), before, at)
        return np.column_stack((phi, x)), old - log_q(given, phi, x)

    return propose


def independent_noise(q: Student | Mixture):
    """Proposal of the noise alone, for the collapsed sampler in x."""

    def propose(coords: FloatArray, random: Any) -> tuple[FloatArray, FloatArray]:
        x = q.draw(len(coords), random)
        return x, q.log_density(coords) - q.log_density(x)

    return propose
