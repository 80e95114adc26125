"""Test procedures as functions that return what the rig applies.

Axes are the case axes (i, j, k), right-handed. At rest ``f = +g`` up; ``f = a - gravitation`` in general.
A component that is nominally zero is exactly zero, so that ``sign(f_i)`` does not follow rounding where the
input axis is horizontal. Between dwells time runs on while nothing is recorded, so the time stamps have gaps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imubayes.errors import InputError
from imubayes.rig.inputs import Inputs
from imubayes.units import STANDARD_GRAVITY

FloatArray = NDArray[np.float64]
Direction = tuple[float, float, float]

EARTH_RATE = 7.292115e-5
"""rad/s, sidereal (WGS 84)."""

_ROUNDING = 1e-12
"""Components of unit vectors below this are rounding of an exact zero."""

_MOST_SAMPLES = 1e9
"""In one dwell; more is a slip of the unit, and would not fit in memory."""


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """A test procedure that is ready to run.

    Attributes
    ----------
    name : of the run that it gives.
    procedure : tumble, centrifuge, rate-table or static.
    inputs : what the rig applies, SI.
    """

    name: str
    procedure: str
    inputs: Inputs


def static(
    duration: float,
    rate: float,
    *,
    up: Direction = (1.0, 0.0, 0.0),
    gravity: float = STANDARD_GRAVITY,
) -> Plan:
    """Log at rest, for noise.

    Parameters
    ----------
    duration : s.
    rate : samples per second.
    up : direction of the local vertical in case axes, any length.
    gravity : local gravity, m/s^2.

    Raises
    ------
    InputError : if the log has no samples or `up` has no length.

    Examples
    --------
    >>> log = static(60.0, 10.0, up=(0.0, 0.0, 1.0)).inputs
    >>> len(log), float(log.channels["f_k"][0]), "f_i" in log.channels
    (600, 9.80665, False)
    """
    vertical = np.array(up, dtype=float)
    if not 0.0 < np.linalg.norm(vertical) < math.inf:
        raise InputError(f"up = {up} has no direction: expected the vertical in case axes, such as (1, 0, 0)")
    t = _dwells(1, duration, rate, 0.0)
    return Plan("static", "static", _at_rest(gravity * _unit(vertical)[None, :], t, 1.0 / rate))


def tumble(
    *,
    angles: int = 24,
    planes: int = 3,
    dwell: float = 30.0,
    rate: float = 10.0,
    settle: float = 5.0,
    gravity: float = STANDARD_GRAVITY,
) -> Plan:
    """Multiposition tumble in the Earth's field (IEEE 1293's static test).

    Parameters
    ----------
    angles : equally spaced positions in each plane; 4 leave the asymmetries and K3 open, 24 do not.
    planes : 1 to 3 of the planes i-j, i-k, j-k; each starts with its first axis up.
    dwell : recorded time at a position, s.
    rate : samples per second.
    settle : time between dwells, not recorded, s.
    gravity : local gravity, m/s^2.

    Raises
    ------
    InputError : if there are no positions, no samples, or other than 1 to 3 planes.

    Examples
    --------
    >>> run = tumble(angles=4, planes=1, dwell=1.0, rate=1.0).inputs
    >>> run.t.tolist(), (run.channels["f_i"] / 9.80665).tolist()
    ([0.0, 6.0, 12.0, 18.0], [1.0, 0.0, -1.0, 0.0])
    """
    if planes not in (1, 2, 3) or angles < 1:
        raise InputError(
            f"tumble of {planes} planes by {angles} angles: expected 1 to 3 planes, 1 angle or more"
        )
    circle = 2.0 * math.pi * np.arange(angles) / angles
    first, second = _snapped(np.cos(circle)), _snapped(np.sin(circle))
    up = np.zeros((planes, angles, 3))
    for plane, (a, b) in enumerate(((0, 1), (0, 2), (1, 2))[:planes]):
        up[plane, :, a], up[plane, :, b] = first, second
    t = _dwells(planes * angles, dwell, rate, settle)
    f = gravity * up.reshape(-1, 3)
    return Plan("tumble", "tumble", _at_rest(f, t, 1.0 / rate, _numbers(planes, len(t))))


def rate_table(
    rates: Sequence[float],
    *,
    mounts: int = 9,
    dwell: float = 30.0,
    rate: float = 10.0,
    settle: float = 5.0,
    latitude: float = math.pi / 4.0,
    radius: float = 0.0,
) -> Plan:
    """Rate steps about a vertical axis, in one mount after the other (IEEE 952's rate test).

    The rate is ``w = (table + W sin(latitude))`` along the vertical and the specific force
    ``f = g up - radius w^2 out``: the horizontal part of the Earth's rate averages out over whole turns.

    Parameters
    ----------
    rates : table rates, rad/s, counter-clockwise seen from above positive.
    mounts : the first of 9 orientations: i, -i, j, -j, k, -k up, then halfway between i-j, i-k and j-k.
    dwell, rate, settle : as in `tumble`.
    latitude : rad, north positive.
    radius : distance of the sensing point from the axis, m.

    Raises
    ------
    InputError : if there are no rates, no samples, or other than 1 to 9 mounts.

    Examples
    --------
    >>> run = rate_table([-1.0, 1.0], mounts=1, dwell=1.0, rate=1.0, latitude=0.0).inputs
    >>> run.channels["w_i"].tolist(), "w_j" in run.channels
    ([-1.0, 1.0], False)
    """
    _check_steps("rate table", rates, mounts, _TABLE_MOUNTS)
    speeds = np.asarray(rates, dtype=float) + EARTH_RATE * math.sin(latitude)
    spin = _stepped(speeds, dwell, rate, settle)
    inputs = _turning(spin, _TABLE_MOUNTS[:mounts], radius=radius, settle=settle, interval=1.0 / rate)
    return Plan("rate-table", "rate-table", inputs)


def centrifuge(
    levels: Sequence[float],
    *,
    mounts: int = 12,
    dwell: float = 30.0,
    rate: float = 10.0,
    settle: float = 5.0,
    arm: float = 1.0,
    ramp: bool = False,
) -> Plan:
    """Levels of centripetal acceleration on a precision centrifuge, in one mount after the other (IEEE 836).

    ``f = -R w^2 out + g up``, ``w`` along the vertical, plus ``R dw/dt`` along the motion while ramping.
    The Earth's rate, which turns with the arm, averages out over whole turns.

    Parameters
    ----------
    levels : centripetal accelerations in g (standard gravity), not in SI: the unit of centrifuge practice.
    mounts : the first of 12 orientations: the input axis along the arm both ways, with j and with k up, along
        the motion both ways, at 45 degrees to the arm, and four that tilt all axes out of its plane.
    dwell, rate, settle : as in `tumble`.
    arm : radius R, m.
    ramp : whether each change of level, including those from rest and back to it, is recorded: a constant
        dw/dt that takes `settle`.

    Raises
    ------
    InputError : if there are no levels, a negative level, no samples, or other than 1 to 12 mounts.

    Examples
    --------
    >>> run = centrifuge([1, 5], mounts=2, dwell=1.0, rate=1.0).inputs
    >>> (run.channels["f_i"] / 9.80665).round(12).tolist()
    [-1.0, -5.0, 1.0, 5.0]
    """
    _check_steps("centrifuge", levels, mounts, _ARM_MOUNTS)
    if min(levels) < 0.0 or not arm > 0.0:
        raise InputError(
            f"centrifuge to {min(levels)} g on an arm of {arm} m: expected levels >= 0, an arm > 0"
        )
    speeds = np.sqrt(np.asarray(levels, dtype=float) * STANDARD_GRAVITY / arm)
    spin = (_ramped if ramp else _stepped)(speeds, dwell, rate, settle)
    inputs = _turning(spin, _ARM_MOUNTS[:mounts], radius=arm, settle=settle, interval=1.0 / rate)
    return Plan("centrifuge", "centrifuge", inputs)


Mount = tuple[Direction, Direction]
"""Outward direction and vertical in case axes, at right angles, any length."""

_I, _J, _K = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


def _minus(axis: Direction) -> Direction:
    return -axis[0], -axis[1], -axis[2]


_ARM_MOUNTS: tuple[Mount, ...] = (
    (_I, _J),  # input axis outward and inward, pendulous axis up
    (_minus(_I), _J),
    (_I, _K),  # the same with the output axis up
    (_minus(_I), _K),
    (_J, _K),  # input axis along the motion, both ways
    (_minus(_J), _K),
    ((1.0, 1.0, 0.0), _K),  # 45 degrees in the plane of the arm
    ((1.0, 0.0, 1.0), _J),
    # tilted; with the smallest geometric mean of the terms' sds that a search over such tilts found
    ((-1.0, -1.0, 0.0), (-1.0, 1.0, 1.0)),
    ((0.0, -1.0, -1.0), (1.0, 1.0, -1.0)),
    ((0.0, -1.0, 1.0), (1.0, 1.0, 1.0)),
    ((1.0, 0.0, -1.0), (1.0, -1.0, 1.0)),
)

_TABLE_MOUNTS: tuple[Mount, ...] = (
    (_J, _I),
    (_J, _minus(_I)),
    (_K, _J),
    (_K, _minus(_J)),
    (_I, _K),
    (_I, _minus(_K)),
    (_K, (1.0, 1.0, 0.0)),
    (_J, (1.0, 0.0, 1.0)),
    (_I, (0.0, 1.0, 1.0)),
)


@dataclass(frozen=True, slots=True, eq=False)
class _Spin:
    """What the axis does in one mount: time, rate and its derivative of each sample; total time; SI."""

    t: FloatArray
    w: FloatArray
    dw: FloatArray
    total: float


def _stepped(speeds: FloatArray, dwell: float, rate: float, settle: float) -> _Spin:
    t = _dwells(len(speeds), dwell, rate, settle)
    w = np.repeat(speeds, len(t) // len(speeds))
    return _Spin(t, w, np.zeros_like(w), len(speeds) * (dwell + settle) - settle)


def _ramped(speeds: FloatArray, dwell: float, rate: float, settle: float) -> _Spin:
    """From rest through the speeds and back to rest, every change a ramp that takes `settle`."""
    if settle * rate < 1.0:
        raise InputError(f"settle = {settle} s has no sample at {rate} per second: a ramp needs at least one")
    start = np.concatenate([[0.0], speeds])
    slope = np.diff(start, append=0.0) / settle
    rising, steady = _samples(settle, rate), _samples(dwell, rate)
    within = np.concatenate([rising, settle + steady])
    t = (np.arange(len(start))[:, None] * (settle + dwell) + within).ravel()
    dw = np.repeat(
        np.stack([slope, 0.0 * slope], axis=1).ravel(), np.tile([len(rising), len(steady)], len(start))
    )
    w = (start[:, None] + slope[:, None] * np.minimum(within, settle)).ravel()
    end = -len(steady)  # back at rest there is nothing to record
    return _Spin(t[:end], w[:end], dw[:end], len(start) * (settle + dwell) - dwell)


def _turning(
    spin: _Spin, mounts: tuple[Mount, ...], *, radius: float, settle: float, interval: float
) -> Inputs:
    """Apply the same spin in every mount, `settle` apart."""
    out, up = (_unit(np.array(axis)) for axis in zip(*mounts, strict=True))
    motion = _snapped(np.cross(up, out))
    f = (
        STANDARD_GRAVITY * up[:, None, :]
        - radius * spin.w[:, None] ** 2 * out[:, None, :]
        + radius * spin.dw[:, None] * motion[:, None, :]
    )
    w, dw = (rate[:, None] * up[:, None, :] for rate in (spin.w, spin.dw))
    t = (np.arange(len(mounts))[:, None] * (spin.total + settle) + spin.t).ravel()
    return Inputs(t, _channels({"f": f, "w": w, "dw": dw}), interval, _numbers(len(mounts), len(t)))


def _at_rest(f: FloatArray, t: FloatArray, interval: float, mount: NDArray[np.int64] | None = None) -> Inputs:
    """One dwell at each row of `f`."""
    return Inputs(t, _channels({"f": np.repeat(f, len(t) // len(f), axis=0)}), interval, mount)


def _numbers(mounts: int, rows: int) -> NDArray[np.int64]:
    """Number of the mount of each row, where all have equally many rows."""
    return np.repeat(np.arange(mounts), rows // mounts)


def _channels(vectors: dict[str, FloatArray]) -> dict[str, FloatArray]:
    """Components of vectors (..., 3) by channel name, without those that were not excited."""
    named = {
        f"{quantity}_{axis}": np.ascontiguousarray(values[..., n]).ravel()
        for quantity, values in vectors.items()
        for n, axis in enumerate("ijk")
    }
    return {name: values for name, values in named.items() if values.any()}


def _dwells(number: int, dwell: float, rate: float, settle: float) -> FloatArray:
    """Time stamps of dwells, `settle` apart."""
    if not 0.0 <= settle < math.inf:
        raise InputError(f"settle = {settle} s is no time between dwells: expected 0 or more")
    return (np.arange(number)[:, None] * (dwell + settle) + _samples(dwell, rate)).ravel()


def _samples(dwell: float, rate: float) -> FloatArray:
    """Time stamps in one dwell."""
    number = dwell * rate if dwell > 0.0 and rate > 0.0 else 0.0
    if not 1.0 - _ROUNDING <= number <= _MOST_SAMPLES:
        raise InputError(
            f"{dwell} s at {rate} samples a second is {number:.3g} samples: expected 1 to {_MOST_SAMPLES:.0e}"
        )
    return np.arange(math.floor(number * (1.0 + _ROUNDING))) / rate


def _check_steps(what: str, steps: Sequence[float], mounts: int, known: tuple[Mount, ...]) -> None:
    if len(steps) == 0 or not np.isfinite(steps).all():
        raise InputError(f"{what} with steps {list(steps)}: expected one finite number or more")
    if not 1 <= mounts <= len(known):
        raise InputError(f"{what} with {mounts} mounts: expected 1 to {len(known)}")


def _unit(axes: FloatArray) -> FloatArray:
    return _snapped(axes / np.linalg.norm(axes, axis=-1, keepdims=True))


def _snapped(components: FloatArray) -> FloatArray:
    """Components with the rounding of exact zeros taken away (and no negative zeros)."""
    return np.where(np.abs(components) < _ROUNDING, 0.0, components)
