"""A full nonlinear strapdown navigator, and flights for it: shares no formula with the linear propagation.

Attitude is a rotation matrix that is turned by each sensor increment and by the Earth; specific force is
turned into the level frame by it and integrated; gravity points to the centre of a round Earth at the
position that was computed. Many sensors fly at once, each with its own error.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

G, R, EARTH = 9.80665, 6378137.0, 7.292115e-5


def turned(v):
    """Rotation matrices (..., 3, 3) of rotation vectors by their quaternions."""
    half = 0.5 * np.linalg.norm(v, axis=-1, keepdims=True)
    w, (x, y, z) = np.cos(half[..., 0]), np.moveaxis(0.5 * v * np.sinc(half / np.pi), -1, 0)
    rows = [
        [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


@dataclass
class Flight:
    """Truth of a flight: times (n,), attitude (n, 3, 3), velocity, force and rate (n, 3), and its Earth."""

    t: np.ndarray
    attitude: np.ndarray
    velocity: np.ndarray
    force: np.ndarray
    rate: np.ndarray
    earth: np.ndarray
    pull: float


def flight(t, angles, velocity, *, level, follows=False):
    """Force and rate of a flight with (yaw, pitch, roll) (n, 3) and a velocity (n, 3) in the level frame.

    level : whether over a round Earth that turns, at 45 degrees north; else in free space.
    follows : whether the angles are against the level at each place, which turns on the way there.
    """
    h = t[1] - t[0]
    yaw, pitch, roll = (turned(np.eye(3)[k] * angles[:, [c]]) for c, k in enumerate((2, 1, 0)))
    attitude = yaw @ pitch @ roll
    earth = EARTH * np.array([0.5**0.5, 0.0, 0.5**0.5]) * level
    place = np.vstack((np.zeros(3), np.cumsum(0.5 * h * (velocity[1:] + velocity[:-1]), axis=0)))
    down = (place * [1.0, 1.0, 0.0] / R + [0.0, 0.0, 1.0]) * -G * level
    carried = np.zeros_like(velocity)
    if follows:
        north, west = velocity[:, 0], velocity[:, 1]
        carried, down = np.column_stack((-west, north, -west)) / R, np.array([0.0, 0.0, -G])
    felt = np.gradient(velocity, h, axis=0) - down + np.cross(2.0 * earth + carried, velocity)
    step = np.swapaxes(attitude[:-1], 1, 2) @ attitude[1:]
    skew = 0.5 * np.stack((step[:, 2, 1] - step[:, 1, 2], step[:, 0, 2] - step[:, 2, 0],
                           step[:, 1, 0] - step[:, 0, 1]), axis=1)  # fmt: skip
    size = np.linalg.norm(skew, axis=1, keepdims=True)
    turn = skew * np.where(size > 0.0, np.arcsin(size) / np.where(size > 0.0, size, 1.0), 1.0) / h
    rate = np.vstack((turn[:1], 0.5 * (turn[1:] + turn[:-1]), turn[-1:]))
    in_case = np.swapaxes(attitude, 1, 2)
    rate = rate + np.einsum("nij,nj->ni", in_case, earth + carried)
    return Flight(t, attitude, velocity, np.einsum("nij,nj->ni", in_case, felt), rate, earth, G / R * level)


def navigate(truth, d_force, d_rate, at):
    """Attitude (k, m, 3, 3), velocity, position (k, m, 3) at rows `at` of m sensors with errors (n, m, 3)."""
    m, h = d_force.shape[1], truth.t[1] - truth.t[0]
    C = np.tile(truth.attitude[0], (m, 1, 1))
    v, r, out = np.tile(truth.velocity[0], (m, 1)), np.zeros((m, 3)), []
    back = turned(-truth.earth * h)
    level, flat = truth.pull > 0.0, np.array([1.0, 1.0, 0.0])

    def pulled(C, f, v, r):
        g = (-truth.pull * r * flat - [0.0, 0.0, G]) if level else 0.0
        return np.einsum("mij,mj->mi", C, f) + g - 2.0 * np.cross(truth.earth, v)

    for k in range(len(truth.t)):
        if k in at:
            out.append((C, v.copy(), r.copy()))
        if k + 1 == len(truth.t):
            break
        f, w = (
            truth.force[k : k + 2, None] + d_force[k : k + 2],
            truth.rate[k : k + 2, None] + d_rate[k : k + 2],
        )
        ahead = back @ C @ turned(0.5 * h * (w[0] + w[1]))
        a = pulled(C, f[0], v, r)
        b = pulled(ahead, f[1], v + h * a, r + h * v)
        r, v, C = r + h * v + h * h / 6.0 * (2.0 * a + b), v + 0.5 * h * (a + b), ahead
        if level:  # height is aided
            v[:, 2] = r[:, 2] = 0.0
    return tuple(np.array(part) for part in zip(*out, strict=True))


def errors(truth, d_force, d_rate, at):
    """Errors of attitude against the local level, velocity and position (k, m, 3) of sensors with errors."""
    none = np.zeros((len(truth.t), 1, 3))
    C, v, r = navigate(
        truth, np.concatenate((none, d_force), axis=1), np.concatenate((none, d_rate), axis=1), at
    )
    turn = C[:, 1:] @ np.swapaxes(C[:, :1], -1, -2)
    psi = 0.5 * np.stack((turn[..., 2, 1] - turn[..., 1, 2], turn[..., 0, 2] - turn[..., 2, 0],
                          turn[..., 1, 0] - turn[..., 0, 1]), axis=-1)  # fmt: skip
    dv, dr = v[:, 1:] - v[:, :1], r[:, 1:] - r[:, :1]
    if truth.pull:  # the level at a place that is off towards the north is turned about west, and so on
        psi[..., 0] += dr[..., 1] / R
        psi[..., 1] -= dr[..., 0] / R
        dv, dr = dv[..., :2], dr[..., :2]
    return psi, dv, dr


def path(kind, t):
    """(yaw, pitch, roll) and velocity of a straight flight, a circle at 3 deg/s, S-turns, a spin, a boost."""
    zero, speed = np.zeros_like(t), np.full_like(t, 100.0)
    pitch = 0.05 * np.sin(t / 7.0)
    yaw = {"circle": np.radians(3.0) * t, "turns": 0.8 * np.sin(2.0 * np.pi * t / 60.0)}.get(kind, zero)
    roll = -np.arctan(speed * np.gradient(yaw, t) / G)
    if kind == "spin":
        roll = 2.0 * np.pi * t / 5.0
    if kind == "boost":
        speed = 0.5 * t**2
    along = np.column_stack((np.cos(yaw), np.sin(yaw), zero))
    return np.column_stack((yaw, pitch, roll)), speed[:, None] * along
