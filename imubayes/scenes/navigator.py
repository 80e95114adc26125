"""What an error of a sensor does to a navigator: a scene is flown with the error and without it.

A strapdown navigator over a round Earth that turns, with nothing linearised; it shares the scene's record and
the terms' columns with `imubayes.scenes.propagation`, and no equation. In axes fixed to the Earth, north,
west and up where it starts, with the Earth's centre at the origin::

    q <- exp(-W h) q exp(turn + h (u + U) / 2)      attitude, a quaternion, by what the gyroscopes feel
    dv/dt = q (f + e) q* - g p / |p| - 2 W x v      gravity points to the centre from the computed place
    dp/dt = v                                       and back to the ground: height is aided

turn is what the case turns against inertial space from row to row, u and e are errors in axes of the case.
Attitude and velocity are compared in the level of the computed and of the true place, and places along the
ground. In free flight there is neither Earth nor gravity. What a scene's record says is flown from rest.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.algebra.compiled import inlined, reordered
from imubayes.algebra.factor import row_blocks
from imubayes.rig.plans import EARTH_RATE, SEMI_MAJOR_AXIS
from imubayes.scenes import Scene, in_case
from imubayes.scenes.effects import mission_columns
from imubayes.scenes.propagation import LATITUDE, ROUNDED, STATES, Budget
from imubayes.sensors.terms import Kind, Library, columns
from imubayes.units import STANDARD_GRAVITY

BLOCK = 4_096
"""Rows that are flown at a time."""

SENSORS: dict[Kind, int] = {"gyroscope": 0, "accelerometer": 3}
"""Number of the first of the three sensors of a kind, along x, y and z."""


def flown_sizes(scene: Scene, lib: Library, budget: Budget, theta: FloatArray, axis: str = "x") -> FloatArray:
    """Size (k, p) of what each coefficient alone does to what is budgeted, when the scene is flown with it.

    Of the output it is the rms over the scene and its draws; of attitude, velocity and position the largest
    of all rows of the mission and of all draws. `theta` (k, p) are the coefficients of k units, SI, and
    `axis` the case axis of the component's input.

    Examples
    --------
    >>> from imubayes.rig.inputs import Inputs
    >>> from imubayes.sensors.terms import library
    >>> lib = Library("gyroscope", library("gyroscope").terms[:2])
    >>> minute = Scene("level", Inputs(np.arange(60.0), {"f_k": np.full(60, 9.80665)}, 1.0), 60.0)
    >>> free = Budget("position", 1.0, schuler=False)
    >>> flown_sizes(minute, lib, free, np.full((1, 2), 1e-5), "y")[0].round(2).tolist()  # g t^3 / 6
    [3.53, 0.0]
    """
    if budget.quantity == "output":
        drawn = [in_case(one.inputs, axis) for one in scene.draws]
        squares = np.zeros((len(drawn), len(lib.terms)))
        for total, inputs in zip(squares, drawn, strict=True):
            for i, j in row_blocks(len(inputs), BLOCK):
                total += np.square(columns(lib, inputs.kept(slice(i, j)).channels, j - i)).sum(axis=0)
        return np.abs(theta) * np.sqrt(squares.sum(axis=0) / sum(map(len, drawn)))
    return np.max([_largest(one, lib, budget, theta, axis) for one in scene.draws], axis=0)


def _largest(scene: Scene, lib: Library, budget: Budget, theta: FloatArray, axis: str) -> FloatArray:
    """Largest error (k, p) over one draw of a scene."""
    case = SENSORS[lib.kind] + "xyz".index(axis)
    columns_of = mission_columns(scene, lib, in_case(scene.mean_motion, axis))

    def errors(record: int, rows: slice) -> FloatArray:
        X = columns_of(record, rows).T
        return np.vstack((0.0 * X[:1], (theta[..., None] * X).reshape(theta.size, -1)))[:, None]

    largest, _ = fly(_record(scene, errors), (case,), theta.size + 1, level=budget.schuler)
    return largest[1:, STATES.index(budget.quantity)].reshape(theta.shape)


Rows = tuple[FloatArray, FloatArray, FloatArray, FloatArray]
"""Time since the row before (n,), attitude (n, 3, 3), force (n, 3) in axes of the case, and the errors
(m, s, n) of s sensors in each of m navigators."""


def _record(scene: Scene, errors: Callable[[int, slice], FloatArray]) -> Iterator[Rows]:
    """Rows of a scene's record until the mission ends; the last is held, and the next record follows at once.

    `errors` are those in rows of each repetition of the record.
    """
    motion = scene.mean_motion
    n, t = len(motion), np.append(motion.t - motion.t[0], motion.t[-1] - motion.t[0] + motion.interval)
    attitude = scene.attitudes
    force = motion.vectors("f")
    if not motion.has("f"):
        force = STANDARD_GRAVITY * attitude[:, 2]
    for record in range(math.ceil(scene.duration / t[-1] * (1.0 - ROUNDED))):
        last = int(np.argmin(np.abs(t - (scene.duration - record * t[-1]))))
        for i, j in row_blocks(min(last + 1, n), BLOCK):
            yield (
                np.diff(t[i:j], prepend=t[max(i - 1, 0)]),
                attitude[i:j],
                force[i:j],
                errors(record, slice(i, j)),
            )
        if last == n:
            held = slice(n - 1, n)
            yield t[n:] - t[n - 1], attitude[held], force[held], errors(record, held)


def fly(
    rows: Iterable[Rows],
    sensors: Sequence[int],
    m: int,
    *,
    level: bool,
    velocity: Sequence[float] = (0.0,) * 3,
) -> tuple[FloatArray, FloatArray]:
    """Fly m navigators, of which the first has no error, and compare the others with it.

    Of the `sensors` that err 0 to 2 are the gyroscopes along x, y and z, 3 to 5 the accelerometers. The
    flight begins at a `velocity`, m/s, over the Earth where the navigators keep a local `level`, else in free
    space.

    Returns
    -------
    largest (m, 3) errors of attitude, velocity and position over all rows, rad, m/s and m, and the vectors
        (m, 3, 3) of the last row.
    """
    from scipy.spatial.transform import Rotation

    state, before = np.zeros((m, 16)), np.zeros(7)
    largest, apart = np.zeros((m, 3)), np.zeros((m, 9))
    earth = EARTH_RATE * np.array([math.cos(LATITUDE), 0.0, math.sin(LATITUDE)]) * level
    for number, (h, attitude, force, errors) in enumerate(rows):
        q = np.roll(Rotation.from_matrix(attitude).as_quat(), 1, axis=1)
        if not number:
            before[:4] = state[:, :4] = q[0]
            before[4:], state[:, 4:7], state[:, 9] = force[0], velocity, SEMI_MAJOR_AXIS * level
        _advance(state, before, largest, apart, (h, q, force, errors), np.array(sensors), earth, level)
    return largest, apart.reshape(m, 3, 3)


@reordered
def _advance(state, before, largest, apart, rows, sensors, earth, level):
    """Take navigators (m, 16) through some rows: attitude, velocity, place, and errors (6,) of the last row.

    `before` (7,) is the true attitude of the row before and the force.
    """
    h, q, force, errors = rows
    n, true, turns = len(h), np.empty((len(h), 6)), np.empty((len(h), 3))
    for i in range(n):
        was = before if i == 0 else q[i - 1]
        turn = _times(
            _turn(h[i] * earth[0], h[i] * earth[1], h[i] * earth[2]), (q[i, 0], q[i, 1], q[i, 2], q[i, 3])
        )
        turns[i, 0], turns[i, 1], turns[i, 2] = _vector(_times((was[0], -was[1], -was[2], -was[3]), turn))
    u = np.zeros(6)
    for lane in range(len(state)):
        s = state[lane]
        for i in range(n):
            u[:] = 0.0
            for k in range(len(sensors)):
                u[sensors[k]] = errors[lane, k, i]
            f = before[4:] if i == 0 else force[i - 1]
            _step(s, u, h[i], turns[i], f, force[i], earth, level)
            for k in range(6):
                s[10 + k] = u[k]
            if lane == 0:
                for k in range(6):
                    true[i, k] = s[4 + k]
            else:
                _compare(s, q[i], true[i], level, apart[lane])
                for k in range(3):
                    d = apart[lane, 3 * k : 3 * k + 3]
                    largest[lane, k] = max(
                        largest[lane, k], math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
                    )
    for k in range(4):
        before[k] = q[-1, k]
    for k in range(3):
        before[4 + k] = force[-1, k]


@inlined
def _step(s, u, h, turn, f, then, earth, level):
    """Take a navigator from one row, with the errors that it holds, to the next, with errors u (6,)."""
    half = 0.5 * h
    was, v, p = (s[0], s[1], s[2], s[3]), (s[4], s[5], s[6]), (s[7], s[8], s[9])
    here = _times(
        _turn(-h * earth[0], -h * earth[1], -h * earth[2]),
        _times(
            was,
            _turn(
                turn[0] + half * (s[10] + u[0]),
                turn[1] + half * (s[11] + u[1]),
                turn[2] + half * (s[12] + u[2]),
            ),
        ),
    )
    a = _felt(was, f[0] + s[13], f[1] + s[14], f[2] + s[15], v, p, earth, level)
    ahead = (v[0] + h * a[0], v[1] + h * a[1], v[2] + h * a[2])
    moved = (p[0] + h * v[0], p[1] + h * v[1], p[2] + h * v[2])
    b = _felt(here, then[0] + u[3], then[1] + u[4], then[2] + u[5], ahead, moved, earth, level)
    for k in range(3):
        s[7 + k] = p[k] + h * v[k] + h * h / 6.0 * (2.0 * a[k] + b[k])
        s[4 + k] = v[k] + half * (a[k] + b[k])
    for k in range(4):
        s[k] = here[k]
    if level:  # height is aided: back to the ground, along it
        far = math.sqrt(s[7] * s[7] + s[8] * s[8] + s[9] * s[9])
        climb = (s[4] * s[7] + s[5] * s[8] + s[6] * s[9]) / far
        for k in range(3):
            s[4 + k] -= climb * s[7 + k] / far
            s[7 + k] *= SEMI_MAJOR_AXIS / far


@inlined
def _felt(q, x, y, z, v, p, earth, level):
    """Acceleration over the ground by a force (x, y, z) in axes of the case."""
    f = _rotated(q, x, y, z)
    if not level:
        return f
    pull = STANDARD_GRAVITY / math.sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2])
    return (
        f[0] - pull * p[0] - 2.0 * (earth[1] * v[2] - earth[2] * v[1]),
        f[1] - pull * p[1] - 2.0 * (earth[2] * v[0] - earth[0] * v[2]),
        f[2] - pull * p[2] - 2.0 * (earth[0] * v[1] - earth[1] * v[0]),
    )


@inlined
def _compare(s, q, true, level, apart):
    """Errors of attitude, velocity and place (9,) of a navigator, each in the level of its own place."""
    turn = _times((s[0], s[1], s[2], s[3]), (q[0], -q[1], -q[2], -q[3]))
    v, dx, dy, dz = (s[4], s[5], s[6]), s[7] - true[3], s[8] - true[4], s[9] - true[5]
    if level:
        # p x p' = p x (p' - p), without the digits that two places share
        x, y, z = true[4] * dz - true[5] * dy, true[5] * dx - true[3] * dz, true[3] * dy - true[4] * dx
        sine = math.sqrt(x * x + y * y + z * z)
        angle = math.atan2(sine, true[3] * s[7] + true[4] * s[8] + true[5] * s[9])
        share = angle / sine if sine > 0.0 else 0.0
        x, y, z = share * x, share * y, share * z
        back = _turn(-x, -y, -z)
        turn, v = _times(back, turn), _rotated(back, v[0], v[1], v[2])
        dx, dy, dz = y * true[5] - z * true[4], z * true[3] - x * true[5], x * true[4] - y * true[3]
    apart[0], apart[1], apart[2] = _vector(turn)
    apart[3], apart[4], apart[5] = v[0] - true[0], v[1] - true[1], v[2] - true[2]
    apart[6], apart[7], apart[8] = dx, dy, dz


@inlined
def _times(a, b):
    """Product of quaternions."""
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] + a[2] * b[0] + a[3] * b[1] - a[1] * b[3],
        a[0] * b[3] + a[3] * b[0] + a[1] * b[2] - a[2] * b[1],
    )


@inlined
def _rotated(q, x, y, z):
    """Turn a vector by a quaternion (w, n): ``x + 2 n x (n x x + w x)``."""
    a, b, c = (q[2] * z - q[3] * y + q[0] * x, q[3] * x - q[1] * z + q[0] * y, q[1] * y - q[2] * x + q[0] * z)
    return (x + 2.0 * (q[2] * c - q[3] * b), y + 2.0 * (q[3] * a - q[1] * c), z + 2.0 * (q[1] * b - q[2] * a))


@inlined
def _turn(x, y, z):
    """Quaternion of a rotation vector."""
    half = 0.5 * math.sqrt(x * x + y * y + z * z)
    share = 0.5 * (math.sin(half) / half if half > 0.0 else 1.0)
    return math.cos(half), share * x, share * y, share * z


@inlined
def _vector(q):
    """Rotation vector of a quaternion, the shorter way round."""
    sine = math.sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    share = 2.0 * (math.atan(sine / q[0]) / sine if sine > 0.0 else 1.0 / q[0])
    return share * q[1], share * q[2], share * q[3]
