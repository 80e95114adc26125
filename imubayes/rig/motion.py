"""What a rig did as vectors in case axes, and how an error of its equipment changes them.

Each error is applied exactly: rotations keep every length, a rate acts by its powers. With the rate w of the
case along its own axes a lab-fixed vector u obeys ``du/dt = -w x u``, so that over a step it becomes
``exp(-[phi]x) u`` with the step's rotation vector phi. For a rate that changes linearly::

    phi = (w_0 + w_1) dt/2 + w_0 x w_1 dt^2/12

whose second part (coning) makes the step right to the fourth order. The rotation of each step is exact.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.sensors.terms import AXES

Channels = Mapping[str, FloatArray]

SLOW = 1e-3
"""rad/s; below it w is the Earth's rate rather than the rig's, and centripetal force does not count."""


FELT = 1.0
"""m/s^2; less of gravity along the axis than this is rounding, and has no direction."""


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """What the rig did in n rows: vectors in case axes, SI.

    Attributes
    ----------
    f, w, dw : (n, 3).
    axis : (n, 3) unit vector that the rig turns about; zero where it is at rest.
    normal : (n, 3) normal of the plane of a tumble; zero elsewhere.
    up : (n, 3) unit vector against gravity; zero where nothing tells it.
    """

    f: FloatArray
    w: FloatArray
    dw: FloatArray
    axis: FloatArray
    normal: FloatArray
    up: FloatArray

    @property
    def along(self) -> FloatArray:
        """Part of f that does not come from turning: along the axis, or all of it where nothing turns."""
        return _along(self.f, self.axis)

    @property
    def across(self) -> FloatArray:
        """Part of f that comes from turning."""
        return self.f - self.along


def vectors(channels: Channels, quantity: str, n: int) -> FloatArray:
    """Vectors (n, 3) of a quantity (f, w, dw), zero where a channel is absent."""
    out = np.zeros((n, 3))
    for column, axis in enumerate(AXES):
        out[:, column] = channels.get(f"{quantity}_{axis}", 0.0)
    return out


def motion_of(channels: Channels, normal: FloatArray, upright: FloatArray, *, turning: bool) -> Motion:
    """Motion that channels tell, of a rig that turns about the axis of w, of dw where w is hardly any.

    `upright` (n, 3) is the unit vector against gravity where the force does not tell it from moment to
    moment, as it does not under vibration; zero where the force along the axis is gravity.
    """
    f, w, dw = (vectors(channels, quantity, len(normal)) for quantity in ("f", "w", "dw"))
    axis = np.zeros_like(w)
    if turning:
        axis = _unit(np.where(np.linalg.norm(w, axis=1, keepdims=True) > SLOW, w, dw))
    known = upright.any(axis=1, keepdims=True)
    return Motion(f, w, dw, axis, normal, np.where(known, upright, _unit(_along(f, axis), FELT)))


def components(m: Motion, channels: Channels) -> dict[str, FloatArray]:
    """Channels of the vectors of which any component is among `channels`."""
    vectors = {"f": m.f, "w": m.w, "dw": m.dw}
    return named({q: v for q, v in vectors.items() if any(f"{q}_{axis}" in channels for axis in AXES)})


def named(vectors: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Components of vectors (..., 3) by channel name."""
    return {
        f"{quantity}_{axis}": np.ascontiguousarray(values[..., column]).ravel()
        for quantity, values in vectors.items()
        for column, axis in enumerate(AXES)
    }


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.einsum("na,na->n", a, b)[:, None]


def _along(f: FloatArray, axis: FloatArray) -> FloatArray:
    turns = axis.any(axis=1, keepdims=True)
    return np.where(turns, _dot(f, axis) * axis, f)


def _unit(v: FloatArray, least: float = 0.0) -> FloatArray:
    """Unit vectors (n, 3); zero where the length is not above the least."""
    length = np.linalg.norm(v, axis=1, keepdims=True)
    return np.where(length > least, v / np.where(length > 0.0, length, 1.0), 0.0)


def turned(v: FloatArray, rotation: FloatArray) -> FloatArray:
    """Turn vectors (n, 3) by rotation vectors (n, 3), by Rodrigues' formula.

    Examples
    --------
    >>> turned(np.array([[1.0, 0.0, 0.0]]), np.array([[0.0, 0.0, np.pi / 2.0]])).round(12).tolist()
    [[0.0, 1.0, 0.0]]
    """
    turns = np.linalg.norm(rotation, axis=1, keepdims=True) / np.pi
    once = np.cross(rotation, v)
    return v + np.sinc(turns) * once + 0.5 * np.sinc(0.5 * turns) ** 2 * np.cross(rotation, once)


