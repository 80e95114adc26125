"""IEEE Std 813: dynamically tuned gyroscope, two input axes x and y, spin axis z.

::

    D_x = B_x + D_xx a_x + D_xy a_y + D_xz a_z + D_xxz a_x a_z + D_xyz a_y a_z + D_xzz a_z^2
    D_y = B_y + D_yy a_y + D_yx a_x + D_yz a_z + D_yyz a_y a_z + D_yxz a_x a_z + D_yzz a_z^2
    output_x = (1 + 1e-6 eps_x) (w_x + m_xy w_y + m_xz w_z + D_x),   y likewise

Each axis is a component (i, j, k) = (own, spin, other), right-handed, so the other axis is **-y for x** and
+x for y. D_xx and D_yy are the direct mass unbalance, D_xy = -D_yx the quadrature one: in component axes a
symmetric rotor has the same coefficients on both. The drift terms are the standard's as commonly quoted; the
arrangement about them (one gain, linear angles) is common practice, not a clause.
"""

# The fields bear the standard's own symbols.
# ruff: noqa: N815

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

from imubayes.sensors.equations.mapping import FloatArray, Standard, Symbol, gained, of, symbols_of, vector

Axis = Literal["x", "y"]


@dataclass(frozen=True, slots=True)
class TunedGyroAxis:
    """Parameters of IEEE 813 for one input axis, SI: each has the unit of the coefficient of its term.

    `other` is the second input axis of the case. The m are responses to the rates about it and the spin axis;
    drift is B, or by acceleration (D_xx, D_xy, D_xz of x), or by its products (D_xxz, D_xyz, D_xzz of x).
    """

    axis: Axis = "x"
    B: float = of("b0", symbol="B_x")
    eps_K: float = of("b1", note="in the numerator", symbol="eps_x")
    m_other: float = of("m_k", -1.0, symbol="m_xy")
    m_spin: float = of("m_j", symbol="m_xz")
    D_own: float = of("g_i", note="direct mass unbalance", symbol="D_xx")
    D_other: float = of("g_k", -1.0, "quadrature", symbol="D_xy")
    D_spin: float = of("g_j", symbol="D_xz")
    D_own_spin: float = of("S_ij", note="anisoelastic", symbol="D_xxz")
    D_other_spin: float = of("S_jk", -1.0, symbol="D_xyz")
    D_spin_spin: float = of("S_jj", symbol="D_xzz")


_OTHER_SIGN: Mapping[Axis, float] = {"x": -1.0, "y": 1.0}
"""Component axis k = own x spin, along the other input axis of the case: x x z = -y, y x z = +x."""

_COMPONENT = {"x": {"i": "x", "j": "z", "k": "y"}, "y": {"i": "y", "j": "z", "k": "x"}}


def component(axis: Axis, case: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Inputs along the (i, j, k) of an input axis from those along the case's, by name (``f_x``, ``T``).

    Examples
    --------
    >>> import numpy as np
    >>> component("x", {"f_y": np.array([2.0])})["f_k"].tolist()
    [-2.0]
    """
    channels = {name: values for name, values in case.items() if name in ("T", "dT")}
    for quantity in ("f", "w", "dw"):
        for ijk, xyz in _COMPONENT[axis].items():
            if f"{quantity}_{xyz}" in case:
                sign = _OTHER_SIGN[axis] if ijk == "k" else 1.0
                channels[f"{quantity}_{ijk}"] = sign * case[f"{quantity}_{xyz}"]
    return channels


def indicated(p: TunedGyroAxis, channels: Mapping[str, FloatArray], n: int) -> FloatArray:
    """Indicated rate (n,) of one axis, rad/s, for inputs along the component's axes (``w_i``, ``f_k``).

    `component` makes them of inputs along the case's axes.
    """
    sign = _OTHER_SIGN[p.axis]
    w_own, w_spin, w_k = vector(channels, "w", n)
    a_own, a_spin, a_k = vector(channels, "f", n)
    a_other = sign * a_k
    drift = p.B + p.D_own * a_own + p.D_other * a_other + p.D_spin * a_spin
    products = p.D_own_spin * a_own + p.D_other_spin * a_other + p.D_spin_spin * a_spin
    return (1.0 + p.eps_K) * (w_own + p.m_other * sign * w_k + p.m_spin * w_spin + drift + products * a_spin)


def indicated_pair(
    x: TunedGyroAxis, y: TunedGyroAxis, case: Mapping[str, FloatArray], n: int
) -> tuple[FloatArray, FloatArray]:
    """Indicated rates of both axes, rad/s, for inputs along the case's axes (``w_x``, ``f_z``)."""
    return indicated(x, component("x", case), n), indicated(y, component("y", case), n)


_OF_X = symbols_of(TunedGyroAxis, "gyroscope")
_SWAPPED = str.maketrans("xy", "yx")

SYMBOLS: Mapping[str, tuple[Symbol, ...]] = {
    "x": _OF_X,
    "y": tuple(replace(row, symbol=row.symbol.translate(_SWAPPED), weight=abs(row.weight)) for row in _OF_X),
}
"""By input axis: the fields of `TunedGyroAxis` have the symbols and signs of x."""


def _standard(axis: Axis) -> Standard:
    to_general, from_general = gained(SYMBOLS[axis], TunedGyroAxis, axis=axis)
    return Standard(
        id=f"ieee813.{axis}",
        title=f"IEEE 813 dynamically tuned gyroscope, axis {axis}",
        kind="gyroscope",
        symbols=SYMBOLS[axis],
        indicated=indicated,
        to_general=to_general,
        from_general=from_general,
        exact="exact for all inputs and all parameters with eps_K > -1; the angles are linear",
        beyond=("D_R",),
    )


STANDARD_X, STANDARD_Y = _standard("x"), _standard("y")
