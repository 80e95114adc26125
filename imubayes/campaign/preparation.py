"""From a sensor's entry in a study to a linear Gaussian problem: runs, priors, noise, and the test bench."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, replace

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.algebra.factor import posterior_root
from imubayes.campaign import SensorSpec
from imubayes.campaign.prepared import (
    NOT_TOLD,
    Doubt,
    Prepared,
    absorbing,
    component_prior,
    examined,
    referenced,
    rules_of,
    stated,
    summarized,
    triad_prior,
    unstated,
    with_extras,
)
from imubayes.errors import ConvergenceError
from imubayes.inference.case import Case, CaseComponent, TriadSpec
from imubayes.inference.conflicts import Priors, refuse_conflicts
from imubayes.inference.ferraris import solve_ferraris
from imubayes.inference.free_tumble import solve_free_tumble, solve_imu_tumble, trusted_stills
from imubayes.inference.known_case import Own, blind_rows, solve_known_case
from imubayes.inference.known_quantities import Recovered, recover
from imubayes.inference.linear import Extra, Linear, linear_of
from imubayes.inference.nuisances import extras_for, rows_with, shortened, shortens
from imubayes.inference.prior import ScalePrior
from imubayes.inference.reproducibility import Spread, between_stills
from imubayes.inference.robust import Distrusted, robust_rows
from imubayes.inference.stills import WINDOW, condensed, find_stills, times_of, with_stills
from imubayes.inference.summary import Summary, summarize
from imubayes.inference.triad import Triad, angles_of, calibration, triad_of
from imubayes.rig.bench import KINDS, effective
from imubayes.rig.filtering import with_disturbances
from imubayes.rig.inputs import Run
from imubayes.rig.recordings import CASES, FERRARIS, OUTPUT_UNIT, RunSpec
from imubayes.rig.runs import read_imu_run, read_run
from imubayes.rig.simulate import simulate_imu, simulate_runs
from imubayes.selection.decision import Selection
from imubayes.sensors.catalogue import typical_noise
from imubayes.sensors.imu import ACCELEROMETERS
from imubayes.sensors.noise import Noise, NoiseRule
from imubayes.sensors.terms import Library
from imubayes.units import factor
from imubayes.work import Progress, silent


def runs_of(spec: SensorSpec, seed: int, index: int, tell: Progress = silent) -> tuple[Run, ...]:
    """Read the recorded runs of a sensor and simulate the others, in the study's order.

    Long files are read a part at a time; `tell` is told how far that is. It is a `DataError` if a file cannot
    be used, or its outputs are far beyond the class.
    """
    simulated = {run.name: run for run in simulate_sensor(spec, seed, index)[0]}

    priors: Priors = {half.kind: (half.sensor_class, half.prior) for half in spec.halves}

    def read(asked: RunSpec) -> Run:
        run = read_imu_run(asked, tell=tell) if spec.gyroscope else read_run(asked, spec.kind, tell=tell)
        run = with_stills(run, asked.still_window or WINDOW, asked.still_threshold)
        held = condensed(with_disturbances(run, spec.kind))
        if not spec.accept_prior_conflict:  # in the hand it is the samples that tell how a case turns
            refuse_conflicts(held if run.sections else run, spec.kind, priors)
        return held

    return tuple(simulated[s.name] if s.simulate else read(s) for s in spec.runs)


def simulate_sensor(spec: SensorSpec, seed: int, index: int) -> tuple[tuple[Run, ...], Mapping[str, float]]:
    """Simulate the runs of one sensor, by its index in a study; give them with what is behind them.

    That is the coefficients by name, of a whole IMU by component and term (``ax.b0``), and the errors of the
    bench where they are drawn, SI. Sensors are independent draws. It is a `StudyError` if the options of a
    run make no run.
    """
    wanted = [s for s in spec.runs if s.simulate is not None]
    if not wanted or spec.sensor_class is None:
        return (), {}
    rng = np.random.default_rng([seed, index])
    if spec.gyroscope or wanted[0].procedure in CASES:
        return simulate_imu(
            wanted,
            classes={half.kind: half.sensor_class for half in spec.halves if half.sensor_class},
            libraries={half.kind: half.library for half in spec.halves},
            truth={name: value for half in spec.halves for name, value in half.truth.items()},
            bench={half.kind: half.reference for half in spec.halves} if spec.bench_drawn else {},
            noises={half.kind: [s.noise.value for s in half.runs if s.simulate] for half in spec.halves},
            rng=rng,
        )
    bench = spec.reference if spec.bench_drawn else {}
    return simulate_runs(wanted, spec.sensor_class, spec.library, truth=spec.truth, bench=bench, rng=rng)


def prepare(
    spec: SensorSpec,
    runs: Sequence[Run],
    tell: Progress,
    rng: np.random.Generator,
    doubt: Doubt | None = None,
) -> Prepared:
    """Noise, errors of the bench, and distrusted dwells (which `rng` is for) of a component's runs.

    With a `doubt` it is asked what bench and library lack; where the data show it, that stands beside the
    terms.
    """
    if doubt is not None and (alone := unstated(spec, runs)):
        names = " and ".join(alone)
        try:
            ready = _prepared(replace(spec, reference=alone), runs, tell, rng, doubt)
        except ConvergenceError:  # beside powers of a hundred thousand g no digits are left for it
            ready = _prepared(spec, runs, tell, rng, doubt)
            return replace(ready, source=f"{ready.source}; {names} taken as exact, for it does not settle")
        told = f"{names} by the catalogue, since the study says nothing of its bench"
        return replace(ready, source=f"{ready.source}; {told}")
    return _prepared(spec, runs, tell, rng, doubt)


def _prepared(
    spec: SensorSpec, runs: Sequence[Run], tell: Progress, rng: np.random.Generator, doubt: Doubt | None
) -> Prepared:
    prior, source = component_prior(spec, runs)
    asked = spec if doubt is None else replace(spec, estimated=frozenset(), reference=stated(spec))
    ready = summarized(asked, runs, prior, tell)
    distrusted: tuple[Distrusted, ...] = ()
    if spec.robust:
        tell("dwells that cannot be trusted")
        usual = {"sensor": spec.sensor_class, "extras": ready.summary.extras}

        def noise_of(runs: Sequence[Run], rows: Sequence[Linear]) -> list[Noise]:
            summary = summarize(runs, spec.library, rules=rules_of(spec, runs), rows=rows, **usual)
            return [run.noise for run in summary.runs]

        kept = robust_rows(runs, ready.rows, ready.prior.sd, noise_of, rng=rng)
        runs, distrusted = kept.noted, kept.distrusted
        # a run that is left out takes the errors with it that no other run has
        kinds = {name: asked.reference[name] for name in effective(runs, asked.reference)}
        ready = summarized(asked, runs, prior, tell, kinds)
    ready = replace(ready, source=source, distrusted=distrusted)
    return ready if doubt is None else absorbing(spec, ready, prior, tell, doubt)


def before_fit(spec: SensorSpec, runs: Sequence[Run]) -> Prepared:
    """Runs of a component as a linear problem without a look at what the sensor said."""
    usual = {"rules": _noise_before_fit(spec), "sensor": spec.sensor_class}
    rows, prior, extras = rows_before(spec, runs)
    summary = summarize(runs, spec.library, rows=rows, extras=extras, **usual)
    if shortens(extras):
        root = posterior_root(summary.factor, prior.sd)[1][-len(extras) :]
        rows, prior, extras = rows_before(spec, runs, shortened(runs, extras, np.sum(root**2, axis=1)))
        summary = summarize(runs, spec.library, rows=rows, extras=extras, **usual)
    return Prepared(runs, summary, rows, prior, component_prior(spec, runs)[1])


def rows_before(
    spec: SensorSpec, runs: Sequence[Run], extras: tuple[Extra, ...] | None = None
) -> tuple[Sequence[Linear], ScalePrior, tuple[Extra, ...]]:
    """Rows of runs with known inputs where all coefficients are zero, prior of the columns, and the extras.

    Of a whole IMU they are component by component, and in each run by run, over the columns of all. Those of
    one component have the extras of its reference, if none are given.
    """
    if spec.gyroscope:
        asked = (
            TriadSpec(half.library, triad_prior(half)[0], reference=half.reference) for half in spec.halves
        )
        return blind_rows(runs, *asked)
    prior, _ = component_prior(spec, runs)
    if extras is None:
        extras = extras_for(runs, spec.reference, sensor=spec.kind)
    rows: Sequence[Linear] = [linear_of(run, spec.library) for run in runs]
    if extras:
        rows = rows_with(runs, spec.library, extras, np.zeros(len(prior.sd)), np.zeros(len(extras)))
    return rows, with_extras(prior, extras), extras


def before_tumble(spec: SensorSpec) -> tuple[FloatArray, tuple[Extra, ...]]:
    """Prior sd of the terms of a free tumble's components, SI, and the errors of what it leans on."""
    return np.concatenate([triad_prior(half)[0].sd for half in spec.halves]), _leant_on(spec)


