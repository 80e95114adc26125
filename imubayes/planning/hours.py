"""How long a class must be tested: the hours of its campaign after which each term is told.

The campaign is gone through in its order, dwell by dwell, and then again from its start with the case mounted
anew. What is known of a term after a while is its posterior sd under the whole library, which does not depend
on what the sensor will say. The rows are those of a unit's analysis where its coefficients are zero, under
the typical noise of the class: within a run flicker and random walk limit what a longer dwell tells, and each
run has a drift of its own. Errors of a mount and of a run are new ones whenever the campaign is repeated, and
average down; those of a machine or of the whole bench (``rate_scale``, ``radius``) are the same, and stay.

So a pass through the campaign, its own errors integrated out, is information I on the terms and the errors
that stay, and after n passes and a part of another one there is ``n I + I_part``, beside the prior.

A term is *told* from when on at least half of the units of the class get a verdict of their own
(`verdicts.decide`: needed or not needed); all of them together may show it sooner (`pooled`). Their
coefficients are drawn over the magnitudes that the catalogue gives the class. Of a coefficient theta, in
units of its prior sd, a posterior sd of r says ``x = theta + d e`` with ``1/d^2 = 1/r^2 - 1`` and e standard
normal. By itself and at even odds the term is then there with the probability ``B / (1 + B)``,
``B = r exp(m^2 / 2 r^2)``, of the posterior mean ``m = (1 - r^2) x``.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import expit, ndtr

from imubayes.algebra import FloatArray
from imubayes.algebra.factor import invert_triangular, triangular
from imubayes.campaign import SensorSpec
from imubayes.campaign.preparation import before_fit, rows_before
from imubayes.inference.dwells import pieces_of
from imubayes.inference.nuisances import shortens
from imubayes.population.lots import LotStudy, exposures
from imubayes.population.needs import HALF, SURE
from imubayes.rig.bench import kind_of
from imubayes.rig.inputs import Run
from imubayes.rig.simulate import plan_run
from imubayes.scenes.relevance import Exposure
from imubayes.selection.verdicts import TENTH, UNRESOLVED, Evidence, decide
from imubayes.sensors import SensorClass
from imubayes.sensors.catalogue import typical_noise
from imubayes.sensors.lots import draw_lot
from imubayes.work import Progress, silent

REACH = 10 * 86400.0
"""s; the longest test that is within reach."""

STEP = 1.02
"""Ratio of the times, at least, at which is asked what is known."""

UNITS = 2000
"""Units of a class, each of a lot of its own, whose verdicts are foreseen: their share is right to 1 %."""

LIMIT = 1.96
"""Posterior sds that a coefficient stays below with 95 % where its estimate is zero."""

RATIOS = np.geomspace(1e-3, UNRESOLVED, 80)
"""Posterior over prior sds at which verdicts are foreseen; beyond there is none."""

ESTIMATES = np.linspace(0.0, 8.0, 321)
"""Estimates at which verdicts are foreseen, in their own sds; the last ones have one at any ratio."""


@dataclass(frozen=True, slots=True, eq=False)
class Pass:
    """What a campaign tells as it goes on, in units of the prior.

    Attributes
    ----------
    stop, runs : (q,) end of each dwell since the campaign began, s, and the run that it belongs to.
    R : (q, c, c) triangular factors of all rows so far: of the errors that stay, then of the p terms.
    prior_sd : (p,) of the terms, SI.
    carriers : (p,) term whose column carries each term's coefficient: another one where they are tied.
    """

    stop: FloatArray
    runs: tuple[str, ...]
    R: FloatArray
    prior_sd: FloatArray
    carriers: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class TermHours:
    """How long one term of a class takes.

    Attributes
    ----------
    name : of the term.
    prior_sd : by the class, SI.
    enough : posterior over prior sd at which half of the units get a verdict.
    seconds : of test after which it is told; infinite beyond `REACH`.
    run : of the campaign in which that is; empty beyond.
    once, most : posterior over prior sd after the campaign, and after `REACH`.
    limit : size, SI, that it is known to stay below with 95 % after `REACH`, where its estimate is zero.
    share_of_budget, scene : largest share of a scene's budget that this takes, and where; NaN without scenes.
    """

    name: str
    prior_sd: float
    enough: float
    seconds: float
    run: str
    once: float
    most: float
    limit: float
    share_of_budget: float
    scene: str


@dataclass(frozen=True, slots=True, eq=False)
class ClassHours:
    """A class: s of its campaign, (name, s) of each run, and every term of the library."""

    sensor_class: SensorClass
    seconds: float
    runs: tuple[tuple[str, float], ...]
    terms: tuple[TermHours, ...]

    def told(self, seconds: float) -> int:
        """Count the terms that are told after some time."""
        return sum(term.seconds <= seconds for term in self.terms)


@dataclass(frozen=True, slots=True, eq=False)
class HoursFound:
    """The hours of every class of a study, and s of computing."""

    study: LotStudy
    classes: tuple[ClassHours, ...]
    seconds: float


def hours(study: LotStudy, *, progress: Progress = silent) -> HoursFound:
    """Find the hours after which each term of each class of a study is told.

    It is a `StudyError` if the options of a run make no run.
    """
    start = time.perf_counter()
    progress("scenes")
    exposed = exposures(study.missions, study.library)
    grades = []
    for k, spec in enumerate(study.specs):
        progress(f"{spec.id}, {k + 1} of {len(study.specs)} classes", k / len(study.specs))
        grades.append(_class_hours(study, k, exposed))
    return HoursFound(study, tuple(grades), time.perf_counter() - start)


def _class_hours(study: LotStudy, k: int, exposed: Sequence[Exposure]) -> ClassHours:
    entry, campaign = study.classes[k], campaign_pass(study.specs[k])
    rng = np.random.default_rng([study.seed, k, 2])
    units = [draw_lot(entry, study.library, 1, rng).theta for _ in range(UNITS)]
    enough = ratio_enough(np.concatenate(units) / campaign.prior_sd)
    times, runs, ratios = known(campaign)
    ends = dict(zip(campaign.runs, campaign.stop.tolist(), strict=True))
    limits = LIMIT * ratios[-1] * campaign.prior_sd
    shares = np.array([seen.budgeted.single(limits) / seen.budget.limit for seen in exposed])
    once = posterior_ratios(campaign, 1)

    def term(j: int, name: str) -> TermHours:
        first = int(np.argmax(ratios[:, j] <= enough[j]))
        told = bool(ratios[first, j] <= enough[j])
        worst = int(np.argmax(shares[:, j])) if exposed else 0
        return TermHours(
            name=name,
            prior_sd=float(campaign.prior_sd[j]),
            enough=float(enough[j]),
            seconds=float(times[first]) if told else math.inf,
            run=runs[first] if told else "",
            once=float(once[j]),
            most=float(ratios[-1, j]),
            limit=float(limits[j]),
            share_of_budget=float(shares[worst, j]) if exposed else math.nan,
            scene=study.missions[worst].name if exposed else "",
        )

    lasting = np.diff([0.0, *ends.values()]).tolist()
    terms = tuple(term(j, name) for j, name in enumerate(study.library.names))
    return ClassHours(entry, float(campaign.stop[-1]), tuple(zip(ends, lasting, strict=True)), terms)


def campaign_pass(spec: SensorSpec) -> Pass:
    """Go through the campaign of a class once, dwell by dwell."""
    if spec.sensor_class is None:
        raise ValueError("the campaign of a class has one")
    plans = [plan_run(run) for run in spec.runs]
    runs = [Run(plan.name, plan.procedure, plan.inputs, np.zeros(len(plan.inputs))) for plan in plans]
    rows, prior, extras = rows_before(spec, runs)
    if shortens(extras):
        ready = before_fit(spec, runs)
        rows, prior, extras = ready.rows, ready.prior, ready.summary.extras
    p, noise = len(spec.library.terms), typical_noise(spec.sensor_class)
    passing = np.array([kind_of(extra.kind).each in ("mount", "run") for extra in extras], dtype=bool)
    order = np.concatenate((p + np.flatnonzero(passing), p + np.flatnonzero(~passing), np.arange(p)))
    sd, own = prior.sd[order], int(passing.sum())
    # the prior of the errors that pass, which are then integrated out; that of all else is added in the end
    R = np.diag(np.arange(len(order)) < own).astype(float)
    stop, names, factors, begin = list[float](), list[str](), list[FloatArray](), 0.0
    for part in rows:
        dwells = pieces_of(part, noise)
        for end, piece in zip(dwells.stop.tolist(), dwells.R, strict=True):
            R = triangular((np.concatenate((R, piece[:, order] * sd)),), len(order))
            stop.append(begin + end - float(dwells.start[0]))
            factors.append(R[own:, own:])
            names.append(part.name)
        begin = stop[-1]
    carriers = tuple(spec.library.names.index(name) for name in spec.library.carriers)
    return Pass(np.array(stop), tuple(names), np.array(factors), prior.sd[list(carriers)], carriers)


def posterior_ratios(campaign: Pass, passes: int, dwell: int = -1) -> FloatArray:
    """Posterior over prior sd (p,) after so many passes, the last one up to a dwell, by default all of it."""
    last, whole = campaign.R[dwell], campaign.R[-1]
    c = whole.shape[1]
    R = triangular((np.concatenate((math.sqrt(passes - 1) * whole, last, np.eye(c))),), c)
    ratios = np.linalg.norm(invert_triangular(R), axis=1)[c - len(campaign.carriers) :]
    return ratios[list(campaign.carriers)]


def known(campaign: Pass) -> tuple[FloatArray, tuple[str, ...], FloatArray]:
    """What is known as the campaign is repeated until `REACH`.

    Returns
    -------
    (m,) times, s, each 2 % later than the one before or more; the run at each; and posterior over prior sd
    (m, p).
    """
    whole, last = float(campaign.stop[-1]), 0.0
    limits = list[tuple[float, str, FloatArray]]()
    for passes in range(1, math.ceil(REACH / whole) + 1):
        for dwell, (stop, run) in enumerate(zip(campaign.stop.tolist(), campaign.runs, strict=True)):
            at = (passes - 1) * whole + stop
            if STEP * last <= at <= REACH:
                limits.append((at, run, posterior_ratios(campaign, passes, dwell)))
                last = at
    times, runs, ratios = zip(*limits, strict=True)
    return np.array(times), runs, np.array(ratios)


def ratio_enough(theta: FloatArray) -> FloatArray:
    """Posterior over prior sd (p,) at which half of the units get a verdict.

    Parameters
    ----------
    theta : (m, p) their coefficients, in units of the prior sd.

    Examples
    --------
    >>> theta = np.random.default_rng(1).standard_normal((4000, 1))
    >>> bool(0.2 < ratio_enough(theta)[0] < 0.25), bool(ratio_enough(10.0 * theta)[0] > 0.8)
    (True, True)
    """
    shares = np.array([_with_verdict(float(ratio), theta) for ratio in RATIOS])
    falling = np.minimum.accumulate(shares).T
    return np.array([np.exp(np.interp(-HALF, -own, np.log(RATIOS))) for own in falling])


def _with_verdict(ratio: float, theta: FloatArray) -> FloatArray:
    """Share (p,) of the units that get a verdict, whose coefficients are `theta` (m, p) in prior sds."""
    d = ratio / math.sqrt(1.0 - ratio**2)
    x, mean, pull = d * ESTIMATES, d * (1.0 - ratio**2) * ESTIMATES, math.sqrt(1.0 - ratio**2) * ESTIMATES
    there = expit(0.5 * pull**2 + math.log(ratio))
    small = 1.0 - there + there * (ndtr((TENTH - mean) / ratio) - ndtr((-TENTH - mean) / ratio))
    evidence = zip(there.tolist(), small.tolist(), pull.tolist(), strict=True)
    open_ = [
        at
        for at, (q, tenth, z) in zip(x.tolist(), evidence, strict=True)
        if decide(Evidence(q, (q, q), tenth, ratio, z, (), "", z))[0] not in SURE
    ]
    if not open_:
        return np.ones(theta.shape[1])
    inside = [ndtr((end - theta) / d) - ndtr((-end - theta) / d) for end in (open_[0], open_[-1])]
    return 1.0 - (inside[1] - inside[0]).mean(axis=0)
