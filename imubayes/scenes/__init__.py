"""What a sensor will see, what its errors come to there, and which terms a scene requires.

A scene is a record of what acts on a case with the axes (x, y, z): specific force, rate, its derivative,
temperature. It comes from the catalogue as a generated trajectory (`scenes.trajectories`), or from a
log. That is taken as it is: specific force, which at rest is +g upwards, so that a log in north-east-down
axes has ``f_z = -g``.

Vibration that is faster than the rows is Gaussian on top of a slow motion. What it adds to the mean of a
term, the rectification, follows from its moments and needs no fast sampling.

Attitude is a matrix for each row that takes the case's axes to a level frame, north, west and up, which stays
as it is while the case turns. It comes from angles or a quaternion of the record, or is followed from the
rate, levelled by the force of the first seconds.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.errors import DataError
from imubayes.rig.columns import ColumnSpec
from imubayes.rig.inputs import Inputs, case_inputs, own_inputs, sampling_interval
from imubayes.rig.motion import onward, vectors
from imubayes.rig.recordings import RunSpec
from imubayes.rig.streams import opened
from imubayes.selection.verdicts import listed
from imubayes.units import STANDARD_GRAVITY, counted

BODY = "ijk"
"""Letters of the channels that a scene stores along x, y, z."""

FOLLOWED = "attitude is followed from the rate, level by the force of the first seconds, with x to the north"

ANGLES, QUATERNION = ("roll", "pitch", "yaw"), ("q_w", "q_x", "q_y", "q_z")
"""Columns of a log that say how the case lies; either is enough."""

_LOGGED = tuple(f"{quantity}_{axis}" for quantity in ("f", "w", "dw") for axis in BODY)


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """Temperature over a mission, linear between its knots t (m,), s; from the last one on it stays as it is.

    `channels` are (m,) arrays of ``T``, K, and ``dT``, K/s; one that is absent counts as in `Inputs`.
    """

    t: FloatArray
    channels: Mapping[str, FloatArray]

    def at(self, t: FloatArray) -> dict[str, FloatArray]:
        """Temperature (n,) and its rate (n,) at times (n,) of the mission.

        Examples
        --------
        >>> soak = Course(np.array([0.0, 60.0]), {"T": np.array([290.0, 320.0]), "dT": np.full(2, 0.5)})
        >>> soak.at(np.array([30.0, 90.0]))
        {'T': array([305., 320.]), 'dT': array([0.5, 0. ])}
        """
        held = {"T": None, "dT": 0.0}
        return {name: np.interp(t, self.t, v, right=held[name]) for name, v in self.channels.items()}


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """What a sensor will see.

    Attributes
    ----------
    inputs : (n,) rows that the scene visits, SI, vibration included; ``f_i f_j f_k`` lie along x, y, z.
    duration : of the mission, s; a longer one than the record repeats it, a shorter one ends within it.
    vibration : rms of the Gaussian vibration of the force along each axis, m/s^2, in `inputs` only.
    band : (lowest, highest) frequency of the vibration, Hz.
    slow : the same rows without vibration; None where `inputs` has none added.
    notes : how the record was made, and what was assumed, in words.
    attitude : (n, 3, 3) matrices that take vectors along x, y, z to a level frame (north, west, up); None
        where the case does not turn.
    course : temperature over the mission; None where it is that of the record, held from its end on. Motion
        is repeated and temperature is not.
    others : further draws of a generated scene; what is said of it holds over all of them.
    """

    name: str
    inputs: Inputs
    duration: float
    vibration: float = 0.0
    band: tuple[float, float] = (0.0, math.inf)
    slow: Inputs | None = None
    notes: tuple[str, ...] = ()
    attitude: FloatArray | None = None
    course: Course | None = None
    others: tuple[Scene, ...] = ()

    @property
    def draws(self) -> tuple[Scene, ...]:
        """Return the scene, and the further draws of it."""
        return (self, *self.others)

    @property
    def mean_motion(self) -> Inputs:
        """Return the motion that vibration is on top of."""
        return self.slow or self.inputs

    @property
    def attitudes(self) -> FloatArray:
        """Return the attitude (n, 3, 3), of a case that does not turn as well."""
        return np.tile(np.eye(3), (len(self.inputs), 1, 1)) if self.attitude is None else self.attitude

    @property
    def temperature(self) -> Course:
        """Return the temperature over the mission."""
        if self.course is not None:
            return self.course
        logged = {name: v for name, v in self.inputs.channels.items() if name in ("T", "dT")}
        return Course(self.inputs.t - self.inputs.t[0], logged)


@dataclass(frozen=True, slots=True, eq=False)
class History:
    """What a case meets over a scene's record, from cell to cell (m,) of time, s; (m, 2) are ends.

    Lowest and highest size of the specific force without vibration, m/s^2, and of the rate, rad/s; tilt of
    the case's z axis to the vertical, rad. The heading (m,) is that of its x axis from north towards west,
    rad, without jumps.
    """

    t: FloatArray
    force: FloatArray
    rate: FloatArray
    tilt: FloatArray
    heading: FloatArray


def history(scene: Scene, cells: int = 80) -> History:
    """What the case meets over a scene's record, in at most so many cells.

    Examples
    --------
    >>> at_rest = Inputs(np.arange(300.0), {"f_k": np.full(300, 9.8)}, 1.0)
    >>> seen = history(Scene("desk", at_rest, 300.0), 3)
    >>> seen.t.tolist(), seen.force[0].tolist()
    ([49.5, 149.5, 249.5], [9.8, 9.8])
    """
    motion = scene.mean_motion
    n = len(motion)
    starts = np.unique(np.linspace(0, n, min(cells, n), endpoint=False).astype(int))
    counts = np.diff(np.append(starts, n))

    def ends(values: FloatArray) -> FloatArray:
        return np.column_stack((np.minimum.reduceat(values, starts), np.maximum.reduceat(values, starts)))

    attitude = scene.attitudes
    heading = np.unwrap(np.arctan2(attitude[:, 1, 0], attitude[:, 0, 0]))
    force, rate = (np.linalg.norm(motion.vectors(what), axis=1) for what in ("f", "w"))
    t, heading = (np.add.reduceat(values, starts) / counts for values in (motion.t - motion.t[0], heading))
    return History(
        t, ends(force), ends(rate), ends(np.arccos(np.clip(attitude[:, 2, 2], -1.0, 1.0))), heading
    )


def read_scene(
    path: Path,
    *,
    name: str = "",
    columns: Mapping[str, ColumnSpec] | None = None,
    duration: float | None = None,
    ignore: Collection[str] = (),
) -> Scene:
    """Scene from a log of any format that runs come in.

    Parameters
    ----------
    name : of the scene; the file's own name where empty.
    columns : where the file's names or units differ from ``t f_i f_j f_k w_i w_j w_k dw_i dw_j dw_k T roll
        pitch yaw q_w q_x q_y q_z``, by channel; (i, j, k) are the case axes x, y, z.
    duration : of the mission, s; the record's own where absent.
    ignore : columns of the file that are no channel, though their names are nearly those of one.

    Raises
    ------
    DataError : if the file cannot be used, or has neither force nor rate; names the file and the place.
    """
    optional = (*_LOGGED, "T", *ANGLES, *QUATERNION)
    spec = RunSpec(name, "other", path, columns=columns or {}, ignore=tuple(ignore))
    rows, clock = opened(path, spec, ("t",), optional).whole()
    t, channels = rows.t - rows.t[0], dict(rows.inputs.channels)
    if not any(channel[0] in "fw" for channel in channels):
        raise DataError(f"{path}: has no force and no rate: a scene needs columns such as 'f_i [g]'")
    attitude = _logged_attitude(path, t, channels)
    notes = (f"record of {path.name}", *clock)
    return scene_of(name or path.stem, t, channels, duration, notes, attitude)


def scene_of(
    name: str,
    t: FloatArray,
    channels: dict[str, FloatArray],
    duration: float | None,
    notes: tuple[str, ...],
    attitude: FloatArray | None,
) -> Scene:
    """Scene of a record; derivatives that it lacks are taken by central differences, attitude is followed."""
    whole = dict(channels)
    for source, slope in (*((f"w_{a}", f"dw_{a}") for a in BODY), ("T", "dT")):
        if source in whole and slope not in whole:
            whole[slope] = np.gradient(whole[source], t)
            notes = (*notes, f"{slope} is the derivative of {source}")
    interval = sampling_interval(t)
    lasting = float(t[-1] - t[0]) + interval if duration is None else duration
    motion = Inputs(t, whole, interval)
    force, rate = motion.vectors("f"), motion.vectors("w")
    if attitude is None:
        attitude, notes = followed(t, rate, force), (*notes, FOLLOWED)
    angle = at_rest(attitude, force, rate)
    agreement = "the case is never at rest: nothing shows how well force and attitude agree"
    if len(angle):
        within, rows = f"{np.degrees(angle.max()):.2g} deg of the vertical", counted(len(angle), "row")
        agreement = f"at rest ({rows}) the force lies within {within}"
    return Scene(name, motion, lasting, notes=(*notes, agreement), attitude=attitude)


def _logged_attitude(path: Path, t: FloatArray, channels: dict[str, FloatArray]) -> FloatArray | None:
    """Take the attitude out of the channels of a log, if it has one."""
    given = {name: channels.pop(name) for name in (*ANGLES, *QUATERNION) if name in channels}
    for names, attitude_of in ((ANGLES, from_angles), (QUATERNION, from_quaternions)):
        if all(name in given for name in names):
            told = [given[name] for name in names]
            if names is QUATERNION and len(none := np.flatnonzero(~np.any(told, axis=0))):
                raise DataError(
                    f"{path}: {listed(names)} are all zero {t[none[0]]:.6g} s from its start, which is no"
                    " attitude: expected a quaternion of any other length; take such rows out, or leave the"
                    " columns out (ignore)"
                )
            attitude = attitude_of(*told)
            # a record's level frame may point down: the specific force says so, which points up on average
            lift = np.einsum("nj,nj->", attitude[:, 2], vectors(channels, "f", len(attitude)))
            return attitude if lift >= 0.0 else attitude * _TURNED_OVER
    if given:
        raise DataError(
            f"{path}: column {listed(tuple(given))} alone is no attitude: expected {listed(ANGLES)}, or"
            f" {listed(QUATERNION)}, or none of them"
        )
    return None


def in_case(inputs: Inputs, axis: str) -> Inputs:
    """Inputs along (i, j, k) of the component whose input axis is a case axis, of those along x, y, z.

    Along ``x`` (i, j, k) are (x, y, z), along ``y`` (y, z, x), along ``z`` (z, x, y).

    Examples
    --------
    >>> up = Inputs(np.zeros(1), {"f_k": np.array([9.8])}, 1.0)
    >>> dict(in_case(up, "z").channels)
    {'f_i': array([9.8])}
    """
    return own_inputs(case_inputs(inputs), f"a{axis}")


LEVELLING = 2.0
"""s; the first of a record, in which force is taken as upwards on the average."""

CALM = (0.02, 0.05)
"""Share of g by which force may differ from it, and rate, rad/s, where the case is taken to be at rest."""

_TURNED_OVER = np.array([[1.0], [-1.0], [-1.0]])
"""Rows of an attitude that change sign where the level frame of a record is north, east, down."""


def from_angles(roll: FloatArray, pitch: FloatArray, yaw: FloatArray) -> FloatArray:
    """Attitude (..., 3, 3) of angles, rad: about x, then the level y, then the vertical.

    Examples
    --------
    >>> from_angles(*np.array([0.0, 0.0, np.pi / 2.0]))[:, 0].round(9).tolist()
    [0.0, 1.0, -0.0]
    """
    (cr, cp, cy), (sr, sp, sy) = np.cos((roll, pitch, yaw)), np.sin((roll, pitch, yaw))
    rows = (
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr),
    )
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def from_quaternions(w: FloatArray, x: FloatArray, y: FloatArray, z: FloatArray) -> FloatArray:
    """Attitude (..., 3, 3) of quaternions (w, x, y, z) of any length but zero.

    Examples
    --------
    >>> from_quaternions(*np.array([1.0, 0.0, 0.0, 1.0]))[:, 0].round(9).tolist()
    [0.0, 1.0, 0.0]
    """
    from scipy.spatial.transform import Rotation

    return Rotation.from_quat(np.stack((x, y, z, w), axis=-1)).as_matrix()


def followed(t: FloatArray, rate: FloatArray, force: FloatArray) -> FloatArray:
    """Attitude (n, 3, 3) by the rate (n, 3), rad/s, from a start level by the force (n, 3) and to the north.

    Examples
    --------
    >>> t, up = np.linspace(0.0, 1.0, 101), np.tile([0.0, 0.0, 9.8], (101, 1))
    >>> followed(t, np.tile([0.0, 0.0, np.pi], (101, 1)), up)[-1].diagonal().round(9).tolist()
    [-1.0, -1.0, 1.0]
    """
    turns = onward(t, rate)
    out = turns[0].T @ turns  # from the case at each time to the case at the first
    first = t - t[0] <= LEVELLING
    return levelled(np.einsum("nij,nj->ni", out[first], force[first])) @ out


def levelled(force: FloatArray) -> FloatArray:
    """Attitude (3, 3) of a case that feels a force (n, 3) upwards, with x (if upright, y) to the north."""
    mean = force.mean(axis=0)
    if not mean.any():
        return np.eye(3)
    up = mean / np.linalg.norm(mean)
    ahead = np.eye(3)[0 if abs(up[0]) < 0.9 else 1]
    north = ahead - (ahead @ up) * up
    north /= np.linalg.norm(north)
    return np.array([north, np.cross(up, north), up])


def at_rest(attitude: FloatArray, force: FloatArray, rate: FloatArray) -> FloatArray:
    """Angle (k,), rad, between the force and the vertical in the rows in which the case is at rest."""
    size = np.linalg.norm(force, axis=1)
    calm = (np.abs(size / STANDARD_GRAVITY - 1.0) < CALM[0]) & (np.linalg.norm(rate, axis=1) < CALM[1])
    along = np.einsum("nj,nj->n", attitude[calm, 2], force[calm]) / size[calm]
    return np.arccos(np.clip(along, -1.0, 1.0))
