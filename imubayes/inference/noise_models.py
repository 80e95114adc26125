"""The restricted likelihood of a set of noise processes, with what the library explains projected out.

Rows are averages over ``T`` that begin a gap ``g`` after the end of the row before, and ``E(x)`` is
``(1 - exp(-x)) / x``. Each process is a few states:

- Gauss-Markov, ``x = T/tau``: variance ``2 sd^2 (x - 1 + exp(-x)) / x^2``, ``U = E exp(-g/tau)``, ``V = E``,
  and ``exp(-(g + T)/tau)`` from one row to the next; bias instability is a row of them;
- random walk from the run's start t0: variance ``K^2 (c - t0 - T/6)`` at the centre c, ``V = c - t0``;
- quantization of the integrated output, ``(q_end - q_start) / T``: variance ``2 Q^2 / T^2``, and
  ``-Q^2 / (T_i T_j)`` between rows that share a boundary.

A ramp is a column of the mean with a normal prior.

Below the diagonal the covariance is a product of such states: for i after j, ``Cov_ij = sum_m power_m U_im
F_(i-1)m ... F_(j+1)m V_jm``, and a variance a_i on the diagonal. The factor L D L' has the same form, with W
in place of V, and costs O(n m^2). Unlike an exponential of time, a state may be forgotten after one row (F =
0), which is what quantization needs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numba import njit

from imubayes.algebra.arrays import FloatArray
from imubayes.inference.noise_rows import NoiseRows
from imubayes.inference.reml import span
from imubayes.inference.whiten import averaged_variance
from imubayes.sensors.noise import flicker
from imubayes.sensors.noise_processes import NoiseProcesses, ProcessPrior


@dataclass(frozen=True, slots=True, eq=False)
class States:
    """States of some processes: arrays (n, m), and variances (n, m) of each."""

    U: FloatArray
    F: FloatArray
    V: FloatArray
    A: FloatArray

    def __len__(self) -> int:
        return self.U.shape[1]


@dataclass(frozen=True, slots=True, eq=False)
class NoiseData:
    """A run ready for its noise to be judged.

    Attributes
    ----------
    rows : the averages.
    table : (n, r + 2) orthonormal basis of the library's columns, the ramp in prior sds, the response.
    states : of each process of unit size that has fixed states: B, K and Q.
    prior : of the processes.
    """

    rows: NoiseRows
    table: FloatArray
    states: Mapping[str, States]
    prior: ProcessPrior


@dataclass(frozen=True, slots=True)
class Likelihood:
    """Restricted log likelihoods at one point, up to a constant that all sets of processes share.

    Attributes
    ----------
    without, ramp : without a ramp and with one, over its prior.
    ramp_mean, ramp_sd : of the ramp, in prior sds.
    """

    without: float
    ramp: float
    ramp_mean: float
    ramp_sd: float


def noise_data(rows: NoiseRows, prior: ProcessPrior) -> NoiseData:
    """Lay out the states and the columns of a run."""
    middle = rows.center - (rows.start[0] + 0.5 * rows.span)
    basis = span(rows.X)
    # what the columns explain is projected out beforehand too: the response is then of the noise's own size
    left = rows.y - basis @ (basis.T @ rows.y)
    table = np.column_stack((basis, prior.ramp * middle, left))
    states = {"B": _flicker(rows), "K": _walk(rows), "Q": _quantization(rows)}
    return NoiseData(rows, np.ascontiguousarray(table), states, prior)


def likelihood(data: NoiseData, noise: NoiseProcesses) -> Likelihood:
    """Restricted likelihood of the processes other than the ramp, without a ramp and with one."""
    parts = [(data.states[name], getattr(noise, name)) for name in "BKQ" if getattr(noise, name) > 0.0]
    if noise.G > 0.0:
        parts.append((gauss_markov(data.rows, np.array([noise.tau])), noise.G))
    variance = noise.N**2 / data.rows.duration
    for states, size in parts:
        variance = variance + size**2 * states.A.sum(axis=1)
    U, F, V = (_joined([getattr(s, key) for s, _ in parts], len(variance)) for key in "UFV")
    power = np.concatenate([np.full(len(states), size**2) for states, size in parts] or [np.empty(0)])
    white = data.table.copy()
    log_det = whitened(U, F, V, variance, white, power)
    return (
        _judged(np.asarray(np.linalg.qr(white, mode="r")), log_det) if math.isfinite(log_det) else _IMPOSSIBLE
    )


_IMPOSSIBLE = Likelihood(-1e300, -1e300, 0.0, 1.0)


def _judged(R: FloatArray, log_det: float) -> Likelihood:
    diagonal = np.abs(np.diag(R))
    common = -0.5 * log_det - float(np.sum(np.log(diagonal[:-2])))
    slope, across, rest = R[-2, -2], R[-2, -1], R[-1, -1]
    more = 1.0 + slope**2
    return Likelihood(
        without=common - 0.5 * float(rest**2 + across**2),
        ramp=common - 0.5 * math.log(more) - 0.5 * float(rest**2 + across**2 / more),
        ramp_mean=float(slope * across / more),
        ramp_sd=1.0 / math.sqrt(more),
    )


def _joined(parts: list[FloatArray], n: int) -> FloatArray:
    return np.ascontiguousarray(np.concatenate(parts, axis=1)) if parts else np.empty((n, 0))


def gauss_markov(rows: NoiseRows, tau: FloatArray) -> States:
    """States of Gauss-Markov processes of unit variance with time constants `tau` (m,) s."""
    x = rows.duration[:, None] / tau
    gap = np.diff(rows.start, prepend=rows.start[0]) - np.concatenate(([0.0], rows.duration[:-1]))
    decay = np.exp(-np.maximum(gap, 0.0)[:, None] / tau)
    E = -np.expm1(-x) / x
    return States(E * decay, np.exp(-x) * decay, E, averaged_variance(x))


def _flicker(rows: NoiseRows) -> States:
    """Bias instability of size one over all averaging times of the run."""
    variance, tau = flicker(1.0, rows.interval, max(rows.span, rows.interval))
    unit = gauss_markov(rows, tau)
    return States(unit.U, unit.F, unit.V * variance, unit.A * variance)


def _walk(rows: NoiseRows) -> States:
    elapsed = (rows.center - rows.start[0])[:, None]
    one = np.ones_like(elapsed)
    return States(one, one, elapsed, elapsed - rows.duration[:, None] / 6.0)


def _quantization(rows: NoiseRows) -> States:
    inverse = 1.0 / rows.duration[:, None]
    joined = np.where(rows.joined[:, None], -inverse, 0.0)
    return States(joined, np.zeros_like(inverse), inverse, 2.0 * inverse**2)


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def whitened(
    U: FloatArray, F: FloatArray, V: FloatArray, a: FloatArray, rows: FloatArray, power: FloatArray
) -> float:
    """Whiten rows (n, k) in place.

    Parameters
    ----------
    U, F, V : (n, m).
    a : (n,) variances.
    rows : (n, k).
    power : (m,) of each state.

    Returns
    -------
    log determinant of the covariance; not a number where it is not positive definite.
    """
    n, m = U.shape
    k = rows.shape[1]
    S, W, SU = np.zeros((m, m)), np.zeros(m), np.zeros(m)
    f = np.zeros((k, m))
    log_det = 0.0
    for i in range(n):
        d = a[i]
        for p in range(m):
            total = 0.0
            for q in range(m):
                total += S[p, q] * U[i, q]
            SU[p] = total
            d -= U[i, p] * total
        if not d > 0.0:
            return np.nan
        log_det += np.log(d)
        root = 1.0 / np.sqrt(d)
        for p in range(m):
            W[p] = power[p] * V[i, p] - F[i, p] * SU[p]
        for p in range(m):
            scaled = W[p] / d
            for q in range(m):
                S[p, q] = F[i, p] * F[i, q] * S[p, q] + scaled * W[q]
        for c in range(k):
            z = rows[i, c]
            for p in range(m):
                z -= U[i, p] * f[c, p]
            share = z / d
            for p in range(m):
                f[c, p] = F[i, p] * f[c, p] + W[p] * share
            rows[i, c] = z * root
    return log_det
