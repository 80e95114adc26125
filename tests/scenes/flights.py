"""Flights for the full navigator, which shares no formula with the linear propagation."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from imubayes.scenes.navigator import fly

G, R, EARTH = 9.80665, 6378137.0, 7.292115e-5


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
    yaw, pitch, roll = (
        Rotation.from_rotvec(np.eye(3)[k] * angles[:, [c]]).as_matrix() for c, k in enumerate((2, 1, 0))
    )
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


def errors(truth, d_force, d_rate, row=None):
    """Errors of sensors (n, m, 3) that fly it, as `imubayes.scenes.navigator` says.

    Returns (m, 3, 3) vectors of attitude, velocity and position at a row, and (m, 3) the largest until then.
    """
    stop = len(truth.t) if row is None else row + 1
    both = np.concatenate((d_rate, d_force), axis=2)[:stop]
    both = np.moveaxis(np.concatenate((np.zeros((stop, 1, 6)), both), axis=1), 0, 2)
    steps = np.diff(truth.t[:stop], prepend=truth.t[0])
    flown = [(steps, truth.attitude[:stop], truth.force[:stop], both)]
    largest, last = fly(flown, range(6), both.shape[0], level=truth.pull > 0.0, velocity=truth.velocity[0])
    return last[1:], largest[1:]


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
