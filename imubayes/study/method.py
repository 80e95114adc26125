"""The whole method, in the order a paper would tell it.

Read the runs; estimate each run's noise with the full library in the mean, whiten, and add up one triangular
factor; weigh every submodel on it; say of each term whether it is needed, not needed, or cannot be told; and
test whether what is left is noise.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from imubayes.algebra import factor as algebra
from imubayes.campaign.preparation import (
    before_fit,
    of_case,
    prepare_case,
    runs_of,
)
from imubayes.campaign.prepared import Doubt, Prepared
from imubayes.campaign.study import (
    ExtraPosterior,
    SensorCheck,
    SensorResult,
    SensorSpec,
    Study,
    StudyResult,
    file_name,
)
from imubayes.errors import UnobservableError
from imubayes.inference.case import Case, rows_at_rest
from imubayes.inference.drift import Drift, drift_of
from imubayes.inference.linear import Linear, drive, linear_of
from imubayes.inference.mcmc.chains import Chains, of_columns
from imubayes.inference.mcmc.ensembles import Limits
from imubayes.inference.misfit import Misfit, find_misfit
from imubayes.inference.nuisances import rows_with
from imubayes.inference.observability import Observability, carried, observe
from imubayes.inference.residuals import FAMILIES, ResidualCheck, check_runs
from imubayes.inference.stills import STILLS
from imubayes.inference.summary import correlation, pulls
from imubayes.ladder import Choice
from imubayes.ladder.costs import calibrate, foreseen, known_law, within
from imubayes.ladder.problem import (
    Answer,
    Ground,
    Posterior,
    Problem,
    ground_of,
    plainly_prepared,
    problem_of,
    size_of,
)
from imubayes.ladder.rungs import by_accuracy, by_budget, by_method, provisional
from imubayes.population.classes import in_common, pooled_by_kind
from imubayes.population.sessions import between_sessions
from imubayes.progress import Progress, part_of, silent
from imubayes.rig.checks import faults
from imubayes.rig.inputs import Run
from imubayes.selection.combined import combined, mounts_of
from imubayes.selection.compensations import Compensation, compensations
from imubayes.selection.decision import (
    Bias,
    Selection,
    loose_fit,
    over_record,
    posterior_draws,
    prior_draws,
)
from imubayes.selection.noise_choice import NoiseChoice, processes_of
from imubayes.selection.panel import Panel, panel_of
from imubayes.sensors.terms import Library
from imubayes.study.scenes import required
from imubayes.units import counted

SHORT = 30.0
"""s: a budget for somebody who does not want to wait."""

DRAWS = 2000
"""Posterior and prior draws that a result carries."""


def run(
    study: Study,
    *,
    progress: Progress = silent,
    quicker: Callable[[str], None] = silent,
    warn: Callable[[str], None] = silent,
    first: Callable[[str], None] | None = None,
) -> StudyResult:
    """Characterise every sensor of a study.

    `progress` is told what goes on, `quicker` of each sensor what would take less time, before it is
    characterised; `warn` what is wrong with its records; `first`, where it is given, the verdicts at the
    estimated noise, before chains.

    Raises
    ------
    InputError : if a run or the study cannot be used; the message says where and why.
    ConvergenceError : if a free tumble does not settle.
    """
    results: list[tuple[SensorSpec, list[SensorResult]]] = []
    for k, spec in enumerate(study.sensors):
        job = _Job(
            spec,
            study,
            np.random.default_rng([study.seed, k, 1]),
            (study.seed, k),
            part_of(progress, k, len(study.sensors), f"{spec.id}: "),
            first,
        )
        job.tell(f"reading {counted(len(spec.runs), 'run')}")
        runs = runs_of(spec, study.seed, k, job.tell)
        for fault in _faults(runs):
            warn(f"{spec.id}: {fault}")
        with _named(spec):
            quicker(_quicker(job, runs))
            found = _case(job, runs) if runs[0].of_case else [_single(job, runs)]
            results.append((spec, found))
    if study.scenes:
        progress(f"requirements of {counted(len(study.scenes), 'scene')}")
    components = tuple(one for _, found in results for one in found)
    scenes, of_cases = required(study.scenes, results)
    common = tuple(in_common(results))
    return StudyResult(study, components, between_sessions(results), scenes, of_cases, common)


def _faults(runs: Sequence[Run]) -> tuple[str, ...]:
    return faults((run.name, run.procedure, run.source) for run in runs)


def _stills(runs: Sequence[Run]) -> tuple[str, ...]:
    return tuple(f"{run.name}: {note}" for run in runs for note in run.source.notes if STILLS in note)


def _quicker(job: _Job, runs: Sequence[Run]) -> str:
    """Say what a budget would give; empty of a case, whose size only its linearisation tells."""
    if runs[0].of_case or job.study.sampling.climbs:
        return ""
    size, law = size_of(problem_of(job.spec, runs)), known_law()
    rung = within(SHORT, size, law)
    seconds = foreseen(rung, size, law)
    return (
        f'if {job.spec.id} takes too long, stop this and add --budget "{SHORT:g} s": the method {rung}'
        f" answers in about {math.ceil(seconds)} s"
    )


def check(study: Study, *, progress: Progress = silent) -> tuple[SensorCheck, ...]:
    """What the runs of each sensor can tell of each term, before anything is fitted.

    The noise is the class's typical one where the study gives none, so that outputs are not looked at
    except by a free tumble, whose directions come from nowhere else.
    """
    checks: list[SensorCheck] = []
    for k, spec in enumerate(study.sensors):
        tell = part_of(progress, k, len(study.sensors), f"{spec.id}: ")
        tell(f"reading {counted(len(spec.runs), 'run')}")
        runs = runs_of(spec, study.seed, k, tell)
        with _named(spec):
            checks += _case_check(spec, runs) if runs[0].of_case else [_check(spec, runs)]
    return tuple(checks)


def _check(spec: SensorSpec, runs: Sequence[Run]) -> SensorCheck:
    ready = before_fit(spec, runs)
    return SensorCheck(
        spec.id,
        spec.library,
        _observed(ready, spec.library),
        ready.summary.extras,
        _faults(runs),
    )


def _case_check(spec: SensorSpec, runs: Sequence[Run]) -> list[SensorCheck]:
    case, ready = prepare_case(spec, runs)
    return [
        SensorCheck(
            f"{spec.id}.{one.name}",
            one.library,
            _observed(replace(ready, summary=replace(ready.summary, facts=one.facts)), one.library, one.name),
            ready.summary.extras,
            (*_faults(runs), *(() if k else _stills(runs))),
        )
        for k, one in enumerate(case.components)
    ]


def _observed(ready: Prepared, lib: Library, component: str = "") -> Observability:
    summary, prefix = ready.summary, f"{component}." if component else ""
    seen = observe(summary.factor, ready.prior.sd, summary.facts, reach=summary.reach)
    return carried(seen, {f"{prefix}{name}": f"{prefix}{leader}" for name, leader in lib.tied})


@dataclass(frozen=True, slots=True, eq=False)
class _Job:
    """One sensor of a study, and what its stages share."""

    spec: SensorSpec
    study: Study
    rng: np.random.Generator
    seed: tuple[int, int]
    tell: Progress
    first: Callable[[str], None] | None = None

    @property
    def share(self) -> int:
        """Parts into which the level of the study's residual tests is divided, one for each family."""
        return FAMILIES * len(self.study.sensors)


