"""Procedures on a machine: rate table, oscillating table and centrifuge, about a vertical axis; and shaker.

The specific force at the radius R, with the rate w along the vertical, is ``f = g up - R w^2 out + R dw/dt
motion``; counter-clockwise seen from above is positive, so that a mount with its input axis down turns the
sign of w_i as of f_i.

A term at the mean input is not the mean of the term: under vibration of rms s, ``<f^2> = f0^2 + s^2``. So the
vibration is sampled, and the same rows serve simulation, analysis and a recorded file.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated

import numpy as np

from imubayes.errors import InputError
from imubayes.rig.inputs import Inputs
from imubayes.rig.plans import (
    EARTH_RATE,
    I_AXIS,
    J_AXIS,
    K_AXIS,
    DwellTime,
    FloatArray,
    Latitude,
    Mount,
    Mounts,
    Plan,
    Radius,
    Sampling,
    Settling,
    Turn,
    angles_turned,
    channels_of,
    check_steps,
    dwells,
    minus,
    numbers,
    samples,
    snapped,
    turned_on_earth,
    unit,
)
from imubayes.units import STANDARD_GRAVITY, Angle, Count, Gravities, Hertz, Key, Metres, Rate

SAMPLES_A_PERIOD = 8.0
"""Of an oscillation, at least: the mean over a sample is within 3 % of the value at its middle."""


def rate_table(
    rates: Annotated[
        Sequence[Rate], Key("table rates, counter-clockwise from above positive", ["-100 deg/s", "100 deg/s"])
    ],
    *,
    mounts: Mounts = 9,
    dwell: DwellTime = 30.0,
    rate: Sampling = 10.0,
    settle: Settling = 5.0,
    latitude: Latitude = math.pi / 4.0,
    radius: Radius = 0.0,
) -> Plan:
    """Rate steps about a vertical axis, in one mount after the other (IEEE 952's rate test, 12.9).

    The rate is ``w = (table + W sin(latitude)) up + W cos(latitude) north``, where north turns in the case as
    the table turns, the other way; the specific force is ``f = g up - radius w^2 out`` with the vertical part
    of w. Between steps the rate of the table changes evenly.

    A gyroscope with the input axis up (1 mount) sees ``b1 b2 b3`` and, at four speeds or more both ways, the
    asymmetries; its bias is confounded with ``g_i`` and ``S_ii``. Six mounts add ``m_j m_k`` and
    ``g_i g_j g_k``, nine the products ``c_ij c_ik c_jk`` and ``S_ij S_ik S_jk``; of the bias and the trace of
    S only the sum is there. Off the axis, ``g_j`` or ``g_k`` times the centripetal force looks like ``b2``.
    Nothing of dw/dt.

    At the first sample of each mount, north is along the first case axis that is most across the vertical.

    Raises
    ------
    InputError : if there are no rates, no samples, or other than 1 to 9 mounts.

    Examples
    --------
    >>> run = rate_table([-1.0, 1.0], mounts=1, dwell=1.0, rate=1.0, latitude=None).inputs
    >>> run.channels["w_i"].tolist(), "w_j" in run.channels
    ([-1.0, 1.0], False)
    >>> still = rate_table([0.0], mounts=1, dwell=1.0, rate=1.0, latitude=0.0).inputs
    >>> {name: round(math.degrees(w[0]) * 3600.0, 2) for name, w in still.channels.items() if "w" in name}
    {'w_j': 15.04}
    """
    check_steps("rate table", rates, mounts, TABLE_MOUNTS)
    spin = t, w, *_ = _stepped(np.asarray(rates, dtype=float), dwell, rate, settle)
    angle, where = angles_turned(t, w, np.zeros(len(t), dtype=np.int64)), TABLE_MOUNTS[:mounts]
    inputs, turn = _on_earth(spin, angle, where, latitude, radius=radius, settle=settle, rate=rate)
    return Plan("rate-table", "rate-table", inputs, turn)


def oscillation(
    frequencies: Annotated[Sequence[Hertz], Key("one dwell at each", ["1 Hz", "5 Hz"])],
    *,
    amplitude: Annotated[Angle, Key("A", "0.5 deg")] = math.pi / 90.0,
    mounts: Mounts = 9,
    dwell: DwellTime = 10.0,
    rate: Annotated[Hertz, Key("samples a second, 8 a period or more", "200 Hz")] = 100.0,
    settle: Settling = 5.0,
    latitude: Latitude = math.pi / 4.0,
    radius: Radius = 0.0,
) -> Plan:
    """Angular oscillation ``A sin(2 pi f t)`` about a vertical axis, in one mount after the other.

    The rate ``2 pi f A cos`` and its derivative ``-(2 pi f)^2 A sin`` are in quadrature, so that what they do
    can be told apart, and the square of the rate has a mean. The Earth's rate and the force are as in
    `rate_table`, and ``radius dw/dt`` along the motion.

    An accelerometer sees ``m_j m_k``, ``s_i s_j s_k`` (Kang) and all of S (Kspin) in nine mounts; a lever arm
    from the point that f is told for drives the same columns. On the axis |f| = g, as in a tumble, and ``b1``
    is not told from ``b3 c_ij c_ik``. A gyroscope sees ``b1 m_j m_k``, ``g_i g_j g_k`` and ``s_i s_j s_k``; a
    latency tau acts on it as an ``s_i`` of -tau does. Source: angular acceleration tests as usual in practice
    (IEEE 1293, IEEE 952).

    Raises
    ------
    InputError : if there are no frequencies, or one is not above 0 or too high for the sampling; if the
        amplitude is not above 0, there are no samples, or other than 1 to 9 mounts.

    Examples
    --------
    >>> run = oscillation([1.0], amplitude=0.1, mounts=1, dwell=1.0, rate=8.0, latitude=None).inputs
    >>> (run.channels["w_i"] / (2.0 * np.pi * 0.1)).round(3).tolist()
    [1.0, 0.707, 0.0, -0.707, -1.0, -0.707, 0.0, 0.707]
    >>> run.channels["dw_i"].round(3).tolist()[:3]
    [0.0, -2.792, -3.948]
    """
    check_steps("oscillation", frequencies, mounts, TABLE_MOUNTS)
    if not (min(frequencies) > 0.0 and SAMPLES_A_PERIOD * max(frequencies) <= rate and amplitude > 0.0):
        raise InputError(
            f"oscillation of {amplitude} rad from {min(frequencies)} to {max(frequencies)} Hz at {rate}"
            f" samples a second: expected more than 0 of each, {SAMPLES_A_PERIOD:g} samples a period or more"
        )
    # one frequency after the other, each from the middle of its swing
    number, pulse = len(frequencies), 2.0 * math.pi * np.asarray(frequencies, dtype=float)[:, None]
    phase = pulse * samples(dwell, rate)
    w = amplitude * pulse * snapped(np.cos(phase))
    dw = amplitude * pulse**2 * snapped(np.sin(-phase))
    t, angle = dwells(number, dwell, rate, settle), (amplitude * np.sin(phase)).ravel()
    spin, where = (t, w.ravel(), dw.ravel(), number * (dwell + settle) - settle), TABLE_MOUNTS[:mounts]
    inputs, turn = _on_earth(spin, angle, where, latitude, radius=radius, settle=settle, rate=rate)
    return Plan("oscillation", "oscillation", inputs, turn)


def centrifuge(
    levels: Annotated[Sequence[Gravities], Key("centripetal accelerations", ["1 g", "5 g", "20 g"])],
    *,
    mounts: Annotated[
        Count,
        Key(
            "the first of: i outward and inward with j and with k up, i along the motion both ways, two at 45"
            " degrees, four tilted",
            4,
        ),
    ] = 12,
    dwell: DwellTime = 30.0,
    rate: Sampling = 10.0,
    settle: Settling = 5.0,
    arm: Annotated[Metres, Key("radius", "2.5 m")] = 1.0,
    ramp: Annotated[
        bool, Key("records the changes of level too (constant dw/dt over `settle`)", True)
    ] = False,
) -> Plan:
    """Levels of centripetal acceleration on a precision centrifuge, in one mount after the other (IEEE 836).

    ``f = -R w^2 out + g up``, ``w`` along the vertical, plus ``R dw/dt`` along the motion while ramping. The
    rate that gives a level is the inertial one: the Earth's vertical part is in it, and its horizontal part,
    which turns with the arm, averages out over whole turns.

    An accelerometer sees, along the arm (4 mounts), ``b2 b3`` and, at four levels or more, the asymmetries;
    because gravity is then always across it, ``b0`` is there only with ``m_j m_k c_jj c_kk``, ``b1`` with
    ``c_ij c_ik``, and ``b1p`` with ``S_jj S_kk``. All twelve mounts see every term of f and
    ``S_ij S_ik S_jk``, ramps also ``s_i s_j s_k``. An error of the radius looks like ``b1`` (take that from a
    tumble), a stretch of the arm like ``b2p`` where the axis is run both ways and like ``b2`` where it is
    not: errors of the bench, which an analysis may allow for (`imubayes.rig.bench`: ``radius``,
    ``arm_stretch``). A gyroscope sees its g-sensitivities ``g_i g_j g_k`` and all of S.

    Levels are in g (standard gravity), not in SI: the unit of centrifuge practice. Ramps include those from
    rest and back to it.

    Raises
    ------
    InputError : if there are no levels, a negative level, no samples, or other than 1 to 12 mounts.

    Examples
    --------
    >>> run = centrifuge([1, 5], mounts=2, dwell=1.0, rate=1.0).inputs
    >>> (run.channels["f_i"] / 9.80665).round(12).tolist()
    [-1.0, -5.0, 1.0, 5.0]
    """
    check_steps("centrifuge", levels, mounts, _ARM_MOUNTS)
    if min(levels) < 0.0 or not arm > 0.0:
        raise InputError(
            f"centrifuge to {min(levels)} g on an arm of {arm} m: expected levels >= 0, an arm > 0"
        )
    speeds = np.sqrt(np.asarray(levels, dtype=float) * STANDARD_GRAVITY / arm)
    spin = (_ramped if ramp else _stepped)(speeds, dwell, rate, settle)
    inputs = _turning(spin, _ARM_MOUNTS[:mounts], radius=arm, settle=settle, interval=1.0 / rate)
    return Plan("centrifuge", "centrifuge", inputs)


_ARM_MOUNTS: tuple[Mount, ...] = (
    (I_AXIS, J_AXIS),  # input axis outward and inward, pendulous axis up
    (minus(I_AXIS), J_AXIS),
    (I_AXIS, K_AXIS),  # the same with the output axis up
    (minus(I_AXIS), K_AXIS),
    (J_AXIS, K_AXIS),  # input axis along the motion, both ways
    (minus(J_AXIS), K_AXIS),
    ((1.0, 1.0, 0.0), K_AXIS),  # 45 degrees in the plane of the arm
    ((1.0, 0.0, 1.0), J_AXIS),
    # tilted; with the smallest geometric mean of the terms' sds that a search over such tilts found
    ((-1.0, -1.0, 0.0), (-1.0, 1.0, 1.0)),
    ((0.0, -1.0, -1.0), (1.0, 1.0, -1.0)),
    ((0.0, -1.0, 1.0), (1.0, 1.0, 1.0)),
    ((1.0, 0.0, -1.0), (1.0, -1.0, 1.0)),
)

TABLE_MOUNTS: tuple[Mount, ...] = (
    (J_AXIS, I_AXIS),
    (J_AXIS, minus(I_AXIS)),
    (K_AXIS, J_AXIS),
    (K_AXIS, minus(J_AXIS)),
    (I_AXIS, K_AXIS),
    (I_AXIS, minus(K_AXIS)),
    (K_AXIS, (1.0, 1.0, 0.0)),
    (J_AXIS, (1.0, 0.0, 1.0)),
    (I_AXIS, (0.0, 1.0, 1.0)),
)


Spin = tuple[FloatArray, FloatArray, FloatArray, float]
"""What the axis does in one mount, SI: time, rate and its derivative of each sample, how long it takes."""


def _stepped(speeds: FloatArray, dwell: float, rate: float, settle: float) -> Spin:
    t = dwells(len(speeds), dwell, rate, settle)
    w = np.repeat(speeds, len(t) // len(speeds))
    return t, w, np.zeros_like(w), len(speeds) * (dwell + settle) - settle


def _ramped(speeds: FloatArray, dwell: float, rate: float, settle: float) -> Spin:
    """From rest through the speeds and back to rest, every change a ramp that takes `settle`."""
    if settle * rate < 1.0:
        raise InputError(f"settle = {settle} s has no sample at {rate} per second: a ramp needs at least one")
    start = np.concatenate([[0.0], speeds])
    slope = np.diff(start, append=0.0) / settle
    rising, steady = samples(settle, rate), samples(dwell, rate)
    within = np.concatenate([rising, settle + steady])
    t = (np.arange(len(start))[:, None] * (settle + dwell) + within).ravel()
    dw = np.repeat(
        np.stack([slope, 0.0 * slope], axis=1).ravel(), np.tile([len(rising), len(steady)], len(start))
    )
    w = (start[:, None] + slope[:, None] * np.minimum(within, settle)).ravel()
    end = -len(steady)  # back at rest there is nothing to record
    return t[:end], w[:end], dw[:end], len(start) * (settle + dwell) - dwell


def _on_earth(
    spin: Spin,
    angle: FloatArray,
    mounts: tuple[Mount, ...],
    latitude: float | None,
    *,
    radius: float,
    settle: float,
    rate: float,
) -> tuple[Inputs, Turn]:
    """Apply the same spin of a table, and the angle of each sample, in every mount, with the Earth's rate."""
    t, w, dw, total = spin
    vertical = 0.0 if latitude is None else EARTH_RATE * math.sin(latitude)
    whole = t, w + vertical, dw, total
    inputs = _turning(whole, mounts, radius=radius, settle=settle, interval=1.0 / rate)
    up = np.repeat(unit(np.array([mount[1] for mount in mounts])), len(t), axis=0)
    turn = Turn(up, np.tile(w, len(mounts)), np.tile(angle, len(mounts)), latitude)
    return turned_on_earth(inputs, turn), turn


def _turning(
    spin: Spin, mounts: tuple[Mount, ...], *, radius: float, settle: float, interval: float
) -> Inputs:
    """Apply the same spin in every mount, `settle` apart."""
    within, rate, slope, total = spin
    out, up = (unit(np.array(axis)) for axis in zip(*mounts, strict=True))
    motion = snapped(np.cross(up, out))
    f = (
        STANDARD_GRAVITY * up[:, None, :]
        - radius * rate[:, None] ** 2 * out[:, None, :]
        + radius * slope[:, None] * motion[:, None, :]
    )
    w, dw = (size[:, None] * up[:, None, :] for size in (rate, slope))
    t = (np.arange(len(mounts))[:, None] * (total + settle) + within).ravel()
    return Inputs(t, channels_of({"f": f, "w": w, "dw": dw}), interval, numbers(len(mounts), len(t)))


SAMPLING = 2.56
"""Samples a second over the upper end of the band, at least: the custom of shaker control."""


def vibration(
    levels: Annotated[
        Sequence[Gravities], Key("rms along the shaken direction; 0 is at rest", ["0 g", "2 g", "5 g"])
    ],
    *,
    mounts: Annotated[
        Count,
        Key(
            "the first of: shaken along i with i, -i and j up, along j with k up, along k with j up, halfway"
            " between i-j with k up, i-k with j up, j-k with i up",
            3,
        ),
    ] = 8,
    dwell: DwellTime = 5.0,
    rate: Annotated[
        Hertz, Key("samples a second, 2.56 times the band's upper end or more", "2 kHz")
    ] = 1000.0,
    settle: Settling = 5.0,
    band: Annotated[tuple[Hertz, Hertz], Key("lowest and highest frequency", ["20 Hz", "100 Hz"])] = (
        20.0,
        120.0,
    ),
) -> Plan:
    """Dwells of Gaussian vibration at several levels along a direction, in one mount after the other.

    The signal is pseudo-random as shaker controllers have it: tones of equal size and fixed phases at every
    multiple of ``1 / dwell`` within the band, other phases in each dwell. Its rms over a dwell is exact, and
    its law as normal as that of so many independent tones.

    The mean of the output moves with the square of the level by ``b2`` (``c_jj``, ``c_kk``, ``c_ij`` in the
    mounts along j, k and at 45 degrees), in proportion to it by ``b1p``, and by 3 f0 s^2 times ``b3`` with
    the input axis up and down: the bias is seen apart from all of them, as it is not at 1 g. A gyroscope sees
    ``g_i g_j g_k`` and all of S, the diagonal apart from the bias. Nothing of an accelerometer's S and s, nor
    of a gyroscope's own powers: no rotation. The signal is taken as known and in step with the output; where
    clocks differ, allow for a latency (8 samples a period, as by default, are enough to tell it). Rocking and
    cross motion of a shaker (1 to 10 %) are not in it. Source: vibration rectification tests as usual in
    practice (IEEE 1293).

    Levels are in g (standard gravity), not in SI: the unit of shaker practice.

    Raises
    ------
    InputError : if there are no levels, a negative level, no samples, a band that no dwell holds or that the
        sampling does not reach, or other than 1 to 8 mounts.

    Examples
    --------
    >>> run = vibration([0.0, 2.0], mounts=1).inputs
    >>> f = run.channels["f_i"].reshape(2, -1) / 9.80665
    >>> f.mean(axis=1).round(9).tolist(), f.std(axis=1).round(9).tolist()
    ([1.0, 1.0], [0.0, 2.0])
    """
    check_steps("vibration", levels, mounts, _SHAKER_MOUNTS)
    if min(levels) < 0.0:
        raise InputError(f"vibration of {min(levels)} g: expected an rms of 0 or more")
    along, up = (unit(np.array(axis)) for axis in zip(*_SHAKER_MOUNTS[:mounts], strict=True))
    t = dwells(mounts * len(levels), dwell, rate, settle)
    signal = _tones(mounts * len(levels), dwell, rate, band).reshape(mounts, len(levels), -1)
    shaken = np.asarray(levels, dtype=float)[:, None] * signal
    f = up[:, None, None, :] + shaken[..., None] * along[:, None, None, :]
    channels = channels_of({"f": STANDARD_GRAVITY * f})
    return Plan("vibration", "other", Inputs(t, channels, 1.0 / rate, numbers(mounts, len(t))))


_SHAKER_MOUNTS: tuple[Mount, ...] = (
    (I_AXIS, I_AXIS),
    (I_AXIS, minus(I_AXIS)),
    (I_AXIS, J_AXIS),
    (J_AXIS, K_AXIS),
    (K_AXIS, J_AXIS),
    ((1.0, 1.0, 0.0), K_AXIS),
    ((1.0, 0.0, 1.0), J_AXIS),
    ((0.0, 1.0, 1.0), I_AXIS),
)


def _tones(number: int, dwell: float, rate: float, band: tuple[float, float]) -> FloatArray:
    """Signals (number, samples) of unit rms within a band, zero on average."""
    n, (low, high) = len(samples(dwell, rate)), band
    first, last = math.ceil(low * n / rate), math.floor(high * n / rate) if high < math.inf else n
    if not (0 < first <= last and SAMPLING * high <= rate):
        raise InputError(
            f"vibration from {low} to {high} Hz in dwells of {dwell} s at {rate} samples a second: expected a"
            f" band above 0 Hz that holds a multiple of 1 / dwell, and {SAMPLING} samples a period or more"
        )
    tone = np.arange(first, last + 1, dtype=float)
    # fifth powers modulo a prime are spread like random numbers, and every dwell has its own
    root = (tone + last * np.arange(number)[:, None]) % _PRIME
    square = root * root % _PRIME
    turns = square * square % _PRIME * root % _PRIME / _PRIME
    spectrum = np.zeros((number, n // 2 + 1), dtype=complex)
    spectrum[:, first : last + 1] = n / math.sqrt(2.0 * len(tone)) * np.exp(2j * math.pi * turns)
    return np.fft.irfft(spectrum, n, axis=1)


_PRIME = 2.0**26 - 5.0
"""Products of whole numbers below it are exact in double precision."""
