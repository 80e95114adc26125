"""Overlapping Allan deviation of a record with gaps, and its confidence."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv

from imubayes.algebra.arrays import FloatArray
from imubayes.rig.inputs import between_gaps

PER_DECADE = 5
"""Averaging times a decade; whole decades of the interval are among them."""

LEVEL = 0.9
"""Probability that a confidence interval holds."""

QUANTIZATION = 2
"""Power of the frequency in the density of the rate whose integral is rounded."""

FINEST = 100
"""Overlaps of an averaging time that are counted; more change the degrees of freedom by less than 1 %."""


def allan_deviation(y: FloatArray, t: FloatArray, interval: float) -> tuple[FloatArray, FloatArray]:
    """Overlapping Allan deviation, pooled over the parts between gaps.

    Parameters
    ----------
    y : (n,) rate or acceleration, each an average over `interval`.
    t : (n,) time, s.
    interval : s.

    Returns
    -------
    (tau, deviation) : arrays (k,), s and the unit of y; an averaging time is there if at least one part is
        twice as long.

    Notes
    -----
    ``sigma^2(tau) = <(ybar_{k+m} - ybar_k)^2> / 2`` over all k (IEEE 952 annex C; NIST SP 1065 eq. 11).

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
    variance = np.array([_pooled(parts, int(m)) for m in steps])
    return steps * interval, np.sqrt(variance)


def _pooled(parts: list[FloatArray], m: int) -> float:
    """Allan variance at m samples, over every part that is long enough."""
    squares, count = 0.0, 0
    for sums in parts:
        if len(sums) > 2 * m:
            steps = (sums[2 * m :] - 2.0 * sums[m:-m] + sums[: -2 * m]) / m
            squares, count = squares + float(steps @ steps), count + len(steps)
    return 0.5 * squares / count


def confidence_band(
    tau: FloatArray, deviation: FloatArray, slopes: NDArray[np.int64], record: tuple[int, float]
) -> tuple[FloatArray, FloatArray]:
    """Interval that holds the true deviation with 90 %, from the equivalent degrees of freedom.

    Parameters
    ----------
    tau, deviation : (k,) of `allan_deviation`.
    slopes : (k,) power of the frequency in the density of the noise that is largest at each averaging time: 2
        quantization, 0 white, -1 flicker, -2 random walk.
    record : (samples, interval in s) of the gapless record.

    Returns
    -------
    (low, high) : (k,), in the unit of the deviation.

    Notes
    -----
    Degrees of freedom by Greenhall and Riley (2004) for overlapping differences: the variance is chi-squared.
    """
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
    A rounded phase is white: r is -2/3 after m samples, 1/6 after 2 m.
    """
    overlaps = m if alpha == QUANTIZATION else min(m, FINEST)
    count = 1 + overlaps * (samples - 2 * m) // m
    if alpha == QUANTIZATION:
        lag, r = np.array([0, m, 2 * m]), np.array([1.0, -2.0 / 3.0, 1.0 / 6.0])
    else:
        lag = np.arange(3 * overlaps)
        z = _structure(alpha, lag[:, None] / overlaps + np.arange(-2.0, 3.0), overlaps)
        z = z @ (1.0, -4.0, 6.0, -4.0, 1.0)
        r = z / z[0]
    weights = np.clip(1.0 - lag / count, 0.0, None)
    return count / float(2.0 * weights @ r**2 - 1.0)


def _structure(alpha: int, t: FloatArray, m: int) -> FloatArray:
    """Generalized autocovariance of the phase whose rate, averaged over 1/m, has the density f^alpha.

    Minus a second difference of ``|t|^3`` for white noise, ``-t^4 ln|t|`` for flicker, ``-|t|^5`` for a walk.
    """
    around = np.abs(t[..., None] + np.array([-1.0, 0.0, 1.0]) / m)
    if alpha == 0:
        smooth = around**3
    else:
        smooth = -(around**5) if alpha == -2 else -(around**4) * np.log(np.where(around > 0.0, around, 1.0))
    return smooth @ (-1.0, 2.0, -1.0)