@dataclass(frozen=True, slots=True, eq=False)
class _Findings:
    """What is said of one component: the decision, the residuals, the other methods, what is missing."""

    selection: Selection
    checks: tuple[ResidualCheck, ...]
    panel: Panel | None
    misfit: Misfit | None
    drift: Drift | None = None
    bias: Bias | None = None
    compensations: tuple[Compensation, ...] = ()


def _ground(job: _Job, problem: Problem) -> Ground:
    """Ground of a problem; chains are kept where they may be resumed, which those of a budget are not."""
    sampling = job.study.sampling
    folder = None if sampling.climbs else sampling.checkpoints
    checkpoint = folder / f"{file_name(job.spec.id)}.h5" if folder else None
    limits = Limits(
        ess=sampling.ess,
        time_limit=sampling.time_limit,
        seed=int(np.random.SeedSequence(job.seed).generate_state(1)[0]),
        checkpoint=checkpoint,
        # a study that was interrupted at its first sensor has nothing of the second one yet
        resume=bool(sampling.resume and checkpoint and checkpoint.exists()),
    )
    return ground_of(problem, job.rng, job.tell, limits)


def _answered(job: _Job, ground: Ground) -> tuple[Answer, Choice | None, str]:
    """Answer of the method that the study asks for, or its budget or accuracy; which was taken, and why."""
    sampling = job.study.sampling
    if not sampling.climbs:
        if job.first is not None and (early := provisional(sampling.method, ground)):
            job.first(f"{job.spec.id}, provisional: {'; '.join(map(_in_short, early.selections))}")
        found, reason = by_method(sampling.method, ground)
        return found, None, reason
    law = calibrate(job.tell)
    if sampling.budget is not None:
        found, choice = by_budget(ground, sampling.budget, law)
    else:
        found, choice = by_accuracy(ground, sampling.accuracy or 0.0, law)
    return found, choice, f"{choice.asked} was asked for"


