"""What to test, before it is tested: the best plan from a study's candidates, and what it is held against."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.algebra.factor import Factor, solve_triangular, triangular
from imubayes.errors import UnobservableError
from imubayes.inference.linear import Rows
from imubayes.inference.observability import Observability, carried, observe
from imubayes.inference.whiten import whiten
from imubayes.planning import (
    Aim,
    Menu,
    PlanProblem,
    Signal,
    Step,
    Steps,
    duration,
    root,
    runs_of,
    settings_of,
    starts,
    turns_of,
    whitened,
    worth,
)
from imubayes.planning.exchange import best_plan, even_plan, following
from imubayes.planning.offers import PlanColumns, PlanStudy, bench_columns
from imubayes.rig.bench import effective
from imubayes.rig.inputs import Facts, case_inputs, facts_of
from imubayes.rig.plans import Plan
from imubayes.rig.recordings import FREE_TUMBLE, RunSpec
from imubayes.rig.sequences import Setting
from imubayes.rig.sequences import settings_of as words_of
from imubayes.rig.simulate import synthesise
from imubayes.scenes.relevance import MATTERS, Exposure, exposure
from imubayes.sensors.imu import own_channels
from imubayes.sensors.noise import Noise
from imubayes.units import STANDARD_GRAVITY
from imubayes.work import Progress, part_of, silent

SEEN = 0.5
"""Posterior over prior sd below which all candidates together tell a term."""

NEXT = 6
"""Next dwells that are told."""

INTERVAL, FEWEST = 5.0, 8
"""s; averaging time of a simulated sample; and samples in a dwell, at least."""


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """What a plan would tell.

    Attributes
    ----------
    steps, seconds, size_of_aim : of the plan, its time, and the size of the aim; smaller is better.
    sd : (p,) predicted posterior sd of each term, SI.
    simulated : (p,) root mean square error over simulated units, SI.
    share_of_budget : predicted rms effect of what is not known in the scene; NaN without one.
    seen : what it can tell of each term and error of the bench.
    """

    steps: Steps
    seconds: float
    size_of_aim: float
    sd: FloatArray
    simulated: FloatArray
    share_of_budget: float
    seen: Observability


@dataclass(frozen=True, slots=True, eq=False)
class Proposal:
    """A plan, and what it is held against.

    Attributes
    ----------
    study : that asked.
    prior_sd, known_sd : (p,) sd of each term by the class, and with the runs that are done, SI.
    need : (p,) sd that the scene needs, SI; infinite for a term that it does not drive, and without a scene.
    needed : terms that the aim is about.
    menus, settings : of each offer, and words for each setting of it.
    outcomes : of going evenly through a run (``even``), of the best plan with that run alone (``same``, where
        several are offered) and of the best one (``best``).
    following : (dwell, time in s, worth) of the best next dwells after what is done.
    shown : kinds of errors of the bench that are allowed for and act on the best plan, or on what is done.
    seconds : of computing.
    """

    study: PlanStudy
    prior_sd: FloatArray
    known_sd: FloatArray
    need: FloatArray
    needed: tuple[str, ...]
    menus: tuple[Menu, ...]
    settings: tuple[tuple[Setting, ...], ...]
    outcomes: Mapping[str, Outcome]
    following: tuple[tuple[Step, float, float], ...]
    shown: tuple[str, ...]
    seconds: float

    @property
    def even(self) -> Outcome:
        """What the best plan is held against."""
        return self.outcomes["even"]

    @property
    def best(self) -> Outcome:
        """Of the best plan."""
        return self.outcomes["best"]

    def words(self, step: Step) -> tuple[str, str, str]:
        """Run, mount, and what the rig is set to in a step."""
        setting = self.settings[step.menu][step.setting]
        return self.menus[step.menu].run, *setting

    def worst(self, outcome: Outcome) -> tuple[str, float]:
        """Needed term with the largest predicted sd over its need (without a scene: over its prior sd)."""
        limit = self.need if np.isfinite(self.need).any() else self.prior_sd
        ratios = zip(self.study.terms, (outcome.sd / limit).tolist(), strict=True)
        return max((pair for pair in ratios if pair[0] in self.needed), key=lambda pair: pair[1])


def propose(study: PlanStudy, *, progress: Progress = silent) -> Proposal:
    """Find the best plan within the time.

    It is an `InputError` if the candidates tell nothing of a needed term, or the time is too short.
    """
    start = time.perf_counter()
    progress("candidates")
    bench = bench_columns(study)
    needed = _needed(study, bench)
    asked, lib = study.mission, study.spec.library
    scene = exposure(asked.scene, lib, asked.budget, axis=asked.axis) if asked else None
    need = _need(study, scene)
    problem = _problem(study, bench, needed, need, scene)
    plans = _plans(problem, study.even, progress)
    outcomes: dict[str, Outcome] = {}
    for k, (name, steps) in enumerate(plans.items()):
        progress(f"{study.units} simulated units of plan '{name}'", k / len(plans))
        outcomes[name] = _outcome(steps, study, bench, problem, scene)
    return Proposal(
        study=study,
        prior_sd=bench.sd[: len(study.terms)],
        known_sd=_sd(study, bench, root(problem, ())),
        need=need,
        needed=needed,
        menus=bench.menus,
        settings=tuple(map(partial(_words, study), bench.plans, study.offered.runs)),
        outcomes=outcomes,
        following=following(problem, NEXT),
        shown=_shown(study, bench, plans["best"]),
        seconds=time.perf_counter() - start,
    )


def _shown(study: PlanStudy, bench: PlanColumns, steps: Steps) -> tuple[str, ...]:
    """Kinds of errors that act on a plan's runs, or on those that are done; in the hand all of them."""
    kinds = study.offered.reference
    if study.offered.runs[0].procedure == FREE_TUMBLE:
        return tuple(kinds)
    done = [run.component("ax") for run in bench.done] if study.offered.gyroscope else bench.done
    return effective([*done, *(bench.plans[k] for k, _ in runs_of(steps))], kinds)


