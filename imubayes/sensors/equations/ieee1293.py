"""IEEE Std 1293: linear, single-axis, nongyroscopic accelerometer.

::

    E = K1 { K0 + (K0'/2) sgn a_i + [1 + (K1'/2) sgn a_i] a_i + Koq a_i|a_i| + K2 a_i^2 + K3 a_i^3 + ...
           + d_o a_p - d_p a_o + Kip a_i a_p + Kio a_i a_o + Kpo a_p a_o + Kpp a_p^2 + Koo a_o^2
           + Kspin w_i w_p + Kang dw_o/dt }

Axes (i, p, o) are (i, j, k). K0' and K1' are full differences between plus and minus. The equation is as
the slides of Olson, Bingham and Walker (JNC 2023) quote the standard, with their slips mended.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from imubayes.sensors.equations.mapping import FloatArray, Standard, channel, gained, of, symbols_of, vector
from imubayes.sensors.terms import HIGHEST_POWER

_FULL = "full difference of plus and minus"


@dataclass(frozen=True, slots=True)
class Accelerometer:
    """Parameters of IEEE 1293, SI: each has the unit of the coefficient of its term.

    K1nom is the nominal scale factor, which divides the output, and s is K1/K1nom - 1, so that a small error
    keeps its digits. d_o and d_p turn the input axis about the output and the pendulous axis.
    """

    s: float = of("b1", note="K1/K1nom - 1", symbol="K1")
    K0: float = of("b0")
    K0p: float = of("b0p", 0.5, _FULL, symbol="K0'")
    K1p: float = of("b1p", 0.5, _FULL, symbol="K1'")
    Koq: float = of("b2p")
    K2: float = of("b2")
    K3: float = of("b3")
    K4: float = of("b4")
    K5: float = of("b5")
    K6: float = of("b6")
    K7: float = of("b7")
    K8: float = of("b8")
    K9: float = of("b9")
    K10: float = of("b10")
    K11: float = of("b11")
    K12: float = of("b12")
    d_o: float = of("m_j", note="about the output axis")
    d_p: float = of("m_k", -1.0, "about the pendulous axis: -m_k")
    Kip: float = of("c_ij")
    Kio: float = of("c_ik")
    Kpo: float = of("c_jk")
    Kpp: float = of("c_jj")
    Koo: float = of("c_kk")
    Kspin: float = of("S_ij", note="with a lever arm along j")
    Kang: float = of("s_k", note="with a lever arm along j")


def indicated(p: Accelerometer, channels: Mapping[str, FloatArray], n: int) -> FloatArray:
    """Indicated specific force ``E / K1nom`` (n,), m/s^2.

    `channels` are inputs in SI by name (``f_i``, ``w_j``, ``dw_k``); absent ones are zero.

    Examples
    --------
    >>> indicated(Accelerometer(K0=0.01, K0p=0.002), {"f_i": np.array([-1.0, 0.0, 1.0])}, 3).tolist()
    [-0.991, 0.01, 1.011]
    """
    a_i, a_p, a_o = vector(channels, "f", n)
    w_i, w_p, _ = vector(channels, "w", n)
    side = np.sign(a_i)
    own = p.K0 + p.K0p / 2.0 * side + (1.0 + p.K1p / 2.0 * side) * a_i + p.Koq * a_i * np.abs(a_i)
    own = own + sum(getattr(p, f"K{m}") * a_i**m for m in range(2, HIGHEST_POWER + 1))
    cross = p.d_o * a_p - p.d_p * a_o + p.Kip * a_i * a_p + p.Kio * a_i * a_o
    cross = cross + p.Kpo * a_p * a_o + p.Kpp * a_p**2 + p.Koo * a_o**2
    turning = p.Kspin * w_i * w_p + p.Kang * channel(channels, "dw_k", n)
    return (1.0 + p.s) * (own + cross + turning)


SYMBOLS = symbols_of(Accelerometer, "accelerometer")
"""Parameters of the equation."""

to_general, from_general = gained(SYMBOLS, Accelerometer)

STANDARD = Standard(
    id="ieee1293",
    title="IEEE 1293 accelerometer",
    kind="accelerometer",
    symbols=SYMBOLS,
    indicated=indicated,
    to_general=to_general,
    from_general=from_general,
    exact="exact for all inputs and all parameters with K1 > 0; the angles are linear, as in the standard",
    beyond=("eps (noise)",),
)
