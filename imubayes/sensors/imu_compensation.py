"""The inverse of an IMU's model: true inputs from outputs, proved over a stated range, and what is left then.

By the fixed point ``x <- y - D(clip(x))``, whose convergence and uniqueness over the range
`imubayes.sensors.imu_range` proves; of the basic model (bias, scale factor, misalignment) that is
``x = (I + M)^-1 (y - b)``. Forces and rates are solved for together: the accelerometers' spin terms
use the compensated rate, and the gyroscopes' g-sensitivity the compensated specific force.

A bias asymmetry b0' jumps at zero. With b0' > 0 no input gives an output inside the gap; such outputs are
compensated to zero. With b0' < 0 inputs within ``|b0'|`` of zero share their outputs with others: the
output's sign decides, and the input is off by ``2 |b0'|``, over the slope of the model, at most.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.errors import InputError
from imubayes.sensors.imu import (
    CASE_CHANNELS,
    COMPONENTS,
    Component,
    Imu,
    Signals,
    case_channel,
    case_columns,
    component_channels,
    forward,
    table_of,
)
from imubayes.sensors.imu_range import InputRange, described, rounds
from imubayes.sensors.terms import column, columns

ROUNDING = 1e-9
"""Relative; how far outside of the range an input may come out by rounding."""


def compensate(imu: Imu, outputs: Signals, within: InputRange) -> Signals:
    """Inputs that the model turns into these outputs.

    Parameters
    ----------
    outputs : ``f`` and ``w`` are the sensors' outputs; dw, T and warming are known inputs.
    within : the range of inputs, in which the answer must lie.

    Returns
    -------
    the inputs; dw, T and warming as given.

    Raises
    ------
    InputError : if the model cannot be inverted over the range, or a row's input lies outside of it; names
        the row, the axis and the range.

    Examples
    --------
    >>> from imubayes.sensors.imu import forward, imu_of, signals
    >>> from imubayes.sensors.imu_range import input_range
    >>> from imubayes.sensors.terms import library
    >>> lib = library("accelerometer", powers=2, asymmetry=-1)
    >>> imu = imu_of({"az": Component(lib, np.full(len(lib.terms), 1e-4))})
    >>> outputs = forward(imu, signals([[0.1, 0.2, 9.8]]))
    >>> compensate(imu, outputs, input_range(20.0, 1.0)).f.round(12).tolist()
    [[0.1, 0.2, 9.8]]
    """
    # known inputs must be inside too: slopes are bounded over all of the range
    ends = within.ends
    _check_inside(case_columns(outputs)[:, 6:], ends[6:] * (1.0 + ROUNDING), _NAMES[6:], within)
    x = inverted(imu, outputs, ends[:6], rounds(split_jumps(imu)[0], within))
    # a row may lie outside by what a negative asymmetry of its triad leaves open
    overlap = overlaps(imu, outputs).reshape(-1, 2, 3).max(axis=2)
    open_by = 3.0 * np.repeat(overlap, 3, axis=1)
    _check_inside(x, ends[:6] * (1.0 + ROUNDING) + open_by, _NAMES, within)
    return replace(outputs, f=np.ascontiguousarray(x[:, :3]), w=np.ascontiguousarray(x[:, 3:]))


def inverted(imu: Imu, outputs: Signals, ends: FloatArray, steps: int) -> FloatArray:
    """Inputs (n, 6), f and w, after at most so many steps; the deviations are held beyond ends (6,)."""
    from imubayes.sensors.imu_kernel import compensate_rows

    smooth, jumps = split_jumps(imu)
    rows = case_columns(outputs)
    return compensate_rows(table_of(smooth), imu.levers, ends, steps, rows, _jumps(jumps, outputs))


def missed(imu: Imu, outputs: Signals, x: FloatArray) -> float:
    """By how much the outputs at inputs x (n, 6) miss given ones at most, beside what jumps leave open."""
    with np.errstate(invalid="ignore", over="ignore"):
        signals = forward(imu, replace(outputs, f=x[:, :3], w=x[:, 3:]))
        left = np.abs(np.hstack([signals.f - outputs.f, signals.w - outputs.w]))
    return float(np.max(left - 2.0 * np.abs(_jumps(split_jumps(imu)[1], outputs)), initial=0.0))


def split_jumps(imu: Imu) -> tuple[Imu, Imu]:
    """The IMU without the terms that jump at zero (``b0p``), and with those alone, their sign left out."""
    smooth, jumps = (
        tuple(_part(component, jumping=jumping) for component in imu.components) for jumping in (False, True)
    )
    return Imu(smooth, imu.levers), Imu(jumps, imu.levers)


def overlaps(imu: Imu, outputs: Signals) -> FloatArray:
    """Size (n, 6) of each negative asymmetry at the rows' temperatures, zero where it is positive."""
    return np.maximum(-_jumps(split_jumps(imu)[1], outputs), 0.0)