def _words(study: PlanStudy, plan: Plan, run: RunSpec) -> tuple[Setting, ...]:
    """Words for each setting; the axes of a case are x, y, z."""
    letters = str.maketrans("ijk", "ijk" if "" in study.libraries else "xyz")
    said = words_of(plan, run.simulate or {})
    return tuple((mount.translate(letters), at.translate(letters)) for mount, at in said)


def _plans(problem: PlanProblem, offer: int, tell: Progress) -> dict[str, Steps]:
    """Going evenly through an offer, the best plan with it alone, and the best plan, which beats both."""
    even, searches = even_plan(problem, offer), min(len(problem.menus), 2)
    best = best_plan(problem, tell=part_of(tell, 0, searches, "the best plan: ")).steps
    if worth(problem, even) < worth(problem, best):
        best = best_plan(
            problem, [even], part_of(tell, 0, searches, "the best plan, from the even one: ")
        ).steps
    if len(problem.menus) == 1:
        return {"even": even, "best": best}
    alone = (menu if k == offer else replace(menu, dwells=()) for k, menu in enumerate(problem.menus))
    told = part_of(tell, 1, searches, "the best plan with the same equipment: ")
    same = best_plan(replace(problem, menus=tuple(alone)), [even], told).steps
    return {"even": even, "same": same, "best": min(best, same, key=lambda steps: worth(problem, steps))}


def _needed(study: PlanStudy, bench: PlanColumns) -> tuple[str, ...]:
    """Terms that the aim is about: as the study says, or all that the candidates together can tell."""
    seen = tuple(name for name, r in zip(study.terms, bench.ratio, strict=False) if r < SEEN)
    rows = [signal.wide(signal.X, len(bench.sd)) for menu in bench.menus for signal in menu.signals]
    idle = np.abs(np.concatenate((bench.known, *rows))).max(axis=0) == 0.0
    asked = tuple(dict.fromkeys(study.carriers.get(name, name) for name in study.needed))
    lost = tuple(name for name in asked if idle[bench.names.index(name)])
    if lost or not seen:
        raise UnobservableError(
            f"no candidate drives {', '.join(lost) or 'any term beyond its prior'}: offer a run that does"
            " ('imubayes check' tells which), or leave the term out of needed",
            lost,
        )
    return asked or seen


