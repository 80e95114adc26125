"""What an error of a body-fixed sensor does to attitude, velocity and position, while the vehicle turns.

A sensor's output error u is fixed in the body, along the case axis e that the sensor lies along. The
navigator's errors are those of strapdown integration, in a level frame n with its axes north, west and up,
which does not turn with the vehicle; C takes the body's axes to n, and f = C f_body::

    dpsi/dt = -W x psi + C e u                          of a gyroscope
    dv/dt   = psi x f - (g/R) r_h - 2 W x v + C e u     of an accelerometer
    dr/dt   = v

psi turns the true body axes into those that the navigator computes; r_h is the horizontal part of r. Where
the navigator keeps a local level, n turns with the Earth at W, gravity points down at the computed position
(which feeds r back: the Schuler period of 84.4 min), and height is aided, so that v and r stay horizontal.
The attitude error is that against the local level at the computed position, ``psi - up x r / R``. In free
flight n is inertial: no W, no feedback, and all three axes count.

All is linear in the error, and so in every coefficient. Between two rows the errors and f are taken as linear
in time. Position-dependent Earth rate and the vertical channel are not in it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.errors import InputError, StudyError
from imubayes.inference.strapdown import cross_matrix
from imubayes.rig.motion import vectors
from imubayes.rig.plans import EARTH_RATE, SEMI_MAJOR_AXIS
from imubayes.scenes.record import Scene
from imubayes.sensors.noise import FLOOR, flicker
from imubayes.sensors.terms import Kind
from imubayes.units import STANDARD_GRAVITY

Quantity = Literal["output", "attitude", "velocity", "position"]

STATES = ("attitude", "velocity", "position")

BUDGET_UNITS: dict[Quantity, str] = {"attitude": "rad", "velocity": "m/s", "position": "m"}
"""SI unit of each budget; of the output's, m/s^2 or rad/s, the sensor's kind decides."""

OUTPUT_TIME = 1.0
"""s; averaging time at which noise is set beside an error of the output."""

LATITUDE = math.pi / 4.0
"""rad; where a navigator that keeps a local level starts: the Earth's rate turns the level frame there."""

RATIO, SPANS = 4.0, 10.0
"""Ratio of time constants of a bias instability, and the longest one over the mission: as simulated."""

CELLS = 2_000
"""Parts of a mission, about, in which a bias instability and a random walk are followed."""

COARSE = 40.0
"""s; longest step of the integration: a twentieth of a radian of Schuler's oscillation."""

ROUNDED = 1e-12
"""Share of a record that may be missing by rounding where a time is a whole number of records."""

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


@dataclass(frozen=True, slots=True, eq=False)
class Propagation:
    """How the errors of one component pass through a record that a mission repeats.

    Attributes
    ----------
    kind : of the component.
    schuler : whether the navigator keeps a local level.
    t : (n + 1,) times of the rows, s since the first, and the end of the last.
    along : (n + 1, 3) the component's axis in the level frame.
    force : (n + 1, 3) specific force in the level frame, m/s^2.
    """

    kind: Kind
    schuler: bool
    t: FloatArray
    along: FloatArray
    force: FloatArray

    def row_at(self, time: float) -> int:
        """Row nearest to a time of the record, s."""
        after = min(int(np.searchsorted(self.t, time)), len(self.t) - 1)
        return after - int(after > 0 and time - self.t[after - 1] < self.t[after] - time)

    def driven(self, X: FloatArray, at: Sequence[int]) -> FloatArray:
        """Errors that columns leave at given rows, from rest.

        Parameters
        ----------
        X : (n, p) columns of the output's error; the last row holds to its end.
        at : k rows in increasing order, up to n.

        Returns
        -------
        (k, 9, p): psi, v and r along the axes of the level frame.
        """
        from imubayes.scenes.integration import forward

        X = np.asfortranarray(X)
        return forward(*self._equations(), X, np.zeros((9, X.shape[1])), np.array(at, dtype=np.int64))

    def moved(self, at: Sequence[int]) -> FloatArray:
        """Transitions (k, 9, 9) from the start to given rows, in increasing order."""
        from imubayes.scenes.integration import forward

        return forward(
            *self._equations(), np.zeros((1, 9), order="F"), np.eye(9), np.array(at, dtype=np.int64)
        )

    def weights(self, end: int) -> tuple[FloatArray, FloatArray]:
        """Errors (9, end) at row `end` by unit errors of the rows before, and the transition (9, 9) to it."""
        from imubayes.scenes.integration import backward

        return backward(*self._equations(), end)

    def read(self, quantity: Quantity) -> FloatArray:
        """Rows (d, 9) that read a quantity off psi, v and r: its two or three components."""
        if quantity == "attitude":
            return np.hstack((np.eye(3), np.zeros((3, 3)), _UP_CROSS / -SEMI_MAJOR_AXIS * self.schuler))
        first = 3 * STATES.index(quantity)
        return np.eye(9)[first : first + (2 if self.schuler else 3)]

    def _equations(self) -> tuple[FloatArray, FloatArray, FloatArray, bool, FloatArray, float]:
        earth = EARTH_RATE * np.array([math.cos(LATITUDE), 0.0, math.sin(LATITUDE)]) * self.schuler
        back = STANDARD_GRAVITY / SEMI_MAJOR_AXIS * self.schuler
        return self.t, self.along, self.force, self.kind == "gyroscope", earth, back