def libraries_of(spec: SensorSpec) -> Mapping[str, Library]:
    """Candidates of each component by its name, which is that of its columns; empty of a single one."""
    if not (spec.gyroscope or spec.runs[0].procedure in CASES):
        return {"": spec.library}
    triads = [triad_of(half.library, referenced=referenced(half)) for half in spec.halves]
    return {
        name: lib for triad in triads for name, lib in zip(triad.components, triad.libraries, strict=True)
    }


def prepare_case(
    spec: SensorSpec,
    runs: Sequence[Run],
    rng: np.random.Generator | None = None,
    doubt: Doubt | None = None,
    tell: Progress = silent,
) -> tuple[Case, Prepared]:
    """Linearise runs of several components in one case, and give the linear problem that comes of it.

    Runs are free tumbles of a triad; of an IMU all free tumbles, all with known sections, or all with known
    inputs. Without an `rng`, which dwells that are not trusted need, what the sensor said is left out where
    inputs are known, so that nothing is fitted. With a `doubt` it is asked of each component what bench and
    library lack; where inputs are known and the data show it, that stands beside its terms. It is a
    `StudyError` if the study names no class, and a `ConvergenceError` if a linearisation does not settle.
    """
    case, ready = _prepared_case(spec, runs, rng)
    if doubt is None:
        return case, ready
    tell("residuals")
    first = ready = examined(ready, doubt, case)
    alone, own = dict[str, Prepared](), dict[str, Own]()
    for one in case.components if case.runs else ():
        if not ready.part(one).fits:
            with suppress(*NOT_TOLD):
                alone[one.name], beside = _alone(spec, case, one, tell, doubt)
                own |= {one.name: beside} if beside else {}
    if own:
        try:
            case, ready = _with_own(spec, runs, case, ready, own)
            ready = examined(ready, doubt, case)
        except NOT_TOLD:
            own = {}
    parts = dict(ready.parts)
    for name, by_itself in alone.items():
        parts[name] = _told(name, ready.parts[name], first.parts[name], by_itself, beside=name in own)
    spreads = tuple(spread for part in parts.values() for spread in part.spreads)
    return case, replace(ready, parts=parts, spreads=spreads)


