"""Attitude of a case over a record: matrices that take its axes to a level frame.

The level frame has its axes north, west and up, and stays as it is while the case turns. Attitude comes
from angles or a quaternion of the record, or is followed from the rate, levelled by the force of the first
seconds.
"""

from __future__ import annotations

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.rig.motion import onward
from imubayes.units import STANDARD_GRAVITY

LEVELLING = 2.0
"""s; the first of a record, in which force is taken as upwards on the average."""

CALM = (0.02, 0.05)
"""Share of g by which force may differ from it, and rate, rad/s, where the case is taken to be at rest."""

_TURNED_OVER = np.array([[1.0], [-1.0], [-1.0]])
"""Rows of an attitude that change sign where the level frame of a record is north, east, down."""


def from_angles(roll: FloatArray, pitch: FloatArray, yaw: FloatArray) -> FloatArray:
    """Attitude (..., 3, 3) of angles, rad: about x, then the level y, then the vertical.

    Examples
    --------
    >>> from_angles(*np.array([0.0, 0.0, np.pi / 2.0]))[:, 0].round(9).tolist()
    [0.0, 1.0, -0.0]
    """
    (cr, cp, cy), (sr, sp, sy) = np.cos((roll, pitch, yaw)), np.sin((roll, pitch, yaw))
    rows = (
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr),
    )
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def from_quaternions(w: FloatArray, x: FloatArray, y: FloatArray, z: FloatArray) -> FloatArray:
    """Attitude (..., 3, 3) of quaternions (w, x, y, z) of any length but zero.

    Examples
    --------
    >>> from_quaternions(*np.array([1.0, 0.0, 0.0, 1.0]))[:, 0].round(9).tolist()
    [0.0, 1.0, 0.0]
    """
    w, x, y, z = np.array((w, x, y, z)) / np.linalg.norm((w, x, y, z), axis=0)
    rows = (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    )
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def upright(attitude: FloatArray, force: FloatArray) -> FloatArray:
    """Attitude (n, 3, 3) in a frame with its third axis up, where a record's may point down.

    Which of the two it is says the specific force (n, 3), which on the average points up.
    """
    lift = float(np.einsum("nj,nj->", attitude[:, 2], force))
    return attitude if lift >= 0.0 else attitude * _TURNED_OVER


def followed(t: FloatArray, rate: FloatArray, force: FloatArray) -> FloatArray:
    """Attitude (n, 3, 3) by the rate (n, 3), rad/s, from a start level by the force (n, 3) and to the north.

    Examples
    --------
    >>> t, up = np.linspace(0.0, 1.0, 101), np.tile([0.0, 0.0, 9.8], (101, 1))
    >>> followed(t, np.tile([0.0, 0.0, np.pi], (101, 1)), up)[-1].diagonal().round(9).tolist()
    [-1.0, -1.0, 1.0]
    """
    turns = onward(t, rate)
    out = turns[0].T @ turns  # from the case at each time to the case at the first
    first = t - t[0] <= LEVELLING
    return levelled(np.einsum("nij,nj->ni", out[first], force[first])) @ out


def levelled(force: FloatArray) -> FloatArray:
    """Attitude (3, 3) of a case that feels a force (n, 3) upwards, with x (if upright, y) to the north."""
    mean = force.mean(axis=0)
    if not mean.any():
        return np.eye(3)
    up = mean / np.linalg.norm(mean)
    ahead = np.eye(3)[0 if abs(up[0]) < 0.9 else 1]
    north = ahead - (ahead @ up) * up
    north /= np.linalg.norm(north)
    return np.array([north, np.cross(up, north), up])


def at_rest(attitude: FloatArray, force: FloatArray, rate: FloatArray) -> FloatArray:
    """Angle (k,), rad, between the force and the vertical in the rows in which the case is at rest."""
    size = np.linalg.norm(force, axis=1)
    calm = (np.abs(size / STANDARD_GRAVITY - 1.0) < CALM[0]) & (np.linalg.norm(rate, axis=1) < CALM[1])
    along = np.einsum("nj,nj->n", attitude[calm, 2], force[calm]) / size[calm]
    return np.arccos(np.clip(along, -1.0, 1.0))
