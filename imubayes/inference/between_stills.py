"""Gyroscopes without a reference: the turns between stills, whose ends the accelerometers know.

A direction u that is fixed in the lab, up, is seen by the accelerometers at each still. From one still to the
next the gyroscopes carry it on, ``u_T = C u_0`` (see `strapdown`), and meet what the accelerometers see then,
but for their errors. With the rates w^ that the current coefficients theta_0 give, true ones are
``w = w^ - G^-1 (X (theta - theta_0) + noise)``, G = I + M, so that to first order two rows, along unit
vectors e across u_T, say::

    e . (u_T - C u_0) = - e . [u_T]x sum_n C_n G^-1 (X_n (theta - theta_0) + noise_n) dt_n
                        - e . (du_T - C du_0)

with C_n the turn from sample n to the end, and du what the accelerometers' own coefficients move their
directions by, so that their uncertainty counts. Divided by the duration of the turn it is an error of rate,
and the row's noise is that of the gyroscopes averaged over the turn. The angle about u stays unseen; turns
about different axes see all three.

At rest a gyroscope puts out bias and g-sensitivity (the Earth's rate, 15 deg/h at most, counts as bias).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra.arrays import FloatArray
from imubayes.errors import UnobservableError
from imubayes.inference.linear import Linear
from imubayes.inference.stills import Stills
from imubayes.inference.strapdown import cross_matrix, onward
from imubayes.inference.triad import Triad
from imubayes.rig.inputs import GAP, ImuRun, durations
from imubayes.sensors.noise import Noise

TURNS = "turns"
"""Part of a run's name that stands for the turns between its stills."""

FEWEST_TURNS = 6
"""Turns below which scale factors and misalignments (9 parameters, two rows a turn) are not determined."""


@dataclass(frozen=True, slots=True, eq=False)
class Directions:
    """What the accelerometers say of each still.

    Attributes
    ----------
    f : (k, 3) compensated specific force, m/s^2.
    force : (n, 3) the same of every sample, moving or not.
    change : (k, 3, p) derivative of the unit vector along f by the accelerometers' coefficients.
    triad : of the accelerometers, where it is linearised.
    """

    f: FloatArray
    force: FloatArray
    change: FloatArray
    triad: Triad

    @property
    def up(self) -> FloatArray:
        """(k, 3) unit vectors."""
        return self.f / np.linalg.norm(self.f, axis=1, keepdims=True)


def directions(triad: Triad, run: ImuRun, stills: Stills) -> Directions:
    """Directions of the specific force in the stills, by calibrated accelerometers."""
    f = triad.compensate(np.array([run.force[a:b].mean(axis=0) for a, b in stills]))
    length = np.linalg.norm(f, axis=1)[:, None]
    u = f / length
    across = (np.eye(3) - u[:, :, None] * u[:, None, :]) / length[:, :, None]
    return Directions(f, triad.compensate(run.force), -across @ _response(triad, f), triad)


def _response(triad: Triad, own: FloatArray, other: FloatArray | None = None) -> FloatArray:
    """``G^-1 X``: derivative (m, 3, p) of minus the compensated input by the coefficients."""
    inverse = np.linalg.inv(triad.gain())
    parts = triad.regressors(own, other)
    return np.concatenate([inverse[None, :, [c]] * part[:, None, :] for c, part in enumerate(parts)], axis=2)


def rest_rows(run: ImuRun, stills: Stills, seen: Directions, gyroscopes: Triad) -> tuple[Linear, ...]:
    """Rows of the gyroscopes at rest: one `Linear` for each component, over the triad's columns."""
    index = np.concatenate([np.arange(a, b) for a, b in stills])
    still = np.repeat(np.arange(len(stills)), [b - a for a, b in stills])
    regressors = gyroscopes.regressors(np.zeros_like(seen.f), seen.f)
    t = run.t[index]
    of_sample = durations(t, run.interval)
    return tuple(
        Linear(
            name=f"{run.name} ({component} at rest)",
            procedure=run.procedure,
            names=tuple(f"{component}.{name}" for name in lib.names),
            t=t,
            duration=of_sample,
            interval=run.interval,
            y=run.rate[index, c],
            columns=_taken(X, still),
        )
        for c, (component, lib, X) in enumerate(
            zip(gyroscopes.components, gyroscopes.libraries, regressors, strict=True)
        )
    )


