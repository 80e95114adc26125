"""The error equations of `imubayes.scenes.propagation`, from row to row, compiled."""

from __future__ import annotations

import numpy as np

from imubayes.algebra.compiled import inlined, reordered


@reordered
def backward(t, attitude, force, gyro, earth, back, first, last):
    """Errors at row `last` by unit errors of the output in each row from `first` on, along each case axis.

    Parameters
    ----------
    t : (n + 1,) times of the rows, and the end of the last, s.
    attitude, force : (n, 3, 3) of the case and (n, 3) in the level frame, m/s^2, which hold to the end.
    gyro : whether the errors are those of a gyroscope.
    earth : (3,) rate of the level frame, rad/s.
    back : g/R, 1/s^2; 0 in free flight, where the vertical counts too.
    first, last : rows.

    Returns
    -------
    weights (3, last - first + 1, 9) of case axis, row and error, and the transition (9, 9) between the rows.
    """
    weights, answer = np.empty((3, last - first + 1, 9)), np.eye(9)
    here, before, held = np.zeros((3, 9)), np.zeros((3, 9)), len(force) - 1
    for i in range(last, first - 1, -1):
        if i > first:
            _go_back(
                answer, t[i] - t[i - 1], force[i - 1], force[min(i, held)], before, here, gyro, earth, back
            )
        case = attitude[min(i, held)]
        for axis in range(3):
            x, y, z = case[0, axis], case[1, axis], case[2, axis]
            for j in range(9):
                weights[axis, i - first, j] = x * here[0, j] + y * here[1, j] + z * here[2, j]
        here, before = before, here
    return weights, answer.T.copy()


@inlined
def _go_back(answer, h, force, then, before, here, gyro, earth, back):
    """Take what errors psi, v, r after a step come to (9, 9) to what those before it come to.

    The step, from force f to force F, is that of Heun in v and exact in r where the acceleration is linear in
    time. With u and U, the gyroscope's errors before and after, or e and E, the accelerometer's::

        d = h (u + U) / 2
        q = psi + d - h W x (psi + d / 2)
        a = psi x f - back r_h - 2 W x v + e
        b = q x F - back (r_h + h v + h^2 a / 2) - 2 W x (v + h a) + E
        v + h (a + b) / 2,   r + h v + h^2 (2 a + b) / 6

    Every line is gone through in reverse: what its result comes to says what its parts do. What u or e comes
    to, along the axes of the level frame, goes into `before` (3, 9), and what U or E does is added to `here`.
    """
    wx, wy, wz, over = h * earth[0], h * earth[1], h * earth[2], 1.0 / h
    fx, fy, fz, gx, gy, gz = force[0], force[1], force[2], then[0], then[1], then[2]
    half, third, fed, high = 0.5 * h, h * h / 6.0, back * h, 0.0 if back > 0.0 else 1.0
    for j in range(9):
        qx, qy, qz = answer[0, j], answer[1, j], answer[2, j]
        ax, ay, az, bx, by, bz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        if j >= 3 and (j % 3 < 2 or high > 0.0):  # attitude has nothing of v and r, and height is aided
            vx, vy, vz, rx, ry, rz = (
                answer[3, j], answer[4, j], answer[5, j], answer[6, j], answer[7, j], answer[8, j],
            )  # fmt: skip
            bx, by, bz = half * vx + third * rx, half * vy + third * ry, high * (half * vz + third * rz)
            ox, oy, oz = 2.0 * (wy * bz - wz * by), 2.0 * (wz * bx - wx * bz), 2.0 * (wx * by - wy * bx)
            ax = bx + third * rx - fed * half * bx + ox
            ay = by + third * ry - fed * half * by + oy
            az = bz + high * (third * rz + oz)
            answer[3, j] = vx + h * rx - fed * bx + (ox + 2.0 * (wy * az - wz * ay)) * over
            answer[4, j] = vy + h * ry - fed * by + (oy + 2.0 * (wz * ax - wx * az)) * over
            answer[5, j] = vz + h * rz + (oz + 2.0 * (wx * ay - wy * ax)) * over
            answer[6, j], answer[7, j] = rx - back * (ax + bx), ry - back * (ay + by)
            qx, qy, qz = qx + gy * bz - gz * by, qy + gz * bx - gx * bz, qz + gx * by - gy * bx
        mx, my, mz = wy * qz - wz * qy, wz * qx - wx * qz, wx * qy - wy * qx
        answer[0, j] = qx + mx + fy * az - fz * ay
        answer[1, j] = qy + my + fz * ax - fx * az
        answer[2, j] = qz + mz + fx * ay - fy * ax
        if gyro:
            ax, ay, az = half * (qx + 0.5 * mx), half * (qy + 0.5 * my), half * (qz + 0.5 * mz)
            bx, by, bz = ax, ay, az
        before[0, j], before[1, j], before[2, j] = ax, ay, az
        here[0, j], here[1, j], here[2, j] = here[0, j] + bx, here[1, j] + by, here[2, j] + bz
