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
from functools import partial
from itertools import accumulate, pairwise
from typing import Literal

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.errors import InputError
from imubayes.rig.motion import cross_matrix
from imubayes.rig.plans import EARTH_RATE, SEMI_MAJOR_AXIS
from imubayes.scenes import Scene
from imubayes.sensors.noise import flicker
from imubayes.sensors.terms import Kind
from imubayes.units import STANDARD_GRAVITY

Quantity = Literal["output", "attitude", "velocity", "position"]

STATES = ("attitude", "velocity", "position")

BUDGET_UNITS: dict[Quantity, str] = {"attitude": "rad", "velocity": "m/s", "position": "m"}
"""SI unit of each budget; of the output's, m/s^2 or rad/s, the sensor's kind decides."""

LATITUDE = math.pi / 4.0
"""rad; where a navigator that keeps a local level starts: the Earth's rate turns the level frame there."""

RATIO, SPANS = 4.0, 10.0
"""Ratio of time constants of a bias instability, and the longest one over the mission: as simulated."""

CELLS = 2_000
"""Parts of a mission, about, in which a bias instability and a random walk are followed."""

BLOCK = 8_192
"""Rows of columns that are made at a time, at least."""

COARSE = 40.0
"""s; longest step of the integration: a twentieth of a radian of Schuler's oscillation."""

TURN = math.radians(45.0)
"""Largest turn from row to row: an error that is fixed in the case is followed to 5 % of what it does."""

ROUNDED = 1e-12
"""Share of a record that may be missing by rounding where a time is a whole number of records."""

MOST_RECORDS = 10_000
"""Times that a record may be repeated to fill a mission."""


@dataclass(frozen=True, slots=True)
class Budget:
    """What an error may come to: `limit`, SI.

    The `quantity` is output (rms over the scene), attitude, velocity or position (largest over the mission).
    `schuler` says whether the navigator keeps a local level; not in free flight.
    """

    quantity: Quantity
    limit: float
    schuler: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class Propagation:
    """How errors of one kind of component pass through a record that a mission repeats.

    Attributes
    ----------
    schuler : whether the navigator keeps a local level.
    t : (n + 1,) times of the rows, s since the first, and the end of the last.
    places : record and nearest row of each time of the mission that is looked at.
    edges : rows between which the record is cut: its first one, those rows, and its end.
    weights : of each part (3, m, 9) errors psi, v and r at its last row by a unit error of the output in each
        of m rows from its first on, along each case axis; the record's own last row holds to its end.
    moved : of each part (9, 9) errors at its last row by those at its first.
    """

    schuler: bool
    t: FloatArray
    places: tuple[tuple[int, int], ...]
    edges: tuple[int, ...]
    weights: tuple[FloatArray, ...]
    moved: tuple[FloatArray, ...]

    def errors(
        self, axis: str, columns: Callable[[int, slice], FloatArray], *, repeated: bool = True
    ) -> FloatArray:
        """Errors (k, 9, p) at the times looked at, from rest: psi, v and r in the level frame.

        `columns` are those (m, p) of the output's error, along a case axis, in repetition 0, 1, ... of the
        record, in m rows of it; where they are `repeated` those of repetition 0 are those of all.
        """
        moved = list(accumulate(self.moved, lambda before, one: one @ before))
        driven, carried, out = list[FloatArray](), np.zeros((9, 1)), list[FloatArray]()
        for record in range(self.places[-1][0] + 1):
            if not (record and repeated):
                driven = self._driven("xyz".index(axis), partial(columns, record))
            parts = [self.edges.index(row, 1) - 1 for k, row in self.places if k == record]
            out += [driven[k] + moved[k] @ carried for k in parts]
            carried = driven[-1] + moved[-1] @ carried
        return np.array(out)

    def _driven(self, axis: int, columns: Callable[[slice], FloatArray]) -> list[FloatArray]:
        """Errors (9, p) at the end of each part of one record, from rest."""
        state, block, X, out = np.zeros((9, 1)), slice(0), np.empty((0, 1)), list[FloatArray]()
        for first, weights, moved in zip(self.edges[:-1], self.weights, self.moved, strict=True):
            stop = first + weights.shape[1]
            if stop > block.stop:
                block = slice(first, max(stop, first + BLOCK))
                X = columns(block)
            part = X[first - block.start : stop - block.start]
            state = moved @ state + weights[axis].T @ part
            out.append(state)
        return out

    def weighted(self, axis: str, end: int) -> tuple[FloatArray, FloatArray]:
        """Errors (9, end) at a part's last row by unit errors of the rows before, and the transition."""
        out, moved = np.zeros((9, end + 1)), np.eye(9)
        for k in reversed(range(self.edges.index(end, 1))):
            first, weights = self.edges[k], self.weights[k]
            out[:, first : first + weights.shape[1]] += moved @ weights["xyz".index(axis)].T
            moved = moved @ self.moved[k]
        out[:, end - 1] += out[:, end]
        return out[:, :end], moved

    def read(self, quantity: Quantity) -> FloatArray:
        """Rows (d, 9) that read a quantity off psi, v and r: its two or three components."""
        if quantity == "attitude":
            return np.hstack((np.eye(3), np.zeros((3, 3)), _UP_CROSS / -SEMI_MAJOR_AXIS * self.schuler))
        first = 3 * STATES.index(quantity)
        return np.eye(9)[first : first + (2 if self.schuler else 3)]


_UP_CROSS = cross_matrix(np.array([0.0, 0.0, 1.0]))
"""``_UP_CROSS @ r = up x r``."""


