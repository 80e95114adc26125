"""Whitening of correlated rows in O(n), with any time stamps.

The covariance of white noise, Gauss-Markov processes and a random walk, each averaged over the duration of a
row, is semiseparable: for i before j, ``Cov = sum_m U_jm V_im exp(-c_m (t_j - t_i))``. celerite2 factors such
a matrix as ``L D L'`` with unit lower L, and solves with L column by column.

For a process of variance s^2 and time constant tau, averaged over T (x = T/tau), rows do not overlap:
``Var = 2 s^2 (x - 1 + exp(-x)) / x^2`` and ``Cov = s^2 exp(-dt/tau) (2 sinh(x/2)/x)^2`` at the distance dt
of the centres. A random walk that starts at t0 has ``Cov = K^2 (t_i - t0)`` and
``Var = K^2 (start_i - t0 + T/3)``.

What n stands for in the penalties of information criteria is the effective sample size of coloured noise. A
column's information in the coloured rows is the squared norm of the whitened column; were the rows
independent with the variances they have, it would be ``sum x_i^2 / Var_i``. n times the ratio of the two is
how many independent rows would tell the coefficient as well as the n coloured ones do. For a constant and a
first-order process of correlation a it is ``(n (1 - a) + 2 a) / (1 + a)``; for white noise it is n, whatever
the durations. A column that alternates faster than the noise wanders would count as more than n rows; it
counts as n.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from celerite2 import driver  # pyright: ignore[reportAttributeAccessIssue]: a compiled module without stubs

from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import Factor
from imubayes.inference.linear import CHUNK, Linear, Rows
from imubayes.sensors.noise import Noise, flicker

FASTEST = 20.0
"""Processes whose time constant is this much shorter than a row are white there: correlation below 2.5 %."""


OVER = 500.0
"""Processes that much shorter than a row are white to 0.1 %, and their exponentials would overflow."""


@dataclass(frozen=True, slots=True, eq=False)
class Processes:
    """First-order processes that stand for bias instability.

    Attributes
    ----------
    variance : (m,) per unit B^2.
    tau : (m,) time constants, s.
    """

    variance: FloatArray
    tau: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Whitener:
    """Factor L D L' of a semiseparable covariance."""

    t: FloatArray
    c: FloatArray
    U: FloatArray
    W: FloatArray
    d: FloatArray

    @property
    def log_det(self) -> float:
        """Log determinant of the covariance."""
        return float(np.sum(np.log(self.d)))


def processes(rows: Rows, shortest: float = 0.0) -> Processes:
    """Return the processes that make flicker noise of unit B over the averaging times of `rows`.

    Parameters
    ----------
    rows : when they were taken.
    shortest : averaging time, s, below which white noise hides the flicker; at least a row's own.
    """
    least = float(np.median(rows.duration)) if rows.finest is None else rows.finest
    longest = float(rows.duration.max()) if rows.finest is None else rows.finest
    variance, tau = flicker(1.0, min(max(shortest, least), rows.span), rows.span)
    slow = tau * FASTEST > longest
    return Processes(variance[slow], tau[slow])


def mattering(noise: Noise, rows: Rows) -> Processes:
    """Return the processes that make flicker noise where it is not hidden by the white noise."""
    if noise.B == 0.0:
        return Processes(np.empty(0), np.empty(0))
    return processes(rows, 0.1 * (noise.N / noise.B) ** 2)


def whitener(noise: Noise, rows: Rows, parts: Processes | None = None) -> Whitener:
    """Factor the covariance of the noise in `rows`.

    Parameters
    ----------
    noise : N, B, K, SI; at least one of them positive.
    rows : when the rows were taken.
    parts : the processes that stand for B; by default those that matter beside the white noise.
    """
    parts = mattering(noise, rows) if parts is None else parts
    duration = common(rows.duration)
    hidden = parts.tau * OVER < rows.duration.min()
    fast = Processes(parts.variance[hidden], parts.tau[hidden])
    parts = Processes(parts.variance[~hidden], parts.tau[~hidden])
    x = duration[:, None] / parts.tau
    start = rows.t[0] - 0.5 * rows.duration[0]
    walk = noise.K**2 > 0.0
    width = len(parts.tau) + walk
    U, V = np.ones((len(rows.t), width)), np.empty((len(rows.t), width))
    weight, variance = averaging(x), noise.B**2 * parts.variance
    U[:, : len(parts.tau)] = weight
    V[:, : len(parts.tau)] = weight * variance
    a = np.empty(len(rows.t))
    a[:] = noise.N**2 / duration + (variance * averaged_variance(x)).sum(axis=1)
    # what is over within a row is white
    a += noise.B**2 * (fast.variance * averaged_variance(duration[:, None] / fast.tau)).sum(axis=1)
    if walk:
        V[:, -1] = noise.K**2 * (rows.t - start)
        a += noise.K**2 * (rows.t - start - duration / 6.0)
    c = np.concatenate((1.0 / parts.tau, np.zeros(int(walk))))
    return _factor(rows, c, a, U, V)