def _part(component: Component, *, jumping: bool) -> Component:
    """The terms that jump where the own input changes its sign, or the others."""
    terms, kept = component.library.terms, []
    for k, term in enumerate(terms):
        rest = tuple(factor for factor in term.factors if not (factor.signed and factor.power == 0))
        if (len(rest) < len(term.factors)) == jumping:
            kept.append((k, replace(term, factors=rest)))
    lib = replace(component.library, terms=tuple(term for _, term in kept))
    return Component(lib, component.theta[[k for k, _ in kept]])


def _jumps(imu: Imu, outputs: Signals) -> FloatArray:
    """Size (n, 6) of each component's jump at the rows' temperatures."""
    sizes = np.zeros((len(outputs.f), 6))
    for c, (name, component) in enumerate(zip(COMPONENTS, imu.components, strict=True)):
        channels = component_channels(name, outputs) if component.library.terms else {}
        for term, theta in zip(component.library.terms, component.theta, strict=True):
            sizes[:, c] += theta * column(term, channels)
    return sizes


_NAMES = (*(f"{quantity} along {axis}" for quantity in ("f", "w", "dw") for axis in "xyz"), "T", "dT/dt")


def _check_inside(values: FloatArray, ends: FloatArray, names: Sequence[str], within: InputRange) -> None:
    rows = ~(np.abs(values) <= ends)
    if rows.any():
        row, axis = np.argwhere(rows)[0]
        count = int(rows.any(axis=1).sum())
        said = f"{count} {'row' if count == 1 else 'rows'} in all"
        raise InputError(
            f"row {row}: {names[axis]} lies outside of the range that the compensation is valid for,"
            f" {described(within)} ({said}): remove such rows, or state a larger range"
        )


def error_covariance(imu: Imu, covariance: FloatArray, inputs: Signals) -> FloatArray:
    """Covariance (n, 6, 6) of the remaining error at each row, to first order: ``J C J'``.

    ``J = -(dF/dx)^-1 X``, F the outputs and X the six components' regressors.

    Parameters
    ----------
    imu : at the coefficients that the compensation uses.
    covariance : (p, p) of all coefficients, in the order of the components and their terms.
    inputs : the n rows.

    Raises
    ------
    InputError : if the covariance does not fit the number of coefficients.
    """
    X = regressors(imu, inputs)
    p = X.shape[2]
    if covariance.shape != (p, p):
        raise InputError(f"covariance of shape {covariance.shape}: expected {(p, p)}, one row a coefficient")
    J = -np.linalg.solve(jacobian(imu, inputs), X)
    return J @ covariance @ J.transpose(0, 2, 1)


def regressors(imu: Imu, inputs: Signals) -> FloatArray:
    """Regressors (n, 6, p) of all components, each at its sense point."""
    ends = np.cumsum([0, *(len(component.theta) for component in imu.components)])
    X = np.zeros((len(inputs.f), 6, ends[-1]))
    for c, (name, component) in enumerate(zip(COMPONENTS, imu.components, strict=True)):
        channels = component_channels(name, sensed(imu, c, inputs))
        columns(component.library, channels, len(X), out=X[:, c, ends[c] : ends[c + 1]])
    return X


def jacobian(imu: Imu, inputs: Signals) -> FloatArray:
    """Slopes (n, 6, 6) of the outputs in f and w along the case axes; of a jump at zero none."""
    slopes = np.zeros((len(inputs.f), 6, 6))
    for c in range(6):
        slopes[:, c, :] = _term_slopes(imu, c, inputs)
        slopes[:, c, c] += 1.0
        if c < 3:
            slopes[:, c, 3:] += np.einsum("ne,ned->nd", slopes[:, c, :3], _turn(imu.levers[c], inputs.w))
    return slopes


def sensed(imu: Imu, c: int, inputs: Signals) -> Signals:
    """Inputs at the sense point of component number c."""
    if c >= 3 or not imu.levers[c].any():
        return inputs
    r = imu.levers[c]
    size = np.cross(inputs.w, np.cross(inputs.w, r)) + np.cross(inputs.dw, r)
    return replace(inputs, f=inputs.f + size)


def _turn(r: FloatArray, w: FloatArray) -> FloatArray:
    """Slopes (n, 3, 3) of ``w (w.r) - r (w.w)`` in w."""
    along = w @ r
    return along[:, None, None] * np.eye(3) + w[:, :, None] * r - 2.0 * r[:, None] * w[:, None, :]


def _term_slopes(imu: Imu, c: int, inputs: Signals) -> FloatArray:
    """Slopes (n, 6) of ``X theta`` of a component in f and w along the case axes, by the product rule."""
    name, component = COMPONENTS[c], imu.components[c]
    channels = component_channels(name, sensed(imu, c, inputs))
    slopes = np.zeros((len(inputs.f), 6))
    for term, theta in zip(component.library.terms, component.theta, strict=True):
        for q, factor in enumerate(term.factors):
            place = CASE_CHANNELS.index(case_channel(name, factor.channel))
            if place < 6 and factor.power:
                lower = replace(factor, power=factor.power - 1)
                rest = replace(term, factors=(*term.factors[:q], lower, *term.factors[q + 1 :]))
                slopes[:, place] += theta * (factor.power * column(rest, channels))
    return slopes