def rest_forces(stills: Stills, seen: Directions) -> FloatArray:
    """Specific force (n, 3) of the still that each row at rest belongs to."""
    return np.repeat(seen.f, [b - a for a, b in stills], axis=0)


def turning(
    run: ImuRun, stills: Stills, seen: Directions, gyroscopes: Triad
) -> tuple[FloatArray, FloatArray]:
    """Compensated rate and specific force, (n, 3) each, of all samples within the turns."""
    turns = [np.arange(turn.start, turn.stop) for turn in _unbroken(run, stills)]
    index = np.concatenate([np.zeros(0, dtype=np.int64), *turns])
    return gyroscopes.compensate(run.rate[index], seen.force[index]), seen.force[index]


def turn_rates(run: ImuRun, stills: Stills, seen: Directions, gyroscopes: Triad) -> FloatArray:
    """Mean rate (2 m, 3), rad/s, of the turn of each row of `turn_rows`."""
    means = [
        gyroscopes.compensate(run.rate[turn.start : turn.stop], seen.force[turn.start : turn.stop]).mean(
            axis=0
        )
        for turn in _unbroken(run, stills)
    ]
    return np.repeat(np.array(means, dtype=np.float64), 2, axis=0)


def _taken(X: FloatArray, still: NDArray[np.int64]) -> Callable[[int, int], FloatArray]:
    return lambda start, stop: X[still[start:stop]]


@dataclass(frozen=True, slots=True, eq=False)
class _Turn:
    """One turn: samples [start, stop) from the last of one still to the first of the next."""

    still: int
    start: int
    stop: int


def turn_rows(
    run: ImuRun,
    stills: Stills,
    seen: Directions,
    gyroscopes: Triad,
    *,
    noises: tuple[Noise, Noise],
) -> Linear:
    """Rows of the turns, linearised: two for each.

    Parameters
    ----------
    run : of the IMU.
    stills : of the run.
    seen : directions in them.
    gyroscopes : at the coefficients to linearise at.
    noises : of an accelerometer and of a gyroscope: the directions' own noise shortens the time over which a
        row averages that of the gyroscopes. Neighbouring turns share a direction; that they err together is
        left out of account, which matters only where the accelerometers' noise is the larger.

    Returns
    -------
    rows in rad/s, with the columns of the accelerometers and, after them, of the gyroscopes.

    Raises
    ------
    UnobservableError : if fewer than 6 turns have no gap in them.
    """
    turns = _unbroken(run, stills)
    if len(turns) < FEWEST_TURNS:
        raise UnobservableError(
            f"run '{run.name}' has {len(turns)} turns without a gap between its {len(stills)} stills:"
            f" expected {FEWEST_TURNS} or more, about different axes"
        )
    made = [_turned(run, turn, seen, gyroscopes) for turn in turns]
    X, y = np.concatenate([m[0] for m in made]), np.concatenate([m[1] for m in made])
    whole = lasting(run, stills)
    extra = np.array([_direction_variance(run, stills, turn, noises[0]) for turn in turns])
    # the directions' variance, as if the gyroscopes had been averaged over less time
    counting = noises[1].N ** 2 / (noises[1].N ** 2 / whole + extra / whole**2)
    middle = np.array([0.5 * (run.t[turn.start] + run.t[turn.stop - 1]) for turn in turns])
    return Linear(
        name=f"{run.name} ({TURNS})",
        procedure=run.procedure,
        names=(*seen.triad.names, *gyroscopes.names),
        t=np.repeat(middle, 2),
        duration=np.repeat(counting, 2),
        interval=float(np.median(counting)),
        y=y,
        columns=lambda start, stop: X[start:stop],
        axes=np.concatenate([m[2] for m in made]),
    )