def _all_turned(m: Motion, rotation: FloatArray) -> Motion:
    f, w, dw = (turned(v, rotation) if v.any() else v for v in (m.f, m.w, m.dw))
    return replace(m, f=f, w=w, dw=dw)


def on_table(m: Motion, angle: FloatArray) -> Motion:
    """Table at a zero that is off by an angle (n, 1)."""
    return _all_turned(m, angle * m.normal)


def in_fixture(m: Motion, rotation: FloatArray) -> Motion:
    """Case turned in its fixture by a rotation vector (n, 3)."""
    return _all_turned(m, -rotation)


def heavier(m: Motion, change: FloatArray) -> Motion:
    """Gravity stronger by `change` (n, 1), m/s^2, whatever else the force is made of."""
    return replace(m, f=m.f + change * m.up)


def longer(m: Motion, share: FloatArray) -> Motion:
    """Arm longer by a share (n, 1)."""
    return replace(m, f=m.f + share * m.across)


def shortened(m: Motion, share: FloatArray) -> Motion:
    """Force and rate smaller by a share (n, 1)."""
    less = 1.0 - share
    return replace(m, f=less * m.f, w=less * m.w, dw=less * m.dw)


def stretched(m: Motion, by_level: FloatArray) -> Motion:
    """Arm longer by a share that is `by_level` (n, 1), 1/(m/s^2), of the force across the axis."""
    across = m.across
    return replace(m, f=m.f + by_level * np.linalg.norm(across, axis=1, keepdims=True) * across)


def faster(m: Motion, share: FloatArray) -> Motion:
    """Rate and its derivative greater by a share (n, 1), at the same radius.

    In the plane across the axis, with complex numbers for directions, the force at radius r is
    ``(-w^2 + i dw) r``.
    """
    along, across, gain = m.along, m.across, 1.0 + share
    rate, slope = _dot(m.w, m.axis), _dot(m.dw, m.axis)
    was = -(rate**2) + 1j * slope
    still = was == 0.0
    ratio = np.where(still, 1.0, (-((gain * rate) ** 2) + 1j * gain * slope) / np.where(still, 1.0, was))
    f = along + np.real(ratio) * across + np.imag(ratio) * np.cross(m.axis, across)
    return replace(m, f=f, w=gain * m.w, dw=gain * m.dw)


def rotation_vectors(t: FloatArray, w: FloatArray) -> FloatArray:
    """Rotation vector (n - 1, 3), rad, of each step between rates w (n, 3), rad/s, at times t (n,), s.

    Examples
    --------
    >>> rotation_vectors(np.array([0.0, 0.5]), np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 3.0]])).tolist()
    [[0.0, 0.0, 1.0]]
    """
    dt = np.diff(t)[:, None]
    return 0.5 * dt * (w[:-1] + w[1:]) + dt**2 / 12.0 * np.cross(w[:-1], w[1:])


def cross_matrix(v: FloatArray) -> FloatArray:
    """Matrices [v]x (..., 3, 3) of vectors v (..., 3): ``[v]x u = v x u``."""
    zero = np.zeros(v.shape[:-1])
    x, y, z = np.moveaxis(v, -1, 0)
    return np.stack((zero, -z, y, z, zero, -x, -y, x, zero), axis=-1).reshape(*v.shape, 3)


def onward(t: FloatArray, w: FloatArray) -> FloatArray:
    """Turn from each time t (n,), s, to the last one: (n, 3, 3), the last of them the identity.

    ``onward[k] @ u(t_k)`` is where a lab-fixed u lies in the case at ``t[-1]``; the case turns at the rate w
    (n, 3) along its axes, rad/s.
    """
    from scipy.spatial.transform import Rotation

    steps = Rotation.from_rotvec(-rotation_vectors(t, w)).as_matrix()
    turns = np.concatenate((steps, np.eye(3)[None]))
    reach = 1
    while reach < len(turns):
        # turns[k] covers `reach` steps from k on: joined to the ones that follow it covers twice as many
        turns[:-reach] = turns[reach:] @ turns[:-reach]
        reach *= 2
    return turns
