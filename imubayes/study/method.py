"""The whole method, in the order a paper would tell it.

Read the runs; estimate each run's noise with the full library in the mean, whiten, and add up one triangular
factor; weigh every submodel on it; say of each term whether it is needed, not needed, or cannot be told; and
test whether what is left is noise.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from imubayes.campaign import Choice, SensorCheck, SensorResult, SensorSpec, Study, file_name
from imubayes.campaign.preparation import before_fit, prepare_case, runs_of
from imubayes.errors import UnobservableError
from imubayes.inference.case import components_of
from imubayes.inference.mcmc.ensembles import Limits
from imubayes.inference.observability import carried, observe
from imubayes.inference.stills import STILLS
from imubayes.ladder import AT_ONCE
from imubayes.ladder.costs import calibrate, foreseen, known_law, within
from imubayes.ladder.problem import (
    Answer,
    Ground,
    Problem,
    ground_of,
    plainly_prepared,
    prepared,
    problem_of,
    size_of,
)
from imubayes.ladder.rungs import by_accuracy, by_budget, by_method, provisional
from imubayes.population.sessions import between_sessions, in_common
from imubayes.rig.checks import faults
from imubayes.rig.inputs import Run
from imubayes.selection.decision import Selection
from imubayes.selection.verdicts import by_verdict
from imubayes.study import StudyResult
from imubayes.study.findings import Job, begun_ahead, findings, id_of, required, result_of, shared_fields
from imubayes.study.schema import read_study
from imubayes.units import counted
from imubayes.work import Begin, Progress, here, part_of, silent

SHORT = 30.0
"""s: a budget for somebody who does not want to wait."""


Loaded = Callable[[], Callable[[], object]]
"""Waits for what a decision needs, and gives what begins to load what only a report does."""


def run(
    study: Study | Path | str,
    *,
    progress: Progress = silent,
    quicker: Callable[[str], None] = silent,
    warn: Callable[[str], None] = silent,
    first: Callable[[str], None] | None = None,
    begin: Begin = here,
    loaded: Loaded | None = None,
) -> StudyResult:
    """Characterise every sensor of a study, which is read where its file is given.

    `progress` is told what goes on, `quicker` of each sensor what would take less time, before it is
    characterised; `warn` what is wrong with its records; `first`, where it is given, the verdicts at the
    estimated noise, before chains. `begin` does what can be done beside all that (see
    `imubayes.work.beside`); `loaded` waits for what another process compiles for the decision.

    Raises
    ------
    InputError : if a run or the study cannot be used; the message says where and why.
    ConvergenceError : if a free tumble does not settle.
    """
    from threadpoolctl import threadpool_limits

    study = _read(study)
    results: list[tuple[SensorSpec, list[SensorResult]]] = []
    for k, spec in enumerate(study.sensors):
        tell = part_of(progress, k, len(study.sensors), f"{spec.id}: ")
        job = Job(spec, study, np.random.default_rng([study.seed, k, 1]), (study.seed, k), tell)
        tell(f"reading {counted(len(spec.runs), 'run')}")
        runs = runs_of(spec, study.seed, k, tell)
        for fault in _faults(runs):
            warn(f"{spec.id}: {fault}")
        # many small matrices: threads of the linear algebra only wait for each other
        with _named(spec), threadpool_limits(1, user_api="blas"):
            quicker(_quicker(job, runs))
            results.append((spec, _characterised(job, runs, first, begin, loaded)))
    if study.scenes:
        progress(f"requirements of {counted(len(study.scenes), 'scene')}")
    components = tuple(sensor for _, sensors in results for sensor in sensors)
    scenes, of_cases = required(study.scenes, results)
    common = tuple(in_common(results))
    return StudyResult(study, components, between_sessions(results), scenes, of_cases, common)


def _characterised(
    job: Job, runs: Sequence[Run], first: Callable[[str], None] | None, begin: Begin, loaded: Loaded | None
) -> list[SensorResult]:
    """Characterise one component with known inputs, or those of a case.

    A budget is that of all of them, who share its method. What it is short of is left out: other methods,
    residuals, what the library lacks.
    """
    start = time.perf_counter()
    ground = _ground(job, runs)
    case, sampling = ground.problem.case, job.study.sampling
    early = prepared(ground) if not (sampling.climbs or sampling.method in AT_ONCE) else None
    report = loaded() if loaded is not None else None
    if early and first is not None and (answer := provisional(sampling.method, ground)):
        first(f"{job.spec.id}, provisional: {'; '.join(map(_in_short, answer.selections))}")
    ahead = begun_ahead(job, case, early, begin) if early else None
    if report is not None:
        report()
    reply, choice, reason = _answered(job, ground)
    ready = reply.ready or plainly_prepared(ground.problem)
    if choice is None:
        told = list(findings(job, case, ready, reply, ahead or begun_ahead(job, case, ready, begin)))
    else:
        components = components_of(case, ready.summary)
        pairs = zip(components, reply.selections, strict=True)
        told = [result_of(job, component, ready, reply, selection) for component, selection in pairs]
    fields = shared_fields(job.spec, case, ready, told) if case else [{}]
    seconds = (time.perf_counter() - start) / len(told)
    asked = {"seconds": seconds, "choice": choice, "method_reason": reason}
    return [replace(sensor, **asked, **own) for sensor, own in zip(told, fields, strict=True)]


def _ground(job: Job, runs: Sequence[Run]) -> Ground:
    """Ground of a sensor's problem; of a case its linearisation is already on it.

    Chains are kept where they may be resumed, which those of a budget are not.
    """
    start, study, sampling = time.perf_counter(), job.study, job.study.sampling
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
    doubt = None if sampling.climbs else job.doubt
    if not runs[0].of_case:
        problem = problem_of(job.spec, runs, costs=study.costs, hierarchical=study.hierarchical)
        return ground_of(replace(problem, doubt=doubt), job.rng, job.tell, limits)
    job.tell("stills, noise and linearisation")
    case, ready = prepare_case(job.spec, runs, job.rng, doubt, job.tell)
    problem = Problem(job.spec, (), ready.prior, study.costs, study.hierarchical, case)
    ground = ground_of(problem, job.rng, job.tell, limits)
    ground.shared["factor"] = (ready, time.perf_counter() - start)
    return ground


def _answered(job: Job, ground: Ground) -> tuple[Answer, Choice | None, str]:
    """Answer of the method that the study asks for, or its budget or accuracy; which was taken, and why."""
    sampling = job.study.sampling
    if not sampling.climbs:
        answer, reason = by_method(sampling.method, ground)
        return answer, None, reason
    law = calibrate(job.tell)
    if sampling.budget is not None:
        answer, choice = by_budget(ground, sampling.budget, law)
    else:
        answer, choice = by_accuracy(ground, sampling.accuracy or 0.0, law)
    return answer, choice, f"{choice.asked} was asked for"


def _in_short(selection: Selection) -> str:
    """Terms of a component by verdict; of a case with the component's name."""
    words = (term.verdict for term in selection.terms)
    return by_verdict(zip(selection.columns, words, strict=True))