def _of_terms(study: PlanStudy, columns: FloatArray) -> FloatArray:
    """What is known (c,) of the columns, of each term (p,): of that which carries its coefficient."""
    names, carriers = list(study.terms), study.carriers
    return columns[[names.index(carriers.get(name, name)) for name in names]]


def _sd(study: PlanStudy, bench: PlanColumns, S: FloatArray) -> FloatArray:
    return _of_terms(study, np.linalg.norm(S, axis=1) * bench.sd)


def _need(study: PlanStudy, scene: Exposure | None) -> FloatArray:
    """Sd (p,) of each term at which its effect is a tenth of the budget."""
    p = len(study.terms)
    if scene is None:
        return np.full(p, np.inf)
    single = scene.budgeted.single(np.ones(p))
    return np.divide(MATTERS * scene.budget.limit, single, out=np.full(p, np.inf), where=single > 0.0)


def _problem(
    study: PlanStudy, bench: PlanColumns, needed: tuple[str, ...], need: FloatArray, scene: Exposure | None
) -> PlanProblem:
    """PlanProblem with the study's aim."""
    where = [bench.names.index(name) for name in needed]
    G = np.eye(len(bench.sd))[where]
    aim: Aim = "D" if study.aim == "D" else "worst"
    if study.aim == "worst" and scene:
        driven = [k for k in where if np.isfinite(need[k])]
        G = np.eye(len(bench.sd))[driven] * bench.sd / need[driven][:, None]
    if study.aim == "scene" and scene:
        G = _in_scene(bench, scene)
        aim = "worst" if scene.budgeted.components else "rms"
        if scene.budgeted.components:  # a plan is sought over the first draw, and judged over all
            G = G[: len(G) // len(scene.scene.draws)]
    return PlanProblem(bench.menus, bench.start, aim, G, study.time)


def _in_scene(bench: PlanColumns, scene: Exposure) -> FloatArray:
    """Rows (q, c) of the error in a scene, over its budget."""
    terms = scene.budgeted.rows
    rows = terms * bench.sd[: terms.shape[1]] / scene.budget.limit
    return np.pad(rows, ((0, 0), (0, len(bench.sd) - terms.shape[1])))


def _outcome(
    steps: Steps, study: PlanStudy, bench: PlanColumns, problem: PlanProblem, scene: Exposure | None
) -> Outcome:
    S, share = root(problem, steps), math.nan
    errors = rehearsed(problem, steps, study.units, np.random.default_rng([study.seed, 1]))
    if scene:
        share = float(scene.budgeted.sized(np.linalg.norm(_in_scene(bench, scene) @ S, axis=1)))
    return Outcome(
        steps=steps,
        seconds=duration(problem, steps),
        size_of_aim=worth(problem, steps),
        sd=_sd(study, bench, S),
        simulated=_of_terms(study, np.sqrt(np.mean(errors**2, axis=0)) * bench.sd),
        share_of_budget=share,
        seen=_seen(study, bench, steps),
    )


def _seen(study: PlanStudy, bench: PlanColumns, steps: Steps) -> Observability:
    """What the plan can tell, with the runs that are done."""
    c = len(bench.sd)
    rows = [whitened(bench.menus[k], part, c) for k, part in runs_of(steps)]
    R = triangular([np.concatenate((bench.known, *rows, np.zeros((1, c))))], c) / bench.sd
    chosen = [
        signal.wide(signal.X[signal.places(settings_of(part))], c)
        for k, part in runs_of(steps)
        for signal in bench.menus[k].signals
    ]
    reach = np.abs(np.concatenate((*chosen, bench.known))).max(axis=0) / bench.sd
    largest = dict(zip(bench.names, reach.tolist(), strict=True))
    factor, components = Factor(bench.names, np.pad(R, ((0, 1), (0, 1))), len(steps)), list(study.libraries)
    seen = {
        component: observe(factor, bench.sd, _facts(study, bench, steps, component), reach=largest)
        for component in components
    }

    def of(terms: Sequence[str]) -> str:
        """Component whose inputs say why terms are not told apart: the first among them."""
        heads = [term.partition(".")[0] for term in terms]
        return next((head for head in heads if head in seen), components[0])

    groups = [group for name, own in seen.items() for group in own.groups if of(group.terms) == name]
    return carried(replace(seen[components[0]], groups=tuple(groups)), study.carriers)


def _facts(study: PlanStudy, bench: PlanColumns, steps: Steps, component: str) -> Facts:
    """What the inputs of a component have in common."""
    kind = study.libraries[component].kind
    if study.offered.runs[0].procedure == FREE_TUMBLE:
        return Facts(kind, one_sided=False, force=STANDARD_GRAVITY, reference_free=True)
    channels = [(run.component(component) if component else run).inputs.channels for run in bench.done]
    for k, part in runs_of(steps):
        inputs, where = bench.plans[k].inputs, settings_of(part)
        own = own_channels(case_inputs(inputs).channels, component) if component else inputs.channels
        channels.append({name: values[where] for name, values in own.items()})
    return facts_of(channels, kind)


def rehearsed(problem: PlanProblem, steps: Steps, units: int, rng: np.random.Generator) -> FloatArray:
    """Errors (units, c) of the estimates of a plan, carried out sample by sample, in units of the prior.

    Units and benches are drawn from the prior. Every noise process of every run is drawn sample by sample;
    samples, and not the means of dwells that a plan is weighed by, are whitened and fitted. What was known
    before counts as drawn with the prior.
    """
    c = len(problem.start)
    truth = solve_triangular(problem.start, rng.standard_normal((c, units)))
    tables = [np.column_stack((problem.start, np.zeros((c, units))))]
    tables += [
        _rehearse(problem.menus[k], signal, part, truth, rng)
        for k, part in runs_of(steps)
        for signal in problem.menus[k].signals
    ]
    R = np.asarray(np.linalg.qr(np.concatenate(tables), mode="r"))
    return (solve_triangular(R[:c, :c], R[:c, c:]) - truth).T


def _rehearse(
    menu: Menu, signal: Signal, steps: Steps, truth: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """Triangle of the whitened rows ``[X y ...]`` of a signal in a run, with a response for each unit."""
    where = signal.places(settings_of(steps))
    if signal.ends is not None:
        rows, each = turns_of(menu, signal, steps), np.arange(len(where))
    else:
        lost = menu.lost
        interval = min(INTERVAL, (min(step.dwell for step in steps) - lost) / FEWEST)
        counts = [int((step.dwell - lost) / interval) for step in steps]
        begin = starts([menu], [step._replace(menu=0) for step in steps]).tolist()
        within = [start + interval * (0.5 + np.arange(n)) for start, n in zip(begin, counts, strict=True)]
        each = np.repeat(np.arange(len(steps)), counts)
        axes = None if signal.axes is None else signal.axes[where][each]
        rows = Rows(np.concatenate(within), np.full(len(each), interval), axes)
    X = signal.X[where[each]]
    noise = np.column_stack([_drawn(signal.noise, rows, rng) for _ in range(truth.shape[1])])
    table = np.ascontiguousarray(np.column_stack((X, X @ truth[signal.columns] + noise)))
    R, s = np.asarray(np.linalg.qr(whiten(signal.noise, rows, table)[0], mode="r")), X.shape[1]
    return np.column_stack((signal.wide(R[:, :s], len(truth)), R[:, s:]))


def _drawn(noise: Noise, rows: Rows, rng: np.random.Generator) -> FloatArray:
    """Noise (n,) of rows, every process of each component drawn by itself."""
    t, first, place = np.unique(rows.t, return_index=True, return_inverse=True)
    lasting = rows.duration[first]
    if rows.axes is None:
        return synthesise(noise, t, float(lasting[0]), rng)
    usual, drift = float(np.median(lasting)), replace(noise, N=0.0)
    white = noise.N / np.sqrt(lasting)
    each = [
        synthesise(drift, t, usual, rng) + white * rng.standard_normal(len(t))
        for _ in range(rows.axes.shape[1])
    ]
    return np.einsum("na,an->n", rows.axes, np.array(each)[:, place])