def _alone(
    spec: SensorSpec, case: Case, component: CaseComponent, tell: Progress, doubt: Doubt
) -> tuple[Prepared, Own | None]:
    """A component by itself, and what is then its own in the case; None where its rows are as they were."""
    half, runs = spec.of(component.library.kind), [case.runs[k] for k in component.parts]
    there = {name: half.reference[name] for name in effective(runs, half.reference)}
    asked = replace(half, id=f"{spec.id}.{component.name}", gyroscope=None, reference=there)
    prior, _ = component_prior(asked, runs)
    ready = summarized(asked, runs, prior, tell)
    made = absorbing(asked, ready, prior, tell, doubt)
    if made.runs is ready.runs:
        return made, None
    bench = {spread.kind: spread.mean for spread in made.spreads if spread.kind in KINDS}
    return made, Own(tuple(made.runs), made.rules, bench, made.beside, scattering=True)


def _with_own(
    spec: SensorSpec, runs: Sequence[Run], case: Case, ready: Prepared, own: Mapping[str, Own]
) -> tuple[Case, Prepared]:
    """Case and linear problem again, of which some components have something of their own."""
    every = dict(own)
    for one in case.components:
        said = tuple(case.runs[k] for k in one.parts)  # without the dwells that are not trusted
        every.setdefault(one.name, Own(said, rules_of(spec.of(one.library.kind), said)))
    again, made = _prepared_case(spec, runs, None, every)
    return replace(again, distrusted=case.distrusted), replace(made, distrusted=ready.distrusted)


