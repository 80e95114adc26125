"""IEEE Std 952: interferometric fiber-optic gyroscope.

::

    S0 dN/dt = (I + E + D) / (1 + 1e-6 eps_K)
    I = w_IRA cos a + sinc(a) (a_Y w_XRA - a_X w_YRA),    a = sqrt(a_X^2 + a_Y^2)
    E = D_T dT + D_Tdot dT/dt + D_gradTdot . d(grad T)/dt
    D = D_F + D_R + D_Q
    eps_K = eps_0 + eps_T dT + eps_1 I + eps_2 I^2 + eps_1' sgn I

Axes (IRA, XRA, YRA) are (i, j, k). ``cos a`` is the standard's ``sqrt(1 - [...]^2 - [...]^2)``. The
scale-factor error divides: a positive eps_K makes the output smaller. Here every eps is a pure number (the
1e-6 is its unit, ppm). The equation is as the slides of Olson, Bingham and Walker (JNC 2023) quote the
standard, with their slips mended; the form of eps_K(I) is our own.
"""

# The fields bear the standard's own symbols.
# ruff: noqa: N815

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from imubayes.sensors.equations.mapping import (
    Coefficients,
    FloatArray,
    Standard,
    alignment,
    channel,
    of,
    reciprocal,
    row,
    symbols_of,
    vector,
    warmth,
)


@dataclass(frozen=True, slots=True)
class FiberOpticGyro:
    """Parameters of IEEE 952, SI: each has the unit of the coefficient of its term.

    Of the scale-factor error eps_K is constant, eps_T by temperature, eps_1 and eps_2 by the rate and its
    square, eps_1p half of the difference between plus and minus. a_X and a_Y are angles of the input axis
    about X and Y. Bias is D_F, D_T by temperature, D_Tdot by its rate, and the D_grad, rad/s/(K/m/s), by the
    rate of its gradient.
    """

    D_F: float = of("b0")
    eps_K: float = of("b1", -1.0, "in the denominator: the output falls as it grows")
    a_X: float = of("m_k", -1.0, "about XRA: the response to YRA is its negative")
    a_Y: float = of("m_j", note="about YRA")
    eps_1: float = of("b2", -1.0, "in the denominator")
    eps_2: float = of("b3", -1.0, "in the denominator")
    eps_1p: float = of("b1p", -1.0, "half difference, in the denominator", symbol="eps_1'")
    D_T: float = of("b0*T")
    D_Tdot: float = of("b0*dT")
    eps_T: float = of("b1*T", -1.0, "in the denominator")
    D_grad_i: float = of("", symbol="D_gradTdot,i", unit="rad/s/(K/m/s)", printed="deg/h/(degC/m/min)")
    D_grad_j: float = of("", symbol="D_gradTdot,j", unit="rad/s/(K/m/s)", printed="deg/h/(degC/m/min)")
    D_grad_k: float = of("", symbol="D_gradTdot,k", unit="rad/s/(K/m/s)", printed="deg/h/(degC/m/min)")


def sensed(a_X: float, a_Y: float, channels: Mapping[str, FloatArray], n: int) -> FloatArray:
    """Rate I about the input axis, rad/s: the exact projection for misalignment angles in rad.

    Examples
    --------
    >>> float(sensed(0.0, np.pi / 6, {"w_j": np.array([2.0])}, 1)[0].round(12))
    1.0
    """
    w_i, w_j, w_k = vector(channels, "w", n)
    a = np.hypot(a_X, a_Y)
    ratio = np.sinc(a / np.pi)
    return np.cos(a) * w_i + ratio * a_Y * w_j - ratio * a_X * w_k


def indicated(p: FiberOpticGyro, channels: Mapping[str, FloatArray], n: int) -> FloatArray:
    """Indicated rate ``S0 dN/dt`` (n,), rad/s; inputs by name (``w_i``, ``T``; ``gradTdot_i`` in K/m/s).

    Examples
    --------
    >>> indicated(FiberOpticGyro(eps_K=0.25), {"w_i": np.array([1.0])}, 1).tolist()
    [0.8]
    """
    turning, heat = sensed(p.a_X, p.a_Y, channels, n), warmth(channels, n)
    gradient = zip((p.D_grad_i, p.D_grad_j, p.D_grad_k), vector(channels, "gradTdot", n), strict=True)
    E = p.D_T * heat + p.D_Tdot * channel(channels, "dT", n) + sum(D * rate for D, rate in gradient)
    eps_K = p.eps_K + p.eps_T * heat + p.eps_1 * turning + p.eps_2 * turning**2
    return (turning + E + p.D_F) / (1.0 + eps_K + p.eps_1p * np.sign(turning))


SYMBOLS = symbols_of(FiberOpticGyro, "gyroscope")


def to_general(p: FiberOpticGyro) -> Coefficients:
    """Generalized coefficients, by the expansion in the own rate.

    With ``g = cos a / (1 + eps_K)``::

        b2 = -g^2 eps_1,   b3 = g^3 [eps_1^2 - (1 + eps_K) eps_2],   b1' = -g eps_1' / (1 + eps_K)

    Examples
    --------
    >>> float(to_general(FiberOpticGyro(eps_K=0.25))["b1"])
    -0.2
    """
    divisor = 1.0 + p.eps_K
    linear = dict(zip(("b1", "m_j", "m_k"), row(reciprocal(p.eps_K), p.a_X, p.a_Y), strict=True))
    gain = 1.0 + linear["b1"]
    return linear | {
        "b0": p.D_F / divisor,
        "b2": -(gain**2) * p.eps_1,
        "b3": gain**3 * (p.eps_1 * p.eps_1 - divisor * p.eps_2),
        "b1p": -gain * p.eps_1p / divisor,
        "b0*T": p.D_T / divisor,
        "b0*dT": p.D_Tdot / divisor,
        "b1*T": -gain * p.eps_T / divisor,
    }


def from_general(theta: Mapping[str, Any]) -> FiberOpticGyro:
    """Parameters for angles below 90 deg, the inverse of `to_general`; a `TermError` for a gain below 0."""

    def of(name: str) -> Any:
        return theta.get(name, 0.0)

    s, a_X, a_Y = alignment(of("b1"), of("m_j"), of("m_k"))
    eps_K, gain = reciprocal(s), 1.0 + of("b1")
    divisor = 1.0 + eps_K
    eps_1 = -of("b2") / gain**2
    return FiberOpticGyro(
        eps_K=eps_K,
        a_X=a_X,
        a_Y=a_Y,
        eps_1=eps_1,
        eps_2=(eps_1 * eps_1 - of("b3") / gain**3) / divisor,
        eps_1p=-of("b1p") * divisor / gain,
        eps_T=-of("b1*T") * divisor / gain,
        D_F=of("b0") * divisor,
        D_T=of("b0*T") * divisor,
        D_Tdot=of("b0*dT") * divisor,
    )


STANDARD = Standard(
    id="ieee952",
    title="IEEE 952 fiber-optic gyroscope",
    kind="gyroscope",
    symbols=SYMBOLS,
    indicated=indicated,
    to_general=to_general,
    from_general=from_general,
    exact="exact for all inputs where eps_K is constant (eps_1 = eps_2 = eps_1' = eps_T = 0), at any angle"
    " below 90 deg; else the own rate's expansion to its third power, and what is left is of second order:"
    " products of eps_1, eps_2, eps_1', eps_T with each other, with the angles, with D and E",
    beyond=("D_RN", "D_RB", "D_RK", "D_RR", "D_Q"),
)