def _in_short(selection: Selection) -> str:
    """Terms of a component by verdict; of a case with the component's name."""
    of: dict[str, list[str]] = {}
    for term, column in zip(selection.terms, selection.columns, strict=True):
        of.setdefault(term.verdict, []).append(column)
    return ", ".join(f"{verdict} {' '.join(names)}" for verdict, names in of.items())


def _single(job: _Job, runs: Sequence[Run]) -> SensorResult:
    """Characterise one component with known inputs.

    What a budget is short of is left out: other methods, residuals, what the library lacks.
    """
    start, spec = time.perf_counter(), job.spec
    asked = problem_of(spec, runs, costs=job.study.costs, hierarchical=job.study.hierarchical)
    doubt = None if job.study.sampling.climbs else Doubt(job.share, (*job.seed, 3))
    ground = _ground(job, replace(asked, doubt=doubt))
    found, choice, reason = _answered(job, ground)
    ready = found.ready or plainly_prepared(ground.problem)
    told, processes = _Findings(found.selection, (), None, None), ()
    if choice is None:
        told, processes = _looked_at(job, ready, found)
    result = _result(job, spec.id, ready, found.posterior, told, time.perf_counter() - start)
    return replace(result, processes=processes, choice=choice, method_reason=reason)


def _looked_at(job: _Job, ready: Prepared, found: Answer) -> tuple[_Findings, tuple[NoiseChoice, ...]]:
    """What is said of one component beside the decision, and which processes its noise shows."""
    job.tell("residuals")
    theta, cov = loose_fit(ready.summary, ready.prior)
    checks = ready.checks or check_runs(ready.rows, theta, ready.summary.runs, cov=cov, share=job.share)
    inputs = [run.inputs.channels for run in ready.runs]
    panel = _panel(job, ready, found.posterior.chains, found.selection)
    selection = _combined(found.selection, panel, ready)
    misfit = ready.misfit or _misfit(job, ready, inputs)
    told = _drifting(job, ready, _Findings(selection, checks, panel, misfit))
    told = _with_compensations(job, ready, told)
    fine = _fine(job.spec.library, ready, theta)
    asked = _told_to(job)
    return told, processes_of(job.study.noise, fine, job.spec.sensor_class, theta=theta, **asked)


def _fine(lib: Library, ready: Prepared, theta: np.ndarray) -> Sequence[Linear]:
    """Rows of samples where a run's are averages, which no longer show the quantization they are made for.

    Where something stands beside the terms whose size dwells tell, rows are these.
    """
    if ready.spreads or all(run.record is None for run in ready.runs):
        return ready.rows
    records, place = [run.record or run for run in ready.runs], np.split(theta, [len(lib.names)])
    extras = ready.summary.extras
    made = rows_with(records, lib, extras, *place) if extras else [linear_of(run, lib) for run in records]
    pairs = zip(ready.runs, ready.rows, made, strict=True)
    return [rows if run.record is None else fine for run, rows, fine in pairs]


