"""The whole method, in the order a paper would tell it.

Read the runs; estimate each run's noise with the full library in the mean, whiten, and add up one triangular
factor; weigh every submodel on it; say of each term whether it is needed, not needed, or cannot be told; and
test whether what is left is noise.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from imubayes.campaign import SensorCheck, SensorResult, SensorSpec, Study, StudyResult
from imubayes.errors import StudyError, UnobservableError
from imubayes.inference.linear import deviation, linear_of
from imubayes.inference.norm_only import FreeTumble, solve_free_tumble
from imubayes.inference.prior import ScalePrior, class_sd, weak_sd
from imubayes.inference.residuals import ResidualCheck, check_residuals, judge
from imubayes.inference.summary import Summary, summarize
from imubayes.inference.triad import COMPONENTS, calibration, triad_of
from imubayes.planning.observability import observe
from imubayes.rig.inputs import Run, TriadRun
from imubayes.rig.runs import read_run, simulate_runs
from imubayes.selection.decision import Selection, select
from imubayes.selection.draws import posterior_draws, prior_draws
from imubayes.sensors.catalogue import typical_noise
from imubayes.sensors.noise import NoiseRule
from imubayes.sensors.terms import Library
from imubayes.units import factor

DRAWS = 2000
"""Posterior and prior draws that a result carries."""


def run(study: Study, *, progress: Callable[[str], None] = lambda message: None) -> StudyResult:
    """Characterise every sensor of a study.

    Parameters
    ----------
    study : as `config.read_study` gives it.
    progress : is told what goes on.

    Raises
    ------
    InputError : if a run or the study cannot be used; the message says where and why.
    ConvergenceError : if a free tumble does not settle.
    """
    results: list[SensorResult] = []
    for k, spec in enumerate(study.sensors):
        progress(f"{spec.id}: reading {len(spec.runs)} runs")
        runs = runs_of(spec, study.seed, k)
        rng = np.random.default_rng([study.seed, k, 1])
        with _named(spec):
            if triad := _of_triad(runs):
                results += _triad(spec, triad, rng, progress)
            else:
                results.append(_single(spec, _of_component(runs), rng, progress))
    return StudyResult(study, tuple(results))


def check(study: Study) -> tuple[SensorCheck, ...]:
    """What the runs of each sensor can tell of each term, before anything is fitted.

    The noise is the class's typical one where the study gives none, so that outputs are not looked at
    except by a free tumble, whose directions come from nowhere else.
    """
    checks: list[SensorCheck] = []
    for k, spec in enumerate(study.sensors):
        runs = runs_of(spec, study.seed, k)
        with _named(spec):
            triad = _of_triad(runs)
            checks += _triad_check(spec, triad) if triad else [_check(spec, _of_component(runs))]
    return tuple(checks)


def _check(spec: SensorSpec, runs: Sequence[Run]) -> SensorCheck:
    summary = summarize(runs, spec.library, sensor=spec.sensor_class, rules=_before_fit(spec))
    prior, _ = _prior(spec, runs, summary)
    return SensorCheck(
        spec.id, spec.library, observe(summary.factor, prior.sd, summary.facts, reach=summary.reach)
    )


def _triad_check(spec: SensorSpec, runs: Sequence[TriadRun]) -> list[SensorCheck]:
    found = _free_tumble(spec, runs)
    seen = observe(
        found.summary.factor, _triad_prior(spec)[0].sd, found.summary.facts, reach=found.summary.reach
    )
    libraries = zip(COMPONENTS, found.triad.libraries, strict=True)
    return [SensorCheck(f"{spec.id}.{name}", lib, seen) for name, lib in libraries]


def runs_of(spec: SensorSpec, seed: int, index: int) -> tuple[Run | TriadRun, ...]:
    """Read the recorded runs of a sensor and simulate the others, in the study's order."""
    simulated = {run.name: run for run in simulate_sensor(spec, seed, index)[0]}
    return tuple(simulated[s.name] if s.simulate else read_run(s, spec.kind) for s in spec.runs)


def simulate_sensor(spec: SensorSpec, seed: int, index: int) -> tuple[tuple[Run, ...], Mapping[str, float]]:
    """Simulate the runs of one sensor of a study; give them with the coefficients behind them.

    Parameters
    ----------
    spec : of the sensor.
    seed : of the study.
    index : of the sensor in the study, so that sensors are independent draws.

    Raises
    ------
    StudyError : if the options of a run make no run.
    """
    wanted = [s for s in spec.runs if s.simulate is not None]
    if not wanted or spec.sensor_class is None:
        return (), {}
    rng = np.random.default_rng([seed, index])
    return simulate_runs(wanted, spec.sensor_class, spec.library, truth=spec.truth, rng=rng)


def _single(
    spec: SensorSpec, runs: Sequence[Run], rng: np.random.Generator, progress: Callable[[str], None]
) -> SensorResult:
    """Characterise one component with known inputs."""
    start = time.perf_counter()
    progress(f"{spec.id}: noise and factor of {sum(len(r.inputs) for r in runs):,} samples")
    summary = summarize(runs, spec.library, sensor=spec.sensor_class, rules=_rules(spec))
    prior, source = _prior(spec, runs, summary)
    progress(f"{spec.id}: every model of {len(summary.names)} terms")
    selection = select(summary, prior)
    progress(f"{spec.id}: residuals")
    checks = tuple(
        check_residuals(r, linear_of(r, spec.library), selection.free, s)
        for r, s in zip(runs, summary.runs, strict=True)
    )
    return _result(spec, spec.id, (summary, selection, checks), rng, source, time.perf_counter() - start)


