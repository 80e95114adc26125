"""IEEE Std 517: single-degree-of-freedom rate-integrating gyroscope, torque to balance.

::

    output = (1 + 1e-6 eps_K) { w_I + a_O w_S - a_S w_O + D
                                + (I_O/H) dw_O/dt + theta_I w_I w_S }
    D = D_F + D_I a_I + D_S a_S + D_O a_O + D_II a_I^2 + D_SS a_S^2 + D_OO a_O^2
        + D_IS a_I a_S + D_IO a_I a_O + D_OS a_O a_S

Axes (I, S, O) are (i, j, k). D is the standard's drift; the arrangement about it (one gain, linear angles,
the float's pickoff angle theta_I per rate) is common practice, not a clause.
"""

# The fields bear the standard's own symbols.
# ruff: noqa: N815

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from imubayes.sensors.equations.mapping import FloatArray, Standard, channel, gained, of, symbols_of, vector


@dataclass(frozen=True, slots=True)
class RateIntegratingGyro:
    """Parameters of IEEE 517, SI: each has the unit of the coefficient of its term.

    D_F is the drift that acceleration does not change; D_I, D_S, D_O (mass unbalance) are by acceleration,
    the others by its squares and products; D_IS is anisoelastic. a_S and a_O turn the input axis about the
    spin and the output axis. J is I_O/H, the inertia about the output axis over the spin momentum.
    """

    D_F: float = of("b0")
    eps_K: float = of("b1", note="in the numerator")
    a_O: float = of("m_j", note="about the output axis")
    a_S: float = of("m_k", -1.0, "about the spin axis: -m_k")
    D_I: float = of("g_i", note="mass unbalance along the spin axis")
    D_S: float = of("g_j", note="mass unbalance along the input axis")
    D_O: float = of("g_k")
    D_II: float = of("S_ii")
    D_SS: float = of("S_jj")
    D_OO: float = of("S_kk")
    D_IS: float = of("S_ij")
    D_IO: float = of("S_ik")
    D_OS: float = of("S_jk")
    J: float = of("s_k", symbol="I_O/H")
    theta_I: float = of("c_ij", note="pickoff angle per rate")


def indicated(p: RateIntegratingGyro, channels: Mapping[str, FloatArray], n: int) -> FloatArray:
    """Indicated rate (n,), rad/s; `channels` are inputs in SI by name (``w_i``, ``f_j``, ``dw_k``).

    Examples
    --------
    >>> import numpy as np
    >>> indicated(RateIntegratingGyro(D_IS=0.5), {"f_i": np.array([2.0]), "f_j": np.array([3.0])}, 1).tolist()
    [3.0]
    """
    w_I, w_S, w_O = vector(channels, "w", n)
    turning = w_I + p.a_O * w_S - p.a_S * w_O + p.theta_I * w_I * w_S + p.J * channel(channels, "dw_k", n)
    return (1.0 + p.eps_K) * (turning + drift(p, channels, n))


def drift(p: RateIntegratingGyro, channels: Mapping[str, FloatArray], n: int) -> FloatArray:
    """Drift rate D, rad/s: fixed, by acceleration, by its squares and products."""
    a_I, a_S, a_O = vector(channels, "f", n)
    linear = p.D_F + p.D_I * a_I + p.D_S * a_S + p.D_O * a_O
    squares = p.D_II * a_I**2 + p.D_SS * a_S**2 + p.D_OO * a_O**2
    return linear + squares + p.D_IS * a_I * a_S + p.D_IO * a_I * a_O + p.D_OS * a_O * a_S


SYMBOLS = symbols_of(RateIntegratingGyro, "gyroscope")

to_general, from_general = gained(SYMBOLS, RateIntegratingGyro)

STANDARD = Standard(
    id="ieee517",
    title="IEEE 517 rate-integrating gyroscope",
    kind="gyroscope",
    symbols=SYMBOLS,
    indicated=indicated,
    to_general=to_general,
    from_general=from_general,
    exact="exact for all inputs and all parameters with eps_K > -1; the angles are linear",
    beyond=("D_R",),
)
