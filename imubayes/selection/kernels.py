"""What an error of a sensor's output does to attitude, velocity and position.

One horizontal channel of an inertial navigator, straight and level, heading known, driven by the output
error of one component: the accelerometer along the channel, or the level gyroscope across it::

    dphi/dt = e_g - dv / R        tilt: attitude error about the level axis, rad
    dv/dt   = e_a + g dphi        velocity error, m/s
    dx/dt   = dv                  position error, m

It is linear in the error, and so in every coefficient: ``p(T) = J(T) theta``, one integration of the columns.
Over times that are short beside the Schuler period of 84.4 min it is double integration of an accelerometer's
error (b t^2/2) and triple integration of g times a gyroscope's (g e t^3/6). Without the term dv/R it stays
that: the navigator of a vehicle that flies free, to which no local level belongs. Coupling by heading, the
vertical channel and position-dependent gravity are not in it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from imubayes.errors import InputError, StudyError
from imubayes.rig.gravity import SEMI_MAJOR_AXIS
from imubayes.rig.inputs import Inputs
from imubayes.sensors.noise import Noise, flicker
from imubayes.sensors.terms import Kind
from imubayes.units import STANDARD_GRAVITY

FloatArray = NDArray[np.float64]
Quantity = Literal["output", "attitude", "velocity", "position"]

SCHULER = math.sqrt(STANDARD_GRAVITY / SEMI_MAJOR_AXIS)
"""rad/s; pulsation of a pendulum as long as the Earth's radius: a period of 84.4 min."""

STATES = ("attitude", "velocity", "position")

BUDGET_UNITS: dict[Quantity, str] = {"attitude": "rad", "velocity": "m/s", "position": "m"}
"""SI unit of each budget; of the output's, m/s^2 or rad/s, the sensor's kind decides."""

OUTPUT_TIME = 1.0
"""s; averaging time at which noise is set beside an error of the output."""

ROUNDED = 1e-12
"""Share of a record that may be missing by rounding where a time is a whole number of records."""

RATIO, SPANS = 4.0, 10.0
"""Ratio of time constants of a bias instability, and the longest one over the mission: as simulated."""

CELLS = 2_000
"""Steps in which the integrals over noise take a mission."""


MOST_RECORDS = 10_000
"""Times that a record may be repeated to fill a mission."""


@dataclass(frozen=True, slots=True)
class Budget:
    """What an error may come to.

    Attributes
    ----------
    quantity : output (rms over the scene), attitude, velocity or position (largest over the mission).
    limit : SI.
    schuler : whether the navigator keeps a local level; not in free flight.
    """

    quantity: Quantity
    limit: float
    schuler: bool = True

    def __post_init__(self) -> None:
        if self.quantity not in get_args(Quantity):
            raise StudyError(
                f"a budget on '{self.quantity}' is not known: expected {', '.join(get_args(Quantity))}"
            )
        if not (math.isfinite(self.limit) and self.limit > 0.0):
            raise StudyError(f"a budget of {self.limit:g} leaves nothing out: expected a positive limit")


def constant_response(kind: Kind, time: FloatArray, *, schuler: bool = True) -> FloatArray:
    """Response to a unit error that stays constant, from rest.

    Parameters
    ----------
    kind : of the component.
    time : (...) s since the error began; before it the response is zero.
    schuler : whether the navigator keeps a local level.

    Returns
    -------
    (3, ...) attitude, velocity and position, per m/s^2 or rad/s of error.

    Examples
    --------
    >>> constant_response("accelerometer", np.array([10.0]), schuler=False)[:, 0].tolist()
    [0.0, 10.0, 50.0]
    """
    t = np.maximum(time, 0.0)
    g = STANDARD_GRAVITY
    if not schuler:
        attitude, velocity = np.zeros_like(t), t
        chain = (attitude, velocity, 0.5 * t**2)
        return np.array(chain if kind == "accelerometer" else (t, 0.5 * g * t**2, g * t**3 / 6.0))
    sine, turned = np.sin(SCHULER * t) / SCHULER, 2.0 * np.sin(0.5 * SCHULER * t) ** 2 / SCHULER**2
    if kind == "accelerometer":
        return np.array((-turned * SCHULER**2 / g, sine, turned))
    return np.array((sine, g * turned, SEMI_MAJOR_AXIS * _lag(t)))


def _lag(t: FloatArray) -> FloatArray:
    """``t - sin(w t)/w``, by its series where the difference would cancel."""
    x = SCHULER * t
    series = t * x**2 / 6.0 * (1.0 - x**2 / 20.0 * (1.0 - x**2 / 42.0 * (1.0 - x**2 / 72.0)))
    return np.where(x < 0.1, series, t - np.sin(x) / SCHULER)


def transition(time: float, *, schuler: bool = True) -> FloatArray:
    """Matrix (3, 3) that carries attitude, velocity and position errors on by `time`, with no new error.

    Examples
    --------
    >>> transition(2.0, schuler=False).round(4).tolist()
    [[1.0, 0.0, 0.0], [19.6133, 1.0, 0.0], [19.6133, 2.0, 1.0]]
    """
    g = STANDARD_GRAVITY
    if not schuler:
        return np.array([[1.0, 0.0, 0.0], [g * time, 1.0, 0.0], [0.5 * g * time**2, time, 1.0]])
    c, s = math.cos(SCHULER * time), math.sin(SCHULER * time)
    rise = 2.0 * math.sin(0.5 * SCHULER * time) ** 2 * SEMI_MAJOR_AXIS
    return np.array([[c, -s * SCHULER / g, 0.0], [g * s / SCHULER, c, 0.0], [rise, s / SCHULER, 1.0]])