def _unbroken(run: ImuRun, stills: Stills) -> tuple[_Turn, ...]:
    """Turns in which no sample is missing."""
    found = (_Turn(k, first[1] - 1, second[0] + 1) for k, (first, second) in enumerate(pairwise(stills)))
    return tuple(turn for turn in found if np.diff(run.t[turn.start : turn.stop]).max() <= GAP * run.interval)


def _direction_variance(run: ImuRun, stills: Stills, turn: _Turn, noise: Noise) -> float:
    """Variance (rad^2) of the directions at both ends of a turn, from the accelerometers' noise."""
    held = [(b - a) * run.interval for a, b in stills[turn.still : turn.still + 2]]
    return sum(noise.N**2 / T + noise.B**2 for T in held) / run.gravity**2


def closures(run: ImuRun, stills: Stills, seen: Directions, gyroscopes: Triad) -> FloatArray:
    """Sines (m, 2) of the angles by which up, carried through each unbroken turn, misses the next still's up.

    Parameters
    ----------
    run, stills, seen, gyroscopes : as in `turn_rows`.
    """
    turns = (_carried(run, turn, seen, gyroscopes) for turn in _unbroken(run, stills))
    return np.array([turn.missed for turn in turns], dtype=np.float64).reshape(-1, 2)


def lasting(run: ImuRun, stills: Stills) -> FloatArray:
    """Duration (m,), s, of each unbroken turn."""
    return np.array([run.t[turn.stop - 1] - run.t[turn.start] for turn in _unbroken(run, stills)])


@dataclass(frozen=True, slots=True, eq=False)
class _Carried:
    """Up, carried through one turn.

    Attributes
    ----------
    t, w, f : (n,), (n, 3), (n, 3) time, compensated rate and specific force.
    C : (n, 3, 3) the turn from each sample to the end.
    here : (3,) up at the end.
    across : (2, 3) unit vectors across it.
    missed : (2,) rad, up as it is seen there minus up as it was carried, along them.
    """

    t: FloatArray
    w: FloatArray
    f: FloatArray
    C: FloatArray
    here: FloatArray
    across: FloatArray
    missed: FloatArray


def _carried(run: ImuRun, turn: _Turn, seen: Directions, gyroscopes: Triad) -> _Carried:
    inside = slice(turn.start, turn.stop)
    t, f = run.t[inside], seen.force[inside]
    w = gyroscopes.compensate(run.rate[inside], f)
    C, here = onward(t, w), seen.up[turn.still + 1]
    across = _across(here)
    return _Carried(t, w, f, C, here, across, across @ (here - C[0] @ seen.up[turn.still]))


def _turned(
    run: ImuRun, turn: _Turn, seen: Directions, gyroscopes: Triad
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Two rows of one turn: columns (2, p), response (2,), and how the three gyroscopes weigh (2, 3)."""
    up = _carried(run, turn, seen, gyroscopes)
    axes = up.across @ cross_matrix(up.here)
    steps = np.convolve(np.diff(up.t), (0.5, 0.5))
    of_gyroscopes = -axes @ np.einsum("n,nab,nbp->ap", steps, up.C, _response(gyroscopes, up.w, up.f))
    of_directions = up.across @ (up.C[0] @ seen.change[turn.still] - seen.change[turn.still + 1])
    X = np.hstack((of_directions, of_gyroscopes))
    y = up.missed + X @ np.concatenate((seen.triad.theta, gyroscopes.theta))
    duration = up.t[-1] - up.t[0]
    return X / duration, y / duration, axes


def _across(u: FloatArray) -> FloatArray:
    """Two unit vectors (2, 3) across a unit vector (3,), and across each other."""
    least = np.eye(3)[int(np.argmin(np.abs(u)))]
    first = np.cross(u, least) / float(np.linalg.norm(np.cross(u, least)))
    return np.asarray((first, np.cross(u, first)), dtype=np.float64)
