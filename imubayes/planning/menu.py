"""What could be tested: a study's candidates become columns, beside what is known of them already.

The class gives the prior and the typical noise, the study the candidates, what they cost and how well the
bench is known; runs that are done already give what is known beyond the prior.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import triangular
from imubayes.campaign.preparation import Prepared, component_prior, prepare
from imubayes.campaign.preparation import runs_of as runs_of_sensor
from imubayes.campaign.study import Mission, SensorSpec
from imubayes.errors import StudyError
from imubayes.inference.linear import Extra
from imubayes.inference.nuisances import extras_for, rows_with
from imubayes.planning.candidates import Handling, Menu
from imubayes.rig.bench import effective
from imubayes.rig.inputs import Run
from imubayes.rig.plans import Plan
from imubayes.rig.recordings import RunSpec
from imubayes.rig.runs import PROFILES
from imubayes.rig.sequences import menu_of
from imubayes.sensors.catalogue import typical_noise

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
    plans = tuple(replace(_candidates(offer), name=offer.spec.name) for offer in study.offers)
    runs = [Run(plan.name, plan.procedure, plan.inputs, own_input(plan, spec)) for plan in plans]
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


def own_input(plan: Plan, spec: SensorSpec) -> FloatArray:
    """Input along the input axis, (n,), SI: the output of a sensor without errors."""
    return plan.inputs.channels.get(spec.library.own, np.zeros(len(plan.inputs)))


def _candidates(offer: Offer) -> Plan:
    given = dict(offer.spec.simulate or {})
    return menu_of(PROFILES[str(given.pop("profile"))], given)


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
    found = runs_of_sensor(study.spec, study.seed, 0)
    done = tuple(run for run in found if isinstance(run, Run))
    if len(done) < len(found):
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