def _case(job: _Job, runs: Sequence[Run]) -> list[SensorResult]:
    """Characterise the components of a case: the accelerometers of a free tumble, or the six of an IMU.

    A budget is that of all of them, who share its method; what it is short of is left out as of one.
    """
    start, spec, study = time.perf_counter(), job.spec, job.study
    job.tell("stills, noise and linearisation")
    case, ready = prepare_case(spec, runs, job.rng)
    ground = _ground(job, Problem(spec, (), ready.prior, study.costs, study.hierarchical, case))
    ground.shared["factor"] = (ready, time.perf_counter() - start)
    found, choice, reason = _answered(job, ground)
    told = [_Findings(selection, (), None, None) for selection in found.selections]
    resting: Mapping[str, Sequence[Linear]] = {}
    if choice is None:
        told, resting = _components(job, case, ready, found), rows_at_rest(ready.runs, case)
    selections = [one.selection for one in told]
    shared = of_case(spec, case, ready, selections, [one.bias is not None for one in told], _flown(told))
    pooled = pooled_by_kind(spec, [one.library.kind for one in case.components], selections)
    seconds = (time.perf_counter() - start) / len(told)
    results, asking = [], _told_to(job)
    for one, said, fields in zip(case.components, told, shared, strict=True):
        kind = one.library.kind
        own = replace(job, spec=spec.of(kind))
        part = _part(ready, one.parts)
        result = _result(own, f"{spec.id}.{one.name}", part, found.posterior, said, seconds)
        noises = processes_of(study.noise, resting.get(one.name, ()), own.spec.sensor_class, **asking)
        told_of = {"processes": noises, "pooled": pooled[kind], **fields}
        results.append(replace(result, choice=choice, method_reason=reason, **told_of))
    return results


def _flown(told: Sequence[_Findings]) -> list[float]:
    """Coefficients that are exported of each component of a case; zero for a term that is not."""
    flown: list[float] = []
    for one in told:
        chosen = one.selection
        used = {t.name: t.mean for t in chosen.terms if t.name in chosen.model and t.verdict != "unresolved"}
        if one.compensations:
            best = one.compensations[0]
            used = dict(zip(best.terms, best.mean.tolist(), strict=True))
        flown += [used.get(term.name, 0.0) for term in chosen.terms]
    return flown


def _components(job: _Job, case: Case, ready: Prepared, found: Answer) -> list[_Findings]:
    every = tuple(dict.fromkeys(one.parts for one in case.components))
    misfits = {p: _misfit(job, _part(ready, p), [case.inputs[k] for k in p], len(every)) for p in every}
    root = algebra.posterior_root(case.summary.factor, ready.prior.sd)[1]
    runs = ready.summary.runs
    checks = check_runs(ready.rows, case.theta, runs, cov=root @ root.T, share=job.share)
    told: list[_Findings] = []
    for one, selection in zip(case.components, found.selections, strict=True):
        own = replace(ready, summary=replace(ready.summary, library=one.library, facts=one.facts))
        panel = _panel(job, own, found.posterior.chains, selection, one.parts)
        checked = tuple(checks[k] for k in one.parts)
        said = _Findings(_combined(selection, panel, ready), checked, panel, misfits[one.parts])
        said = _drifting(job, _part(ready, one.parts), said)
        told.append(_with_compensations(job, ready, said, one.parts))
    return told


def _with_compensations(job: _Job, ready: Prepared, told: _Findings, parts: Sequence[int] = ()) -> _Findings:
    """What is said of a component with the models that may be exported."""
    job.tell("positions predicted from all others")
    given = (ready.summary, ready.prior, ready.rows, told.selection)
    return replace(told, compensations=compensations(*given, parts=parts, drift=told.drift))


def _drifting(job: _Job, ready: Prepared, told: _Findings) -> _Findings:
    """What is said of a component with its bias over the record, where a random walk moves it."""
    columns = dict(zip((term.name for term in told.selection.terms), told.selection.columns, strict=True))
    drift = drift_of(ready.summary, ready.rows, ready.prior.sd, columns.get("b0", ""))
    if drift is None:
        return told
    selection, bias = over_record(told.selection, drift, np.random.default_rng([*job.seed, 5]))
    return replace(told, selection=selection, drift=drift, bias=bias)


def _part(ready: Prepared, parts: Sequence[int]) -> Prepared:
    """Runs and rows of some parts; the factor is that of all."""
    runs = tuple(ready.summary.runs[k] for k in parts)
    named = {run.name for run in runs}
    return replace(
        ready,
        summary=replace(ready.summary, runs=runs),
        rows=[ready.rows[k] for k in parts],
        distrusted=tuple(dwell for dwell in ready.distrusted if dwell.run in named),
    )


