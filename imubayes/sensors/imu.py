"""Six generalized components in one case: what an IMU puts out.

The components ``ax ay az gx gy gz`` have the axes (i, j, k) = xyz, yzx, zxy of the case, all right-handed.
Their coefficients are errors, so ``output = input + X(f, w, dw/dt, T) theta`` for each.

A *lever arm* r of an accelerometer goes from the point whose specific force is f to the point where the
component senses (the size effect): it feels ``f + w x (w x r) + dw x r``. It drives the same regressors as
the terms S and s of that accelerometer. Coefficients that were fitted with f at the case's origin hold it
already, so it is given either in the one form or in the other: `without_lever` moves it out of the
coefficients.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from imubayes.algebra import FloatArray
from imubayes.errors import InputError, TermError
from imubayes.sensors.terms import CHANNELS, REFERENCE_TEMPERATURE, Kind, Library

if TYPE_CHECKING:
    from imubayes.sensors.imu_kernel import Table

ACCELEROMETERS = ("ax", "ay", "az")
GYROSCOPES = ("gx", "gy", "gz")
COMPONENTS = (*ACCELEROMETERS, *GYROSCOPES)

PERMUTATION = ((0, 1, 2), (1, 2, 0), (2, 0, 1))
"""Case axes of (i, j, k) of the x, y and z component of a triad."""

CASE_CHANNELS = tuple([f"{quantity}_{axis}" for quantity in ("f", "w", "dw") for axis in "xyz"] + ["T", "dT"])
"""Columns of the case's inputs: `imubayes.sensors.terms.CHANNELS` along x, y, z."""


@dataclass(frozen=True, slots=True, eq=False)
class Component:
    """A component at known coefficients theta (p,), SI, in the order of its library's terms."""

    library: Library
    theta: FloatArray

    def __post_init__(self) -> None:
        if strange := self.library.on("gT"):
            raise TermError(
                f"term '{strange[0]}' needs a second thermometer, which the inputs of an IMU, and of exported"
                " code, do not have: choose a model without it"
            )


@dataclass(frozen=True, slots=True, eq=False)
class Imu:
    """Six components in one case, ax to gz; rows of the levers (3, 3), m, are sense points of ax, ay, az."""

    components: tuple[Component, ...]
    levers: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Signals:
    """Inputs of an IMU along the case axes; or its outputs, which stand in the place of f and w.

    Attributes
    ----------
    f, w, dw : (n, 3) specific force, m/s^2 (+g up at rest), rate, rad/s, angular acceleration, rad/s^2.
    T, warming : (n,) temperature, K, and its rate, K/s.
    """

    f: FloatArray
    w: FloatArray
    dw: FloatArray
    T: FloatArray
    warming: FloatArray


def imu_of(components: Mapping[str, Component], levers: ArrayLike | None = None) -> Imu:
    """Put components into a case; those that are not named are ideal.

    Parameters
    ----------
    components : by name, ``ax`` to ``gz``.
    levers : (3, 3) sense point of ax, ay, az along the case axes, m; all in the origin where absent.

    Raises
    ------
    TermError : if a name is not of a component, or its kind is the other one.
    InputError : if a component has not one finite coefficient a term, or the levers are not (3, 3) numbers.

    Examples
    --------
    >>> from imubayes.sensors.terms import library
    >>> lib = library("accelerometer", powers=1, asymmetry=-1)
    >>> imu = imu_of({"ay": Component(lib, np.full(len(lib.terms), 1e-3))})
    >>> [len(c.theta) for c in imu.components]
    [0, 15, 0, 0, 0, 0]
    """
    for name, component in components.items():
        kind, p = kind_of(name), len(component.library.terms)
        if component.library.kind != kind:
            raise TermError(f"{name}: expected a library of kind {kind}, not {component.library.kind}")
        if component.theta.shape != (p,) or not np.isfinite(component.theta).all():
            raise InputError(
                f"{name}: coefficients of shape {component.theta.shape}: expected {p} finite ones, one a term"
            )
    arms = np.zeros((3, 3)) if levers is None else np.array(levers, dtype=float)
    if arms.shape != (3, 3) or not np.isfinite(arms).all():
        raise InputError(f"lever arms of shape {arms.shape}: expected (3, 3) finite, a row an accelerometer")
    return Imu(tuple(components.get(name, ideal(kind_of(name))) for name in COMPONENTS), arms)


