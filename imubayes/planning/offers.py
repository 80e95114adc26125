"""What a study offers to a plan, as menus: columns, noise and handling of what a bench or a hand could do.

The class gives the prior and the typical noise, the study the candidates, their costs and how well the bench
is known; runs that are done already give what is known beyond the prior. On a bench each component sees the
settings along its own axes. In the hand only |f| = g is known: of an unknown attitude the rows of a still
that it moves are left out, which leaves one, along gravity; gyroscopes tell their bias at rest, and on the
way from still to still what turns the one direction into the other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.algebra.factor import triangular
from imubayes.campaign import Mission, SensorSpec
from imubayes.campaign.preparation import before_tumble, libraries_of, prepare, prepare_case, rows_before
from imubayes.campaign.preparation import runs_of as runs_of_sensor
from imubayes.campaign.prepared import Prepared, unstated
from imubayes.errors import Place, StudyError
from imubayes.inference.between_stills import directions, rest_rows, turn_rows
from imubayes.inference.free_tumble import norm_rows
from imubayes.inference.linear import Extra, Linear
from imubayes.inference.nuisances import shortened, shortens
from imubayes.inference.triad import triad_of
from imubayes.planning import Menu, PlanProblem, Signal, Step, root
from imubayes.rig.bench import effective
from imubayes.rig.inputs import Inputs, Run, case_inputs
from imubayes.rig.plans import Plan
from imubayes.rig.recordings import FREE_TUMBLE
from imubayes.rig.sequences import menu_of
from imubayes.rig.simulate import PROFILES
from imubayes.rig.tumbles import held_in_turn
from imubayes.sensors.catalogue import typical_noise
from imubayes.sensors.noise import Noise
from imubayes.sensors.terms import Kind, Library, Term
from imubayes.work import silent

STEPS_OF_TURN = 16
"""Samples of a turn from which its columns are made: its rates are as good as smooth."""


@dataclass(frozen=True, slots=True, eq=False)
class PlanStudy:
    """A plan to make, as its file says.

    Attributes
    ----------
    spec, offered : of the sensor, with the runs that are done already, and with those that could be made.
    offers : a menu for each of these, which has no signals yet; in the hand the time to settle is that of
        the turn before a still.
    time : for all of them, s.
    aim : what to make small.
    needed : terms that the aim is about; empty for all that the candidates can tell.
    even : number of the offer whose even run the plan is held against.
    units : simulated to check the prediction.
    """

    title: str
    seed: int
    spec: SensorSpec
    offered: SensorSpec
    offers: tuple[Menu, ...]
    time: float
    aim: Literal["worst", "D", "scene"]
    needed: tuple[str, ...]
    even: int
    units: int
    mission: Mission | None
    path: Path
    text: str

    @property
    def libraries(self) -> Mapping[str, Library]:
        """Candidates of each component, as `libraries_of` has them."""
        return libraries_of(self.offered)

    @property
    def terms(self) -> Mapping[str, Term]:
        """Terms by the names of their columns."""
        return {
            named(component, term.name): term
            for component, lib in self.libraries.items()
            for term in lib.terms
        }

    @property
    def carriers(self) -> Mapping[str, str]:
        """Column that carries each column's coefficient, where that is another."""
        return {
            named(component, name): named(component, leader)
            for component, lib in self.libraries.items()
            for name, leader in lib.tied
        }


def named(component: str, term: str) -> str:
    """Name of a term's column: ``ax.b0`` in a case, ``b0`` of a single component."""
    return f"{component}.{term}" if component else term


@dataclass(frozen=True, slots=True, eq=False)
class PlanColumns:
    """Columns of terms, then of errors of the bench: names, prior sd (c,), and what is known of them.

    `known` (k, c) are rows in units of the prior, `menus` the candidates, `plans` their inputs.
    """

    names: tuple[str, ...]
    sd: FloatArray
    known: FloatArray
    menus: tuple[Menu, ...]
    plans: tuple[Plan, ...]
    done: tuple[Run, ...]

    @property
    def start(self) -> FloatArray:
        """Triangular factor (c, c) of the prior and of what the runs that are done say, in its units."""
        c = len(self.sd)
        return triangular([np.concatenate((self.known, np.eye(c)))], c)

    @property
    def ratio(self) -> FloatArray:
        """Posterior over prior sd (c,) after all that could be done, each setting for its longest dwell."""
        every = [Step(m, k, max(menu.dwells)) for m, menu in enumerate(self.menus) for k in range(len(menu))]
        whole = PlanProblem(self.menus, self.start, "D", np.eye(len(self.sd)), np.inf)
        return np.linalg.norm(root(whole, tuple(every)), axis=1)


