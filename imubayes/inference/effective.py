"""Effective sample size of coloured noise: what n stands for in the penalties of information criteria.

A column's information in the coloured rows is the squared norm of the whitened column; were the rows
independent with the variances they have, it would be ``sum x_i^2 / Var_i``. n times the ratio of the two is
how many independent rows would tell the coefficient as well as the n coloured ones do. For a constant and a
first-order process of correlation a it is ``(n (1 - a) + 2 a) / (1 + a)``; for white noise it is n, whatever
the durations. A column that alternates faster than the noise wanders would count as more than n rows; it
counts as n.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import Factor
from imubayes.inference.linear import CHUNK, Linear, Rows
from imubayes.inference.whiten import averaged_variance, mattering
from imubayes.sensors.noise import Noise


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
