"""The linear Gaussian problem at a noise: every row whitened by it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import reduce

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import Factor, add, noise_scale, with_prior_rows
from imubayes.inference.linear import Linear
from imubayes.inference.mcmc.chains import NoiseDraw
from imubayes.inference.prior import ScalePrior
from imubayes.inference.summary import Summary
from imubayes.inference.whiten import mattering
from imubayes.inference.whitened import whitened_factor
from imubayes.sensors.noise import Noise


def at_noise(summary: Summary, rows: Sequence[Linear], noise: FloatArray, sd: FloatArray) -> NoiseDraw:
    """Whiten all rows by a noise.

    Parameters
    ----------
    summary : of the g runs.
    rows : of each run.
    noise : (g, 3) N, B, K of each run, SI.
    sd : (p,) prior sds of all columns, SI.
    """
    factors = [
        whitened_factor(part, Noise(*values.tolist()), mattering(run.noise, part.rows))[0]
        for part, values, run in zip(rows, noise, summary.runs, strict=True)
    ]
    whole = reduce(add, factors)
    return NoiseDraw(whole, log_marginal(whole, sd))


def log_marginal(f: Factor, sd: FloatArray) -> float:
    """Log probability of the rows of a factor, whitened by their true noise, under prior sds (p,).

    Examples
    --------
    >>> from imubayes.algebra.factor import factor_of
    >>> f = factor_of(np.array([[1.0]]), np.array([2.0]), ("b0",))
    >>> round(log_marginal(f, np.array([1.0])), 6)  # y ~ N(0, 2)
    -2.265512
    """
    diagonal = np.diag(with_prior_rows(f.R, 1.0 / sd))
    log_det = f.log_det + 2.0 * float(np.sum(np.log(np.abs(diagonal[:-1]) * sd)))
    return -0.5 * (log_det + float(diagonal[-1] ** 2) + f.n * math.log(2.0 * math.pi))


def at_found_noise(summary: Summary, prior: ScalePrior) -> NoiseDraw:
    """Problem at the noise that was found, its common scale included.

    Rows are hundreds or thousands, so that the scale is known to a few percent: to average over it would take
    ten times as long and hardly move an inclusion.
    """
    found = summary.factor
    scale = noise_scale(found, prior.sd)
    log_det = found.log_det + 2.0 * found.n * math.log(scale)
    return NoiseDraw(replace(found, R=found.R / scale, log_det=log_det, rest=0.0), 0.0)
