"""Gyroscopes without a reference: the turns between stills, whose ends the accelerometers know.

A direction u that is fixed in the lab, up, is seen by the accelerometers at each still. From one still to the
next the gyroscopes carry it on, ``u_T = C u_0`` (`imubayes.rig.motion`), and meet what the accelerometers see
then, but for their errors. With the rates w^ that the current coefficients theta_0 give, true ones are
``w = w^ - G^-1 (X (theta - theta_0) + noise)``, G = I + M, so that to first order two rows, along unit
vectors e across u_T, say::

    e . (u_T - C u_0) = - e . [u_T]x sum_n C_n G^-1 (X_n (theta - theta_0) + noise_n) dt_n
                        - e . (du_T - C du_0)

with C_n the turn from sample n to the end, and du what the accelerometers' own coefficients move their
directions by, so that their uncertainty counts. Divided by the duration of the turn it is an error of rate,
and the row's noise is that of the gyroscopes averaged over the turn. The angle about u stays unseen; turns
about different axes see all three.

Of gyroscopes alone the stills are positions in which up is known, but for tilts.

At rest a gyroscope puts out bias and g-sensitivity (the Earth's rate, 15 deg/h at most, counts as bias).

What wanders slowly is alike at rest and in the turns between, but the rows of each have drift of their own:
turns would tell of a bias once more what rest has told. So they take biases as they are at rest, and tell
nothing of them. That white noise, too, puts these off a little is left out of account.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.errors import UnobservableError
from imubayes.inference.linear import Extra, Linear
from imubayes.inference.stills import means_of, resting, samples_in, still_rows
from imubayes.inference.triad import Triad
from imubayes.rig.inputs import GAP, Run
from imubayes.rig.motion import cross_matrix, onward
from imubayes.sensors.noise import Noise

TURNS = "turns"
"""Part of a run's name that stands for the turns between its stills."""

FEWEST_TURNS = 6
"""Turns below which scale factors and misalignments (9 parameters, two rows a turn) are not determined."""


@dataclass(frozen=True, slots=True, eq=False)
class Directions:
    """What the accelerometers say of each still of a run.

    The compensated specific force is f (k, 3), m/s^2, and `force` (n, 3) of every sample, moving or not. By
    the coefficients `names` of the accelerometers, or errors of positions that are known, the unit vector
    along f has the derivative `change` (k, 3, p) at the place `theta` (p,), SI.
    """

    run: Run
    f: FloatArray
    force: FloatArray
    change: FloatArray
    names: tuple[str, ...]
    theta: FloatArray

    @property
    def up(self) -> FloatArray:
        """(k, 3) unit vectors."""
        return self.f / np.linalg.norm(self.f, axis=1, keepdims=True)


def directions(triad: Triad, run: Run) -> Directions:
    """Directions of the specific force in the stills, by calibrated accelerometers."""
    f = triad.compensate(means_of(run, run.force, run.stills))
    length = np.linalg.norm(f, axis=1)[:, None]
    u = f / length
    across = (np.eye(3) - u[:, :, None] * u[:, None, :]) / length[:, :, None]
    change = -across @ _response(triad, f)
    return Directions(run, f, triad.compensate(run.force), change, triad.names, triad.theta)


def known_directions(run: Run, extras: Sequence[Extra]) -> Directions:
    """Directions in positions that are known, with the errors of the bench among which their tilts are.

    Between them gravity is where the gyroscopes carry it; what the hand accelerates by is not known.
    """
    run, order = resting(run), np.argsort([section.start for section in run.sections])
    u = np.array([run.sections[n].direction for n in order])
    change = np.zeros((len(u), 3, len(extras)))
    for column, extra in enumerate(extras):
        for k, n in enumerate(order.tolist()):
            change[k, :, column] = -np.cross(rotation_of(extra, f"{run.name}.{n}"), u[k])
    force = np.zeros((len(run.t), 3))
    rest = means_of(run, run.rate, run.stills).mean(axis=0)
    for up, (a, b) in zip(u[1:], pairwise(run.stills), strict=True):
        turn = slice(a[1] - 1, b[0] + 1)
        force[turn] = np.einsum("nba,b->na", onward(run.t[turn], run.rate[turn] - rest), up)
    for (a, b), direction in zip(run.stills, u, strict=True):
        force[a:b] = direction
    names, theta = tuple(extra.name for extra in extras), np.zeros(len(extras))
    return Directions(run, run.gravity * u, run.gravity * force, change, names, theta)


def rotation_of(extra: Extra, place: str) -> FloatArray:
    """Axis (3,) about which an error of the positions turns the case in one section; zero elsewhere."""
    head, _, where = extra.name.partition(".")
    return np.eye(3)["ijk".index(head[-1])] if where == place else np.zeros(3)


def _response(triad: Triad, own: FloatArray, other: FloatArray | None = None) -> FloatArray:
    """``G^-1 X``: derivative (m, 3, p) of minus the compensated input by the coefficients."""
    inverse = np.linalg.inv(triad.gain())
    parts = triad.regressors(own, other)
    return np.concatenate([inverse[None, :, [c]] * part[:, None, :] for c, part in enumerate(parts)], axis=2)


def rest_rows(seen: Directions, gyroscopes: Triad) -> tuple[Linear, ...]:
    """Rows of the gyroscopes at rest: one `Linear` for each component, over its own columns."""
    run, X = seen.run, gyroscopes.regressors(np.zeros_like(seen.f), seen.f)
    named = zip(gyroscopes.components, gyroscopes.libraries, run.rate.T, X, strict=True)
    return tuple(
        still_rows(run, run.stills, c, tuple(f"{c}.{name}" for name in lib.names), said, columns)
        for c, lib, said, columns in named
    )


