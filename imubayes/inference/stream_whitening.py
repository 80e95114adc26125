"""Whitening that is carried from one block of rows to the next.

The recursion of `imubayes.inference.whiten` (celerite2's factor and lower solve in one sweep), with its state
handed on: the blocks give what all rows at once would give. One thing is written differently. The variance
of a random walk grows with the length of the run, and what the rows before explain of it is nearly all; the
difference of the two is carried here, which stays of the size of the noise however long the run is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from imubayes.algebra.arrays import FloatArray
from imubayes.inference.whiten import Processes, averaged_variance, averaging, common
from imubayes.sensors.noise import Noise

NEARLY = 1e-5
"""Change of an exponent that is followed by a series of second order: its error is below a rounding."""

LANES = 8
"""Columns are padded to a multiple of so many: a processor works on that many at a time."""


@dataclass(frozen=True, slots=True, eq=False)
class Carry:
    """Whitening of a run between two of its blocks; the arrays change as it goes on.

    Attributes
    ----------
    noise, parts : that whiten; J processes, a random walk last.
    rates, variance : (J,) decay in 1/s and variance of each; zero of the walk, which `drift` (K^2) drives.
    explained : (J, J) covariance that the rows before explain, less that of the walk as it is.
    means : (J, width) state by column.
    gain : (J,) of the last row.
    last : (width,) the last row, before it was scaled.
    at : time of the last row in s, and its variance.
    """

    noise: Noise
    parts: Processes
    rates: FloatArray
    variance: FloatArray
    drift: float
    explained: FloatArray
    means: FloatArray
    gain: FloatArray
    last: FloatArray
    at: FloatArray


def padded(width: int) -> int:
    """Columns of a table for so many, with what fills it up.

    Examples
    --------
    >>> padded(22)
    24
    """
    return -(-width // LANES) * LANES


def begin(noise: Noise, parts: Processes, start: float, width: int) -> Carry:
    """Whitening before the first row.

    Parameters
    ----------
    noise : N, B, K, SI.
    parts : the processes that stand for B.
    start : time at which the first row begins, s; a random walk is zero there.
    width : columns of the tables to come.
    """
    walk = noise.K**2 > 0.0
    rates = np.concatenate((1.0 / parts.tau, np.zeros(int(walk))))
    variance = np.concatenate((noise.B**2 * parts.variance, np.zeros(int(walk))))
    J = len(rates)
    return Carry(
        noise=noise,
        parts=parts,
        rates=rates,
        variance=variance,
        drift=noise.K**2 if walk else 0.0,
        explained=np.zeros((J, J)),
        means=np.zeros((J, width)),
        gain=np.zeros(J),
        last=np.zeros(width),
        at=np.array([start, 0.0]),
    )


def whiten_on(carry: Carry, t: FloatArray, duration: FloatArray, table: FloatArray) -> FloatArray:
    """Whiten the next rows in place, and give their variances (k,) given all rows before.

    Parameters
    ----------
    carry : after the rows before; moved on.
    t, duration : (k,) time and averaging time, s.
    table : (k, width) rows, row-major, with the width that the whitening began with.
    """
    lasting = common(duration)
    x = lasting[:, None] / carry.parts.tau
    own = carry.noise.N**2 / lasting - carry.drift * lasting / 6.0
    own = own + (carry.noise.B**2 * carry.parts.variance * averaged_variance(x)).sum(axis=1)
    weights = np.ones((len(lasting), len(carry.rates)))
    weights[:, : len(carry.parts.tau)] = averaging(x)
    d = np.empty(len(t))
    if len(carry.rates):
        _sweep(
            table, t, own, weights, carry.rates, carry.variance, carry.drift, carry.explained, carry.means,
            carry.gain, carry.last, carry.at, d,
        )  # fmt: skip
    else:
        d[:] = own
        table /= np.sqrt(d)[:, None]
    return d


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _sweep(table, t, own, weights, rates, variance, drift, explained, means, gain, last, at, d):
    width, J = table.shape[1], len(rates)
    step = 1 if len(own) > 1 else 0
    decay, usual, seen = np.empty(J), np.empty(J), np.empty(J)
    fastest, dt_usual = rates.max(), -1.0
    for i in range(len(t)):
        dt = t[i] - at[0]
        at[0] = t[i]
        if dt_usual < 0.0 or abs(dt - dt_usual) * fastest > NEARLY:
            dt_usual = dt
            for j in range(J):
                usual[j] = np.exp(-rates[j] * dt)
        for j in range(J):
            off = rates[j] * (dt - dt_usual)
            decay[j] = usual[j] * (1.0 - off * (1.0 - 0.5 * off))
            seen[j] = 0.0
        u = weights[i * step]
        for j in range(J):
            kept, added = decay[j], at[1] * gain[j]
            for k in range(J):
                value = kept * decay[k] * (explained[j, k] + added * gain[k])
                explained[j, k] = value
                seen[k] += value * u[j]
        if drift > 0.0:
            explained[J - 1, J - 1] -= drift * dt
            seen[J - 1] -= drift * dt * u[J - 1]
        left = own[i * step]
        for j in range(J):
            left -= u[j] * seen[j]
        row = table[i]
        for j in range(J):
            kept, added, weight = decay[j], decay[j] * gain[j], u[j]
            for q in range(width):
                state = kept * means[j, q] + added * last[q]
                means[j, q] = state
                row[q] -= weight * state
        root = 1.0 / np.sqrt(left)
        for q in range(width):
            last[q] = row[q]
            row[q] *= root
        for j in range(J):
            gain[j] = (u[j] * variance[j] - seen[j]) / left
        at[1] = left
        d[i] = left