def _panel(
    job: _Job, ready: Prepared, chains: Chains | None, selection: Selection, parts: Sequence[int] = ()
) -> Panel | None:
    if not job.study.compare:
        return None
    job.tell("the other methods: criteria, sparse regression, other priors")
    return panel_of(
        ready.summary,
        ready.prior,
        ready.rows,
        selection,
        rng=np.random.default_rng([*job.seed, 2]),
        chains=chains,
        hierarchical=job.study.hierarchical,
        parts=parts,
        mounts=mounts_of(ready.runs),
    )


def _combined(selection: Selection, panel: Panel | None, ready: Prepared) -> Selection:
    """Decision in which all families have their say, where they were asked."""
    if panel is None:
        return selection
    return combined(selection, panel.left_out, panel.sindy, doubtful=ready.absorbed is not None)


def _misfit(job: _Job, ready: Prepared, inputs: Sequence[Mapping[str, np.ndarray]], parts: int = 1) -> Misfit:
    """Ask whether the residuals of one of so many parts of a case depend on an input as no term does."""
    rng = np.random.default_rng([*job.seed, 3])
    asked = {"rng": rng, "share": job.share * parts}
    return find_misfit(ready.rows, inputs, ready.summary, ready.prior.sd, **asked)


def _told_to(job: _Job) -> dict[str, Any]:
    """What the search for noise processes is given: draws of its own, and whom it tells."""
    return {"rng": np.random.default_rng([*job.seed, 4]), "tell": job.tell}


def _result(
    job: _Job,
    name: str,
    ready: Prepared,
    posterior: Posterior,
    told: _Findings,
    seconds: float,
) -> SensorResult:
    selection = told.selection
    spec, summary = job.spec, ready.summary
    chains = posterior.chains
    columns, carriers = _columns(selection, ready)
    return SensorResult(
        id=name,
        kind=spec.kind,
        class_id=spec.sensor_class.id if spec.sensor_class else "",
        samples=sum(r.samples for r in summary.runs),
        runs=summary.runs,
        selection=selection,
        checks=told.checks,
        draws=posterior_draws(selection, DRAWS, job.rng, told.drift),
        prior_draws=prior_draws(selection, DRAWS, job.rng),
        prior_source=ready.source,
        seconds=seconds,
        method=posterior.rung,
        chains=of_columns(_over_record(job, chains, told.drift), columns, carriers) if chains else None,
        extras=_extras(ready, selection, posterior),
        distrusted=ready.distrusted,
        panel=told.panel,
        misfit=told.misfit,
        correlation=correlation(ready.summary.factor, ready.prior.sd, selection.carriers),
        drive=drive(ready.rows, selection.columns, [term.name for term in selection.terms]),
        pulls=pulls(ready.summary.factor, ready.prior.sd, selection.carriers),
        bias=told.bias,
        compensations=told.compensations,
        spreads=(*ready.spreads, *ready.scatter),
        absorbed=ready.absorbed,
    )


def _over_record(job: _Job, chains: Chains, drift: Drift | None) -> Chains:
    """Chains whose b0 is the bias on average over the record."""
    if drift is None:
        return chains
    theta = chains.theta.reshape(-1, len(chains.names))
    ordered = theta[:, [chains.names.index(name) for name in drift.names]]
    z = np.random.default_rng([*job.seed, 6]).standard_normal((len(theta), 2))
    moved = theta.copy()
    moved[:, chains.names.index(drift.names[drift.own])] = drift.bias(ordered, z)[:, 1]
    return replace(chains, theta=moved.reshape(chains.theta.shape))


def _columns(selection: Selection, ready: Prepared) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Columns that are told of, those of the terms, then the errors of the bench; and which carry these."""
    extras = tuple(extra.name for extra in ready.summary.extras)
    return (*selection.columns, *extras), (*selection.carriers, *extras)


def _extras(ready: Prepared, selection: Selection, posterior: Posterior) -> tuple[ExtraPosterior, ...]:
    mean, sd = posterior.moments or algebra.posterior(ready.summary.factor, ready.prior.sd)
    found = dict(zip(ready.summary.names, zip(mean.tolist(), sd.tolist(), strict=True), strict=True))
    return tuple(
        ExtraPosterior(extra, *found[extra.name], selection.observability.partners(extra.name))
        for extra in ready.summary.extras
    )


@contextmanager
def _named(spec: SensorSpec) -> Iterator[None]:
    """Let what a stage cannot do name the sensor that it could not do it for."""
    try:
        yield
    except UnobservableError as error:
        raise UnobservableError(f"sensor '{spec.id}': {error}", error.terms) from None
