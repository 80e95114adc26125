"""The restricted likelihood of a set of noise processes, with what the library explains projected out.

Rows are averages over ``T`` that begin a gap ``g`` after the end of the row before, and ``E(x)`` is
``(1 - exp(-x)) / x``. Each process is a few states of `imubayes.inference.noise_kernel`:

- Gauss-Markov, ``x = T/tau``: variance ``2 sd^2 (x - 1 + exp(-x)) / x^2``, ``U = E exp(-g/tau)``, ``V = E``,
  and ``exp(-(g + T)/tau)`` from one row to the next; bias instability is a row of them;
- random walk from the run's start t0: variance ``K^2 (c - t0 - T/6)`` at the centre c, ``V = c - t0``;
- quantization of the integrated output, ``(q_end - q_start) / T``: variance ``2 Q^2 / T^2``, and
  ``-Q^2 / (T_i T_j)`` between rows that share a boundary.

A ramp is a column of the mean with a normal prior.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

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
    from imubayes.inference.noise_kernel import whitened

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
