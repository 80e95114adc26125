"""Vibration on a shaker: what rectifies, term by term, at known levels.

A term at the mean input is not the mean of the term: under vibration of rms s, ``<f^2> = f0^2 + s^2``, and
|f|, f|f| and the sign have means of their own. So the vibration is sampled; columns and output are then used
as they are, or both averaged over a dwell. The same rows serve simulation, analysis and a recorded file.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.errors import InputError
from imubayes.rig.inputs import Inputs
from imubayes.rig.plans import (
    I_AXIS,
    J_AXIS,
    K_AXIS,
    DwellTime,
    Mount,
    Plan,
    Settling,
    channels_of,
    check_steps,
    dwells,
    minus,
    numbers,
    samples,
    unit,
)
from imubayes.sensors.terms import Factor, Library, Term, column
from imubayes.units import STANDARD_GRAVITY, Count, Gravities, Hertz, Key

SAMPLING = 2.56
"""Samples a second over the upper end of the band, at least: the custom of shaker control."""


def vibration(
    levels: Annotated[
        Sequence[Gravities], Key("rms along the shaken direction; 0 is at rest", ["0 g", "2 g", "5 g"])
    ],
    *,
    mounts: Annotated[
        Count,
        Key(
            "the first of: shaken along i with i, -i and j up, along j with k up, along k with j up, halfway"
            " between i-j with k up, i-k with j up, j-k with i up",
            3,
        ),
    ] = 8,
    dwell: DwellTime = 5.0,
    rate: Annotated[
        Hertz, Key("samples a second, 2.56 times the band's upper end or more", "2 kHz")
    ] = 1000.0,
    settle: Settling = 5.0,
    band: Annotated[tuple[Hertz, Hertz], Key("lowest and highest frequency", ["20 Hz", "100 Hz"])] = (
        20.0,
        120.0,
    ),
) -> Plan:
    """Dwells of Gaussian vibration at several levels along a direction, in one mount after the other.

    The signal is pseudo-random as shaker controllers have it: tones of equal size and fixed phases at every
    multiple of ``1 / dwell`` within the band, other phases in each dwell. Its rms over a dwell is exact, and
    its law as normal as that of so many independent tones.

    The mean of the output moves with the square of the level by ``b2`` (``c_jj``, ``c_kk``, ``c_ij`` in the
    mounts along j, k and at 45 degrees), in proportion to it by ``b1p``, and by 3 f0 s^2 times ``b3`` with
    the input axis up and down: the bias is seen apart from all of them, as it is not at 1 g. A gyroscope sees
    ``g_i g_j g_k`` and all of S, the diagonal apart from the bias. Nothing of an accelerometer's S and s, nor
    of a gyroscope's own powers: no rotation. The signal is taken as known and in step with the output; where
    clocks differ, allow for a latency (8 samples a period, as by default, are enough to tell it). Rocking and
    cross motion of a shaker (1 to 10 %) are not in it. Source: vibration rectification tests as usual in
    practice (IEEE 1293).

    Levels are in g (standard gravity), not in SI: the unit of shaker practice.

    Raises
    ------
    InputError : if there are no levels, a negative level, no samples, a band that no dwell holds or that the
        sampling does not reach, or other than 1 to 8 mounts.

    Examples
    --------
    >>> run = vibration([0.0, 2.0], mounts=1).inputs
    >>> f = run.channels["f_i"].reshape(2, -1) / 9.80665
    >>> f.mean(axis=1).round(9).tolist(), f.std(axis=1).round(9).tolist()
    ([1.0, 1.0], [0.0, 2.0])
    """
    check_steps("vibration", levels, mounts, _SHAKER_MOUNTS)
    if min(levels) < 0.0:
        raise InputError(f"vibration of {min(levels)} g: expected an rms of 0 or more")
    along, up = (unit(np.array(axis)) for axis in zip(*_SHAKER_MOUNTS[:mounts], strict=True))
    t = dwells(mounts * len(levels), dwell, rate, settle)
    signal = _tones(mounts * len(levels), dwell, rate, band).reshape(mounts, len(levels), -1)
    shaken = np.asarray(levels, dtype=float)[:, None] * signal
    f = up[:, None, None, :] + shaken[..., None] * along[:, None, None, :]
    channels = channels_of({"f": STANDARD_GRAVITY * f})
    return Plan("vibration", "other", Inputs(t, channels, 1.0 / rate, numbers(mounts, len(t))))


_SHAKER_MOUNTS: tuple[Mount, ...] = (
    (I_AXIS, I_AXIS),
    (I_AXIS, minus(I_AXIS)),
    (I_AXIS, J_AXIS),
    (J_AXIS, K_AXIS),
    (K_AXIS, J_AXIS),
    ((1.0, 1.0, 0.0), K_AXIS),
    ((1.0, 0.0, 1.0), J_AXIS),
    ((0.0, 1.0, 1.0), I_AXIS),
)


def _tones(number: int, dwell: float, rate: float, band: tuple[float, float]) -> FloatArray:
    """Signals (number, samples) of unit rms within a band, zero on average."""
    n, (low, high) = len(samples(dwell, rate)), band
    first, last = math.ceil(low * n / rate), math.floor(high * n / rate) if high < math.inf else n
    if not (0 < first <= last and SAMPLING * high <= rate):
        raise InputError(
            f"vibration from {low} to {high} Hz in dwells of {dwell} s at {rate} samples a second: expected a"
            f" band above 0 Hz that holds a multiple of 1 / dwell, and {SAMPLING} samples a period or more"
        )
    tone = np.arange(first, last + 1, dtype=float)
    # fifth powers modulo a prime are spread like random numbers, and every dwell has its own
    root = (tone + last * np.arange(number)[:, None]) % _PRIME
    square = root * root % _PRIME
    turns = square * square % _PRIME * root % _PRIME / _PRIME
    spectrum = np.zeros((number, n // 2 + 1), dtype=complex)
    spectrum[:, first : last + 1] = n / math.sqrt(2.0 * len(tone)) * np.exp(2j * math.pi * turns)
    return np.fft.irfft(spectrum, n, axis=1)


_PRIME = 2.0**26 - 5.0
"""Products of whole numbers below it are exact in double precision."""


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
    X = np.empty((len(inputs), len(lib.terms)), order="F")
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
