"""What to test: the best plan of what a bench offers.

A test is made of dwells at the settings of a bench or a hand; here stands what each tells and costs. A dwell
with constant inputs is one row for each component, the mean over its time: one dwell serves all of them. The
rows of a component in a run are correlated by its drift, so that what a dwell tells depends on its place in
the run, and the order matters. Where the attitude is not known, the part of the rows that it moves is gone
from them (`imubayes.planning.offers`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import groupby, pairwise
from types import EllipsisType
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import FloatArray
from imubayes.algebra.factor import invert_triangular
from imubayes.inference.between_stills import counting_time
from imubayes.inference.linear import Rows
from imubayes.inference.whiten import processes, whiten
from imubayes.sensors.noise import Noise

POWER = 16.0
"""Order of the power mean that stands for the worst of several: smooth, and above 0.84 of the worst of 15."""

Aim = Literal["D", "worst", "rms"]


@dataclass(frozen=True, slots=True, eq=False)
class Signal:
    """What one component says in a run, or what a triad says of which only a part is known.

    A dwell is a row. Of turns between dwells there are two rows for each: they are what a gyroscope triad
    says of the way from one setting to the next.

    Attributes
    ----------
    X : (r, s) columns, for coefficients and errors of the bench in units of their prior sd: a row for each of
        m settings; of turns 2 m^2, two from each setting to each.
    noise : of a component, SI.
    axes : (r, a) weights of a alike and independent components in each row; None for a single component.
    ends : of turns, noise in rad of the directions that are seen before and after; None of dwells.
    columns : places (s,) of the columns among the c of a problem; all of them in their order, if not given.
    """

    X: FloatArray
    noise: Noise
    axes: FloatArray | None = None
    ends: Noise | None = None
    columns: NDArray[np.intp] | EllipsisType = ...

    def wide(self, rows: FloatArray, c: int) -> FloatArray:
        """Rows (n, c) over all columns of a problem, of rows (n, s) over the signal's own."""
        out = np.zeros((len(rows), c))
        out[:, self.columns] = rows
        return out

    def seen(self, rows: FloatArray, S: FloatArray) -> FloatArray:
        """Rows (..., s) times those of a matrix (c, w) that are of the signal's columns."""
        return np.tensordot(rows, S[self.columns], 1)

    def places(self, settings: NDArray[np.intp]) -> NDArray[np.intp]:
        """Rows of X (..., n) that settings (..., k) in their order make."""
        if self.ends is None:
            return settings
        m = math.isqrt(len(self.X) // 2)
        pairs = 2 * (m * settings[..., :-1] + settings[..., 1:])
        return np.stack((pairs, pairs + 1), axis=-1).reshape(*settings.shape[:-1], -1)

    def rows_at(self, steps: int) -> NDArray[np.intp]:
        """Rows (steps, w), of those that a run of so many steps makes, that belong to each step."""
        if self.ends is None:
            return np.arange(steps)[:, None]
        return 2 * np.maximum(np.arange(steps)[:, None] - 1, 0) + np.arange(2 * min(steps - 1, 1))


@dataclass(frozen=True, slots=True, eq=False)
class Menu:
    """Dwells that a run could be made of: m settings, each of which all signals tell of at the same time.

    The signals have independent noises; a study's own menus have none yet. `mount` (m,) numbers the mount
    that each setting belongs to; `dwells` are times that one may take, and `interval` is the averaging time
    of a sample, s. Time that is no record is before every dwell (`settle`), more of it where the case is
    mounted anew (`remount`), and once for the run (`setup`); and at the ends of every dwell (`lost`), which
    are told from motion by a window, so that the turns have it.
    """

    run: str
    signals: tuple[Signal, ...]
    mount: NDArray[np.int64]
    dwells: tuple[float, ...]
    interval: float = 1.0
    settle: float = 0.0
    remount: float = 0.0
    setup: float = 0.0
    lost: float = 0.0

    def __len__(self) -> int:
        return len(self.mount)


class Step(NamedTuple):
    """One dwell of a plan: at a setting of a menu, for so many seconds."""

    menu: int
    setting: int
    dwell: float


Steps = tuple[Step, ...]


def size_of(aim: Aim, V: FloatArray) -> FloatArray:
    """Size (...) of posterior covariances (..., g, g), all of it normal, that a plan is to make small.

    That is with ``D`` the geometric mean sd of V's axes, with ``worst`` the largest sd, as a power mean of
    order `POWER`, and with ``rms`` the root of the summed variances.

    Examples
    --------
    >>> [round(float(size_of(aim, np.diag([4.0, 1.0]))), 3) for aim in ("D", "worst", "rms")]
    [1.414, 1.915, 2.236]
    """
    if aim == "D":
        return np.exp(np.linalg.slogdet(V)[1] / (2.0 * V.shape[-1]))
    sd = np.sqrt(np.maximum(np.diagonal(V, axis1=-2, axis2=-1), 0.0))
    if aim == "rms":
        return np.linalg.norm(sd, axis=-1)
    top = np.maximum(sd.max(axis=-1), np.finfo(float).tiny)
    return top * np.mean((sd / top[..., None]) ** POWER, axis=-1) ** (1.0 / POWER)


@dataclass(frozen=True, slots=True, eq=False)
class PlanProblem:
    """A plan to find, of runs with independent noises, that makes G theta well known within a time, s.

    `start` (c, c) is the triangular factor of what is known before: the prior, and the data that are in. The
    `aim` is to make the size of the covariance of G theta small (`size_of`); G (g, c) is of coefficients and
    errors in units of their prior, and what it gives is 1 where it is as uncertain as is needed.
    """

    menus: tuple[Menu, ...]
    start: FloatArray
    aim: Aim
    G: FloatArray
    limit: float


def duration(problem: PlanProblem, steps: Sequence[Step]) -> float:
    """Time that steps take, handling included, s."""
    if not steps:
        return 0.0
    return float(starts(problem.menus, steps)[-1]) + steps[-1].dwell


def starts(menus: Sequence[Menu], steps: Sequence[Step]) -> FloatArray:
    """Time (n,) at which the record of each step begins, s from the start of the plan."""
    times, clock = list[float](), 0.0
    for k, part in runs_of(steps):
        clock += menus[k].setup
        for step, pause in zip(part, pauses(menus[k], part), strict=True):
            times.append(clock + pause)
            clock = times[-1] + step.dwell
    return np.array(times)


def runs_of(steps: Sequence[Step]) -> list[tuple[int, Steps]]:
    """Steps by run: (number of the menu, its steps in order)."""
    return [(k, tuple(part)) for k, part in groupby(steps, key=lambda step: step.menu)]


def pauses(menu: Menu, steps: Sequence[Step]) -> tuple[float, ...]:
    """Time before each step of a run, s."""
    mounts = menu.mount[[step.setting for step in steps]].tolist()
    new = [True, *(a != b for a, b in pairwise(mounts))]
    return tuple(menu.settle + menu.remount * fresh for fresh in new)


@lru_cache(maxsize=16)
def whitened(menu: Menu, steps: Steps, c: int) -> FloatArray:
    """Rows (n, c) of all signals in the steps of one run, whitened; of a signal as many as it has columns."""
    where, told = settings_of(steps), list[FloatArray]()
    for signal in menu.signals:
        rows = whitening(menu, signal, steps) @ signal.X[signal.places(where)]
        if len(rows) > rows.shape[1]:
            rows = np.asarray(np.linalg.qr(rows, mode="r"))
        told.append(signal.wide(rows, c))
    return np.concatenate(told)


def settings_of(steps: Sequence[Step]) -> NDArray[np.intp]:
    """Settings (n,) of steps of one run."""
    return np.array([step.setting for step in steps], dtype=np.intp)


def whitening(menu: Menu, signal: Signal, steps: Steps) -> FloatArray:
    """Root W (n, n) of the inverse covariance of a signal's rows in a run, ``W' W``."""
    lasting, pause = _times(menu, steps)
    if signal.axes is None:
        return _whitening(signal.noise, menu.interval, pause, lasting)
    if signal.ends is not None:
        rows = turns_of(menu, signal, steps)
        return whiten(signal.noise, rows, np.eye(len(rows.t)))[0] if len(rows.t) else np.zeros((0, 0))
    return _root(signal.noise, menu.interval, Rows(*_clock(pause, lasting), signal.axes[settings_of(steps)]))


def turns_of(menu: Menu, signal: Signal, steps: Steps) -> Rows:
    """When the rows of the turns between the steps of a run were taken."""
    dwell, pause = _times(menu, steps)
    (t, lasting), turn = _clock(pause, dwell), np.array(pause[1:])
    counting = counting_time(
        signal.noise, signal.ends or signal.noise, turn, np.stack((lasting[:-1], lasting[1:]))
    )
    middle = t[1:] - 0.5 * (lasting[1:] + turn)
    axes = None if signal.axes is None else signal.axes[signal.places(settings_of(steps))]
    return Rows(np.repeat(middle, 2), np.repeat(counting, 2), axes)


@lru_cache(maxsize=16)
def _times(menu: Menu, steps: Steps) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Time of each dwell that counts, and before it, s."""
    lost = menu.lost
    return tuple(step.dwell - lost for step in steps), tuple(lost + pause for pause in pauses(menu, steps))


@lru_cache(maxsize=8)
def _whitening(
    noise: Noise, interval: float, pause: tuple[float, ...], dwell: tuple[float, ...]
) -> FloatArray:
    return _root(noise, interval, Rows(*_clock(pause, dwell)))


def _clock(pause: tuple[float, ...], dwell: tuple[float, ...]) -> tuple[FloatArray, FloatArray]:
    """Middles and durations (n,) of dwells, s."""
    lasting = np.array(dwell)
    return np.cumsum(np.array(pause) + lasting) - 0.5 * lasting, lasting


def _root(noise: Noise, interval: float, rows: Rows) -> FloatArray:
    t, lasting = rows.t, rows.duration
    # the processes that stand for B are those that an analysis of the samples has
    ends = np.array([t[0] - 0.5 * lasting[0] + 0.5 * interval, t[-1] + 0.5 * lasting[-1] - 0.5 * interval])
    return whiten(noise, rows, np.eye(len(t)), processes(Rows(ends, np.full(2, interval)), noise))[0]


def added(signal: Signal, menu: Menu, part: Steps, new: Sequence[Step]) -> tuple[FloatArray, FloatArray]:
    """Rows (k, w, s) that each of the steps adds to a run, and their variances (k, w)."""
    before = part[-1:] if signal.ends is not None else []
    settings = np.array([[*(last.setting for last in before), step.setting] for step in new])
    rows = signal.X[signal.places(settings)]
    variance = np.array([_variance(menu, signal, step.dwell) for step in new])
    return rows, np.repeat(variance[:, None], rows.shape[1], axis=1)


@lru_cache(maxsize=64)
def _variance(menu: Menu, signal: Signal, dwell: float) -> float:
    """Variance of the mean of a dwell, or of a turn's, given that of a dwell before it."""
    return float(whitening(menu, signal, (Step(0, 0, dwell),) * 2)[1, 1] ** -2)


@lru_cache(maxsize=16)
def root(problem: PlanProblem, steps: Steps) -> FloatArray:
    """Root S (c, c) of the posterior covariance ``S S'`` after the steps, in units of the prior."""
    rows = [whitened(problem.menus[k], part, len(problem.start)) for k, part in runs_of(steps)]
    return invert_triangular(np.asarray(np.linalg.qr(np.concatenate((problem.start, *rows)), mode="r")))


def worth(problem: PlanProblem, steps: Steps) -> float:
    """Size of what is left to know after the steps: smaller is better."""
    spread = problem.G @ root(problem, steps)
    return float(size_of(problem.aim, spread @ spread.T))