def whiten(w: Whitener, rows: FloatArray) -> FloatArray:
    """Whiten (n, k) row-major rows in place, and return them."""
    if w.U.shape[1]:
        driver.solve_lower(w.t, w.c, w.U, w.W, rows, rows)
    rows /= np.sqrt(w.d)[:, None]
    return rows


def common(duration: FloatArray) -> FloatArray:
    """One duration where all are alike: what follows from it is then broadcast, not held for each row."""
    return duration[:1] if duration.min() == duration.max() else duration


def averaging(x: FloatArray) -> FloatArray:
    """Weight of a process in a row of x time constants; the next row sees none of one far shorter."""
    half = 0.5 * np.minimum(x, OVER)
    return np.where(x <= OVER, np.sinh(half) / half, 0.0)


def averaged_variance(x: FloatArray) -> FloatArray:
    """Variance of the average of a unit process over x time constants: 2 (x - 1 + exp(-x)) / x^2."""
    small = 1.0 - x / 3.0 + x * x / 12.0 - x**3 / 60.0
    return np.where(x < 1e-3, small, 2.0 * (x + np.expm1(-x)) / np.maximum(x, 1e-3) ** 2)


def _factor(rows: Rows, c: FloatArray, a: FloatArray, U: FloatArray, V: FloatArray) -> Whitener:
    if rows.axes is not None:
        width = rows.axes.shape[1]
        a = a * np.sum(rows.axes**2, axis=1)
        U, V = _each_axis(U, rows.axes), _each_axis(V, rows.axes)
        c = np.repeat(c, width)
    t = rows.t - rows.t[0]
    if U.shape[1]:
        a, V = driver.factor(t, c, a, U, V, a, V)
    return Whitener(t, c, U, V, a)


def _each_axis(U: FloatArray, axes: FloatArray) -> FloatArray:
    return np.ascontiguousarray((U[:, :, None] * axes[:, None, :]).reshape(len(U), -1))


def effective_samples(f: Factor, rows: Sequence[Linear], noises: Sequence[Noise]) -> float:
    """Effective sample size, the geometric mean over the columns.

    Parameters
    ----------
    f : of all whitened rows, over the columns that count: those of the candidates that are excited.
    rows : of each run, over these columns and perhaps others.
    noises : that whitened each run, SI.
    """
    alone = np.zeros(f.p)
    for part, noise in zip(rows, noises, strict=True):
        places = [part.names.index(name) for name in f.names]
        weight = part.counts / marginal_variance(noise, _single(part))
        for a in range(0, len(part), CHUNK):
            b = min(a + CHUNK, len(part))
            alone += weight[a:b] @ part.columns(a, b)[:, places] ** 2
    return samples_of(f.column_norms**2, alone, f.n)


def _single(part: Linear) -> Rows:
    """When single samples were taken: of a run that is read a part at a time, one for each average."""
    return part.rows if part.stream is None else Rows(part.t, np.full(len(part), part.stream.interval))


def samples_of(whitened: FloatArray, alone: FloatArray, n: int) -> float:
    """Effective sample size from what the rows tell of each column, whitened and as if they were independent.

    Parameters
    ----------
    whitened, alone : (p,) information on each column: squared norms of the whitened columns, and of the rows
        divided by the noise's sd.
    n : rows.

    Examples
    --------
    >>> round(samples_of(np.array([1.0, 4.0]), np.array([100.0, 100.0]), 1000), 9)
    20.0
    """
    told = alone > 0.0
    share = np.minimum(whitened[told] / alone[told], 1.0)
    return n * float(np.exp(np.mean(np.log(share)))) if told.any() else float(n)


def marginal_variance(noise: Noise, rows: Rows) -> FloatArray:
    """Variance (n,) of the noise in each row, SI squared.

    White noise, flicker and a random walk that starts with the run, each averaged over the row.
    """
    parts = mattering(noise, rows)
    start = rows.t[0] - 0.5 * rows.duration[0]
    variance = noise.N**2 / rows.duration + noise.K**2 * (rows.t - start - rows.duration / 6.0)
    for unit, tau in zip(parts.variance.tolist(), parts.tau.tolist(), strict=True):
        variance += noise.B**2 * unit * averaged_variance(rows.duration / tau)
    return variance if rows.axes is None else variance * np.sum(rows.axes**2, axis=1)
