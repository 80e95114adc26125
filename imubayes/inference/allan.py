"""Overlapping Allan deviation of a record with gaps, and the sizes of the noise processes by a fit of it.

Neighbouring averaging times share their data, so the logarithms of the Allan variance are correlated, and
inverse variances alone would claim too much. For a stationary record the estimate at tau is a sum over the
periodogram, ``sum_f I(f) H(f, tau)``, ``H = 2 sin^4(pi f tau) / (pi f tau)^2``, and so ::

    Cov(ln A1, ln A2) = sum_f S^2 H1 H2 / (sum_f S H1  sum_f S H2)

over the Fourier frequencies. Generalized least squares with this covariance is nearly as sharp as the
likelihood, and blind to other faults than it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import FloatArray
from imubayes.inference.noise_fit import Spectrum, density
from imubayes.rig.inputs import between_gaps
from imubayes.sensors.noise import Sizes, allan_variance, shares

EVERY = 4096
"""Fourier frequencies that are all taken; above them as many stand for their neighbours."""

SLOPES = {"Q": 2, "N": 0, "B": -1, "G": -1, "K": -2, "R": -2}
"""Power of the frequency in each density; a Gauss-Markov process is between white and random walk."""

LEAST = 1e-2
"""Share of the correlation's largest eigenvalue that is added to its diagonal: differences of neighbouring
averaging times, known far better than either, would else judge the approximations of the curve."""


@dataclass(frozen=True, slots=True, eq=False)
class AllanCurve:
    """Allan deviation (k,), SI, of a record at tau (k,), s, beside that of processes, by symbol and together.

    The truth lies between `low` and `high` (k,) with 90 %.
    """

    tau: FloatArray
    deviation: FloatArray
    low: FloatArray
    high: FloatArray
    shares: dict[str, FloatArray]
    fitted: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class AllanFit:
    """Sizes by the weighted fit of the Allan variance: their names, values, SI, and sds of their logarithms.

    `chi2` is the weighted sum of squares, which has `dof` degrees of freedom.
    """

    names: tuple[str, ...]
    values: tuple[float, ...]
    log_sd: tuple[float, ...]
    chi2: float
    dof: int


def allan_curve(y: FloatArray, t: FloatArray, interval: float, noise: Sizes) -> AllanCurve | None:
    """Allan deviation of a record with its confidence, beside the processes; None for too short a record.

    The record is residuals y (n,), SI, at times t (n,), s. The processes of `noise` say how many degrees of
    freedom the data have.
    """
    tau, deviation = allan_deviation(y, t, interval)
    if not len(tau) or not (deviation > 0.0).all():
        return None
    parts = shares(noise, tau)
    largest = [max(parts, key=lambda name, k=k: parts[name][k]) for k in range(len(tau))]
    longest = max(b - a for a, b in between_gaps(t, interval))
    slopes = np.array([SLOPES[name] for name in largest])
    low, high = confidence_band(tau, deviation, slopes, (longest, interval))
    return AllanCurve(
        tau=tau,
        deviation=deviation,
        low=low,
        high=high,
        shares={name: np.sqrt(part) for name, part in parts.items()},
        fitted=np.sqrt(allan_variance(noise, tau)),
    )


def log_covariance(noise: Sizes, tau: FloatArray, record: tuple[int, float]) -> FloatArray:
    """Covariance (k, k) of the logarithms of the overlapping Allan variance at tau (k,), s.

    `record` is (samples, interval in s) of the gapless record; a ramp of its noise has no part in it.
    """
    samples, interval = record
    k = np.arange(1, samples // 2 + 1)
    if len(k) > 2 * EVERY:
        k = np.unique(np.concatenate((k[:EVERY], np.rint(np.geomspace(EVERY, len(k), EVERY)).astype(int))))
    count = np.diff(np.append(k, k[-1] + 1)).astype(float)
    f = k / (samples * interval)
    S = density(noise, Spectrum(f, count, np.full(len(f), interval)))
    x = np.pi * f * tau[:, None]
    weight = S * 2.0 * np.sin(x) ** 4 / x**2
    level = weight @ count
    return (weight * count) @ weight.T / np.outer(level, level)


WITHIN = math.log(100.0)
"""A size is looked for within a factor of a hundred of where the fit begins."""

EXACT = 1e-12
"""Change at which the fit stops: of a size that the curve says little of its sd hangs on where that is."""


def fit_allan(curve: AllanCurve, noise: Sizes, names: Sequence[str], record: tuple[int, float]) -> AllanFit:
    """Fit the sizes `names`, of N, B, K, Q, R, G and tau, to the logarithm of the Allan variance.

    `noise` is where to begin; it gives the weights, and the sizes of the others. `record` is (samples,
    interval in s) of the gapless record.
    """
    from scipy.optimize import least_squares
    from scipy.special import digamma

    covariance = log_covariance(noise, curve.tau, record)
    # half of the degrees of freedom; the mean logarithm of a chi-squared is short
    half = 1.0 / np.diag(covariance)
    observed = 2.0 * np.log(curve.deviation) - digamma(half) + np.log(half)
    root = _root(covariance)
    start = np.log([abs(noise[name]) for name in names])

    def misfit(x: FloatArray) -> FloatArray:
        made = {**noise, **dict(zip(names, np.exp(x).tolist(), strict=True))}
        return np.linalg.solve(root, observed - np.log(allan_variance(made, curve.tau)))

    bounds = (start - WITHIN, start + WITHIN)
    found = least_squares(misfit, start, jac="3-point", bounds=bounds, ftol=EXACT, xtol=EXACT, gtol=EXACT)
    information, along = np.linalg.eigh(found.jac.T @ found.jac)
    # a direction of which the curve says nothing is as wide as what is searched
    sd = np.sqrt(along**2 @ (1.0 / np.maximum(information, WITHIN**-2)))
    return AllanFit(
        names=tuple(names),
        values=tuple(np.exp(found.x).tolist()),
        log_sd=tuple(sd.tolist()),
        chi2=2.0 * float(found.cost),
        dof=len(observed) - len(names),
    )


def _root(covariance: FloatArray) -> FloatArray:
    scale = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(scale, scale)
    least = LEAST * float(np.linalg.eigvalsh(correlation)[-1])
    root = np.linalg.cholesky(correlation + least * np.eye(len(scale)))
    return np.asarray(scale[:, None] * root, dtype=np.float64)


PER_DECADE = 5
"""Averaging times a decade; whole decades of the interval are among them."""

LEVEL = 0.9
"""Probability that a confidence interval holds."""

FINEST = 100
"""Overlaps of an averaging time that are counted; more change the degrees of freedom by less than 1 %."""


def allan_deviation(y: FloatArray, t: FloatArray, interval: float) -> tuple[FloatArray, FloatArray]:
    """Averaging times (k,), s, and overlapping Allan deviation (k,), pooled over the parts between gaps.

    ``sigma^2(tau) = <(ybar_{k+m} - ybar_k)^2> / 2`` over all k (IEEE 952 annex C; NIST SP 1065 eq. 11), of
    rates or accelerations y (n,), averages over `interval` at the times t (n,), s. An averaging time is there
    if at least one part is twice as long.

    Examples
    --------
    >>> tau, deviation = allan_deviation(np.array([1.0, 2.0, 1.0, 2.0]), np.arange(4.0), 1.0)
    >>> tau.tolist(), deviation.round(3).tolist()
    ([1.0, 2.0], [0.707, 0.0])
    """
    parts = [np.concatenate(([0.0], np.cumsum(y[a:b] - y[a]))) for a, b in between_gaps(t, interval)]
    longest = max(len(part) - 1 for part in parts) // 2
    if longest < 1:
        return np.empty(0), np.empty(0)
    exponents = np.arange(math.floor(PER_DECADE * math.log10(longest)) + 1) / PER_DECADE
    steps = np.unique(np.rint(10.0**exponents).astype(int))
    variance = np.zeros(len(steps))
    for k, m in enumerate(steps.tolist()):
        squares, count = 0.0, 0
        for sums in parts:
            if len(sums) > 2 * m:
                over = sums[m:] - sums[:-m]
                apart = over[m:] - over[:-m]
                squares, count = squares + float(apart @ apart), count + len(apart)
        variance[k] = 0.5 * squares / (count * m**2)
    return steps * interval, np.sqrt(variance)


def confidence_band(
    tau: FloatArray, deviation: FloatArray, slopes: NDArray[np.int64], record: tuple[int, float]
) -> tuple[FloatArray, FloatArray]:
    """Ends (k,) of the interval that holds the true deviation with 90 %, from the degrees of freedom.

    These are by Greenhall and Riley (2004) for overlapping differences: the variance is chi-squared. `slopes`
    (k,) are powers of the frequency in the density of the noise that is largest at each averaging time: 2
    quantization, 0 white, -1 flicker, -2 random walk; `record` is (samples, interval in s), without a gap.
    """
    from scipy.special import gammaincinv

    samples, interval = record
    steps = np.rint(tau / interval).astype(int).tolist()
    half = np.array([_freedom(a, m, samples) for a, m in zip(slopes.tolist(), steps, strict=True)]) / 2.0
    tail = (1.0 - LEVEL) / 2.0
    low, high = (np.sqrt(half / gammaincinv(half, p)) for p in (1.0 - tail, tail))
    return low * deviation, high * deviation


def _freedom(alpha: int, m: int, samples: int) -> float:
    """Equivalent degrees of freedom of the overlapping Allan variance at m samples.

    Its terms are the second differences z of the phase over m samples; the mean of M squares has
    ``M / (1 + 2 sum_j (1 - j/M) r_j^2)`` of them, r the correlation of z (Greenhall and Riley, eq. 8 and 9).
    A rounded phase is white: r is -2/3 after m samples, 1/6 after 2 m. Else r follows from the generalized
    autocovariance of the phase whose rate, averaged over 1/m, has the density f^alpha: minus a second
    difference of ``|t|^3`` for white noise, ``-t^4 ln|t|`` for flicker, ``-|t|^5`` for a walk.
    """
    overlaps = m if alpha == SLOPES["Q"] else min(m, FINEST)
    count = 1 + overlaps * (samples - 2 * m) // m
    if alpha == SLOPES["Q"]:
        lag, r = np.array([0, m, 2 * m]), np.array([1.0, -2.0 / 3.0, 1.0 / 6.0])
    else:
        lag = np.arange(3 * overlaps)
        t = lag[:, None] / overlaps + np.arange(-2.0, 3.0)
        around = np.abs(t[..., None] + np.array([-1.0, 0.0, 1.0]) / overlaps)
        if alpha == 0:
            smooth = around**3
        else:
            flicker = -(around**4) * np.log(np.where(around > 0.0, around, 1.0))
            smooth = -(around**5) if alpha == SLOPES["K"] else flicker
        z = smooth @ (-1.0, 2.0, -1.0) @ (1.0, -4.0, 6.0, -4.0, 1.0)
        r = z / z[0]
    weights = np.clip(1.0 - lag / count, 0.0, None)
    return count / float(2.0 * weights @ r**2 - 1.0)