def _told(name: str, part: Prepared, first: Prepared, alone: Prepared, *, beside: bool) -> Prepared:
    """A component with what it tells by itself: how far off its noise is stated, or what stands beside it.

    `first` is what it was before something was.
    """
    if not beside:
        pairs = zip(part.checks, alone.checks or part.checks, strict=True)
        return replace(part, checks=tuple(replace(one, misstated=own.misstated) for one, own in pairs))
    spreads = [replace(one, names=tuple(f"{error}.{name}" for error in one.names)) for one in alone.spreads]
    absorbed = first.misfit if alone.absorbed else None
    return replace(part, spreads=tuple(spreads), scatter=alone.scatter, absorbed=absorbed)


def _prepared_case(
    spec: SensorSpec,
    runs: Sequence[Run],
    rng: np.random.Generator | None,
    own: Mapping[str, Own] | None = None,
) -> tuple[Case, Prepared]:
    """Case and linear problem, of which components have what is their `own`."""
    prior, source = triad_prior(spec)
    distrusted: tuple[Distrusted, ...] = ()
    free: Case | None = None
    asked = TriadSpec(spec.library, prior, spec.sensor_class, rules_of(spec, runs))
    if spec.robust and rng is not None and not referenced(spec):
        runs, distrusted, free = trusted_stills(runs, asked, extras=_leant_on(spec), rng=rng)
    if spec.gyroscope:
        theirs, beside = triad_prior(spec.gyroscope)
        source = source if source == beside else f"accelerometers: {source}; gyroscopes: {beside}"
        case = _imu_case(spec, runs, (prior, theirs), rng, free, own)
        prior = ScalePrior([*prior.sd, *theirs.sd])
    elif referenced(spec):
        case = _of_sections(spec, runs, asked)
    else:
        case = free or solve_free_tumble(runs, asked, extras=_leant_on(spec))
    whole = with_extras(prior, case.summary.extras)
    if referenced(spec):
        case = replace(case, angles=angles_of(case.triads, case.summary, whole.sd))
    return case, Prepared(runs, case.summary, case.rows, whole, source, (*case.distrusted, *distrusted))


def _imu_case(
    spec: SensorSpec,
    runs: Sequence[Run],
    priors: tuple[ScalePrior, ScalePrior],
    rng: np.random.Generator | None,
    free: Case | None,
    own: Mapping[str, Own] | None,
) -> Case:
    """Characterise an IMU in one piece, by what its runs know."""
    known, blind = runs[0].known, rng is None and own is None
    asked = [
        TriadSpec(
            half.library,
            prior,
            half.sensor_class,
            _noise_before_fit(half) if blind and known else rules_of(half, runs),
            half.reference,
        )
        for half, prior in zip(spec.halves, priors, strict=True)
    ]
    if known:
        return solve_known_case(runs, *asked, blind=blind, rng=rng if spec.robust else None, own=own)
    if runs[0].procedure == FERRARIS:
        return _of_sections(spec, runs, *asked)
    return solve_imu_tumble(runs, *asked, extras=_leant_on(spec), free=free)


def _of_sections(spec: SensorSpec, runs: Sequence[Run], *asked: TriadSpec) -> Case:
    """Characterise what has known positions and turns."""
    return solve_ferraris(runs, *asked, extras=_leant_on(spec), fixture=spec.reference.get("fixture"))


def _leant_on(spec: SensorSpec) -> tuple[Extra, ...]:
    """Errors of what partly known runs lean on, where the study allows for them; `ferraris` has a fixture."""
    kinds = [KINDS[name] for name in spec.reference if KINDS[name].each != "mount"]
    return tuple(
        Extra(kind.name, kind.name, spec.reference[kind.name], kind.unit, kind.printed, kind.text)
        for kind in kinds
    )


