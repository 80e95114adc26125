"""What a test could be made of: dwells with their columns, their noise and what they cost.

A dwell with constant inputs is one row, the mean over its time. The rows of a run are correlated by the
drift of the sensor, so that what a dwell tells depends on its place in the run, and the order matters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import groupby, pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import invert_triangular
from imubayes.inference.linear import Rows
from imubayes.inference.whiten import mattering, whiten, whitener
from imubayes.sensors.noise import Noise

POWER = 16.0
"""Order of the power mean that stands for the worst of several: smooth, and above 0.84 of the worst of 15."""

AimKind = Literal["D", "worst", "rms"]


@dataclass(frozen=True, slots=True)
class Handling:
    """Time that is no record, s.

    Attributes
    ----------
    settle : before every dwell.
    mount : more of it where the case is mounted anew.
    setup : once, if the run is made at all.
    """

    settle: float
    mount: float = 0.0
    setup: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Menu:
    """Dwells that a run could be made of.

    Attributes
    ----------
    run : its name.
    X : (m, c) columns at each of m settings, for coefficients and errors of the bench in units of their
        prior sd.
    mount : (m,) number of the mount that each setting belongs to.
    dwells : times that a dwell may take, s.
    handling : what comes on top.
    noise : of the sensor, SI.
    interval : averaging time of a sample, s.
    """

    run: str
    X: FloatArray
    mount: NDArray[np.int64]
    dwells: tuple[float, ...]
    handling: Handling
    noise: Noise
    interval: float = 1.0


@dataclass(frozen=True, slots=True)
class Step:
    """One dwell of a plan: at a setting of a menu, for so many seconds."""

    menu: int
    setting: int
    dwell: float


Steps = tuple[Step, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Aim:
    """What a plan is to make small: a size of the posterior covariance V of G theta, all of it normal.

    Attributes
    ----------
    kind : ``D``, the geometric mean sd of V's axes; ``worst``, the largest sd, as a power mean of order
        `POWER`; ``rms``, the root of the summed variances.
    G : (g, c) of coefficients and errors in units of their prior; what it gives is 1 where it is as uncertain
        as is needed.
    """

    kind: AimKind
    G: FloatArray

    def size(self, V: FloatArray) -> FloatArray:
        """Size (...) of covariances (..., g, g).

        Examples
        --------
        >>> V = np.diag([4.0, 1.0])
        >>> [round(float(Aim(kind, np.eye(2)).size(V)), 3) for kind in ("D", "worst", "rms")]
        [1.414, 1.915, 2.236]
        """
        if self.kind == "D":
            return np.exp(np.linalg.slogdet(V)[1] / (2.0 * V.shape[-1]))
        sd = np.sqrt(np.maximum(np.diagonal(V, axis1=-2, axis2=-1), 0.0))
        if self.kind == "rms":
            return np.linalg.norm(sd, axis=-1)
        top = np.maximum(sd.max(axis=-1), np.finfo(float).tiny)
        return top * np.mean((sd / top[..., None]) ** POWER, axis=-1) ** (1.0 / POWER)


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """A plan to find.

    Attributes
    ----------
    menus : one for each run that could be made; their noises are independent.
    start : (c, c) triangular factor of what is known before: the prior, and the data that are in.
    aim : what to make small.
    limit : time for all of it, s.
    """

    menus: tuple[Menu, ...]
    start: FloatArray
    aim: Aim
    limit: float


def duration(problem: Problem, steps: Sequence[Step]) -> float:
    """Time that steps take, handling included, s."""
    if not steps:
        return 0.0
    return float(starts(problem.menus, steps)[-1]) + steps[-1].dwell


def starts(menus: Sequence[Menu], steps: Sequence[Step]) -> FloatArray:
    """Time (n,) at which the record of each step begins, s from the start of the plan."""
    found, clock = list[float](), 0.0
    for k, part in runs_of(steps):
        clock += menus[k].handling.setup
        for step, pause in zip(part, pauses(menus[k], part), strict=True):
            found.append(clock + pause)
            clock = found[-1] + step.dwell
    return np.array(found)


def runs_of(steps: Sequence[Step]) -> list[tuple[int, list[Step]]]:
    """Steps by run: (number of the menu, its steps in order)."""
    return [(k, list(part)) for k, part in groupby(steps, key=lambda step: step.menu)]


def pauses(menu: Menu, steps: Sequence[Step]) -> tuple[float, ...]:
    """Time before each step of a run, s."""
    mounts = menu.mount[[step.setting for step in steps]].tolist()
    new = [True, *(a != b for a, b in pairwise(mounts))]
    return tuple(menu.handling.settle + menu.handling.mount * fresh for fresh in new)


def whitened(menu: Menu, steps: Sequence[Step]) -> FloatArray:
    """Rows (n, c) of the steps of one run, whitened."""
    return whitening(menu, steps) @ menu.X[[step.setting for step in steps]]


def whitening(menu: Menu, steps: Sequence[Step]) -> FloatArray:
    """Root W (n, n) of the inverse covariance of a run's rows, ``W' W``."""
    dwell = tuple(step.dwell for step in steps)
    return _whitening(menu.noise, menu.interval, pauses(menu, steps), dwell)


@lru_cache(maxsize=256)
def _whitening(
    noise: Noise, interval: float, pause: tuple[float, ...], dwell: tuple[float, ...]
) -> FloatArray:
    lasting = np.array(dwell)
    t = np.cumsum(np.array(pause) + lasting) - 0.5 * lasting
    # the processes that stand for B are those that an analysis of the samples has
    ends = np.array([t[0] - 0.5 * lasting[0] + 0.5 * interval, t[-1] + 0.5 * lasting[-1] - 0.5 * interval])
    parts = mattering(noise, Rows(ends, np.full(2, interval)))
    return whiten(whitener(noise, Rows(t, lasting), parts), np.eye(len(t)))


def root(problem: Problem, steps: Sequence[Step]) -> FloatArray:
    """Root S (c, c) of the posterior covariance ``S S'`` after the steps, in units of the prior."""
    rows = [whitened(problem.menus[k], part) for k, part in runs_of(steps)]
    return invert_triangular(np.asarray(np.linalg.qr(np.concatenate((problem.start, *rows)), mode="r")))


def worth(problem: Problem, steps: Sequence[Step]) -> float:
    """Size of what is left to know after the steps: smaller is better."""
    spread = problem.aim.G @ root(problem, steps)
    return float(problem.aim.size(spread @ spread.T))
