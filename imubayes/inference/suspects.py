"""Which dwells look contaminated before the noise is known: a start that outliers do not spoil."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra.arrays import FloatArray
from imubayes.inference.dwells import Dwells
from imubayes.inference.linear import Linear, residuals

Mask = NDArray[np.bool_]

WIDE = 100.0
"""Prior sd of an offset in robust sds of the dwell means: offsets are gross. Odds depend on its logarithm."""

SUSPECT = 4.0
"""Robust sds beyond which a dwell is suspected."""

STEPS = 50
"""Steps of the fit with least absolute deviations: it is a start, no more."""

NEAR = 0.05
"""Residuals below this many robust sds weigh alike in that fit."""

NORMAL_MAD = 1.4826
"""Sd of a normal sample over its median absolute deviation."""


def first_suspects(
    rows: Sequence[Linear], dwells: Sequence[Dwells], prior_sd: FloatArray
) -> tuple[Mask, FloatArray]:
    """Dwells that stand out from a fit with least absolute deviations, and prior sds of offsets.

    A dwell stands out by its mean, or by the scatter of its samples.

    Returns
    -------
    (suspects, tau) : (m,) each; tau is a hundred robust sds of the run's dwell means, or the largest residual
        where that is larger, SI.
    """
    theta = _least_absolute(dwells, prior_sd)
    suspects, tau = [], []
    for part, d in zip(rows, dwells, strict=True):
        left = d.means.y - d.means.X @ theta
        sd = _robust_sd(left)
        rough = np.log(_scatter(part, d, theta))
        rough -= np.median(rough)
        off = np.abs(left) > SUSPECT * sd
        both = off | (np.abs(rough) > SUSPECT * _robust_sd(rough))
        suspects.append(both if 2 * np.count_nonzero(both) <= len(d) else off)
        tau.append(np.full(len(d), max(WIDE * sd, float(np.abs(left).max()))))
    return np.concatenate(suspects), np.concatenate(tau)


def _least_absolute(dwells: Sequence[Dwells], prior_sd: FloatArray) -> FloatArray:
    """Coefficients (p,) of least absolute deviations within their prior, by reweighted least squares."""
    X, y = np.concatenate([d.means.X for d in dwells]) * prior_sd, np.concatenate([d.means.y for d in dwells])
    runs = np.split(np.arange(len(y)), np.cumsum([len(d) for d in dwells])[:-1])
    eye, theta, weight = np.eye(X.shape[1]), np.zeros(X.shape[1]), np.ones(len(y))
    for _ in range(STEPS):
        left = y - X @ theta
        for run in runs:
            sd = _robust_sd(left[run])
            weight[run] = 1.0 / sd / np.sqrt(np.maximum(np.abs(left[run]) / sd, NEAR))
        stacked = np.concatenate((X * weight[:, None], eye)), np.concatenate((y * weight, 0.0 * theta))
        theta = np.linalg.lstsq(*stacked, rcond=None)[0]
    return theta * prior_sd


def _robust_sd(left: FloatArray) -> float:
    """Sd of a sample that is normal but for less than half of it; never zero."""
    return NORMAL_MAD * float(np.median(np.abs(left))) or float(np.abs(left).max()) or 1.0


def _scatter(rows: Linear, dwells: Dwells, theta: FloatArray) -> FloatArray:
    """Sd (q,) of the samples within each dwell; never zero."""
    left, first, counts = residuals(rows, theta), dwells.edges[:-1], np.diff(dwells.edges)
    left -= np.repeat(np.add.reduceat(left, first) / counts, counts)
    sd = np.sqrt(np.add.reduceat(left**2, first) / counts)
    return np.maximum(sd, np.finfo(float).eps * (sd.max() or 1.0))