Told = tuple[Signal, tuple[str, ...]]
"""A signal with columns in SI, and their names."""

Offered = tuple[Sequence[Sequence[Told]], FloatArray, tuple[Extra, ...]]
"""Signals of each offer, prior sd of the terms, and errors of the bench."""


def bench_columns(study: PlanStudy) -> PlanColumns:
    """Columns of everything that could be done, and what is known already."""
    plans = list[Plan]()
    for k, run in enumerate(study.offered.runs):
        options = dict(run.simulate or {})
        with Place(str(study.path)).at("plan", "run", k, "candidates").blamed():
            menu = menu_of(PROFILES[str(options.pop("profile"))], options)
        plans.append(replace(menu, name=run.name))
    known = _done(study)
    if study.offered.runs[0].procedure == FREE_TUMBLE:
        return _columns(study, plans, _in_hand(study, plans), known)
    *_, extras = offered = _on_bench(study, plans)
    bench = _columns(study, plans, offered, known)
    if study.offered.gyroscope or not shortens(extras):
        return bench
    left = (bench.ratio * bench.sd)[[bench.names.index(extra.name) for extra in extras]] ** 2
    return _columns(study, plans, _on_bench(study, plans, shortened(plans, extras, left)), known)


def _columns(
    study: PlanStudy, plans: Sequence[Plan], offered: Offered, known: tuple[tuple[Run, ...], Prepared | None]
) -> PlanColumns:
    """What is offered over the columns of all, in units of the prior, beside what is known."""
    (signals, sd, extras), (done, ready) = offered, known
    before = ready.summary.extras if ready else ()
    every: dict[str, Extra] = {extra.name: extra for extra in (*before, *extras)}
    prior = ready.prior.sd[: len(study.terms)] if ready else sd
    names = (*study.terms, *every)
    sd = np.concatenate((prior, [extra.sd for extra in every.values()]))
    menus = tuple(
        replace(
            offer,
            signals=tuple(_over(signal, [names.index(name) for name in own], sd) for signal, own in told),
            mount=plan.inputs.mounts,
        )
        for offer, plan, told in zip(study.offers, plans, signals, strict=True)
    )
    f = ready.summary.factor if ready else None
    rows = np.zeros((f.p if f else 0, len(names)))
    if f:
        rows[:, [names.index(name) for name in f.names]] = f.R[:-1, :-1]
    return PlanColumns(names, sd, rows * sd, menus, tuple(plans), done)


def _on_bench(study: PlanStudy, plans: Sequence[Plan], extras: tuple[Extra, ...] | None = None) -> Offered:
    """What a bench offers; its errors are those of the study's reference, if none are given."""
    whole = study.offered.gyroscope is not None
    runs = [
        Run(plan.name, plan.procedure, case_inputs(plan.inputs), np.zeros((len(plan.inputs), 6)))
        if whole
        else Run(plan.name, plan.procedure, plan.inputs, np.zeros(len(plan.inputs)))
        for plan in plans
    ]
    spec = _allowing(study.offered, [run.component("ax") for run in runs] if whole else runs)
    rows, prior, extras = rows_before(spec, runs, extras)
    kinds: list[Kind] = [lib.kind for lib in study.libraries.values()]
    told = [
        [
            (Signal(part.X, _noise(study, k, kind)), part.names)
            for kind, part in zip(kinds, rows[k :: len(runs)], strict=True)
        ]
        for k in range(len(runs))
    ]
    return told, prior.sd[: len(study.terms)], extras


def _allowing(spec: SensorSpec, runs: Sequence[Run]) -> SensorSpec:
    """What is asked of a sensor, with those errors of the bench that its runs can show."""
    kinds = {name: spec.reference[name] for name in effective(runs, spec.reference)}
    if spec.gyroscope is None:
        return replace(spec, reference=kinds or unstated(spec, runs))
    beside = _allowing(spec.gyroscope, runs)
    return replace(spec, reference=kinds, gyroscope=beside)


