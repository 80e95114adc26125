"""Gaussian vibration of a scene's force: what it does to the mean of a term.

What vibration adds to the mean of a term, the rectification, follows from its moments at each row of the slow
motion, and needs no fast sampling.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.rig.inputs import Inputs
from imubayes.sensors.terms import Factor, Library, Term, column


def mean_columns(lib: Library, inputs: Inputs, vibration: float) -> FloatArray:
    """Regressors (n, p) averaged over Gaussian vibration of the force, independent from axis to axis.

    This is what remains of a term at frequencies far below the vibration's: K2's rectification, and the
    smoothing of a sign (erf).

    Parameters
    ----------
    lib : the library.
    inputs : (n,) motion without the vibration, along (i, j, k).
    vibration : rms along each axis, m/s^2; 0 gives the plain columns.

    Examples
    --------
    >>> from imubayes.sensors.terms import library
    >>> still = Inputs(np.zeros(1), {"f_i": np.zeros(1)}, 1.0)
    >>> mean_columns(library("accelerometer", asymmetry=-1), still, 2.0)[0, :4].tolist()
    [1.0, 0.0, 4.0, 0.0]
    """
    X = np.empty((len(inputs), len(lib.terms)))
    for j, term in enumerate(lib.terms):
        X[:, j] = _mean_column(term, inputs, vibration) if vibration > 0.0 else column(term, inputs.channels)
    return X


def _mean_column(term: Term, inputs: Inputs, vibration: float) -> FloatArray:
    """Product of the factors' means: no channel comes twice in a term, and channels are independent."""
    value = np.ones(len(inputs))
    for factor in term.factors:
        if factor.channel.startswith("f_"):
            level = inputs.channels.get(factor.channel, np.zeros(len(inputs)))
            value = value * _moment(level, vibration, factor)
        else:
            value = value * column(replace(term, factors=(factor,)), inputs.channels)
    return value


def _moment(level: FloatArray, rms: float, factor: Factor) -> FloatArray:
    """Mean of x^n, or of sgn(x) x^n, for x normal about a level.

    Stein's identity E[(x - m) g(x)] = s^2 E[g'(x)] gives ``M_n = m M_(n-1) + (n - 1) s^2 M_(n-2)`` for both;
    the jump of the sign adds to |x| alone.
    """
    from scipy.special import erf

    if factor.signed:
        before = erf(level / (math.sqrt(2.0) * rms))
        jump = math.sqrt(2.0 / math.pi) * rms * np.exp(-0.5 * (level / rms) ** 2)
    else:
        before, jump = np.ones_like(level), 0.0
    if factor.power == 0:
        return before
    here = level * before + jump
    for n in range(2, factor.power + 1):
        before, here = here, level * here + (n - 1) * rms**2 * before
    return here
