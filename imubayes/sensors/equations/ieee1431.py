"""IEEE Std 1431: Coriolis vibratory gyroscope (MEMS, HRG).

::

    output = (I + D_F + D_a . a + D_T dT) (1 + 1e-6 [eps_K + eps_T dT])
    I = w_i + a_Y w_j - a_X w_k

after the adaptation of IEEE 1431 in NXP's public TSIM model, where the scale-factor error multiplies (in IEEE
952 and 647 it divides: the signs are opposite). Every eps is a pure number here. The ramp R t, the random
drift and the pattern angle of a whole-angle resonator are no functions of the inputs.
"""

# The fields bear the standard's own symbols.
# ruff: noqa: N815

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from imubayes.sensors.equations.mapping import (
    Coefficients,
    FloatArray,
    Standard,
    gained_from_general,
    gained_to_general,
    of,
    symbols_of,
    vector,
    warmth,
)


@dataclass(frozen=True, slots=True)
class VibratoryGyro:
    """Parameters of IEEE 1431, SI: each has the unit of the coefficient of its term.

    eps_T and D_T are by temperature, a_X and a_Y angles of the input axis about X (j) and Y (k), and the D of
    an axis the linear acceleration sensitivity D_a along it.
    """

    D_F: float = of("b0")
    eps_K: float = of("b1", note="in the numerator")
    a_X: float = of("m_k", -1.0, "about X: the response to Y is its negative")
    a_Y: float = of("m_j", note="about Y")
    D_i: float = of("g_i", symbol="D_a,i")
    D_j: float = of("g_j", symbol="D_a,j")
    D_k: float = of("g_k", symbol="D_a,k")
    D_T: float = of("b0*T")
    eps_T: float = of("b1*T", note="in the numerator")


def indicated(p: VibratoryGyro, channels: Mapping[str, FloatArray], n: int) -> FloatArray:
    """Indicated rate (n,), rad/s; `channels` are inputs in SI by name (``w_i``, ``f_j``, ``T``).

    Examples
    --------
    >>> import numpy as np
    >>> indicated(VibratoryGyro(eps_K=0.25), {"w_i": np.array([1.0])}, 1).tolist()
    [1.25]
    """
    w_i, w_j, w_k = vector(channels, "w", n)
    f_i, f_j, f_k = vector(channels, "f", n)
    heat = warmth(channels, n)
    drift = p.D_F + p.D_i * f_i + p.D_j * f_j + p.D_k * f_k + p.D_T * heat
    return (w_i + p.a_Y * w_j - p.a_X * w_k + drift) * (1.0 + p.eps_K + p.eps_T * heat)


SYMBOLS = symbols_of(VibratoryGyro, "gyroscope")
_COLD = SYMBOLS[:-2]
"""Those that do not change with temperature: all but D_T and eps_T."""

_HEATED = ("m_j", "m_k", "g_i", "g_j", "g_k")


def to_general(p: VibratoryGyro) -> Coefficients:
    """Generalized coefficients: the product multiplied out, exact for all inputs.

    Examples
    --------
    >>> to_general(VibratoryGyro(eps_T=0.5, a_Y=0.25))["m_j*T"]
    0.125
    """
    cold = gained_to_general(SYMBOLS[:-1], p)
    per_kelvin = p.eps_T / (1.0 + p.eps_K)
    return cold | {
        "b0*T": cold["b0*T"] + per_kelvin * cold["b0"],
        "b0*T2": p.eps_T * p.D_T,
        "b1*T": p.eps_T,
        **{f"{name}*T": per_kelvin * cold[name] for name in _HEATED},
    }


def from_general(theta: Mapping[str, Any]) -> VibratoryGyro:
    """Parameters of generalized coefficients: the inverse of `to_general`.

    Terms that the equation implies (``b0*T2``, ``m_j*T``, ...) are not read: they follow from the others. It
    is a `TermError` if 1 + b1 is not positive.
    """
    fields, eps_T = gained_from_general(_COLD, theta), theta.get("b1*T", 0.0)
    D_T = (theta.get("b0*T", 0.0) - eps_T * fields["D_F"]) / (1.0 + fields["eps_K"])
    return VibratoryGyro(**fields, D_T=D_T, eps_T=eps_T)


STANDARD = Standard(
    id="ieee1431",
    title="IEEE 1431 Coriolis vibratory gyroscope",
    kind="gyroscope",
    symbols=SYMBOLS,
    indicated=indicated,
    to_general=to_general,
    from_general=from_general,
    exact="exact for all inputs and all parameters with eps_K > -1; with eps_T the terms b0*T2, m*T and g*T"
    " must be in the library, else products of eps_T with D_T, the angles and D_a are missing",
    beyond=("R t", "D_RN", "D_RB", "D_RK", "A_n cos n(theta - theta_n) of the whole-angle mode"),
    implied=("b0*T2", *(f"{name}*T" for name in _HEATED)),
)
