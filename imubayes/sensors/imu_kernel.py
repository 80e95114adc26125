"""The IMU's inner loops, compiled: outputs of many rows, and their inverse.

Rows are taken in blocks that stay in the cache, a column of inputs after the other, so that every loop over a
block is one that the compiler turns into vector instructions.
"""

from __future__ import annotations

import numpy as np

from imubayes.algebra import BoolArray, FloatArray, IntArray
from imubayes.algebra.compiled import strict

WIDTH = 11
"""Columns of the case's inputs: f, w, dw along x, y, z, temperature above 25 degC and its rate."""

Table = tuple[IntArray, FloatArray, IntArray, IntArray, IntArray, BoolArray]
"""An IMU as numbers: of each component its first term; of each term its coefficient and first factor; of each
factor its column, power and whether it comes with the sign."""

BLOCK = 256
"""Rows at a time: 11 columns and the work space take 60 kB."""


@strict
def _size_effect(u: FloatArray, r: FloatArray, v: FloatArray) -> None:
    """Inputs at a sense point, columns (11, m): ``f + w (w.r) - r (w.w) + dw x r``."""
    for b in range(u.shape[1]):
        wr = u[3, b] * r[0] + u[4, b] * r[1] + u[5, b] * r[2]
        ww = u[3, b] * u[3, b] + u[4, b] * u[4, b] + u[5, b] * u[5, b]
        v[0, b] = u[0, b] + u[3, b] * wr - r[0] * ww + u[7, b] * r[2] - u[8, b] * r[1]
        v[1, b] = u[1, b] + u[4, b] * wr - r[1] * ww + u[8, b] * r[0] - u[6, b] * r[2]
        v[2, b] = u[2, b] + u[5, b] * wr - r[2] * ww + u[6, b] * r[1] - u[7, b] * r[0]
    for c in range(3, len(u)):
        for b in range(u.shape[1]):
            v[c, b] = u[c, b]


@strict
def _times(value: FloatArray, x: FloatArray, power: int, signed: bool) -> None:
    """``value *= x ** power``, and times the sign of x if `signed`."""
    for _ in range(power):
        for b in range(len(value)):
            value[b] *= x[b]
    if signed:
        for b in range(len(value)):
            value[b] *= np.sign(x[b])


@strict
def _add_terms(table: Table, component: int, u: FloatArray, value: FloatArray, out: FloatArray) -> None:
    """``out += X theta`` of a component at the columns u (11, m)."""
    first, theta, start, column, power, signed = table
    for k in range(first[component], first[component + 1]):
        value[:] = theta[k]
        for q in range(start[k], start[k + 1]):
            _times(value, u[column[q]], power[q], signed[q])
        for b in range(len(value)):
            out[b] += value[b]


@strict
def _deviate(table: Table, levers: FloatArray, u: FloatArray, v: FloatArray, out: FloatArray) -> None:
    """Output minus input (6, m) of the components at the columns u (11, m).

    The size effect of each goes to the first six rows of v (18, m); the others are room to work in.
    """
    shifted, value = v[6:-1], v[-1]
    for c in range(6):
        r = levers[c % 3]
        if c < 3 and (r[0] != 0.0 or r[1] != 0.0 or r[2] != 0.0):
            _size_effect(u, r, shifted)
            for b in range(u.shape[1]):
                v[c, b] = out[c, b] = shifted[c, b] - u[c, b]
            _add_terms(table, c, shifted, value, out[c])
        else:
            v[c] = 0.0
            out[c] = 0.0
            _add_terms(table, c, u, value, out[c])


@strict
def _columns(rows: FloatArray, start: int, u: FloatArray) -> int:
    """Copy a block of rows (n, 11) into columns; returns how many there are."""
    m = min(u.shape[1], len(rows) - start)
    for b in range(m):
        for c in range(WIDTH):
            u[c, b] = rows[start + b, c]
    return m


@strict
def forward_rows(table: Table, levers: FloatArray, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Outputs (n, 3) of the accelerometers and of the gyroscopes at inputs (n, 11)."""
    f, w = np.empty((len(rows), 3)), np.empty((len(rows), 3))
    size = max(1, min(BLOCK, len(rows)))
    u, v, out = np.zeros((WIDTH, size)), np.empty((6 + WIDTH + 1, size)), np.empty((6, size))
    for start in range(0, len(rows), size):
        m = _columns(rows, start, u)
        _deviate(table, levers, u, v, out)
        for b in range(m):
            for c in range(3):
                f[start + b, c] = u[c, b] + out[c, b]
                w[start + b, c] = u[3 + c, b] + out[3 + c, b]
    return f, w


@strict
def _step(
    y: FloatArray,
    out: FloatArray,
    arm: FloatArray,
    jump: FloatArray,
    end: float,
    x: FloatArray,
    u: FloatArray,
) -> bool:
    """One fixed-point step of a component in place; whether any row still moves beyond rounding.

    A positive jump where the input at the sense point is zero is a gap in the outputs: what falls into it
    comes from an input of zero there.
    """
    moving = False
    for b in range(len(y)):
        new = y[b] - out[b]
        if jump[b] > 0.0:
            there = new + arm[b]
            new = np.sign(there) * max(np.abs(there) - jump[b], 0.0) - arm[b]
        if np.abs(new - x[b]) > 1e-15 * (np.abs(y[b]) + np.abs(out[b])):
            moving = True
        x[b] = new
        u[b] = min(max(new, -end), end)
    return moving


@strict
def compensate_rows(
    table: Table, levers: FloatArray, ends: FloatArray, rounds: int, rows: FloatArray, jumps: FloatArray
) -> FloatArray:
    """Inputs (n, 6) of outputs in the first six columns of `rows` (n, 11), in so many rounds at most.

    The iteration is ``x = y - D(clip(x))``, a block of rows at a time.

    The table is without the terms that jump at zero, whose sizes are in `jumps` (n, 6). Beyond the largest
    inputs, `ends` (6,), the deviations are held, so that the iteration always settles.
    """
    found = np.empty((len(rows), 6))
    size = max(1, min(BLOCK, len(rows)))
    u, v, out = np.zeros((WIDTH, size)), np.empty((6 + WIDTH + 1, size)), np.empty((6, size))
    y, x, jump = np.zeros((6, size)), np.zeros((6, size)), np.zeros((6, size))
    for start in range(0, len(rows), size):
        m = _columns(rows, start, u)
        overlap = False
        for b in range(m):
            for c in range(6):
                y[c, b], jump[c, b] = u[c, b], jumps[start + b, c]
                u[c, b] = min(max(u[c, b], -ends[c]), ends[c])
                overlap |= jump[c, b] < 0.0
        for again in (False, True):
            for _ in range(rounds):  # u holds the clipped inputs and the known ones
                _deviate(table, levers, u, v, out)
                moving = False
                for c in range(6):
                    moving |= _step(y[c], out[c], v[c], jump[c], ends[c], x[c], u[c])
                if not moving:
                    break
            if again or not overlap:
                break
            for c in range(6):  # two inputs for one output near zero: the output's sign decides
                for b in range(size):
                    if jump[c, b] < 0.0:
                        y[c, b] -= jump[c, b] * np.sign(x[c, b] + v[c, b])
        for b in range(m):
            for c in range(6):
                found[start + b, c] = x[c, b]
    return found