_UP_CROSS = cross_matrix(np.array([0.0, 0.0, 1.0]))
"""``_UP_CROSS @ r = up x r``."""


def propagation(kind: Kind, scene: Scene, axis: str, *, schuler: bool = True) -> Propagation:
    """Lay out how errors of a component pass through a scene's record.

    Parameters
    ----------
    kind : of the component.
    scene : with its attitude. Where nothing says what force acts, it is 1 g upwards.
    axis : case axis that the component lies along.
    schuler : whether the navigator keeps a local level.

    Raises
    ------
    InputError : if rows are over 40 s apart, or the mission ends before the second of them.

    Examples
    --------
    >>> from imubayes.scenes.record import recorded
    >>> minute = recorded("level", np.arange(60.0), np.tile([0.0, 0.0, 10.0], (60, 1)), np.zeros((60, 3)))
    >>> level = propagation("gyroscope", minute, "y", schuler=False)
    >>> level.driven(np.ones((60, 1)), [60])[0, 6, 0].round(6).item()  # 10 t^3/6
    360000.0
    """
    motion = scene.mean_motion
    t = motion.t - motion.t[0]
    t = np.append(t, t[-1] + motion.interval)
    if (longest := float(np.diff(t).max())) > COARSE:
        raise InputError(
            f"scene '{scene.name}': rows are up to {longest:.3g} s apart: expected {COARSE:g} s at most, so"
            " that errors of attitude, velocity and position can be followed"
        )
    if scene.duration < motion.interval:
        raise InputError(
            f"scene '{scene.name}': a mission of {scene.duration:.3g} s ends within the first row, of"
            f" {motion.interval:.3g} s: expected a longer duration, or a log with finer rows"
        )
    force = vectors(motion.channels, "f", len(motion))
    attitude = np.broadcast_to(np.eye(3), (len(force), 3, 3)) if scene.attitude is None else scene.attitude
    in_level = np.einsum("nij,nj->ni", attitude, force)
    if not any(name.startswith("f_") for name in motion.channels):
        in_level[:, 2] = STANDARD_GRAVITY
    along = attitude[:, :, "xyz".index(axis)]
    held = (np.ascontiguousarray(np.vstack((v, v[-1:]))) for v in (along, in_level))
    return Propagation(kind, schuler, t, *held)


def errors_at(
    passed: Propagation, columns: Callable[[int], FloatArray], times: Sequence[float], *, repeated: bool
) -> FloatArray:
    """Errors per unit of each coefficient at given times of a mission.

    Parameters
    ----------
    passed : of the record; times beyond it repeat it.
    columns : (n, p) columns in repetition 0, 1, ... of the record, SI.
    times : m times, s since the start.
    repeated : whether the columns are those of repetition 0 in all of them.

    Returns
    -------
    (m, 9, p), at the rows nearest to the times.

    Raises
    ------
    InputError : if the record would be repeated more than 10,000 times.
    """
    last, length = len(passed.t) - 1, float(passed.t[-1])
    records = [max(math.ceil(time / length * (1.0 - ROUNDED)) - 1, 0) for time in times]
    rows = [passed.row_at(time - k * length) for time, k in zip(times, records, strict=True)]
    if max(records) > MOST_RECORDS:
        raise InputError(
            f"a mission of {max(times):.4g} s repeats its record of {length:.4g} s {max(records):,} times:"
            f" expected {MOST_RECORDS:,} at most; give a longer log, or a shorter duration"
        )
    wanted = sorted({*rows, last})
    place = [wanted.index(row) for row in rows]
    X = columns(0)
    driven = passed.driven(X, wanted)
    if not max(records):
        return driven[place]
    moved = passed.moved(wanted)
    weights = None if repeated else passed.weights(last)[0]
    carried, out = np.zeros(driven.shape[1:]), np.empty((len(times), *driven.shape[1:]))
    for record in range(max(records) + 1):
        if record and not repeated:
            X = columns(record)
            driven = passed.driven(X, wanted) if record in records else driven
        for k in (k for k, at in enumerate(records) if at == record):
            out[k] = driven[place[k]] + moved[place[k]] @ carried
        left = driven[-1] if weights is None else weights @ X
        carried = left + moved[-1] @ carried
    return out


