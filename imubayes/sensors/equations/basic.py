"""The basic triad: bias, scale and a 3x3 matrix, 12 parameters.

::

    f~ = (I + M) f + b,      f^ = (I + M)^-1 (f~ - b)    (`imubayes.sensors.imu_compensation`)

Row x of M is the component with (i, j, k) = (x, y, z), row y has (y, z, x), row z has (z, x, y): ``m_xy`` is
the m_j of x, and ``m_yx`` the m_k of y. Basic to generalized is exact, the rest is zero. The way back is a
projection over the inputs that matter (`project`): what the other terms do there is absorbed as well as
bias, scale and misalignment can, and the rms that is lost is stated. Leaving terms out instead is worse.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from imubayes.algebra import factor
from imubayes.algebra.factor import Factor
from imubayes.errors import TermError
from imubayes.sensors.equations import mapping
from imubayes.sensors.equations.mapping import (
    Coefficients,
    FloatArray,
    Projection,
    Standard,
    of,
    symbols_of,
    vector,
)
from imubayes.sensors.terms import QUANTITY, Kind, Library

TERMS = ("b0", "b1", "m_j", "m_k")
"""The generalized terms of one component of the triad."""


@dataclass(frozen=True, slots=True)
class BasicComponent:
    """One row of the triad, SI: bias, scale-factor error, and the response to the second and third axis."""

    kind: Kind
    b: float = of("b0")
    s: float = of("b1")
    m_j: float = of("m_j", note="m_xy of component x", symbol="m_ij")
    m_k: float = of("m_k", note="m_xz of component x", symbol="m_ik")


def indicated(p: BasicComponent, channels: Mapping[str, FloatArray], n: int) -> FloatArray:
    """Indicated input of one component, m/s^2 or rad/s.

    Examples
    --------
    >>> indicated(BasicComponent("gyroscope", b=0.5, m_k=2.0), {"w_k": np.array([1.0])}, 1).tolist()
    [2.5]
    """
    i, j, k = vector(channels, QUANTITY[p.kind], n)
    return p.b + (1.0 + p.s) * i + p.m_j * j + p.m_k * k


def to_general(p: BasicComponent) -> Coefficients:
    """Generalized coefficients of one component; exact."""
    return {"b0": p.b, "b1": p.s, "m_j": p.m_j, "m_k": p.m_k}


def from_general(kind: Kind, theta: Mapping[str, Any]) -> BasicComponent:
    """Read bias, scale and misalignment off; exact only where all else is zero, else use `project`."""
    b, s, m_j, m_k = (theta.get(name, 0.0) for name in TERMS)
    return BasicComponent(kind, b, s, m_j, m_k)


def project(lib: Library, theta: FloatArray, inputs: Factor) -> tuple[BasicComponent, Projection]:
    """The basic component that serves best over given inputs, and what it cannot serve.

    The coefficients theta (p,) of `lib` are in SI; `inputs` is the factor of the library's columns, whose
    response is not used. A term of the basic model that they do not excite keeps its own value. The
    projection has the rms over the inputs of what the other terms do, and of what is lost. It is a
    `TermError` if the factor is of other columns, and an `UnobservableError` if the inputs cannot tell bias,
    scale and misalignment apart.
    """
    if inputs.names != lib.names:
        raise TermError(
            f"the factor of the inputs must have the library's {len(lib.names)} columns in its order,"
            f" got {len(inputs.names)}: factor columns(lib, channels, n)"
        )
    theta = np.asarray(theta, dtype=np.float64)
    basic = [lib.names.index(name) for name in TERMS]
    others = np.delete(np.arange(len(theta)), basic)
    R = factor.reorder(inputs, [lib.names[j] for j in (*basic, *others)]).R[:-1, :-1]
    absorbed = mapping.project(R[:, : len(basic)], R[:, len(basic) :] @ theta[others], TERMS, inputs.n)
    b, s, m_j, m_k = (theta[j] + absorbed.coefficients[name] for j, name in zip(basic, TERMS, strict=True))
    return BasicComponent(lib.kind, float(b), float(s), float(m_j), float(m_k)), absorbed


def _standard(kind: Kind) -> Standard:
    return Standard(
        id="basic",
        title="basic triad",
        kind=kind,
        symbols=symbols_of(BasicComponent, kind),
        indicated=indicated,
        to_general=to_general,
        from_general=lambda theta: from_general(kind, theta),
        exact="basic to generalized is exact; the way back is exact only where all other terms are zero, else"
        " it is a projection over stated inputs",
    )


ACCELEROMETER = _standard("accelerometer")
GYROSCOPE = _standard("gyroscope")
