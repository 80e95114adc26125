"""Temperature of a run: a chamber's soaks and ramps, and the rate of a temperature that was recorded."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.errors import InputError
from imubayes.rig.inputs import Inputs
from imubayes.rig.plans import CUBE, Plan, Sampling, channels_of, unit
from imubayes.rig.rotations import TABLE_MOUNTS
from imubayes.units import STANDARD_GRAVITY, Count, Kelvin, Key, Pause, Quantity, Rate, Seconds

Ramp = Annotated[float, Quantity("K/s", positive=True)]

POSITIONS = unit(np.array([up for _, up in TABLE_MOUNTS]))
"""Vertical in case axes of each position: both ways along i, j and k, then halfway between two of them."""

BINS = 2000
"""Averages that a recorded temperature is taken to at most before its rate is looked for."""

RATE_NOISE = 0.05
"""Noise of a derived rate over its own rms at which the window is long enough: it shortens a coefficient by
the square of this, 0.25 %; a longer window would round off the corners of a ramp by more."""

LONGEST = 0.1
"""Share of a record that the window may take at most: slower than this nothing would be left of a ramp."""

STEP_NOISE = 0.3
"""Rms error of a slope over (step of a quantised temperature / window), where the steps are not blurred."""

ENOUGH = 5
"""Averages in a window, at least: two more than a parabola has coefficients."""


def thermal(
    temperatures: Annotated[
        Sequence[Kelvin],
        Key(
            "of the soaks, in order; up and down again shows hysteresis",
            ["-20 degC", "60 degC", "-20 degC"],
        ),
    ],
    *,
    positions: Annotated[Count, Key(CUBE, 2)] = 6,
    dwell: Annotated[Seconds, Key("time in each position", "30 s")] = 60.0,
    soak: Annotated[Pause, Key("time at a temperature before the positions", "1 h")] = 1800.0,
    ramp: Annotated[Ramp, Key("size of the rate between soaks", "3 degC/min")] = 1.0 / 60.0,
    rate: Sampling = 1.0,
    turning: Annotated[
        Rate,
        Key("rate about the vertical in each position, which a gyroscope's `b1*T` needs", "60 deg/s"),
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
    _check(levels, positions, (dwell, ramp, rate))
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


def temperature_rate(t: FloatArray, T: FloatArray) -> FloatArray:
    """Rate (n,) in K/s of a recorded temperature.

    A parabola is fitted by least squares to a window about each instant, and its slope there is the rate.
    Noise of a regressor shortens its coefficient and passes what is lost to others (errors in variables), so
    the window is no matter of taste: it is the shortest at which the rate's own noise is below a twentieth of
    its rms, which costs a coefficient a quarter of a percent. The noise is that of neighbouring averages, and
    of the steps of a temperature that was quantised. Where even a tenth of the record is too short for that,
    the temperature did not change by anything that the thermometer tells.

    Parameters
    ----------
    t : (n,) s, increasing.
    T : (n,) K.

    Examples
    --------
    >>> t = np.arange(3600.0)
    >>> quantised = np.round((280.0 + t / 60.0) / 0.25) * 0.25
    >>> bool(np.std(temperature_rate(t, quantised) * 60.0) < 0.05)
    True
    """
    if len(t) < ENOUGH:
        return np.gradient(T, t) if len(t) > 1 else np.zeros(len(t))
    centres, means = _averaged(t, T)
    if len(centres) < ENOUGH:
        return np.full(len(t), np.polyfit(t - t.mean(), T, 1)[0])
    off = means[1:-1] - 0.5 * (means[:-2] + means[2:])
    # an average's distance to the straight line between its neighbours
    white, step = float(np.median(np.abs(off))) / (0.6745 * math.sqrt(1.5)), _step(T)
    found = np.zeros(len(centres))
    # windows to try, s: from one that holds enough averages to the longest
    span = float(centres[-1] - centres[0])
    shortest = ENOUGH * float(np.median(np.diff(centres)))
    longest = max(LONGEST * span, shortest)
    for window in np.geomspace(shortest, longest, max(2, math.ceil(4.0 * math.log2(longest / shortest)) + 1)):
        found = _slopes(centres, means, window)
        inside = max(window / (centres[-1] - centres[0]) * len(centres), 1.0)
        noise = math.hypot(white * math.sqrt(12.0 / inside), STEP_NOISE * step) / window
        if noise <= RATE_NOISE * math.sqrt(float(found @ found) / len(found)):
            break
    return np.interp(t, centres, found)


def _check(levels: FloatArray, positions: int, times: tuple[float, float, float]) -> None:
    if len(levels) == 0 or not (np.isfinite(levels) & (levels > 0.0)).all():
        raise InputError(f"thermal run at {levels.tolist()} K: expected one temperature above 0 K or more")
    if not 1 <= positions <= len(POSITIONS):
        raise InputError(f"thermal run in {positions} positions: expected 1 to {len(POSITIONS)}")
    if not all(0.0 < value < math.inf for value in times):
        raise InputError(f"thermal run with dwell, ramp and rate {times}: expected more than zero of each")


def _averaged(t: FloatArray, T: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean time and temperature over at most so many equal times."""
    if len(t) <= BINS:
        return t - t[0], T
    bins = np.minimum(((t - t[0]) / (t[-1] - t[0]) * BINS).astype(np.int64), BINS - 1)
    counts = np.bincount(bins, minlength=BINS)
    there = counts > 0
    means = [np.bincount(bins, values, BINS)[there] / counts[there] for values in (t - t[0], T - T[0])]
    return means[0], means[1] + T[0]


def _step(T: FloatArray) -> float:
    """Step of a quantised temperature: the smallest difference, where most neighbours share their value."""
    values = np.unique(T)
    if len(values) < 2 or len(values) > len(T) // 2:
        return 0.0
    return float(np.median(np.diff(values)))


def _slopes(t: FloatArray, T: FloatArray, window: float) -> FloatArray:
    """Slope at each instant of the parabola through the window about it."""
    # at the ends the window stays inside; beside gaps it reaches farther to one side
    middle = np.clip(t, t[0] + 0.5 * window, t[-1] - 0.5 * window)
    first = np.searchsorted(t, middle - 0.5 * window * (1.0 + 1e-12))
    last = np.searchsorted(t, middle + 0.5 * window * (1.0 + 1e-12), side="right")
    first = np.clip(np.minimum(first, last - ENOUGH), 0, len(t) - ENOUGH)
    last = np.maximum(last, first + ENOUGH)
    rates = np.empty(len(t))
    for k, (a, b) in enumerate(zip(first.tolist(), last.tolist(), strict=True)):
        x = (t[a:b] - t[k]) / window
        basis = np.column_stack((np.ones(b - a), x, x * x))
        rates[k] = np.linalg.lstsq(basis, T[a:b] - T[k], rcond=None)[0][1] / window
    return rates