def noise_growth(passed: Propagation, quantity: Quantity, time: float) -> tuple[float, float, float]:
    """Standard deviation per unit of N, B and K at the end of a mission, SI: of all components together.

    In straight and level flight, short of the Schuler period, these are sqrt(t) in velocity and t^1.5/sqrt(3)
    in position for the white noise of an accelerometer, g t^2.5/sqrt(20) in position for that of a gyroscope,
    t^2.5/sqrt(20) and g t^3.5/sqrt(252) for random walks.

    Parameters
    ----------
    passed : how errors pass through the record that the mission repeats.
    quantity : that is budgeted, not the output.
    time : s, end of the mission.
    """
    length, last = float(passed.t[-1]), len(passed.t) - 1
    whole = int(time / length * (1.0 + ROUNDED))
    rest = passed.row_at(time - whole * length)
    reach, white, told = passed.read(quantity), 0.0, list[tuple[FloatArray, FloatArray]]()
    span = 0.5 * (np.diff(passed.t, prepend=0.0)[:-1] + np.diff(passed.t))  # that a row stands for
    size = max(1, math.ceil((whole * last + rest) / CELLS))
    for end, times in ((rest, 1), (last, whole)):
        if not end * times:
            continue
        weights, moved = passed.weights(end)
        density = (weights / span[:end]) @ weights.T
        starts = np.arange(0, end, size)
        cells = np.add.reduceat(weights, starts, axis=1)
        lasting = np.add.reduceat(np.diff(passed.t)[:end], starts)
        for _ in range(times):
            white += float(np.trace(reach @ density @ reach.T))
            told.append((reach @ cells, lasting))
            reach = reach @ moved
    weights, lasting = (np.concatenate(parts, axis=-1) for parts in zip(*reversed(told), strict=True))
    # response to a unit error that begins with a cell and goes on: the sum of the later cells
    answer = np.append(np.cumsum(weights[:, ::-1], axis=1)[:, ::-1], np.zeros((len(weights), 1)), axis=1)
    square = np.sum(answer**2, axis=0)
    walked = float(np.sum(0.5 * lasting * (square[:-1] + square[1:])))
    return math.sqrt(white), _flicker_growth(weights, time), math.sqrt(walked)


def _flicker_growth(weights: FloatArray, time: float) -> float:
    """Sd of the weighted sum (d,) of the stationary first-order processes of a unit bias instability."""
    from scipy.signal import lfilter

    step, total = time / weights.shape[1], 0.0
    for variance, tau in zip(*flicker(1.0, RATIO * step, SPANS * time / RATIO, RATIO), strict=True):
        a = math.exp(-step / tau)
        past = np.asarray(lfilter([0.0, a], [1.0, -a], weights, axis=1))
        total += variance * float(np.sum(weights * (weights + 2.0 * past)))
    return math.sqrt(total)


def output_noise(time: float) -> tuple[float, float, float]:
    """Standard deviation per unit of N, B and K of an output's average over a second.

    Parameters
    ----------
    time : s, of the mission: for the rms of the random walk.
    """
    return 1.0 / math.sqrt(OUTPUT_TIME), FLOOR, math.sqrt(0.5 * time)


def budget_unit(kind: Kind, quantity: Quantity) -> str:
    """SI unit of a budget.

    Examples
    --------
    >>> budget_unit("gyroscope", "output"), budget_unit("gyroscope", "position")
    ('rad/s', 'm')
    """
    return BUDGET_UNITS.get(quantity, "m/s^2" if kind == "accelerometer" else "rad/s")
