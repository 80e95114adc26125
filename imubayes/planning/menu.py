"""What a test could be made of: a study's candidates as dwells, with their columns, noise and what they cost.

A dwell with constant inputs is one row, the mean over its time. The rows of a run are correlated by the
drift of the sensor, so that what a dwell tells depends on its place in the run, and the order matters. The
class gives the prior and the typical noise, the study the candidates, their costs and how well the bench is
known; runs that are done already give what is known beyond the prior.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import groupby, pairwise
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import invert_triangular, triangular
from imubayes.campaign.preparation import Prepared, component_prior, prepare
from imubayes.campaign.preparation import runs_of as runs_of_sensor
from imubayes.campaign.study import Mission, SensorSpec
from imubayes.errors import StudyError
from imubayes.inference.linear import Extra, Rows
from imubayes.inference.nuisances import extras_for, rows_with
from imubayes.inference.whiten import mattering, whiten
from imubayes.rig.bench import effective
from imubayes.rig.inputs import Run
from imubayes.rig.plans import Plan
from imubayes.rig.recordings import RunSpec
from imubayes.rig.sequences import menu_of
from imubayes.rig.simulate import PROFILES
from imubayes.sensors.catalogue import typical_noise
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
class PlanProblem:
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


def duration(problem: PlanProblem, steps: Sequence[Step]) -> float:
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
    return whiten(noise, Rows(t, lasting), np.eye(len(t)), parts)[0]


def root(problem: PlanProblem, steps: Sequence[Step]) -> FloatArray:
    """Root S (c, c) of the posterior covariance ``S S'`` after the steps, in units of the prior."""
    rows = [whitened(problem.menus[k], part) for k, part in runs_of(steps)]
    return invert_triangular(np.asarray(np.linalg.qr(np.concatenate((problem.start, *rows)), mode="r")))


def worth(problem: PlanProblem, steps: Sequence[Step]) -> float:
    """Size of what is left to know after the steps: smaller is better."""
    spread = problem.aim.G @ root(problem, steps)
    return float(problem.aim.size(spread @ spread.T))


What = Literal["worst", "D", "scene"]


@dataclass(frozen=True, slots=True, eq=False)
class Offer:
    """A run that could be made.

    Attributes
    ----------
    spec : of the run, with the profile and the arguments of its procedure.
    dwells : times that a dwell may take, s.
    rate : samples per second.
    handling : time that is no record.
    """

    spec: RunSpec
    dwells: tuple[float, ...]
    rate: float
    handling: Handling


@dataclass(frozen=True, slots=True, eq=False)
class PlanStudy:
    """A plan to make, as its file says.

    Attributes
    ----------
    title, seed : of the study.
    spec : of the sensor; its runs are done already.
    offers : runs that could be made.
    time : for all of them, s.
    aim : what to make small.
    needed : terms that the aim is about; empty for all that the candidates can tell.
    even : number of the offer whose even run the plan is held against.
    units : simulated to check the prediction.
    mission : scene and budget; None without.
    path, text : of the file.
    """

    title: str
    seed: int
    spec: SensorSpec
    offers: tuple[Offer, ...]
    time: float
    aim: What
    needed: tuple[str, ...]
    even: int
    units: int
    mission: Mission | None
    path: Path
    text: str


@dataclass(frozen=True, slots=True, eq=False)
class Bench:
    """Columns of terms and errors of the bench: names, prior sd (c,), p terms, and what is known of them.

    `known` (k, c) are rows in units of the prior, `menus` the candidates, `plans` their inputs.
    """

    names: tuple[str, ...]
    sd: FloatArray
    p: int
    known: FloatArray
    menus: tuple[Menu, ...]
    plans: tuple[Plan, ...]
    done: tuple[Run, ...]


def bench_columns(study: PlanStudy) -> Bench:
    """Columns of everything that could be done, and what is known already."""
    spec = study.spec
    given = [dict(offer.spec.simulate or {}) for offer in study.offers]
    plans = tuple(
        replace(menu_of(PROFILES[str(one.pop("profile"))], one), name=offer.spec.name)
        for offer, one in zip(study.offers, given, strict=True)
    )
    # a sensor without errors puts out its own input
    outputs = [plan.inputs.channels.get(spec.library.own, np.zeros(len(plan.inputs))) for plan in plans]
    runs = [Run(p.name, p.procedure, p.inputs, output) for p, output in zip(plans, outputs, strict=True)]
    done, ready = _done(study)
    kinds = {name: spec.reference[name] for name in effective(runs, spec.reference)}
    extras = extras_for(runs, kinds, sensor=spec.kind) if kinds else ()
    before = ready.summary.extras if ready else ()
    every: dict[str, Extra] = {extra.name: extra for extra in (*before, *extras)}
    prior = ready.prior.sd[: len(spec.library.terms)] if ready else component_prior(spec, runs)[0].sd
    names = (*spec.library.names, *every)
    sd = np.concatenate((prior, [extra.sd for extra in every.values()]))
    p, q = len(prior), len(extras)
    tables = rows_with(runs, spec.library, extras, np.zeros(p), np.zeros(q))
    here = [names.index(name) for name in (*spec.library.names, *(extra.name for extra in extras))]
    menus = tuple(
        _menu(study, offer, _spread(rows.columns(0, len(rows)), here, len(names)) * sd, plan)
        for offer, rows, plan in zip(study.offers, tables, plans, strict=True)
    )
    known = np.zeros((0, len(names)))
    if ready:
        f = ready.summary.factor
        known = _spread(f.R[:-1, :-1], [names.index(name) for name in f.names], len(names)) * sd
    return Bench(names, sd, p, known, menus, plans, done)


def _menu(study: PlanStudy, offer: Offer, X: FloatArray, plan: Plan) -> Menu:
    rule, sensor = offer.spec.noise, study.spec.sensor_class
    if rule.rule == "fixed" and rule.value is not None:
        noise = rule.value
    elif sensor is not None:
        noise = typical_noise(sensor)
    else:
        raise StudyError(
            f"sensor '{study.spec.id}': a plan needs the prior and the noise of a class: name one"
        )
    mount = np.zeros(len(X), dtype=np.int64) if plan.inputs.mount is None else plan.inputs.mount
    return Menu(offer.spec.name, X, mount, offer.dwells, offer.handling, noise, 1.0 / offer.rate)


def _done(study: PlanStudy) -> tuple[tuple[Run, ...], Prepared | None]:
    """Runs that are done, and what they say."""
    if not study.spec.runs:
        return (), None
    done = runs_of_sensor(study.spec, study.seed, 0)
    if any(run.of_case for run in done):
        raise StudyError(
            f"sensor '{study.spec.id}': a plan goes on from runs with known inputs, not a free tumble"
        )
    kinds = {name: study.spec.reference[name] for name in effective(done, study.spec.reference)}
    spec = replace(study.spec, reference=kinds)
    return done, prepare(spec, done, lambda message: None, np.random.default_rng([study.seed, 0]))


def _spread(rows: FloatArray, where: Sequence[int], width: int) -> FloatArray:
    """Rows with their columns at the given places of a wider table."""
    out = np.zeros((len(rows), width))
    out[:, where] = rows
    return out


def start_of(bench: Bench) -> FloatArray:
    """Triangular factor (c, c) of the prior and of what the runs that are done say, in units of the prior."""
    c = len(bench.sd)
    return triangular([np.concatenate((bench.known, np.eye(c)))], c)