def functionals(
    kind: Kind, X: FloatArray, inputs: Inputs, times: Sequence[float], *, schuler: bool = True
) -> FloatArray:
    """Attitude, velocity and position errors per unit of each coefficient, at given times.

    Each row holds until the next; the last for the sampling interval. Times beyond the record repeat it.

    Parameters
    ----------
    kind : of the component.
    X : (n, p) columns, SI.
    inputs : the record that they belong to.
    times : m times, s since the start.
    schuler : whether the navigator keeps a local level.

    Returns
    -------
    (m, 3, p).

    Raises
    ------
    InputError : if the record would be repeated more than 10,000 times.

    Examples
    --------
    >>> minute = Inputs(np.arange(60.0), {}, 1.0)
    >>> J = functionals("accelerometer", np.ones((60, 1)), minute, [60.0, 120.0], schuler=False)
    >>> J[:, 2, 0].tolist()
    [1800.0, 7200.0]
    """
    start = inputs.t - inputs.t[0]
    edges = np.append(start, start[-1] + inputs.interval)
    length = float(edges[-1])
    whole = [int(time / length * (1.0 + ROUNDED)) for time in times]
    once = _within(kind, X, edges, length, schuler)
    if max(whole, default=0) > MOST_RECORDS:
        raise InputError(
            f"a mission of {max(times):.4g} s repeats its record of {length:.4g} s {max(whole):,} times:"
            f" expected {MOST_RECORDS:,} at most; give a longer log, or a shorter duration"
        )
    carried = _repeated(once, transition(length, schuler=schuler), max(whole, default=0))
    out = np.empty((len(times), 3, X.shape[1]))
    for row, (time, records) in enumerate(zip(times, whole, strict=True)):
        rest = max(time - records * length, 0.0)
        out[row] = transition(rest, schuler=schuler) @ carried[records]
        if rest > 0.0:
            out[row] += _within(kind, X, edges, rest, schuler)
    return out


def _within(kind: Kind, X: FloatArray, edges: FloatArray, time: float, schuler: bool) -> FloatArray:
    """Errors (3, p) at a time within the record, from rest at its start."""
    answer = constant_response(kind, time - edges, schuler=schuler)
    return (answer[:, :-1] - answer[:, 1:]) @ X


def _repeated(once: FloatArray, carry: FloatArray, most: int) -> list[FloatArray]:
    """Errors after 0, 1, ... records."""
    states = [np.zeros_like(once)]
    for _ in range(most):
        states.append(carry @ states[-1] + once)
    return states


def noise_growth(
    kind: Kind, noise: Noise, quantity: Quantity, time: float, *, schuler: bool = True
) -> tuple[float, float, float]:
    """Standard deviation that white noise, bias instability and random walk bring about, SI.

    Short of the Schuler period these are N sqrt(t) in velocity and N t^1.5/sqrt(3) in position for an
    accelerometer, g N t^2.5/sqrt(20) in position for a gyroscope, K t^2.5/sqrt(20) and g K t^3.5/sqrt(252)
    for the random walks. Of the output it is what an average over a second holds: N, 0.664 B, and the rms of
    the random walk over the mission.

    Parameters
    ----------
    kind : of the component.
    noise : its N, B, K.
    quantity : that is budgeted.
    time : s, end of the mission.
    schuler : whether the navigator keeps a local level.

    Examples
    --------
    >>> sd = noise_growth("accelerometer", Noise(1e-3, 0.0, 0.0), "velocity", 100.0, schuler=False)
    >>> round(sd[0], 6)
    0.01
    """
    if quantity == "output":
        floor = math.sqrt(2.0 * math.log(2.0) / math.pi)
        return noise.N / math.sqrt(OUTPUT_TIME), floor * noise.B, noise.K * math.sqrt(0.5 * time)
    step = time / CELLS
    edges = time - step * np.arange(CELLS + 1, dtype=np.float64)
    state = STATES.index(quantity)
    answer = constant_response(kind, edges, schuler=schuler)[state]
    weights = answer[:-1] - answer[1:]
    return (
        noise.N * math.sqrt(float(np.sum(weights**2)) / step),
        _flicker_growth(noise.B, weights, step, time),
        noise.K * math.sqrt(_integral(answer**2, step)),
    )


def _integral(values: FloatArray, step: float) -> float:
    return float(step * (np.sum(values) - 0.5 * (values[0] + values[-1])))


def _flicker_growth(B: float, weights: FloatArray, step: float, time: float) -> float:
    """Sd of the weighted sum of the stationary first-order processes of a bias instability."""
    from scipy.signal import lfilter

    if B == 0.0:
        return 0.0
    total = 0.0
    longest = SPANS * time / RATIO
    for variance, tau in zip(*flicker(B, RATIO * step, longest, RATIO), strict=True):
        a = math.exp(-step / tau)
        past = np.asarray(lfilter([0.0, a], [1.0, -a], weights))
        total += variance * float(weights @ (weights + 2.0 * past))
    return math.sqrt(total)


def budget_unit(kind: Kind, quantity: Quantity) -> str:
    """SI unit of a budget.

    Examples
    --------
    >>> budget_unit("gyroscope", "output"), budget_unit("gyroscope", "position")
    ('rad/s', 'm')
    """
    return BUDGET_UNITS.get(quantity, "m/s^2" if kind == "accelerometer" else "rad/s")