def signals(
    f: ArrayLike,
    w: ArrayLike | None = None,
    *,
    dw: ArrayLike | None = None,
    T: ArrayLike | None = None,
    warming: ArrayLike | None = None,
) -> Signals:
    """Collect inputs (or outputs) of n rows; what is absent is zero, and T is 25 degC.

    Raises
    ------
    InputError : if the shapes differ from (n, 3) and (n,), or a value is not finite; names the row.

    Examples
    --------
    >>> signals([[0.0, 0.0, 9.81]]).T.tolist()
    [298.15]
    """
    n = len(np.atleast_2d(np.asarray(f, dtype=float)))
    usual = (
        ("f", f, 0.0),
        ("w", w, 0.0),
        ("dw", dw, 0.0),
        ("T", T, REFERENCE_TEMPERATURE),
        ("warming", warming, 0.0),
    )
    return Signals(
        *(_array(name, given, (n,) if name in ("T", "warming") else (n, 3), at) for name, given, at in usual)
    )


def forward(imu: Imu, inputs: Signals) -> Signals:
    """Outputs of the six components, without noise.

    Parameters
    ----------
    inputs : true inputs, n rows.

    Returns
    -------
    outputs of the accelerometers as ``f`` and of the gyroscopes as ``w``; the rest as given.

    Examples
    --------
    >>> from imubayes.sensors.terms import library
    >>> lib = library("gyroscope", powers=1, asymmetry=-1, set="slide")
    >>> gz = Component(lib, np.eye(len(lib.terms))[lib.names.index("m_j")] * 1e-3)
    >>> forward(imu_of({"gz": gz}), signals([[0, 0, 9.81]], [[2.0, 0.0, 0.0]])).w.tolist()
    [[2.0, 0.0, 0.002]]
    """
    from imubayes.sensors.imu_kernel import forward_rows

    f, w = forward_rows(table_of(imu), imu.levers, case_columns(inputs))
    return replace(inputs, f=f, w=w)


def ideal(kind: Kind) -> Component:
    """Component without any error."""
    return Component(Library(kind, ()), np.zeros(0))


def kind_of(name: str) -> Kind:
    """Kind of ``ax`` to ``gz``; a `TermError` if there is no such component."""
    if name not in COMPONENTS:
        raise TermError(f"component '{name}' is not known: expected one of {', '.join(COMPONENTS)}")
    return "accelerometer" if name in ACCELEROMETERS else "gyroscope"


def axes_of(name: str) -> tuple[int, int, int]:
    """Case axes of (i, j, k) of a component.

    Examples
    --------
    >>> axes_of("gy")
    (1, 2, 0)
    """
    return PERMUTATION["xyz".index(name[1])]


def case_channel(name: str, channel: str) -> str:
    """Input channel of a component as one of the case.

    Examples
    --------
    >>> case_channel("ay", "dw_j"), case_channel("gz", "f_k"), case_channel("ax", "T")
    ('dw_z', 'f_y', 'T')
    """
    quantity, _, axis = channel.partition("_")
    return f"{quantity}_{'xyz'[axes_of(name)['ijk'.index(axis)]]}" if axis else channel


def component_channels(name: str, inputs: Signals) -> dict[str, FloatArray]:
    """Inputs of the case along the axes of a component, without a lever arm, for `terms.columns`."""
    case = (*inputs.f.T, *inputs.w.T, *inputs.dw.T, inputs.T, inputs.warming)
    return own_channels(dict(zip(CASE_CHANNELS, case, strict=True)), name)


