"""IEEE Std 647: ring laser gyroscope, with lock-in.

::

    S0 dN/dt = L(I + E + D) / (1 + 1e-6 eps_K),       L(w) = sgn(w) sqrt(w^2 - w_R^2) for |w| > w_R, else 0
    I, E as in IEEE 952,   D = D_F + D_H . H + random,   eps_K = eps_0 + eps_T dT

The fringe phase obeys ``dpsi/dt = S (w - w_L sin psi)`` (Adler); L is its mean rate. Dither by an angle of
amplitude theta_D leaves, to first order in w_L, the lock-in rate ``w_R = w_L |J0(S theta_D)|``; without
dither w_R is w_L. Randomised dither has no dead band (w_L = 0 here) and pays with random walk in angle
(`random_walk`).

A polynomial cannot follow L: it has a corner of infinite slope at w_R and ``L - w`` falls like w_R^2/(2 w)
beyond. `polynomial_of` says what the library's terms make of it over given rates, and what they leave:
of what lock-in does (rms) over rates uniform to 100 w_R, terms to the third power with asymmetries leave
67 %, to the sixth 54 %.
"""

# The fields bear the standard's own symbols.
# ruff: noqa: N815

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from imubayes.errors import TermError
from imubayes.sensors.equations import ieee952
from imubayes.sensors.equations.ieee952 import FiberOpticGyro, sensed
from imubayes.sensors.equations.mapping import (
    Coefficients,
    FloatArray,
    Projection,
    Standard,
    channel,
    of,
    project,
    symbols_of,
    vector,
    warmth,
)
from imubayes.sensors.terms import Library, columns


@dataclass(frozen=True, slots=True)
class RingLaserGyro:
    """Parameters of IEEE 647, SI; the first seven are those of IEEE 952.

    Attributes
    ----------
    D_H_i, D_H_j, D_H_k : bias by magnetic flux density, rad/s/T.
    w_L : lock-in rate of the ring without dither, rad/s; 0 for randomised dither.
    S : phase of the fringes per angle of rotation, rad/rad.
    theta_D : amplitude of the dither, rad; 0 without.
    """

    eps_K: float = 0.0
    eps_T: float = 0.0
    a_X: float = 0.0
    a_Y: float = 0.0
    D_F: float = 0.0
    D_T: float = 0.0
    D_Tdot: float = 0.0
    D_H_i: float = of("", symbol="D_H,i", unit="rad/s/T", printed="deg/h/G")
    D_H_j: float = of("", symbol="D_H,j", unit="rad/s/T", printed="deg/h/G")
    D_H_k: float = of("", symbol="D_H,k", unit="rad/s/T", printed="deg/h/G")
    w_L: float = of("", note="lock-in rate without dither", symbol="Omega_L", unit="rad/s", printed="deg/s")
    S: float = of("", note="phase per angle", unit="1", printed="1", default=1.0)
    theta_D: float = of("", note="dither amplitude", unit="rad", printed="arcsec")


def locked(w: FloatArray, w_L: float) -> FloatArray:
    """Mean output ``sgn(w) sqrt(w^2 - w_L^2)`` of a ring with lock-in, zero in the dead band, rad/s.

    Examples
    --------
    >>> locked(np.array([-5.0, -3.0, 0.0, 2.0, 5.0]), 3.0).tolist()
    [-4.0, -0.0, 0.0, 0.0, 4.0]
    """
    size = np.abs(w)
    return np.sign(w) * np.sqrt(np.maximum(size - w_L, 0.0) * (size + w_L))


def residual_lock_in(w_L: float, S: float, theta_D: float) -> float:
    """Lock-in rate that a sinusoidal dither leaves, rad/s: ``w_L |J0(S theta_D)|``.

    First order in w_L: it must stay far below the dither's peak rate.

    Examples
    --------
    >>> residual_lock_in(1e-3, 1e6, 0.0)
    0.001
    """
    from scipy.special import j0

    return w_L * abs(float(j0(S * theta_D)))


def random_walk(w_L: float, S: float, w_D: float) -> float:
    """Random walk in angle N, rad/s/sqrt(Hz), of a ring with randomised dither: ``w_L / sqrt(S w_D)``.

    Each turn of the dither kicks the angle by ``w_L sqrt(2 pi / (S w_D W)) sin(phase)`` (stationary phase,
    W the dither's angular frequency), twice a period, at phases that are random. With S in fringes instead of
    radians this is the familiar ``w_L / sqrt(2 pi S w_D)``.

    w_L is the lock-in rate and w_D the peak rate of the dither, rad/s; S is phase per angle, rad/rad.

    Examples
    --------
    >>> random_walk(1e-3, 4e5, 2.5)
    1e-06
    """
    return w_L / math.sqrt(S * w_D)


