"""Attitude from rates: how a direction that is fixed in the lab turns in the case.

With the rate w of the case along its own axes a lab-fixed vector u obeys ``du/dt = -w x u``, so that over a
step it becomes ``exp(-[phi]x) u`` with the step's rotation vector phi. For a rate that changes linearly::

    phi = (w_0 + w_1) dt/2 + w_0 x w_1 dt^2/12

whose second part (coning) makes the step right to the fourth order. The rotation of each step is exact.
"""

from __future__ import annotations

import numpy as np

from imubayes.algebra.arrays import FloatArray

SMALL = 1e-4
"""rad: below it the sines of a rotation are taken from their series, good to 1e-16 there."""


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


def rotation(v: FloatArray) -> FloatArray:
    """exp([v]x), (..., 3, 3), of rotation vectors v (..., 3), rad, by Rodrigues' formula.

    Examples
    --------
    >>> rotation(np.array([0.0, 0.0, np.pi / 2.0])).round(12).tolist()
    [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    """
    angle = np.linalg.norm(v, axis=-1)[..., None, None]
    safe = np.where(angle < SMALL, 1.0, angle)
    first = np.where(angle < SMALL, 1.0 - angle**2 / 6.0, np.sin(safe) / safe)
    second = np.where(angle < SMALL, 0.5 - angle**2 / 24.0, 2.0 * (np.sin(0.5 * safe) / safe) ** 2)
    K = cross_matrix(v)
    return np.eye(3) + first * K + second * (K @ K)


def onward(t: FloatArray, w: FloatArray) -> FloatArray:
    """Turn from each time to the last one: (n, 3, 3), the last of them the identity.

    ``onward[k] @ u(t_k)`` is where a lab-fixed u lies in the case at ``t[-1]``.

    Parameters
    ----------
    t : (n,) s.
    w : (n, 3) rate of the case along its axes, rad/s.
    """
    steps = rotation(-rotation_vectors(t, w))
    turns = np.concatenate((steps, np.eye(3)[None]))
    reach = 1
    while reach < len(turns):
        # turns[k] covers `reach` steps from k on: joined to the ones that follow it covers twice as many
        turns[:-reach] = turns[reach:] @ turns[:-reach]
        reach *= 2
    return turns