def own_channels(channels: Mapping[str, FloatArray], component: str) -> dict[str, FloatArray]:
    """Channels along the case axes as those of a component, along its axes."""
    places = {channel: case_channel(component, channel) for channel in CHANNELS}
    return {own: channels[place] for own, place in places.items() if place in channels}


def case_columns(inputs: Signals) -> FloatArray:
    """Inputs as rows (n, 11) of `CASE_CHANNELS`, temperature above 25 degC."""
    heat = inputs.T - REFERENCE_TEMPERATURE
    return np.column_stack([inputs.f, inputs.w, inputs.dw, heat, inputs.warming])


def table_of(imu: Imu) -> Table:
    """Terms of the six components in one flat table."""
    named = list(zip(COMPONENTS, imu.components, strict=True))
    terms = [(name, term) for name, component in named for term in component.library.terms]
    factors = [(name, factor) for name, term in terms for factor in term.factors]
    columns = [CASE_CHANNELS.index(case_channel(name, factor.channel)) for name, factor in factors]
    return (
        np.cumsum([0, *(len(component.theta) for component in imu.components)], dtype=np.int64),
        np.concatenate([component.theta for component in imu.components]),
        np.cumsum([0, *(len(term.factors) for _, term in terms)], dtype=np.int64),
        np.array(columns, dtype=np.int64),
        np.array([factor.power for _, factor in factors], dtype=np.int64),
        np.array([factor.signed for _, factor in factors], dtype=np.bool_),
    )


def lever_terms(lever: tuple[float, float, float]) -> dict[str, float]:
    """Coefficients that a lever arm along (i, j, k), m, adds to those of its accelerometer, to first order.

    ``[w x (w x r)]_i + [dw x r]_i``, term by term.

    Examples
    --------
    >>> lever_terms((0.0, 0.01, 0.0))["S_ij"]
    0.01
    """
    r_i, r_j, r_k = lever
    return {"S_ij": r_j, "S_ik": r_k, "S_jj": -r_i, "S_kk": -r_i, "s_j": r_k, "s_k": -r_j}


def without_lever(name: str, component: Component, lever: ArrayLike) -> Component:
    """Take a lever arm out of the coefficients that were fitted with f at the case's origin.

    What stays in S and s is the component's own spin and angular-acceleration sensitivity.

    Parameters
    ----------
    name : ``ax``, ``ay`` or ``az``.
    lever : (3,) sense point along the case axes, m.

    Raises
    ------
    TermError : if the library lacks a term that the lever drives (``S_jj`` and ``S_kk`` are extended terms).
    """
    r_x = np.asarray(lever, dtype=float)
    i, j, k = axes_of(name)
    theta = component.theta.copy()
    for term, size in lever_terms((r_x[i], r_x[j], r_x[k])).items():
        if size and term not in component.library.names:
            raise TermError(
                f"{name}: the lever arm drives {term}, which the library lacks: expected set = 'extended'"
            )
        if size:
            theta[component.library.names.index(term)] -= size
    return Component(component.library, theta)


def _array(name: str, given: ArrayLike | None, shape: tuple[int, ...], usual: float) -> FloatArray:
    if given is None:
        return np.full(shape, usual)
    values = (
        np.ascontiguousarray(given, dtype=float).reshape(-1, 3)
        if len(shape) == 2
        else np.array(given, dtype=float)
    )
    if values.ndim == 0:
        values = np.full(shape, float(values))
    if values.shape != shape:
        raise InputError(f"{name} has the shape {values.shape}: expected {shape}, as many rows as f")
    wrong = ~np.isfinite(values).reshape(len(values), -1).all(axis=1)
    if wrong.any():
        raise InputError(f"{name}: row {int(np.argmax(wrong))} is not finite: remove the row, or fill it")
    return values
