"""What is left after compensation: compensated output minus truth, and how uncertain that is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.errors import InputError
from imubayes.sensors.imu import COMPONENTS, Component, Imu, Signals, axes_of, component_channels, forward
from imubayes.sensors.imu_compensation import compensate
from imubayes.sensors.imu_range import InputRange
from imubayes.sensors.terms import Factor, Term, column, columns


def remaining_error(truth: Imu, estimate: Imu, inputs: Signals, within: InputRange) -> FloatArray:
    """Error (n, 6) of f and w of an IMU that is compensated with an estimate of its model, without noise.

    Raises
    ------
    InputError : if the compensation is not valid at a row, see `compensate`.

    Examples
    --------
    >>> from imubayes.sensors.imu import imu_of, signals
    >>> from imubayes.sensors.imu_range import input_range
    >>> from imubayes.sensors.terms import library
    >>> lib = library("accelerometer", powers=1, asymmetry=-1)
    >>> imu = imu_of({"ax": Component(lib, np.eye(len(lib.terms))[0] * 0.01)})
    >>> left = remaining_error(imu, imu_of({}), signals([[1.0, 2.0, 3.0]]), input_range(20.0, 1.0))
    >>> left[0, :2].round(12).tolist()
    [0.01, 0.0]
    """
    found = compensate(estimate, forward(truth, inputs), within)
    return np.hstack([found.f - inputs.f, found.w - inputs.w])


def error_draws(
    estimate: Imu, draws: Mapping[str, FloatArray], inputs: Signals, within: InputRange
) -> FloatArray:
    """Remaining errors (m, n, 6) over m draws of the true coefficients, exact in them.

    Parameters
    ----------
    estimate : what the compensation uses.
    draws : by component, (m, p) coefficients in the order of its library; the others are as estimated.

    Raises
    ------
    InputError : if the components have different numbers of draws, or the compensation is not valid at a row;
        rows are counted through all draws.
    """
    sizes = {len(theta) for theta in draws.values()}
    if len(sizes) != 1:
        raise InputError(f"components with {sorted(sizes)} draws: expected as many of each, one at least")
    m = sizes.pop()
    outputs = [forward(_unit(estimate, draws, k), inputs) for k in range(m)]
    truth = replace(inputs, **{key: np.concatenate([getattr(inputs, key)] * m) for key in _FIELDS})
    measured = replace(
        truth, f=np.vstack([one.f for one in outputs]), w=np.vstack([one.w for one in outputs])
    )
    found = compensate(estimate, measured, within)
    return np.hstack([found.f - truth.f, found.w - truth.w]).reshape(m, -1, 6)


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
    blocks = [
        columns(component.library, component_channels(name, sensed(imu, c, inputs)), len(inputs.f))
        for c, (name, component) in enumerate(zip(COMPONENTS, imu.components, strict=True))
    ]
    X = np.zeros((len(inputs.f), 6, sum(block.shape[1] for block in blocks)))
    ends = np.cumsum([0, *(block.shape[1] for block in blocks)])
    for c, block in enumerate(blocks):
        X[:, c, ends[c] : ends[c + 1]] = block
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
    name, component = COMPONENTS[c], imu.components[c]
    channels = component_channels(name, sensed(imu, c, inputs))
    slopes = np.zeros((len(inputs.f), 6))
    for q, axis in ((q, axis) for q in "fw" for axis in range(3)):
        channel = f"{q}_{'ijk'[axis]}"
        for term, theta in zip(component.library.terms, component.theta, strict=True):
            slopes[:, axes_of(name)[axis] + 3 * "fw".index(q)] += theta * _slope(term, channel, channels)
    return slopes


def _slope(term: Term, channel: str, channels: Mapping[str, FloatArray]) -> FloatArray | float:
    """Derivative of a regressor in one of its inputs, by the product rule."""
    total: FloatArray | float = 0.0
    for q, factor in enumerate(term.factors):
        if factor.channel == channel and factor.power:
            lower = Factor(channel, factor.power - 1, factor.signed)
            factors: Sequence[Factor] = (*term.factors[:q], lower, *term.factors[q + 1 :])
            total = total + factor.power * column(replace(term, factors=tuple(factors)), channels)
    return total


_FIELDS = ("f", "w", "dw", "T", "warming")


def _unit(estimate: Imu, draws: Mapping[str, FloatArray], k: int) -> Imu:
    components = zip(COMPONENTS, estimate.components, strict=True)
    return replace(
        estimate,
        components=tuple(
            Component(component.library, draws[name][k]) if name in draws else component
            for name, component in components
        ),
    )
