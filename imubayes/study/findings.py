"""What is said of each component beside its decision: residuals, other methods, what is missing, what to fly.

The components of a case share one linear problem; a sensor by itself is the only component of its own. What
the scenes of a study require is held against every component, and against those of a case together.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import NamedTuple

import numpy as np

from imubayes.algebra import factor as algebra
from imubayes.algebra.factor import reorder
from imubayes.campaign import ExtraPosterior, Mission, SensorResult, SensorSpec, Study
from imubayes.campaign.preparation import of_case
from imubayes.campaign.prepared import Doubt, Prepared, examined, fit_of
from imubayes.inference.case import Case, CaseComponent, components_of, rows_at_rest
from imubayes.inference.drift import Drift, drift_of
from imubayes.inference.linear import Linear, drive, linear_of
from imubayes.inference.mcmc import Chains, of_columns
from imubayes.inference.nuisances import rows_with
from imubayes.inference.residuals import FAMILIES
from imubayes.inference.summary import RunSummary, correlation, pulls
from imubayes.ladder.problem import Answer
from imubayes.population.needs import CANNOT_TELL
from imubayes.population.sessions import pooled_by_kind
from imubayes.scenes import relevance
from imubayes.scenes.effects import SceneEffects
from imubayes.selection.compensations import compensations
from imubayes.selection.decision import Selection, loose_fit, over_record, posterior_draws, prior_draws
from imubayes.selection.noise_choice import NoiseChoice, identified, question_of, with_curve
from imubayes.selection.panel import Begun, Unasked, begun, panel_of
from imubayes.selection.sensitivity import combined, mounts_of
from imubayes.selection.verdicts import listed
from imubayes.sensors.imu import COMPONENTS
from imubayes.sensors.terms import Kind, Library
from imubayes.work import Begin, Progress

DRAWS = 2000
"""Posterior and prior draws that a result carries."""


@dataclass(frozen=True, slots=True, eq=False)
class Job:
    """One sensor of a study, and what its stages share."""

    spec: SensorSpec
    study: Study
    rng: np.random.Generator
    seed: tuple[int, int]
    tell: Progress

    @property
    def share(self) -> int:
        """Parts into which the level of the study's residual tests is divided, one for each family."""
        return FAMILIES * len(self.study.sensors)

    @property
    def doubt(self) -> Doubt:
        """How it is asked what bench and library lack."""
        return Doubt(self.share, (*self.seed, 3))

    def own(self, stage: int) -> np.random.Generator:
        """Source of randomness of a stage, so that none hangs on what the others draw."""
        return np.random.default_rng([*self.seed, stage])


class Ahead(NamedTuple):
    """What needs no decision, and is begun before there is one.

    `panels` are the other methods of each component, none where they are not asked; `resting` the rows of
    each that are asked for their noise processes, which `noises` waits for, one after the other.
    """

    panels: list[Begun | list[Unasked]]
    resting: list[list[Linear]]
    noises: Callable[[], list[NoiseChoice]]


def begun_ahead(job: Job, case: Case | None, ready: Prepared, begin: Begin) -> Ahead:
    """Begin what takes long and needs no decision."""
    components, asked = components_of(case, ready.summary), job.study.noise
    panels = [
        begun(
            replace(ready.summary, library=component.library, facts=component.facts),
            ready.prior,
            ready.rows,
            rng=job.own(2),
            component=component.name,
            hierarchical=job.study.hierarchical,
            parts=component.parts,
            costs=job.study.costs,
            begin=begin,
        )
        for component in (components if job.study.compare else ())
    ]
    whole = rows_at_rest(ready.runs, case) if case else {"": _samples(job.spec, ready)}
    resting = [[run for run in whole.get(component.name, ()) if asked.asks(run)] for component in components]
    questions = [
        question_of(run, job.spec.of(component.library.kind).sensor_class, asked.candidates)
        for component, runs in zip(components, resting, strict=True)
        for run in runs
    ]
    return Ahead(panels, resting, begin(identified, questions, job.own(4)))


def findings(
    job: Job, case: Case | None, ready: Prepared, answer: Answer, ahead: Ahead
) -> Iterator[SensorResult]:
    """Result of each component, with what is said of it beside the decision."""
    if not (ready.parts or ready.misfit):
        job.tell("residuals")
        ready = examined(ready, job.doubt, case)
    told = list(_of_each(job, case, ready, answer, ahead.panels))
    if named := [rows.name for runs in ahead.resting for rows in runs]:
        job.tell(f"noise processes of {listed(named)}")
    theta, noises = None if case else fit_of(ready, case)[0], iter(ahead.noises())
    for sensor, resting in zip(told, ahead.resting, strict=True):
        yield replace(sensor, processes=tuple(with_curve(next(noises), rows, theta) for rows in resting))


