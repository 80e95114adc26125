"""What an error of a sensor's output does to attitude, velocity and position.

One horizontal channel of an inertial navigator, heading known, driven by the output error of one component:
the accelerometer along the channel, or the level gyroscope across it::

    dphi/dt = e_g - dv / R        tilt: attitude error about the gyroscope's axis, rad
    dv/dt   = e_a + f(t) dphi     velocity error, m/s
    dx/dt   = dv                  position error, m

f is the load: the specific force that a small turn about the gyroscope's axis moves into the channel, which
is the part of it that lies across that axis, ``|e_i x f|``. Straight and level it is g. A channel of an
accelerometer is taken as level, with g.

All is linear in the error, and so in every coefficient: ``p(T) = J(T) theta``, one integration of the
columns. Over times that are short beside the Schuler period of 84.4 min it is double integration of an
accelerometer's error (b t^2/2) and triple integration of f times a gyroscope's (g e t^3/6). Without the term
dv/R it stays that: the navigator of a vehicle that flies free, to which no local level belongs. Coupling by
heading, the vertical channel and position-dependent gravity are not in it.

Inputs hold from one row to the next, the load as well as the error. While f holds, all follows from Stumpff's
functions ``c_k(z) = 1/k! - z/(k+2)! + z^2/(k+4)! - ...`` of ``z = f t^2/R`` (0 without dv/R; negative where f
is): ``c0 = cos sqrt(z)``, ``c1 = sin sqrt(z)/sqrt(z)``, and so on.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.errors import InputError, StudyError
from imubayes.rig.gravity import SEMI_MAJOR_AXIS
from imubayes.rig.inputs import Inputs
from imubayes.sensors.noise import FLOOR, Noise, flicker
from imubayes.sensors.terms import Kind
from imubayes.units import STANDARD_GRAVITY

Quantity = Literal["output", "attitude", "velocity", "position"]

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

SERIES = 9
"""Terms of a series in z, up to z = 1: the next one is below 1e-19."""

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


def constant_response(
    kind: Kind, time: FloatArray, *, schuler: bool = True, load: FloatArray | float = STANDARD_GRAVITY
) -> FloatArray:
    """Response to a unit error that stays constant under a load that does, from rest.

    Parameters
    ----------
    kind : of the component.
    time : (...) s since the error began; before it the response is zero.
    schuler : whether the navigator keeps a local level.
    load : force that a tilt turns into the channel, m/s^2, of the shape of `time` or a number.

    Returns
    -------
    (3, ...) attitude, velocity and position, per m/s^2 or rad/s of error.

    Examples
    --------
    >>> constant_response("accelerometer", np.array([10.0]), schuler=False)[:, 0].tolist()
    [0.0, 10.0, 50.0]
    """
    t, back = np.maximum(time, 0.0), _feedback(schuler)
    _, c1, c2, c3 = _stumpff(back * load * t**2)
    if kind == "accelerometer":
        return np.array((0.0 - back * t**2 * c2, t * c1, t**2 * c2))
    return np.array((t * c1, load * t**2 * c2, load * t**3 * c3))


def transition(
    time: FloatArray | float, *, schuler: bool = True, load: FloatArray | float = STANDARD_GRAVITY
) -> FloatArray:
    """Matrices (..., 3, 3) that carry attitude, velocity and position errors on by `time`, with no new error.

    Examples
    --------
    >>> transition(2.0, schuler=False).round(4).tolist()
    [[1.0, 0.0, 0.0], [19.6133, 1.0, 0.0], [19.6133, 2.0, 1.0]]
    """
    t, back = np.asarray(time), _feedback(schuler)
    c0, c1, c2, _ = _stumpff(back * load * t**2)
    out = np.zeros((*c0.shape, 3, 3))
    out[..., 0, 0], out[..., 0, 1] = c0, 0.0 - back * t * c1
    out[..., 1, 0], out[..., 1, 1] = load * t * c1, c0
    out[..., 2, 0], out[..., 2, 1], out[..., 2, 2] = load * t**2 * c2, t * c1, 1.0
    return out


def _feedback(schuler: bool) -> float:
    """Tilt rate by velocity, 1/m."""
    return 1.0 / SEMI_MAJOR_AXIS if schuler else 0.0


def _stumpff(z: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """c0, c1, c2 and c3, (...) each; by their series where the closed forms would cancel."""
    near = np.abs(z) < 1.0
    little, root = np.where(near, z, 0.0), np.sqrt(np.where(near, 1.0, z).astype(np.complex128))
    c2, c3 = np.ones_like(little), np.ones_like(little)
    for k in range(SERIES, 0, -1):
        c2 = 1.0 - little * c2 / ((2 * k + 1) * (2 * k + 2))
        c3 = 1.0 - little * c3 / ((2 * k + 2) * (2 * k + 3))
    sine, half = np.sin(root) / root, np.sin(0.5 * root) / (0.5 * root)
    c2 = np.where(near, c2 / 2.0, np.real(0.5 * half**2))
    c3 = np.where(near, c3 / 6.0, np.real((1.0 - sine) / root**2))
    c0 = np.where(near, 1.0 - z * c2, np.real(np.cos(root)))
    return c0, np.where(near, 1.0 - z * c3, np.real(sine)), c2, c3


@dataclass(frozen=True, slots=True, eq=False)
class Propagation:
    """How errors pass through a record, row by row.

    Attributes
    ----------
    kind : of the component.
    schuler : whether the navigator keeps a local level.
    edges : (n + 1,) starts of the rows, s since the first, and the end of the last.
    load : (n,) force that a tilt turns into the channel, m/s^2.
    moved : (n + 1, 3, 3) transitions from the start to each edge.
    driven : (3, n) errors at the start that are, at the end of each row, what a unit error in it leaves.
    """

    kind: Kind
    schuler: bool
    edges: FloatArray
    load: FloatArray
    moved: FloatArray
    driven: FloatArray

    @property
    def length(self) -> float:
        """Length of the record, s."""
        return float(self.edges[-1])

    def until(self, time: float) -> tuple[FloatArray, FloatArray]:
        """Transition (3, 3) from the start to a time, and weights (3, n) of the errors in the rows."""
        row = min(int(np.searchsorted(self.edges, time, "right")), len(self.load)) - 1
        rest, load = np.array(time - self.edges[row]), float(self.load[row])
        carry = transition(rest, schuler=self.schuler, load=load) @ self.moved[row]
        weights = np.zeros_like(self.driven)
        weights[:, :row] = carry @ self.driven[:, :row]
        weights[:, row] = constant_response(self.kind, rest, schuler=self.schuler, load=load)
        return carry, weights


def propagation(
    kind: Kind, inputs: Inputs, *, schuler: bool = True, load: FloatArray | float = STANDARD_GRAVITY
) -> Propagation:
    """Work out how errors pass through a record.

    Parameters
    ----------
    kind : of the component.
    inputs : (n,) rows of the record; each holds until the next, the last for the sampling interval.
    schuler : whether the navigator keeps a local level.
    load : force that a tilt turns into the channel, m/s^2: (n,), or a number that holds throughout.

    Examples
    --------
    >>> boost = propagation("gyroscope", Inputs(np.arange(60.0), {}, 1.0), schuler=False, load=98.1)
    >>> carry, weights = boost.until(10.0)
    >>> float(weights[1].sum().round(9))
    4905.0
    """
    start = inputs.t - inputs.t[0]
    edges = np.append(start, start[-1] + inputs.interval)
    steps, course = np.diff(edges), np.broadcast_to(load, start.shape)
    if np.ndim(load):
        moved = _running(transition(steps, schuler=schuler, load=course))
    else:
        moved = transition(edges, schuler=schuler, load=load)
    done = constant_response(kind, steps, schuler=schuler, load=course)
    return Propagation(kind, schuler, edges, course, moved, _undone(moved[1:], done))


def _running(steps: FloatArray) -> FloatArray:
    """Products (n + 1, 3, 3) of the first 0, 1, ..., n of n matrices, the later ones on the left.

    Spans are doubled, so that rounding grows with the logarithm of n.
    """
    out, span = np.concatenate((np.eye(3)[None], steps)), 1
    while span < len(out):
        out[span:] = out[span:] @ out[:-span]
        span *= 2
    return out


def _undone(moved: FloatArray, errors: FloatArray) -> FloatArray:
    """Errors (3, n) taken back through transitions (n, 3, 3), of which the determinant is 1."""
    attitude = moved[:, 1, 1] * errors[0] - moved[:, 0, 1] * errors[1]
    velocity = moved[:, 0, 0] * errors[1] - moved[:, 1, 0] * errors[0]
    return np.array((attitude, velocity, errors[2] - moved[:, 2, 0] * attitude - moved[:, 2, 1] * velocity))


def functionals(propagated: Propagation, X: FloatArray, times: Sequence[float]) -> FloatArray:
    """Attitude, velocity and position errors per unit of each coefficient, at given times.

    Parameters
    ----------
    propagated : of the record that the columns belong to; times beyond the record repeat it.
    X : (n, p) columns, SI.
    times : m times, s since the start.

    Returns
    -------
    (m, 3, p).

    Raises
    ------
    InputError : if the record would be repeated more than 10,000 times.

    Examples
    --------
    >>> minute = propagation("accelerometer", Inputs(np.arange(60.0), {}, 1.0), schuler=False)
    >>> functionals(minute, np.ones((60, 1)), [60.0, 120.0])[:, 2, 0].tolist()
    [1800.0, 7200.0]
    """
    once = propagated.until(propagated.length)[1] @ X
    return _at_times(propagated, lambda _: X, lambda _: once, times)


def running_functionals(
    propagated: Propagation, columns: Callable[[int], FloatArray], times: Sequence[float]
) -> FloatArray:
    """Errors as `functionals` gives them, of columns that differ from one repetition of a record to the next.

    Parameters
    ----------
    propagated : of the record.
    columns : (n, p) columns in repetition 0, 1, ... of the record.
    times : m times, s since the start.
    """
    weights = propagated.until(propagated.length)[1]
    return _at_times(propagated, columns, lambda record: weights @ columns(record), times)


def _at_times(
    propagated: Propagation,
    columns: Callable[[int], FloatArray],
    once: Callable[[int], FloatArray],
    times: Sequence[float],
) -> FloatArray:
    """Errors (m, 3, p), given the columns of each record and what each leaves at its end, from rest."""
    carry, length = propagated.until(propagated.length)[0], propagated.length
    whole = [int(time / length * (1.0 + ROUNDED)) for time in times]
    most = max(whole, default=0)
    if most > MOST_RECORDS:
        raise InputError(
            f"a mission of {max(times):.4g} s repeats its record of {length:.4g} s {most:,} times:"
            f" expected {MOST_RECORDS:,} at most; give a longer log, or a shorter duration"
        )
    carried = [np.zeros((3, columns(0).shape[1]))]
    for record in range(most):
        carried.append(carry @ carried[-1] + once(record))
    out = [carried[records] for records in whole]
    for row, (time, records) in enumerate(zip(times, whole, strict=True)):
        rest = time - records * length
        if rest > 0.0:
            on, weights = propagated.until(rest)
            out[row] = on @ carried[records] + weights @ columns(records)
    return np.array(out)


def noise_growth(
    kind: Kind,
    noise: Noise,
    quantity: Quantity,
    time: float,
    *,
    schuler: bool = True,
    load: FloatArray | float = STANDARD_GRAVITY,
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
    load : force that a tilt turns into the channel, m/s^2: a number, or its means (2000,)
        over as many parts of the mission (`scene_effects.cell_loads`).

    Examples
    --------
    >>> sd = noise_growth("accelerometer", Noise(1e-3, 0.0, 0.0), "velocity", 100.0, schuler=False)
    >>> round(sd[0], 6)
    0.01
    """
    if quantity == "output":
        return noise.N / math.sqrt(OUTPUT_TIME), FLOOR * noise.B, noise.K * math.sqrt(0.5 * time)
    step = time / CELLS
    cells = Inputs(step * np.arange(CELLS, dtype=np.float64), {}, step)
    propagated = propagation(kind, cells, schuler=schuler, load=load)
    weights = propagated.until(propagated.length)[1][STATES.index(quantity)]
    # response to a unit error that begins with a cell and goes on: the sum of the later cells
    answer = np.append(0.0, np.cumsum(weights[::-1]))
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