def _triad(
    spec: SensorSpec, runs: Sequence[TriadRun], rng: np.random.Generator, progress: Callable[[str], None]
) -> list[SensorResult]:
    """Characterise the three components of a reference-free tumble."""
    start = time.perf_counter()
    progress(f"{spec.id}: stills, noise and linearisation")
    found = _free_tumble(spec, runs)
    prior, source = _triad_prior(spec)
    checks = tuple(
        judge(left, rows, s, dict(zip(("f_i", "f_j", "f_k"), force.T, strict=True)))
        for (left, rows, force), s in zip(found.residuals, found.summary.runs, strict=True)
    )
    selections: list[Selection] = []
    for name, lib in zip(COMPONENTS, found.triad.libraries, strict=True):
        progress(f"{spec.id}.{name}: every model of {len(lib.terms)} terms")
        selections.append(select(found.summary, prior, lib, component=name))
    theta = np.array([term.mean for selection in selections for term in selection.terms])
    rows = calibration(replace(found.triad, theta=theta), [_nominal(spec, name) for name in COMPONENTS])
    seconds = (time.perf_counter() - start) / len(COMPONENTS)
    return [
        replace(
            _result(spec, f"{spec.id}.{name}", (found.summary, selection, checks), rng, source, seconds),
            calibration=row,
        )
        for name, selection, row in zip(COMPONENTS, selections, rows, strict=True)
    ]


def _result(
    spec: SensorSpec,
    name: str,
    parts: tuple[Summary, Selection, tuple[ResidualCheck, ...]],
    rng: np.random.Generator,
    source: str,
    seconds: float,
) -> SensorResult:
    summary, selection, checks = parts
    return SensorResult(
        id=name,
        kind=spec.kind,
        class_id=spec.sensor_class.id if spec.sensor_class else "",
        samples=sum(r.samples for r in summary.runs),
        runs=summary.runs,
        selection=selection,
        checks=checks,
        draws=posterior_draws(selection, DRAWS, rng),
        prior_draws=prior_draws(selection, DRAWS, rng),
        prior_source=source,
        seconds=seconds,
    )


@contextmanager
def _named(spec: SensorSpec) -> Iterator[None]:
    """Let what a stage cannot do name the sensor that it could not do it for."""
    try:
        yield
    except UnobservableError as error:
        raise UnobservableError(f"sensor '{spec.id}': {error}", error.terms) from None


def _of_triad(runs: Sequence[Run | TriadRun]) -> list[TriadRun]:
    """Free tumbles among the runs; a study has all of them or none."""
    return [run for run in runs if isinstance(run, TriadRun)]


def _of_component(runs: Sequence[Run | TriadRun]) -> list[Run]:
    return [run for run in runs if isinstance(run, Run)]


def _free_tumble(spec: SensorSpec, runs: Sequence[TriadRun]) -> FreeTumble:
    return solve_free_tumble(
        runs, spec.library, _triad_prior(spec)[0], sensor=spec.sensor_class, rules=_rules(spec)
    )


def _rules(spec: SensorSpec) -> dict[str, NoiseRule]:
    return {s.name: s.noise for s in spec.runs}


def _before_fit(spec: SensorSpec) -> dict[str, NoiseRule]:
    """Noise rules that need no fit: what the study gives, else the class's typical noise, else white."""
    typical = typical_noise(spec.sensor_class) if spec.sensor_class else None
    usual = NoiseRule("fixed", typical) if typical else NoiseRule("white")
    return {s.name: s.noise if s.noise.rule == "fixed" and s.noise.value else usual for s in spec.runs}


def _prior(spec: SensorSpec, runs: Sequence[Run], summary: Summary) -> tuple[ScalePrior, str]:
    """Physical prior of a component, and where it comes from in words."""
    if spec.sensor_class:
        return _overridden(class_sd(spec.sensor_class, spec.library), spec, [spec.library])
    swing = max(float(np.max(np.abs(deviation(r, spec.library)))) for r in runs)
    return _overridden(weak_sd(np.array(list(summary.reach.values())), swing), spec, [spec.library])


def _triad_prior(spec: SensorSpec) -> tuple[ScalePrior, str]:
    libraries = triad_of(spec.library).libraries
    if spec.sensor_class is None:
        raise StudyError(
            f"sensor '{spec.id}': a free tumble needs a class: the directions alone give no prior"
        )
    return _overridden(
        np.concatenate([class_sd(spec.sensor_class, lib) for lib in libraries]), spec, libraries
    )


def _overridden(sd: np.ndarray, spec: SensorSpec, libraries: Sequence[Library]) -> tuple[ScalePrior, str]:
    """Prior with the study's own sds in place of the class's."""
    names = [name for lib in libraries for name in lib.names]
    values = [spec.prior.get(name, usual) for name, usual in zip(names, sd.tolist(), strict=True)]
    given = [name for name in dict.fromkeys(names) if name in spec.prior]
    source = (
        f"typical magnitudes of class {spec.sensor_class.id}"
        if spec.sensor_class
        else "no class is named: each term alone may move the output by its whole range"
    )
    return ScalePrior(values), f"{source}; {', '.join(given)} from the study" if given else source


def _nominal(spec: SensorSpec, component: str) -> tuple[float, float]:
    """Scale (SI per file unit) and offset (file units) that the study gives a component's column."""
    column = spec.runs[0].columns.get(component)
    if column is None:
        return 1.0, 0.0
    unit = factor(column.unit, "m/s^2") if column.unit and column.scale is None else 1.0
    return column.scale or unit, column.offset or 0.0