def slowest_rate(w_L: float, error: float) -> float:
    """Rate above which lock-in takes less than `error` off the output, rad/s: ``(w_L^2 + e^2) / (2 e)``.

    The linear equation holds to `error` where all of |I + E + D| stays above it.

    It is a `TermError` if the error is not positive; up to w_L it is met in part, beyond it everywhere.

    Examples
    --------
    >>> slowest_rate(3.0, 1.0)
    5.0
    """
    if not error > 0.0:
        raise TermError(f"an error above 0 is needed, got {error:g}: lock-in never vanishes altogether")
    return (w_L * w_L + error * error) / (2.0 * error) if error < w_L else 0.0


def polynomial_of(lib: Library, w_R: float, channels: Mapping[str, FloatArray], n: int) -> Projection:
    """What a library makes of lock-in at the rate w_R, rad/s, over given inputs, by least squares.

    Told are coefficients by term, the rms of ``L(w_i) - w_i``, and the rms that the library cannot follow,
    rad/s. It is an `UnobservableError` if the inputs cannot tell the terms apart.
    """
    w = channel(channels, "w_i", n)
    return project(columns(lib, channels, n), locked(w, w_R) - w, lib.names, n)


def indicated(p: RingLaserGyro, channels: Mapping[str, FloatArray], n: int) -> FloatArray:
    """Indicated rate ``S0 dN/dt`` (n,), rad/s; inputs by name (``w_i``, ``T``, ``dT``; ``H_i`` in tesla).

    Examples
    --------
    >>> indicated(RingLaserGyro(w_L=3.0), {"w_i": np.array([2.0, 5.0])}, 2).tolist()
    [0.0, 4.0]
    """
    heat = warmth(channels, n)
    drift = p.D_F + p.D_T * heat + p.D_Tdot * channel(channels, "dT", n)
    for D, H in zip((p.D_H_i, p.D_H_j, p.D_H_k), vector(channels, "H", n), strict=True):
        drift = drift + D * H
    w = sensed(p.a_X, p.a_Y, channels, n) + drift
    return locked(w, residual_lock_in(p.w_L, p.S, p.theta_D)) / (1.0 + p.eps_K + p.eps_T * heat)


_SHARED = ("D_F", "eps_K", "a_X", "a_Y", "D_T", "D_Tdot", "eps_T")
"""Parameters that are IEEE 952's."""

SYMBOLS = (*(row for row in ieee952.SYMBOLS if row.field in _SHARED), *symbols_of(RingLaserGyro, "gyroscope"))

_TERMS = tuple(row.term for row in SYMBOLS if row.term)


def to_general(p: RingLaserGyro) -> Coefficients:
    """Generalized coefficients; lock-in and magnetic bias have none.

    Examples
    --------
    >>> to_general(RingLaserGyro(D_F=1e-6))["b0"]
    1e-06
    """
    theta = ieee952.to_general(FiberOpticGyro(**{field: getattr(p, field) for field in _SHARED}))
    return {name: theta[name] for name in _TERMS}


def from_general(theta: Mapping[str, Any]) -> RingLaserGyro:
    """Parameters without lock-in: the inverse of `to_general`; a `TermError` if 1 + b1 is not positive."""
    common = ieee952.from_general({name: theta[name] for name in _TERMS if name in theta})
    return RingLaserGyro(**{field: getattr(common, field) for field in _SHARED})


STANDARD = Standard(
    id="ieee647",
    title="IEEE 647 ring laser gyroscope",
    kind="gyroscope",
    symbols=SYMBOLS,
    indicated=indicated,
    to_general=to_general,
    from_general=from_general,
    exact="exact for all inputs where eps_T = 0, D_H = 0 and no lock-in is left (w_L = 0: randomised dither),"
    " at any angle below 90 deg; with eps_T products of eps_T with itself, the angles and the drift are left;"
    " with lock-in w_R the output differs by up to w_R in the dead band |I + E + D| <= w_R and by"
    " w_R^2/(w + sqrt(w^2 - w_R^2)) beyond, and no polynomial closes that",
    beyond=("D_RN", "D_RB", "D_RK", "D_RR", "D_Q"),
)