def _of_each(
    job: Job, case: Case | None, ready: Prepared, answer: Answer, panels: Sequence[Begun | list[Unasked]]
) -> Iterator[SensorResult]:
    """All of it but the noise processes."""
    components = components_of(case, ready.summary)
    for k, (component, selection) in enumerate(zip(components, answer.selections, strict=True)):
        panel, own = None, ready.part(component)
        if panels:
            job.tell("the other methods: criteria, sparse regression, other priors")
            panel = panel_of(
                panels[k], selection, chains=answer.posterior.chains, mounts=mounts_of(ready.runs)
            )
            selection = combined(selection, panel.left_out, panel.sindy, doubtful=own.doubtful)
        columns = dict(zip((term.name for term in selection.terms), selection.columns, strict=True))
        bias = None
        drift = drift_of(own.summary, own.rows, own.prior.sd, columns.get("b0", ""))
        if drift:  # a random walk moves the bias over the record
            selection, bias = over_record(selection, drift, job.own(5))
        job.tell("positions predicted from all others")
        given = (ready.summary, ready.prior, ready.rows, selection)
        yield replace(
            result_of(job, component, ready, answer, selection, drift),
            checks=own.checks,
            panel=panel,
            misfit=own.misfit,
            bias=bias,
            compensations=compensations(*given, parts=component.parts, drift=drift),
        )


def _samples(spec: SensorSpec, ready: Prepared) -> Sequence[Linear]:
    """Rows of samples where a run's are averages, which no longer show the quantization they are made for.

    Where something stands beside the terms whose size dwells tell, rows are these.
    """
    if ready.spreads or all(run.record is None for run in ready.runs):
        return ready.rows
    lib, extras = spec.library, ready.summary.extras
    theta, _ = loose_fit(ready.summary, ready.prior)
    records, place = [run.record or run for run in ready.runs], np.split(theta, [len(lib.names)])
    made = rows_with(records, lib, extras, *place) if extras else [linear_of(run, lib) for run in records]
    pairs = zip(ready.runs, ready.rows, made, strict=True)
    return [rows if run.record is None else fine for run, rows, fine in pairs]


def result_of(
    job: Job,
    component: CaseComponent,
    ready: Prepared,
    answer: Answer,
    selection: Selection,
    drift: Drift | None = None,
) -> SensorResult:
    """Result of one component by its decision, where `drift` is how its bias walks over the record."""
    summary, chains = ready.summary, answer.posterior.chains
    spec, own = job.spec.of(component.library.kind), ready.part(component)
    extras = tuple(extra.name for extra in summary.extras)
    columns, carriers = (*selection.columns, *extras), (*selection.carriers, *extras)
    means, sds = answer.posterior.moments or algebra.posterior(summary.factor, ready.prior.sd)
    told = dict(zip(summary.factor.names, zip(means.tolist(), sds.tolist(), strict=True), strict=True))
    return SensorResult(
        id=id_of(job.spec, component),
        kind=spec.kind,
        class_id=spec.sensor_class.id if spec.sensor_class else "",
        samples=sum(run.samples for run in own.summary.runs),
        runs=own.summary.runs,
        selection=selection,
        checks=(),
        draws=posterior_draws(selection, DRAWS, job.rng, drift),
        prior_draws=prior_draws(selection, DRAWS, job.rng),
        prior_source=ready.source,
        seconds=0.0,
        method=answer.rung,
        chains=chains and of_columns(_over_record(job, chains, drift), columns, carriers),
        extras=tuple(
            ExtraPosterior(extra, *told[extra.name], selection.observability.partners(extra.name))
            for extra in summary.extras
        ),
        distrusted=own.distrusted,
        correlation=correlation(summary.factor, ready.prior.sd, selection.carriers),
        drive=drive(own.rows, selection.columns, [term.name for term in selection.terms]),
        pulls=pulls(summary.factor, ready.prior.sd, selection.carriers),
        spreads=(*own.spreads, *own.scatter),
        absorbed=own.absorbed,
    )


def id_of(spec: SensorSpec, component: CaseComponent) -> str:
    """Name of a component in a result: its sensor's, and of a case its own."""
    return f"{spec.id}.{component.name}" if component.name else spec.id


def _over_record(job: Job, chains: Chains, drift: Drift | None) -> Chains:
    """Chains whose b0 is the bias on average over the record."""
    if drift is None:
        return chains
    theta = chains.theta.reshape(-1, len(chains.names))
    moved = theta.copy()
    moved[:, chains.names.index(drift.b0)] = drift.bias(chains.names, theta, job.own(6))[:, 1]
    return replace(chains, theta=moved.reshape(chains.theta.shape))