def _in_hand(study: PlanStudy, plans: Sequence[Plan]) -> Offered:
    """What a hand offers; of the bench there is the error of gravity."""
    sd, extras = before_tumble(study.offered)
    return [list(_held(study, k, plan, extras)) for k, plan in enumerate(plans)], sd, extras


def _held(study: PlanStudy, offer: int, plan: Plan, extras: tuple[Extra, ...]) -> list[Told]:
    """Signals of stills, and of the turns from each attitude to each, at coefficients that are zero."""
    spec, force = study.offered, plan.inputs.vectors("f")
    m, g = len(force), float(np.linalg.norm(force[0]))
    stills = tuple((k, k + 1) for k in range(m))
    once, said = Inputs(np.arange(m, dtype=float), {}, 1.0), np.hstack((force, np.zeros((m, 3))))
    run = Run(plan.name, FREE_TUMBLE, once, said, gravity=g, stills=stills)
    accelerometers, noise = triad_of(spec.library), _noise(study, offer, spec.kind)
    norms = norm_rows(accelerometers, run, extras)
    told = [(Signal(norms.X, noise, norms.axes), norms.names)]
    if spec.gyroscope is None:
        return told
    gyroscopes = triad_of(spec.gyroscope.library, referenced=True)
    drift = _noise(study, offer, spec.gyroscope.kind)
    seen = directions(accelerometers, run)
    told += [(Signal(rows.X, drift), rows.names) for rows in rest_rows(seen, gyroscopes)]
    # a way from each attitude to each, and in between from where it ends to where the next begins
    ways = np.stack(np.meshgrid(np.arange(m), np.arange(m), indexing="ij"), axis=-1).reshape(-1)
    times, n = study.offers[offer], len(ways)
    step = times.settle / STEPS_OF_TURN
    beside = round(0.5 * times.lost / step)  # samples at rest at both ends of a turn
    inputs = held_in_turn(
        force[ways], np.full(n, (2 * beside + 2) * step), np.full(n - 1, times.settle), 1.0 / step
    )
    whole = np.hstack([inputs.vectors(quantity) for quantity in "fw"])
    begin = np.arange(n) * (STEPS_OF_TURN + 2 * beside + 2) + beside
    between = tuple((k, k + 2) for k in begin.tolist())
    moving = Run(plan.name, FREE_TUMBLE, Inputs(inputs.t, {}, step), whole, gravity=g, stills=between)
    rows = turn_rows(directions(accelerometers, moving), gyroscopes, noises=(noise, drift))
    return [*told, (_turning(rows, noise, drift, g), rows.names)]


def _turning(rows: Linear, noise: Noise, drift: Noise, gravity: float) -> Signal:
    """Turns from each attitude to each: every other one of those that lead through all of them."""
    kept = np.arange(len(rows)) // 2 % 2 == 0
    ends = Noise(noise.N / gravity, noise.B / gravity, 0.0)
    axes = np.asarray(rows.axes)[kept]
    return Signal(rows.X[kept], drift, axes, ends)


def _noise(study: PlanStudy, offer: int, kind: Kind) -> Noise:
    """Noise of components of a kind in an offer: as the study says, or typical of the class."""
    spec = study.offered.of(kind)
    rule = spec.runs[offer].noise
    if rule.rule == "fixed" and rule.value is not None:
        return rule.value
    if spec.sensor_class is None:
        raise StudyError(f"sensor '{spec.id}': a plan needs the prior and the noise of a class: name one")
    return typical_noise(spec.sensor_class)


def _done(study: PlanStudy) -> tuple[tuple[Run, ...], Prepared | None]:
    """Runs that are done, and what they say."""
    if not study.spec.runs:
        return (), None
    done, rng = runs_of_sensor(study.spec, study.seed, 0), np.random.default_rng([study.seed, 0])
    if done[0].of_case:
        return done, prepare_case(study.spec, done, rng)[1]
    return done, prepare(_allowing(study.spec, done), done, silent, rng)


def _over(signal: Signal, places: Sequence[int], sd: FloatArray) -> Signal:
    """A signal over those of its columns that say anything, in units of the prior, at these places."""
    seen = signal.X.any(axis=0)
    columns = np.array(places)[seen]
    return replace(signal, X=signal.X[:, seen] * sd[columns], columns=columns)
