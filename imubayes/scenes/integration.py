"""The error equations of `imubayes.scenes.propagation`, from row to row, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit

BLOCK = 256
"""Rows of columns that are laid side by side at a time."""


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract"})
def forward(t, along, force, gyro, earth, back, drive, start, at):
    """Errors (k, 9, p) at rows `at` (k,), increasing, of columns with errors `drive` (m, p).

    Parameters
    ----------
    t, along, force : (n + 1,) and (n + 1, 3), as in `Propagation`.
    gyro : whether the errors are those of a gyroscope.
    earth : (3,) rate of the level frame, rad/s.
    back : g/R, 1/s^2; 0 in free flight, where the vertical counts too.
    drive : (m, p) errors of the output; the last row holds from there on.
    start : (9, p) errors at the first row.
    at : (k,).
    """
    x, out, k, last = start.copy(), np.empty((len(at), 9, start.shape[1])), 0, len(drive) - 1
    part = np.empty((BLOCK + 1, drive.shape[1]))
    for first in range(0, at[-1] + 1, BLOCK):
        for j in range(drive.shape[1]):  # columns are in one piece each, rows are wanted
            for i in range(BLOCK + 1):
                part[i, j] = drive[min(max(first + i - 1, 0), last), j]
        for i in range(first, min(first + BLOCK, at[-1] + 1)):
            if i:
                h, both, row = t[i] - t[i - 1], slice(i - 1, i + 1), i - first
                _advance(x, h, along[both], force[both], part[row], part[row + 1], gyro, earth, back)
            if k < len(at) and at[k] == i:
                out[k] = x
                k += 1
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def backward(t, along, force, gyro, earth, back, end):
    """Errors (9, end) at row `end` by unit errors of each row before, and the transition (9, 9) to it.

    The error in the last row holds to its end.
    """
    moved, out = np.eye(9), np.zeros((9, end + 1))
    unit, before, after = np.zeros((9, 11)), np.zeros(11), np.zeros(11)
    before[9], after[10] = 1.0, 1.0
    for i in range(end, 0, -1):
        unit[:] = 0.0
        for k in range(9):
            unit[k, k] = 1.0
        h = t[i] - t[i - 1]
        _advance(unit, h, along[i - 1 : i + 1], force[i - 1 : i + 1], before, after, gyro, earth, back)
        for r in range(9):
            for k in range(9):
                out[r, i - 1] += moved[r, k] * unit[k, 9]
                out[r, i] += moved[r, k] * unit[k, 10]
        moved = moved @ np.ascontiguousarray(unit[:, :9])
    out[:, end - 1] += out[:, end]
    return out[:, :end].copy(), moved


@njit(cache=True, nogil=True, inline="always", error_model="numpy", fastmath={"reassoc", "contract"})
def _advance(x, h, along, force, before, after, gyro, earth, back):
    """Carry errors x (9, p) over a step, with errors of the output before and after it (p,)."""
    cx, cy, cz, ex, ey, ez = along[0, 0], along[0, 1], along[0, 2], along[1, 0], along[1, 1], along[1, 2]
    fx, fy, fz, gx, gy, gz = force[0, 0], force[0, 1], force[0, 2], force[1, 0], force[1, 1], force[1, 2]
    wx, wy, wz = earth[0], earth[1], earth[2]
    high = 0.0 if back > 0.0 else 1.0
    turn, push, half = (0.5 * h, 0.0, 0.5 * h) if gyro else (0.0, 1.0, 0.5 * h)
    for j in range(x.shape[1]):
        u, w = before[j], after[j]
        px, py, pz = x[0, j], x[1, j], x[2, j]
        dx, dy, dz = turn * (cx * u + ex * w), turn * (cy * u + ey * w), turn * (cz * u + ez * w)
        mx, my, mz = px + 0.5 * dx, py + 0.5 * dy, pz + 0.5 * dz
        qx = px + dx - h * (wy * mz - wz * my)
        qy = py + dy - h * (wz * mx - wx * mz)
        qz = pz + dz - h * (wx * my - wy * mx)
        vx, vy, vz, rx, ry, rz = x[3, j], x[4, j], x[5, j], x[6, j], x[7, j], x[8, j]
        ax = py * fz - pz * fy - back * rx - 2.0 * (wy * vz - wz * vy) + push * cx * u
        ay = pz * fx - px * fz - back * ry - 2.0 * (wz * vx - wx * vz) + push * cy * u
        az = high * (px * fy - py * fx + push * cz * u)
        ox, oy, oz = vx + h * ax, vy + h * ay, vz + h * az
        bx = qy * gz - qz * gy - back * (rx + h * (vx + half * ax)) + push * ex * w
        by = qz * gx - qx * gz - back * (ry + h * (vy + half * ay)) + push * ey * w
        bx -= 2.0 * (wy * oz - wz * oy)
        by -= 2.0 * (wz * ox - wx * oz)
        bz = high * (qx * gy - qy * gx + push * ez * w)
        x[0, j], x[1, j], x[2, j] = qx, qy, qz
        x[3, j], x[4, j], x[5, j] = vx + half * (ax + bx), vy + half * (ay + by), vz + half * (az + bz)
        third = h * h / 6.0
        x[6, j] = rx + h * vx + third * (2.0 * ax + bx)
        x[7, j] = ry + h * vy + third * (2.0 * ay + by)
        x[8, j] = rz + h * vz + third * (2.0 * az + bz)
