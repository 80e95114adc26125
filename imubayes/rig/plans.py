"""What every test procedure has in common: the plan that it gives, its times, and the Earth.

Axes are the case axes (i, j, k), right-handed. At rest ``f = +g`` up; ``f = a - gravitation`` in general, and
w is the inertial rate, so that the Earth's is part of it. A component that is nominally zero is exactly zero,
so that ``sign(f_i)`` does not follow rounding where the input axis is horizontal. Between dwells time runs on
while nothing is recorded, so the time stamps have gaps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import FloatArray
from imubayes.errors import InputError
from imubayes.rig.inputs import Inputs
from imubayes.rig.motion import named
from imubayes.units import Acceleration, Angle, Count, Hertz, Key, Metres, Pause, Seconds

EARTH = "north positive; puts the Earth's rate into `w_i w_j w_k`"
CUBE = "the first of i, -i, j, -j, k, -k up, then halfway between i-j, i-k, j-k"

DwellTime = Annotated[Seconds, Key("recorded time at a step", "1 min")]
Sampling = Annotated[Hertz, Key("samples a second", "1 Hz")]
Settling = Annotated[Pause, Key("between steps, not recorded", "20 s")]
Gravity = Annotated[Acceleration, Key("local gravity", "9.81 m/s^2")]
Latitude = Annotated[Angle | None, Key(EARTH, "48.1 deg")]
Radius = Annotated[Metres, Key("of the sensing point from the axis", "2 cm")]
Mounts = Annotated[Count, Key(CUBE, 6)]

Direction = tuple[float, float, float]
Mount = tuple[Direction, Direction]
"""Two directions in case axes, any length: outward or shaken, and the vertical."""

I_AXIS, J_AXIS, K_AXIS = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)

EARTH_RATE = 7.292115e-5
"""rad/s, sidereal (WGS 84)."""

_ROUNDING = 1e-12
"""Components of unit vectors below this are rounding of an exact zero."""

_MOST_SAMPLES = 1e9
"""In one dwell; more is a slip of the unit, and would not fit in memory."""


@dataclass(frozen=True, slots=True, eq=False)
class Turn:
    """How a table turns on the Earth, about the vertical `up` (n, 3) in case axes, in n rows.

    `rate` (n,) is that of the table itself, rad/s, counter-clockwise seen from above; `angle` (n,) rad since
    the first row of a mount, where north is along `north_across` the vertical.
    """

    up: FloatArray
    rate: FloatArray
    angle: FloatArray
    latitude: float | None


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """A test procedure that is ready to run: the inputs that the rig applies, SI; how its table turns."""

    name: str
    procedure: str
    inputs: Inputs
    turn: Turn | None = None


def minus(axis: Direction) -> Direction:
    """Give the opposite direction."""
    return -axis[0], -axis[1], -axis[2]


def earth_rate(up: FloatArray, north: FloatArray, latitude: float) -> FloatArray:
    """Rate (n, 3) of the Earth along the case axes, rad/s: ``W (cos(latitude) north + sin(latitude) up)``.

    `up` and `north` (n, 3) are unit vectors in case axes; an `InputError` if there is no such latitude (rad).
    """
    if not abs(latitude) <= math.pi / 2.0:
        raise InputError(f"latitude = {latitude} rad is nowhere on Earth: expected -pi/2 to pi/2")
    cos, sin = snapped(np.array([math.cos(latitude), math.sin(latitude)]))
    return EARTH_RATE * (cos * north + sin * up)


def turned_on_earth(inputs: Inputs, turn: Turn) -> Inputs:
    """Inputs with the inertial rate of a table along the case axes, the mean over each sample.

    The Earth's rate across the vertical stays in the horizontal plane and turns the other way in the case.
    """
    w = turn.rate[:, None] * turn.up
    if turn.latitude is not None:
        north = north_across(turn.up)
        cos, sin = np.cos(turn.angle)[:, None], np.sin(turn.angle)[:, None]
        left = np.sinc(turn.rate * inputs.interval / (2.0 * math.pi))[:, None]
        heading = snapped(left * (cos * north - sin * np.cross(turn.up, north)))
        w = w + earth_rate(turn.up, heading, turn.latitude)
    kept = {name: values for name, values in inputs.channels.items() if not name.startswith("w_")}
    return replace(inputs, channels={**kept, **channels_of({"w": w})})


def angles_turned(t: FloatArray, rate: FloatArray, mount: NDArray[np.int64]) -> FloatArray:
    """Angle (n,) since the first row of each mount, rad; between dwells the rate changes evenly.

    Examples
    --------
    >>> one = np.zeros(3, dtype=int)
    >>> angles_turned(np.array([0.0, 1.0, 5.0]), np.array([0.5, 0.5, 1.0]), one).tolist()
    [0.0, 0.5, 3.5]
    """
    turned = np.concatenate(([0.0], np.cumsum(0.5 * np.diff(t) * (rate[1:] + rate[:-1]))))
    _, first, place = np.unique(mount, return_index=True, return_inverse=True)
    return turned - turned[first][place]


def north_across(up: FloatArray) -> FloatArray:
    """Horizontal part (n, 3), as a unit vector, of the first case axis that is most across each vertical."""
    return level(np.eye(3)[np.argmin(np.abs(up), axis=1)], up)


def level(north: FloatArray, up: FloatArray) -> FloatArray:
    """Unit vectors (n, 3) along the horizontal part of directions; an `InputError` if one has none."""
    finite = np.where(np.isfinite(north), north, 0.0)
    flat = snapped(finite - np.sum(finite * up, axis=1, keepdims=True) * up)
    if not (flat.any(axis=1).all() and np.isfinite(north).all()):
        told = tuple(north[0].tolist())
        raise InputError(f"north = {told} has no horizontal part: expected a direction across up")
    return unit(flat)


def at_rest(vectors: dict[str, FloatArray], t: FloatArray, interval: float) -> Inputs:
    """One dwell at each row of the vectors."""
    rows = {name: np.repeat(v, len(t) // len(v), axis=0) for name, v in vectors.items()}
    return Inputs(t, channels_of(rows), interval)


def numbers(mounts: int, rows: int) -> NDArray[np.int64]:
    """Number of the mount of each row, where all have equally many rows."""
    return np.repeat(np.arange(mounts), rows // mounts)


def channels_of(vectors: dict[str, FloatArray]) -> dict[str, FloatArray]:
    """Components of vectors (..., 3) by channel name, without those that were not excited."""
    return {name: values for name, values in named(vectors).items() if values.any()}


def dwells(number: int, dwell: float, rate: float, settle: float) -> FloatArray:
    """Time stamps of dwells, `settle` apart; an `InputError` if that is no time, or there are no samples."""
    if not 0.0 <= settle < math.inf:
        raise InputError(f"settle = {settle} s is no time between dwells: expected 0 or more")
    return (np.arange(number)[:, None] * (dwell + settle) + samples(dwell, rate)).ravel()


def samples(dwell: float, rate: float) -> FloatArray:
    """Time stamps in one dwell; an `InputError` if there are none, or more than fit in memory."""
    number = dwell * rate if dwell > 0.0 and rate > 0.0 else 0.0
    if not 1.0 - _ROUNDING <= number <= _MOST_SAMPLES:
        raise InputError(
            f"{dwell} s at {rate} samples a second is {number:.3g} samples: expected 1 to {_MOST_SAMPLES:.0e}"
        )
    return np.arange(math.floor(number * (1.0 + _ROUNDING))) / rate


def check_steps(what: str, steps: Sequence[float], mounts: int, known: tuple[Mount, ...]) -> None:
    """Refuse steps that are none, and mounts that are not known: an `InputError` names them."""
    if len(steps) == 0 or not np.isfinite(steps).all():
        raise InputError(f"{what} with steps {list(steps)}: expected one finite number or more")
    if not 1 <= mounts <= len(known):
        raise InputError(f"{what} with {mounts} mounts: expected 1 to {len(known)}")


def unit(axes: FloatArray) -> FloatArray:
    """Unit vectors (..., 3) along axes."""
    return snapped(axes / np.linalg.norm(axes, axis=-1, keepdims=True))


def snapped(components: FloatArray) -> FloatArray:
    """Components with the rounding of exact zeros taken away (and no negative zeros)."""
    return np.where(np.abs(components) < _ROUNDING, 0.0, components)


SEMI_MAJOR_AXIS = 6378137.0
"""m, WGS-84 (NIMA TR8350.2, table 3.1)."""
FLATTENING = 1.0 / 298.257223563
"""WGS-84."""
GRAVITY_AT_EQUATOR = 9.7803253359
"""m/s^2, WGS-84 (TR8350.2, table 3.4)."""
SOMIGLIANA_CONSTANT = 0.00193185265241
"""k = (b gamma_p)/(a gamma_e) - 1, WGS-84 (TR8350.2, table 3.4)."""
ECCENTRICITY_SQUARED = 0.00669437999014
"""First eccentricity squared, WGS-84."""
ROTATION_RATIO = 0.00344978650684
"""m = omega^2 a^2 b / GM, WGS-84 (TR8350.2, table 3.4)."""


def normal_gravity(
    latitude: Annotated[Angle, Key("geodetic, north positive", "45.4 deg")],
    height: Annotated[Metres, Key("above the ellipsoid", "12 m")],
) -> float:
    """Gravity of the reference ellipsoid at a place, m/s^2.

    Somigliana's closed formula on the ellipsoid, continued upwards to second order in the height
    (TR8350.2, equations 4-1 and 4-3). Local anomalies, which reach 5e-4 m/s^2 in hills, are not in it: a
    gravimeter's value is better.

    Examples
    --------
    >>> round(normal_gravity(0.0, 0.0), 7), round(normal_gravity(math.pi / 2.0, 0.0), 7)
    (9.7803253, 9.8321849)
    """
    sin2 = math.sin(latitude) ** 2
    on_ellipsoid = GRAVITY_AT_EQUATOR * (1.0 + SOMIGLIANA_CONSTANT * sin2)
    on_ellipsoid /= math.sqrt(1.0 - ECCENTRICITY_SQUARED * sin2)
    slope = 1.0 + FLATTENING + ROTATION_RATIO - 2.0 * FLATTENING * sin2
    relative = height / SEMI_MAJOR_AXIS
    return on_ellipsoid * (1.0 - 2.0 * slope * relative + 3.0 * relative**2)