def _quicker(job: Job, runs: Sequence[Run]) -> str:
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


def check(study: Study | Path | str, *, progress: Progress = silent) -> tuple[SensorCheck, ...]:
    """What the runs of each sensor of a study, or of its file, can tell of each term, before a fit.

    The noise is the class's typical one where the study gives none, so that outputs are not looked at
    except by a free tumble, whose directions come from nowhere else.
    """
    study = _read(study)
    checks: list[SensorCheck] = []
    for k, spec in enumerate(study.sensors):
        tell = part_of(progress, k, len(study.sensors), f"{spec.id}: ")
        tell(f"reading {counted(len(spec.runs), 'run')}")
        runs = runs_of(spec, study.seed, k, tell)
        with _named(spec):
            checks += _checks(spec, runs)
    return tuple(checks)


def _read(study: Study | Path | str) -> Study:
    return study if isinstance(study, Study) else read_study(study)


def _checks(spec: SensorSpec, runs: Sequence[Run]) -> Iterator[SensorCheck]:
    case, ready = prepare_case(spec, runs) if runs[0].of_case else (None, before_fit(spec, runs))
    sd, extras = ready.prior.sd, ready.summary.extras
    stills = tuple(f"{run.name}: {note}" for run in runs for note in run.source.notes if STILLS in note)
    for component in components_of(case, ready.summary):
        seen = observe(ready.summary.factor, sd, component.facts, reach=ready.summary.reach)
        seen = carried(
            seen,
            {component.column(name): component.column(leader) for name, leader in component.library.tied},
        )
        yield SensorCheck(id_of(spec, component), component.library, seen, extras, (*_faults(runs), *stills))
        stills = ()


def _faults(runs: Sequence[Run]) -> tuple[str, ...]:
    return faults((run.name, run.procedure, run.source) for run in runs)


@contextmanager
def _named(spec: SensorSpec) -> Iterator[None]:
    """Let what a stage cannot do name the sensor that it could not do it for."""
    try:
        yield
    except UnobservableError as error:
        raise UnobservableError(f"sensor '{spec.id}': {error}", error.terms) from None
