"""Procedures at rest: static log, tumble in planes, standard sets of positions, stills in the hand, soaks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from typing import Annotated

import numpy as np

from imubayes.errors import InputError
from imubayes.rig.inputs import Inputs
from imubayes.rig.plans import (
    CUBE,
    EARTH,
    Direction,
    DwellTime,
    FloatArray,
    Gravity,
    Latitude,
    Plan,
    Sampling,
    Settling,
    at_rest,
    channels_of,
    dwells,
    earth_rate,
    level,
    north_across,
    numbers,
    samples,
    snapped,
    unit,
)
from imubayes.rig.rotations import TABLE_MOUNTS
from imubayes.units import STANDARD_GRAVITY, Angle, Count, Hertz, Kelvin, Key, Pause, Quantity, Rate, Seconds


def static(
    duration: Annotated[Seconds, Key("of the log", "2 h")],
    rate: Sampling,
    *,
    up: Annotated[Direction, Key("vertical in case axes i, j, k, any length", [0, 0, 1])] = (1.0, 0.0, 0.0),
    gravity: Gravity = STANDARD_GRAVITY,
    latitude: Latitude = None,
    north: Annotated[
        Direction | None,
        Key(
            "in case axes; only its horizontal part counts, and only with a `latitude`; without it along the"
            " first axis most across the vertical",
            [0, 1, 0],
        ),
    ] = None,
) -> Plan:
    """Log at rest.

    Sees the noise (N, B, K), and one number of the model: the mean of the output. Every term that is excited
    is confounded with the bias. Source: the noise tests of IEEE 952 and IEEE 1293.

    Raises
    ------
    InputError : if the log has no samples, `up` has no length, or `north` is vertical.

    Examples
    --------
    >>> log = static(60.0, 10.0, up=(0.0, 0.0, 1.0)).inputs
    >>> len(log), float(log.channels["f_k"][0]), "f_i" in log.channels
    (600, 9.80665, False)
    """
    vertical = np.array(up, dtype=float)
    if not 0.0 < np.linalg.norm(vertical) < math.inf:
        raise InputError(f"up = {up} has no direction: expected the vertical in case axes, such as (1, 0, 0)")
    t, upward = dwells(1, duration, rate, 0.0), unit(vertical)[None, :]
    vectors = {"f": gravity * upward}
    if latitude is not None:
        heading = north_across(upward) if north is None else level(np.array([north], dtype=float), upward)
        vectors["w"] = earth_rate(upward, heading, latitude)
    return Plan("static", "static", at_rest(vectors, t, 1.0 / rate))


def tumble(
    *,
    angles: Annotated[Count, Key("equal steps of a turn in each plane", 36)] = 24,
    planes: Annotated[Count, Key("the first of i-j, i-k, j-k", 2)] = 3,
    dwell: DwellTime = 30.0,
    rate: Sampling = 10.0,
    settle: Settling = 5.0,
    gravity: Gravity = STANDARD_GRAVITY,
    latitude: Annotated[
        Angle | None,
        Key(f"{EARTH}. A gyroscope feels it; the axis of the table lies level to the north", "48.1 deg"),
    ] = None,
) -> Plan:
    """Multiposition tumble in the Earth's field (IEEE 1293's static test), plane by plane.

    An accelerometer sees ``b1 m_j m_k b3``, the products ``c_ij c_ik c_jk`` of the planes that are run, and
    with 24 angles or so the asymmetries. It does not see ``b0 b2 c_jj c_kk`` apart: |f| = g in every row, so
    only ``b0 + g^2 b2``, ``b2 - c_jj`` and ``b2 - c_kk`` are there. One plane of 4 angles has rank 4, one of
    12 has 9, two of 24 have 13, three 14 of the 15 terms of f up to third order. Nothing of S and s: the rig
    applies no rates.

    A gyroscope sees ``g_i g_j g_k`` and S, whose trace is confounded with the bias. The Earth's 15 deg/h go
    on top of that: leave them out only where the noise drowns them. The table's axis lies level to the north,
    so that in a plane the rate is ``W sin(latitude)`` along f and ``W cos(latitude)`` along the normal, and
    ``b1 m_j m_k`` look like ``g_i g_j g_k`` but for steps from plane to plane: take them from a rate table.

    Of the angles 4 leave the asymmetries and K3 open, 24 do not. Each plane starts with its first axis up,
    turns towards its second one, and has the normal that is right-handed to that, k, -j or i, to the north.
    Without a latitude the Earth's rate is left out, as suits an accelerometer.

    Raises
    ------
    InputError : if there are no positions, no samples, other than 1 to 3 planes, or no such latitude.

    Examples
    --------
    >>> run = tumble(angles=4, planes=1, dwell=1.0, rate=1.0, latitude=math.pi / 6.0).inputs
    >>> run.t.tolist(), (run.channels["f_i"] / 9.80665).tolist()
    ([0.0, 6.0, 12.0, 18.0], [1.0, 0.0, -1.0, 0.0])
    >>> (run.channels["w_i"] / 7.292115e-5).round(9).tolist()
    [0.5, 0.0, -0.5, 0.0]
    """
    if planes not in (1, 2, 3) or angles < 1:
        raise InputError(
            f"tumble of {planes} planes by {angles} angles: expected 1 to 3 planes, 1 angle or more"
        )
    pairs = ((0, 1), (0, 2), (1, 2))[:planes]
    up = np.concatenate([_circle(angles, *pair) for pair in pairs])
    vectors = {"f": gravity * up}
    if latitude is not None:
        vectors["w"] = earth_rate(
            up, np.repeat([np.cross(*np.eye(3)[list(pair)]) for pair in pairs], angles, axis=0), latitude
        )
    t = dwells(planes * angles, dwell, rate, settle)
    inputs = at_rest(vectors, t, 1.0 / rate)
    return Plan("tumble", "tumble", replace(inputs, mount=numbers(planes, len(t))))


def positions(
    positions: Annotated[Count, Key("which set: 4, 6, 12, 24 or 26", 26)] = 24,
    *,
    dwell: DwellTime = 30.0,
    rate: Sampling = 10.0,
    settle: Settling = 5.0,
    gravity: Gravity = STANDARD_GRAVITY,
    latitude: Latitude = None,
) -> Plan:
    """Standard sets of positions at rest, for an accelerometer, or with the Earth's rate for a gyroscope.

    - 4 or 12: equal steps of a turn from i to j up, about the axis k, which lies level to the north;
    - 6: each case axis up and down;
    - 24: the orientations of a cube, each axis up and down at four headings;
    - 26: the faces, edges and corners of a cube upwards.

    An accelerometer (IEEE 1293, 12.3.4) sees ``m_j m_k`` in 6, 24 and 26 positions, and ``m_j`` in 4 and 12;
    ``c_ij`` in 12; ``c_ij c_ik c_jk`` in 26. In 4, 6 and 24 the size of f_i is 0 or g, so that ``b1`` looks
    like every odd function of it (``b3 b0p b2p``); 12 and 26 have three sizes of it and tell ``b1`` from
    ``b3`` as long as the asymmetries are left out. As always at 1 g, ``b0 b2 c_jj c_kk`` are not seen apart.

    A gyroscope (IEEE 952, 12.11 and 12.12) sees in 24 and 26 positions ``g_i g_j g_k`` beside
    ``b1 m_j m_k``, because the Earth's rate is not along gravity except at a pole; 15 deg/h say little of
    ``b1`` below navigation grade. The bias is confounded with the trace of S: |f| = g. In 4 and 12 positions
    w is along f but for a constant: ``b1`` looks like ``g_i``, and ``m_j`` like ``g_j``.

    Raises
    ------
    InputError : if there is no such set, or a dwell has no samples.

    Examples
    --------
    >>> run = positions(6, dwell=1.0, rate=1.0).inputs
    >>> (run.channels["f_j"] / 9.80665).tolist()
    [0.0, 0.0, 1.0, -1.0, 0.0, 0.0]
    """
    if positions not in _SETS:
        raise InputError(f"{positions} positions are no standard set: expected {', '.join(map(str, _SETS))}")
    up, north = _SETS[positions]
    vectors = {"f": gravity * up}
    if latitude is not None:
        vectors["w"] = earth_rate(up, north, latitude)
    return Plan("positions", "tumble", at_rest(vectors, dwells(positions, dwell, rate, settle), 1.0 / rate))


ATTITUDES = (6, 18, 26)
"""Faces of a cube; with its edges; and with its corners."""


def free_tumble(
    *,
    attitudes: Annotated[Count, Key("6, the faces upwards; 18, edges too; or 26, corners too", 18)] = 26,
    dwell: DwellTime = 5.0,
    rate: Annotated[Hertz, Key("samples a second", "200 Hz")] = 100.0,
    settle: Annotated[Pause, Key("of each turn to the next still", "2 s")] = 2.0,
    gravity: Gravity = STANDARD_GRAVITY,
) -> Plan:
    """Stills in the hand, and the turns between them, of which only |f| = g at rest will be known.

    Accelerometers tell ``b0 b1`` and the angles between their axes; nine stills do, in directions all around,
    and |f| = g leaves squares and products to the bias. Gyroscopes tell their bias and ``g_i g_j g_k`` at
    rest, and by turns of a quarter or more about all axes ``b1 m_j m_k``. The Earth's rate is left out.

    Raises
    ------
    InputError : if there is no such set of attitudes, or a still has no samples.

    Examples
    --------
    >>> run = free_tumble(attitudes=6, dwell=1.0, settle=1.0, rate=8.0).inputs
    >>> float(run.t[-1]), run.channels["f_i"][[0, 7, 16]].tolist()
    (10.875, [9.80665, 9.80665, 0.0])
    """
    if attitudes not in ATTITUDES:
        raise InputError(f"{attitudes} attitudes are no set: expected {', '.join(map(str, ATTITUDES))}")
    samples(dwell, rate)
    up, _ = _SETS[26]
    order = np.argsort(np.count_nonzero(up, axis=1), kind="stable")[:attitudes]
    lasting = np.full(attitudes, dwell), np.full(attitudes - 1, settle)
    return Plan("free-tumble", "free-tumble", held_in_turn(gravity * up[order], *lasting, rate))


def held_in_turn(force: FloatArray, dwell: FloatArray, turn: FloatArray, rate: float) -> Inputs:
    """Inputs of a case that is held still in attitudes, and turned the shortest way from one to the next.

    The specific force in each is `force` (k, 3), m/s^2; stills take `dwell` (k,), turns between them `turn`
    (k - 1,), s; `rate` samples are taken a second.
    """
    n = np.round(np.cumsum(np.append(0.0, (dwell + np.append(turn, 0.0))[:-1])) * rate)
    begin, total = n / rate, round(n[-1] + dwell[-1] * rate)
    t = np.arange(total) / rate
    k = np.searchsorted(n, np.arange(total), side="right") - 1
    length = np.linalg.norm(force[0])
    here, there = force / length, np.roll(force, -1, axis=0) / length
    across = np.cross(here, there)
    sine = np.linalg.norm(across, axis=1)
    flat = sine < 1e-9
    across[flat] = np.cross(here, np.eye(3)[np.argmin(np.abs(here), axis=1)])[flat]
    normal, angle = unit(across), np.arctan2(np.where(flat, 0.0, sine), np.sum(here * there, axis=1))
    lasting = np.where(np.append(turn, 0.0) > 0.0, np.append(turn, 0.0), math.inf)
    s = np.clip((t - begin[k] - dwell[k]) / lasting[k], 0.0, 1.0)
    s[k == len(force) - 1] = 0.0
    turned = (angle[k] * (s - np.sin(2.0 * math.pi * s) / (2.0 * math.pi)))[:, None]
    f = np.cos(turned) * here[k] + np.sin(turned) * np.cross(normal, here)[k]
    w = -(angle / lasting)[k, None] * (1.0 - np.cos(2.0 * math.pi * s))[:, None] * normal[k]
    return Inputs(t, channels_of({"f": length * snapped(f), "w": w}), 1.0 / rate)


Ramp = Annotated[float, Quantity("K/s", positive=True)]

POSITIONS = unit(np.array([up for _, up in TABLE_MOUNTS]))
"""Vertical in case axes of each position: both ways along i, j and k, then halfway between two of them."""


def thermal(
    temperatures: Annotated[
        Sequence[Kelvin],
        Key(
            "of the soaks, in order; up and down again shows hysteresis", ["-20 degC", "60 degC", "-20 degC"]
        ),
    ],
    *,
    positions: Annotated[Count, Key(CUBE, 2)] = 6,
    dwell: Annotated[Seconds, Key("time in each position", "30 s")] = 60.0,
    soak: Annotated[Pause, Key("time at a temperature before the positions", "1 h")] = 1800.0,
    ramp: Annotated[Ramp, Key("size of the rate between soaks", "3 degC/min")] = 1.0 / 60.0,
    rate: Sampling = 1.0,
    turning: Annotated[
        Rate, Key("rate about the vertical in each position, which a gyroscope's `b1*T` needs", "60 deg/s")
    ] = 0.0,
    lag: Annotated[
        Pause, Key("time constant with which a second thermometer follows the first; 0 for none", "5 min")
    ] = 0.0,
) -> Plan:
    """Soak at one temperature after the other, with still positions at the end of each, and ramps between.

    Everything is recorded. The input axis is up during the first soak, and points down and up by turns
    during the ramps (and the soaks that they end in), so that what dT/dt does to the bias and to the scale
    factor can be told apart; lead the temperatures up and down again to see hysteresis. A second
    thermometer, as within a coil, lags: what it reads above the first is ``gT``.

    Raises
    ------
    InputError : if there is no temperature, one is not above 0 K, the ramp or the dwell is no positive time,
        or there are other than 1 to 9 positions.

    Examples
    --------
    >>> run = thermal([298.0, 300.0], positions=2, dwell=1.0, soak=2.0, ramp=1.0, rate=1.0).inputs
    >>> run.channels["T"].tolist()
    [298.0, 298.0, 298.0, 298.0, 298.0, 299.0, 300.0, 300.0, 300.0, 300.0]
    >>> run.channels["dT"].tolist()
    [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0]
    """
    levels = np.asarray(temperatures, dtype=float)
    times = dwell, ramp, rate
    if len(levels) == 0 or not (np.isfinite(levels) & (levels > 0.0)).all():
        raise InputError(f"thermal run at {levels.tolist()} K: expected one temperature above 0 K or more")
    if not 1 <= positions <= len(POSITIONS):
        raise InputError(f"thermal run in {positions} positions: expected 1 to {len(POSITIONS)}")
    if not all(0.0 < value < math.inf for value in times):
        raise InputError(f"thermal run with dwell, ramp and rate {times}: expected more than zero of each")
    if not 0.0 <= lag < math.inf:
        raise InputError(f"thermal run with a second thermometer {lag} s behind: expected zero or more")
    steps = np.diff(levels, prepend=levels[0])
    # each temperature is a ramp, a soak, and the positions
    lasting = np.column_stack(
        (np.abs(steps) / ramp, np.full_like(levels, soak), *[[dwell] * len(levels)] * positions)
    )
    starts = np.concatenate(([0.0], np.cumsum(lasting)))
    t = np.arange(math.floor(starts[-1] * rate * (1.0 + 1e-12))) / rate
    part = np.searchsorted(starts, t * (1.0 + 1e-12) + 1e-12, side="right") - 1
    level, phase = np.divmod(part, 2 + positions)
    into = t - starts[part]
    climbing = np.sign(steps)[level] * ramp * (phase == 0)
    T = np.where(phase == 0, (levels - steps)[level] + climbing * into, levels[level])
    up = POSITIONS[np.where(phase < 2, level % 2, phase - 2)]
    spin = np.where(phase < 2, 0.0, turning)
    vectors = {"f": STANDARD_GRAVITY * up, "w": spin[:, None] * up}
    heat = {"T": T, "dT": climbing} | ({"gT": _behind(climbing, lag, rate)} if lag else {})
    return Plan("thermal", "thermal", Inputs(t, {**channels_of(vectors), **heat}, 1.0 / rate))


def _behind(climbing: FloatArray, lag: float, rate: float) -> FloatArray:
    """What a thermometer that follows with a time constant reads above the temperature, K.

    ``d(gT)/dt = -gT / lag - dT/dt``, from zero on, with a rate dT/dt that holds over a sample.
    """
    from scipy.signal import lfilter

    kept = math.exp(-1.0 / (rate * lag))
    return np.asarray(lfilter([0.0, -lag * (1.0 - kept)], [1.0, -kept], climbing))


def _circle(angles: int, first: int, second: int) -> FloatArray:
    """Verticals (angles, 3) that turn from one axis towards another."""
    turn = 2.0 * math.pi * np.arange(angles) / angles
    up = np.zeros((angles, 3))
    up[:, first], up[:, second] = snapped(np.cos(turn)), snapped(np.sin(turn))
    return up


def _sets() -> dict[int, tuple[FloatArray, FloatArray]]:
    """Vertical and north (n, 3) in case axes of each standard set of n positions."""
    axes, k = np.eye(3), np.array([0.0, 0.0, 1.0])
    faces = np.concatenate([snapped(sign * axis[None, :]) for axis in axes for sign in (1.0, -1.0)])
    # what is left of the six faces across a vertical are its four headings
    cube = [(up, north) for up, north in product(faces, faces) if up @ north == 0.0]
    around = np.array([d for d in product((1.0, 0.0, -1.0), repeat=3) if any(d)])
    ways = unit(around)
    upward, northward = (np.array(side) for side in zip(*cube, strict=True))
    return {
        4: (_circle(4, 0, 1), np.tile(k, (4, 1))),
        6: (faces, north_across(faces)),
        12: (_circle(12, 0, 1), np.tile(k, (12, 1))),
        24: (upward, northward),
        26: (ways, north_across(ways)),
    }


_SETS = _sets()