def propagation(kind: Kind, scene: Scene, times: Sequence[float], *, schuler: bool = True) -> Propagation:
    """Follow back how errors of a component pass through a scene's record, whichever axis it lies along.

    The `times` of the mission at which errors are looked at, s since its start, increase; beyond the record
    they repeat it. Where nothing says what force acts, it is 1 g upwards. `schuler` says whether the
    navigator keeps a local level.

    Raises
    ------
    InputError : if rows are over 40 s or 45 deg apart, the mission ends before the second of them, or the
        record would be repeated more than 10,000 times.

    Examples
    --------
    >>> from imubayes.rig.inputs import Inputs
    >>> minute = Scene("level", Inputs(np.arange(60.0), {"f_k": np.full(60, 10.0)}, 1.0), 60.0)
    >>> level = propagation("gyroscope", minute, [60.0], schuler=False)
    >>> level.errors("y", lambda record, rows: np.ones((60, 1))[rows])[0, 6, 0].round(6).item()  # 10 t^3/6
    360000.0
    """
    from imubayes.scenes.integration import backward

    motion = scene.mean_motion
    t = motion.t - motion.t[0]
    t = np.append(t, t[-1] + motion.interval)
    _check(scene, t, times)
    places = [_place(t, time) for time in times]
    force = motion.vectors("f")
    attitude = np.ascontiguousarray(scene.attitudes)  # of one layout, which is compiled once
    in_level = np.ascontiguousarray(np.einsum("nij,nj->ni", attitude, force))
    if not motion.has("f"):
        in_level[:, 2] = STANDARD_GRAVITY
    earth = EARTH_RATE * np.array([math.cos(LATITUDE), 0.0, math.sin(LATITUDE)]) * schuler
    back = STANDARD_GRAVITY / SEMI_MAJOR_AXIS * schuler
    edges = (0, *sorted({row for _, row in places} | {len(motion)}))
    gyro = kind == "gyroscope"
    parts = [backward(t, attitude, in_level, gyro, earth, back, *ends) for ends in pairwise(edges)]
    weights, moved = zip(*parts, strict=True)
    # the last row holds to the end of the record
    weights[-1][:, -2] += weights[-1][:, -1]
    return Propagation(schuler, t, tuple(places), edges, (*weights[:-1], weights[-1][:, :-1]), moved)


def _check(scene: Scene, t: FloatArray, times: Sequence[float]) -> None:
    """Refuse rows too far apart to follow errors, and missions of less than a row or of too many records."""
    if (longest := float(np.diff(t).max())) > COARSE:
        raise InputError(
            f"scene '{scene.name}': rows are up to {longest:.3g} s apart: expected {COARSE:g} s at most, so"
            " that errors of attitude, velocity and position can be followed"
        )
    if (farthest := _largest_turn(scene)) > TURN:
        raise InputError(
            f"scene '{scene.name}': the case turns by up to {math.degrees(farthest):.3g} deg from row to row:"
            f" expected {math.degrees(TURN):.0f} deg at most, so that errors can be followed; look at the"
            " unit of the rates, or give finer rows"
        )
    if scene.duration < t[-1] - t[-2]:
        raise InputError(
            f"scene '{scene.name}': a mission of {scene.duration:.3g} s ends within the first row, of"
            f" {t[-1] - t[-2]:.3g} s: expected a longer duration, or a log with finer rows"
        )
    if (records := _place(t, max(times))[0]) > MOST_RECORDS:
        raise InputError(
            f"scene '{scene.name}': a mission of {max(times):.4g} s repeats its record of {t[-1]:.4g} s"
            f" {records:,} times: expected {MOST_RECORDS:,} at most; give a longer log, or a shorter duration"
        )


def _largest_turn(scene: Scene) -> float:
    """Largest turn from row to row, rad: by the rate, or without one by the attitude."""
    motion = scene.mean_motion
    if motion.has("w"):
        rate = motion.vectors("w")[:-1]
        return math.sqrt((np.einsum("nj,nj->n", rate, rate) * np.diff(motion.t) ** 2).max())
    attitude = scene.attitudes.reshape(-1, 9)
    cosine = 0.5 * (np.einsum("nj,nj->n", attitude[:-1], attitude[1:]).min() - 1.0)
    return math.acos(min(max(cosine, -1.0), 1.0))


def _place(t: FloatArray, time: float) -> tuple[int, int]:
    """Repetition of a record with rows at `t` that a time of the mission lies in, and the nearest row."""
    record = max(math.ceil(time / t[-1] * (1.0 - ROUNDED)) - 1, 0)
    within = time - record * t[-1]
    after = min(int(np.searchsorted(t, within)), len(t) - 1)
    return record, after - int(after > 0 and within - t[after - 1] < t[after] - within)


def noise_growth(passed: Propagation, axis: str, quantity: Quantity) -> tuple[float, float, float]:
    """Standard deviation per unit of N, B and K at the last of the times, SI: of all components together.

    In straight and level flight, short of the Schuler period, these are sqrt(t) in velocity and t^1.5/sqrt(3)
    in position for the white noise of an accelerometer, g t^2.5/sqrt(20) in position for that of a gyroscope,
    t^2.5/sqrt(20) and g t^3.5/sqrt(252) for random walks. The quantity is not the output.
    """
    last, (whole, rest) = len(passed.t) - 1, passed.places[-1]
    reach, white, told = passed.read(quantity), 0.0, list[tuple[FloatArray, FloatArray]]()
    span = 0.5 * (np.diff(passed.t, prepend=0.0)[:-1] + np.diff(passed.t))  # that a row stands for
    size = max(1, math.ceil((whole * last + rest) / CELLS))
    for end, times in ((rest, 1), (last, whole)):
        if not end * times:
            continue
        weights, moved = passed.weighted(axis, end)
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
    time = float(whole * passed.t[-1] + passed.t[rest])
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