def shared_fields(
    spec: SensorSpec, case: Case, ready: Prepared, told: Sequence[SensorResult]
) -> list[Mapping[str, object]]:
    """Fields of `SensorResult` that the components of a case have for being in one."""
    selections = [sensor.selection for sensor in told]
    kinds: list[Kind] = [component.library.kind for component in case.components]
    walking = [sensor.bias is not None for sensor in told]
    own = of_case(spec, case, ready, selections, walking, [c for sensor in told for c in _flown(sensor)])
    pooled = pooled_by_kind(spec, kinds, selections)
    return [{**fields, "pooled": pooled[kind]} for fields, kind in zip(own, kinds, strict=True)]


def _flown(told: SensorResult) -> list[float]:
    """Coefficients that are exported of a component; zero for a term that is not."""
    terms, model = told.selection.terms, told.selection.model
    used = {t.name: t.mean for t in terms if t.name in model and t.verdict != "unresolved"}
    if told.compensations:
        best = told.compensations[0]
        used = dict(zip(best.terms, best.mean.tolist(), strict=True))
    return [used.get(term.name, 0.0) for term in terms]


def required(
    missions: Sequence[Mission], results: Sequence[tuple[SensorSpec, Sequence[SensorResult]]]
) -> tuple[tuple[tuple[str, relevance.Relevance], ...], tuple[tuple[str, relevance.CaseRelevance], ...]]:
    """Hold every component against every scene, and the components of a case together.

    A budget of the output is only for components of its kind.

    Returns
    -------
    id of a component and what a scene requires of it, scene by scene; the same of cases.
    """
    sensor_scenes: list[tuple[str, relevance.Relevance]] = []
    cases: list[tuple[str, relevance.CaseRelevance]] = []
    for mission in missions:
        expose = cache(partial(relevance.exposure, mission.scene, budget=mission.budget))
        for spec, components in results:
            seen: dict[str, relevance.Exposure] = {}
            for sensor in components:
                if mission.kind in (None, sensor.kind):
                    name = sensor.id.removeprefix(f"{spec.id}.")
                    # of a triad a component's own axis: ``ax`` lies along x
                    own = name in COMPONENTS and sensor.id != spec.id
                    axis = name[-1] if own else mission.axis
                    seen[sensor.id] = expose(component_library(spec, sensor), axis=axis)
                    sensor_scenes.append((sensor.id, _required(mission, seen[sensor.id], sensor)))
            if len(seen) > 1 and mission.budget.quantity != "output":
                knowledge = {one.id: relevance.known(one.selection, one.draws) for one in components}
                noise = {one.id: _longest(one).noise for one in components}
                case = relevance.weigh_case(seen, knowledge, noise)
                cases.append((spec.id, replace(case, scene=mission.name)))
    return tuple(sensor_scenes), tuple(cases)


def component_library(spec: SensorSpec, result: SensorResult) -> Library:
    """Terms of a component: a triad leaves out those that only turn its case."""
    names = {term.name for term in result.selection.terms}
    lib = spec.of(result.kind).library
    return replace(lib, terms=tuple(term for term in lib.terms if term.name in names), ties=())


def _required(mission: Mission, exposed: relevance.Exposure, result: SensorResult) -> relevance.Relevance:
    """Hold one component against one scene; the longest run shows its B and K best."""
    longest, tested = _longest(result), None
    if result.drive is not None:
        factor = reorder(result.drive, exposed.lib.names)
        tested = SceneEffects(exposed.lib.names, factor.R[:-1, :-1])
    weighed = relevance.weigh(
        exposed, relevance.known(result.selection, result.draws), noise=longest.noise, tested=tested
    )
    notes = (*weighed.notes, f"noise as in run '{longest.name}'", *_idle(exposed))
    # of a term that the test cannot tell inclusion is mostly the prior's, and shows nothing
    silent = {term.name for term in result.selection.terms if term.verdict in CANNOT_TELL}
    terms = tuple(
        replace(term, quadrant=relevance.quadrant(0.0, 0.0, term.share_at_limit95))
        if term.name in silent
        else term
        for term in weighed.terms
    )
    return replace(weighed, scene=mission.name, notes=notes, terms=terms)


def _longest(result: SensorResult) -> RunSummary:
    return max(result.runs, key=lambda run: run.duration)


def _idle(exposed: relevance.Exposure) -> Iterator[str]:
    """Say which terms the scene does not drive, and whether that is for want of a thermometer."""
    alone = exposed.output.single(np.ones(len(exposed.lib.terms)))
    idle = [name for name, size in zip(exposed.lib.names, alone, strict=True) if size == 0.0]
    if not idle:
        return
    single = set(idle).intersection(exposed.lib.on("gT"))
    heated = sum("*" in name for name in idle) > len(single)
    cold = heated and "T" not in exposed.scene.inputs.channels
    why = "it has no temperature, and " if cold else "it has no second thermometer, and " if single else ""
    yield f"{why}nothing in it drives {listed(idle)}: counted as without effect"