def turning(seen: Directions, gyroscopes: Triad) -> list[tuple[FloatArray, FloatArray]]:
    """Compensated rate and specific force, (n, 3) each, of the samples of each turn of `turn_rows`."""
    turns = [(seen.run.rate[turn], seen.force[turn]) for _, turn in _unbroken(seen)]
    return [(gyroscopes.compensate(rate, force), force) for rate, force in turns]


def turn_rows(seen: Directions, gyroscopes: Triad, *, noises: tuple[Noise, Noise]) -> Linear:
    """Rows of the turns, rad/s, linearised at the gyroscopes' coefficients: two for each.

    They have the columns of the accelerometers and, after them, of the gyroscopes; those of biases are zero.
    `noises` are of an accelerometer and of a gyroscope: the directions' own noise shortens the time over
    which a row averages that of the gyroscopes. Neighbouring turns share a direction; that they err together
    is left out of account, which matters only where the accelerometers' noise is the larger. It is an
    `UnobservableError` if fewer than 6 turns have no gap in them.
    """
    run, turns = seen.run, _unbroken(seen)
    if len(turns) < FEWEST_TURNS:
        raise UnobservableError(
            f"run '{run.name}' has {len(turns)} turns without a gap between its {len(run.stills)} stills:"
            f" expected {FEWEST_TURNS} or more, about different axes"
        )
    made = [_turned(seen, still, turn, gyroscopes) for still, turn in turns]
    X, y, axes = (np.concatenate(parts) for parts in zip(*made, strict=True))
    long = np.array([samples_in(run, (still,)) * run.interval for still in run.stills])
    before, g = np.array([still for still, _ in turns]), run.gravity
    ends = Noise(noises[0].N / g, noises[0].B / g, 0.0)
    counting = counting_time(noises[1], ends, lasting(seen), np.array([long[before], long[before + 1]]))
    middle = np.array([0.5 * (run.t[turn.start] + run.t[turn.stop - 1]) for _, turn in turns])
    return Linear(
        name=f"{run.name} ({TURNS})",
        procedure=run.procedure,
        names=(*seen.names, *gyroscopes.names),
        t=np.repeat(middle, 2),
        duration=np.repeat(counting, 2),
        interval=float(np.median(counting)),
        y=y,
        columns=lambda start, stop: X[start:stop],
        axes=axes,
    )


def _unbroken(seen: Directions) -> list[tuple[int, slice]]:
    """Turns in which no sample is missing: the still before, and samples from its last to the first after."""
    run = seen.run
    found = [(k, slice(a[1] - 1, b[0] + 1)) for k, (a, b) in enumerate(pairwise(run.stills))]
    return [(k, turn) for k, turn in found if np.diff(run.t[turn]).max() <= GAP * run.interval]


def counting_time(noise: Noise, ends: Noise, whole: FloatArray, held: FloatArray) -> FloatArray:
    """Time (m,), s, over which the row of a turn that lasts `whole` (m,), s, averages a gyroscope's noise.

    The variance of the directions at both `ends`, rad/sqrt(Hz) and rad, averaged over the stills before and
    after it, `held` (2, m), s, counts as if the gyroscopes had been averaged over less time.
    """
    extra = np.sum(ends.N**2 / held + ends.B**2, axis=0)
    return noise.N**2 / (noise.N**2 / whole + extra / whole**2)


def closures(seen: Directions, gyroscopes: Triad) -> FloatArray:
    """Sines (m, 2) of the angles by which up, carried through each unbroken turn, misses up after it."""
    turns = (_carried(seen, still, turn, gyroscopes) for still, turn in _unbroken(seen))
    return np.array([missed for *_, missed in turns], dtype=np.float64).reshape(-1, 2)


def lasting(seen: Directions) -> FloatArray:
    """Duration (m,), s, of each unbroken turn."""
    t = seen.run.t
    return np.array([t[turn.stop - 1] - t[turn.start] for _, turn in _unbroken(seen)])


def _carried(
    seen: Directions, still: int, turn: slice, gyroscopes: Triad
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Up, carried through one turn of n samples.

    Compensated rate (n, 3); the turn from each sample to the end (n, 3, 3); two unit vectors (2, 3) across up
    at the end; rad along them (2,), up as it is seen there minus up as it was carried.
    """
    w = gyroscopes.compensate(seen.run.rate[turn], seen.force[turn])
    C, here = onward(seen.run.t[turn], w), seen.up[still + 1]
    first = np.cross(here, np.eye(3)[int(np.argmin(np.abs(here)))])
    first /= float(np.linalg.norm(first))
    across = np.asarray((first, np.cross(here, first)), dtype=np.float64)
    return w, C, across, across @ (here - C[0] @ seen.up[still])


def _turned(
    seen: Directions, still: int, turn: slice, gyroscopes: Triad
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Two rows of one turn: columns (2, p), response (2,), and how the three gyroscopes weigh (2, 3)."""
    w, C, across, missed = _carried(seen, still, turn, gyroscopes)
    axes, t = across @ cross_matrix(seen.up[still + 1]), seen.run.t[turn]
    steps = np.convolve(np.diff(t), (0.5, 0.5))
    response = _response(gyroscopes, w, seen.force[turn])
    of_gyroscopes = -axes @ np.einsum("n,nab,nbp->ap", steps, C, response)
    of_directions = across @ (C[0] @ seen.change[still] - seen.change[still + 1])
    X = np.hstack((of_directions, of_gyroscopes))
    X[:, [name.endswith(".b0") for name in (*seen.names, *gyroscopes.names)]] = 0.0
    y = missed + X @ np.concatenate((seen.theta, gyroscopes.theta))
    duration = t[-1] - t[0]
    return X / duration, y / duration, axes