def _noise_before_fit(spec: SensorSpec) -> dict[str, NoiseRule]:
    """Noise rules that need no fit: what the study gives, else the class's typical noise, else white."""
    typical = typical_noise(spec.sensor_class) if spec.sensor_class else None
    usual = NoiseRule("fixed", typical) if typical else NoiseRule("white")
    return {s.name: s.noise if s.noise.rule == "fixed" and s.noise.value else usual for s in spec.runs}


def nominal_columns(spec: SensorSpec, component: str) -> tuple[float, float]:
    """Scale (SI per file unit) and offset (file units) that the study gives a component's column."""
    column = spec.runs[0].columns.get(component)
    if column is None:
        return 1.0, 0.0
    like = OUTPUT_UNIT["accelerometer" if component in ACCELEROMETERS else "gyroscope"]
    unit = factor(column.unit, like) if column.unit and column.scale is None else 1.0
    return column.scale or unit, column.offset or 0.0


def compensation(spec: SensorSpec, case: Case, theta: Sequence[float]) -> list[dict[str, object]]:
    """Compensation of each component of a case, as calibration tools publish it (see `triad.calibration`).

    The sensor's columns say what the file's numbers are; `theta` are coefficients of all components, SI.
    """
    parts = np.split(np.asarray(theta, dtype=float), [len(case.triads[0].theta)])
    angles = {"angles": [asdict(angle) for angle in case.angles]} if case.angles else {}
    return [
        row | angles
        for triad, mean in zip(case.triads, parts, strict=False)
        for row in calibration(
            replace(triad, theta=mean),
            [nominal_columns(spec, name) for name in triad.components],
            alone=len(case.triads) == 1,
        )
    ]


def of_case(
    spec: SensorSpec,
    case: Case,
    ready: Prepared,
    selections: Sequence[Selection],
    walking: Sequence[bool],
    flown: Sequence[float],
) -> list[dict[str, object]]:
    """Fields of `SensorResult` that the components of a decided case have for being in one.

    Of a component whose bias is `walking` b0 is that on average over the record; `flown` are the coefficients
    that are exported, of all components.
    """
    runs = [run for run in ready.runs if not run.known]
    try:
        recovered = recover(_over_record(case, selections, walking), runs, ready.prior.sd, np.array(flown))
    except ConvergenceError:  # data and prior disagree, which the report says first of all
        recovered = ()
    rows = compensation(spec, case, [term.mean for selection in selections for term in selection.terms])
    stills = {"accelerometer": _between_stills(runs, ready.summary, recovered)}
    parts = [(ready.part(component), component.library.kind) for component in case.components]
    return [
        {
            "calibration": row,
            "recovered": recovered,
            "spreads": (*part.spreads, *part.scatter, *stills.get(kind, ())),
        }
        for row, (part, kind) in zip(rows, parts, strict=True)
    ]


def _between_stills(runs: Sequence[Run], summary: Summary, told: Sequence[Recovered]) -> tuple[Spread, ...]:
    """Sd from still to still of every run in which gravity is known."""
    named, noise = {run.name: run for run in runs}, {run.name: run.noise.N for run in summary.runs}
    spreads: list[Spread | None] = []
    for quantity in told:
        if quantity.what == "gravity" and quantity.run in noise:
            times = np.array(times_of(named[quantity.run], find_stills(named[quantity.run])))
            spreads.append(between_stills(quantity, times[:, 1] - times[:, 0], noise[quantity.run]))
    return tuple(spread for spread in spreads if spread is not None)


def _over_record(case: Case, selections: Sequence[Selection], walking: Sequence[bool]) -> Case:
    """Case whose triads have the b0 that is told of components whose bias is walking."""
    told = {
        column: term.full_mean
        for selection, walks in zip(selections, walking, strict=True)
        for column, term in zip(selection.columns, selection.terms, strict=True)
        if walks and term.name == "b0"
    }

    def moved(triad: Triad) -> Triad:
        theta = [told.get(name, value) for name, value in zip(triad.names, triad.theta.tolist(), strict=True)]
        return replace(triad, theta=np.array(theta))

    return replace(case, triads=tuple(map(moved, case.triads)))
