"""From a sensor's entry in a study to a linear Gaussian problem: runs, priors, noise, and the test bench."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import reduce
from typing import Any

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import add
from imubayes.campaign.study import SensorSpec
from imubayes.errors import ConvergenceError, StudyError, UnobservableError
from imubayes.inference.case import Asked, Case
from imubayes.inference.conflicts import Priors, refuse_conflicts
from imubayes.inference.dwells import dwells_of
from imubayes.inference.ferraris import solve_ferraris
from imubayes.inference.free_tumble import solve_free_tumble, solve_imu_tumble, trusted_stills
from imubayes.inference.known_case import blind_rows, solve_known_case
from imubayes.inference.known_quantities import Recovered, recover
from imubayes.inference.lack_of_fit import NOTHING, Beside, functions_of, varies
from imubayes.inference.linear import Extra, Linear, linear_of, reach_of, residuals, swing_of
from imubayes.inference.mcmc.chains import at_found_noise
from imubayes.inference.misfit import Misfit, find_misfit
from imubayes.inference.nuisances import extras_for, rows_with, solve
from imubayes.inference.prior import ScalePrior, class_sd, weak_sd
from imubayes.inference.reproducibility import (
    FEWEST,
    SHOWN,
    Spread,
    between_stills,
    odds_of,
    scatter_of,
    spreads,
)
from imubayes.inference.residuals import check_residuals, level_of
from imubayes.inference.robust import Distrusted, NoiseOf, robust_rows
from imubayes.inference.stills import WINDOW, condensed, find_stills, times_of, with_stills
from imubayes.inference.summary import Summary, rules_among, summarize
from imubayes.inference.triad import Triad, angles_of, calibration, triad_of
from imubayes.inference.whitened import whitened_factor
from imubayes.progress import Progress, silent
from imubayes.rig.bench import effective
from imubayes.rig.filtering import dwell_means, with_disturbances
from imubayes.rig.inputs import Run
from imubayes.rig.recordings import CASES, FERRARIS, FREE_TUMBLE, OUTPUT_UNIT, RunSpec
from imubayes.rig.reference import KINDS, errors_of
from imubayes.rig.runs import read_imu_run, read_run
from imubayes.rig.simulate import Made, simulate_imu, simulate_runs
from imubayes.selection.decision import Selection, loose_fit
from imubayes.sensors.catalogue import typical_noise
from imubayes.sensors.imu import ACCELEROMETERS
from imubayes.sensors.noise import Noise, NoiseRule
from imubayes.sensors.terms import Library
from imubayes.units import factor

SETTLED = 0.05
"""Change of ln of an estimated sd that is none: its own uncertainty is larger."""

HIDDEN = 30.0
"""Typical size of what the library lacks over what it leaves of that: powers take the place of most of it."""

SPARE = 8
"""Dwells beyond the columns that a run excites from which their scatter is told."""

ROUNDS = 20
"""Most rounds in which estimated sds must settle; they take two or three."""


def runs_of(spec: SensorSpec, seed: int, index: int, tell: Progress = silent) -> tuple[Run, ...]:
    """Read the recorded runs of a sensor and simulate the others, in the study's order.

    Long files are read a part at a time; `tell` is told how far that is.

    Raises
    ------
    DataError : if a file cannot be used, or its outputs are far beyond the class.
    """
    simulated = {run.name: run for run in simulate_sensor(spec, seed, index)[0]}

    kinds = (spec, spec.gyroscope) if spec.gyroscope else (spec,)
    priors: Priors = {one.kind: (one.sensor_class, one.prior) for one in kinds}

    def read(one: RunSpec) -> Run:
        run = read_imu_run(one, tell=tell) if spec.gyroscope else read_run(one, spec.kind, tell=tell)
        run = with_stills(run, one.still_window or WINDOW, one.still_threshold)
        held = condensed(with_disturbances(run, spec.kind))
        if not spec.accept_prior_conflict:  # in the hand it is the samples that tell how a case turns
            refuse_conflicts(held if run.sections else run, spec.kind, priors)
        return held

    return tuple(simulated[s.name] if s.simulate else read(s) for s in spec.runs)


def simulate_sensor(spec: SensorSpec, seed: int, index: int) -> tuple[tuple[Run, ...], Mapping[str, float]]:
    """Simulate the runs of one sensor, by its index in a study; give them with what is behind them.

    That is the coefficients by name, of a whole IMU by component and term (``ax.b0``), and the errors of the
    bench where they are drawn, SI. Sensors are independent draws.

    Raises
    ------
    StudyError : if the options of a run make no run.
    """
    wanted = [s for s in spec.runs if s.simulate is not None]
    if not wanted or spec.sensor_class is None:
        return (), {}
    rng = np.random.default_rng([seed, index])
    if spec.gyroscope or wanted[0].procedure in CASES:
        halves = (spec, spec.gyroscope) if spec.gyroscope else (spec,)
        made = Made(
            classes={one.kind: one.sensor_class for one in halves if one.sensor_class},
            libraries={one.kind: one.library for one in halves},
            truth={name: value for one in halves for name, value in one.truth.items()},
            bench={one.kind: one.reference for one in halves} if spec.bench_drawn else {},
        )
        return simulate_imu(wanted, made, rng)
    bench = spec.reference if spec.bench_drawn else {}
    return simulate_runs(wanted, spec.sensor_class, spec.library, truth=spec.truth, bench=bench, rng=rng)


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """Runs as a linear Gaussian problem: factor, rows, prior of every column, and where it comes from."""

    runs: Sequence[Run]
    summary: Summary
    rows: Sequence[Linear]
    prior: ScalePrior
    source: str
    distrusted: tuple[Distrusted, ...] = ()
    spreads: tuple[Spread, ...] = ()
    scatter: tuple[Spread, ...] = ()
    absorbed: Misfit | None = None


def prepare(
    spec: SensorSpec,
    runs: Sequence[Run],
    tell: Progress,
    rng: np.random.Generator,
    share: int | None = None,
) -> Prepared:
    """Noise, errors of the bench, and distrusted dwells (which `rng` is for) of a component's runs.

    With a `share` of the level of residual tests (see `find_misfit`) it is asked what the library lacks, and
    where the residuals show something, that stands beside it as functions of the inputs.
    """
    prior, source = component_prior(spec, runs)
    asked = spec if share is None else replace(spec, estimated=frozenset(), reference=_stated(spec))
    found = _summarized(asked, runs, prior, tell)
    distrusted: tuple[Distrusted, ...] = ()
    if spec.robust:
        tell("dwells that cannot be trusted")
        kept = robust_rows(runs, found.rows, found.prior.sd, _noise_of(spec, found), rng=rng)
        runs, distrusted = kept.noted, kept.distrusted
        # a run that is left out takes the errors with it that no other run has
        kinds = {name: asked.reference[name] for name in effective(runs, asked.reference)}
        found = _summarized(asked, runs, prior, tell, kinds)
    found = replace(found, source=source, distrusted=distrusted)
    return found if share is None else _absorbing(spec, found, prior, tell, share)


def _stated(spec: SensorSpec) -> dict[str, float]:
    return {kind: size for kind, size in spec.reference.items() if kind not in spec.estimated}


def _absorbing(spec: SensorSpec, found: Prepared, prior: ScalePrior, tell: Progress, share: int) -> Prepared:
    """Problem with what nobody stated of the bench, and what the library lacks, where the data show it.

    Dwells are then what counts: their scatter is the noise.
    """
    means = tuple(dwell_means(run) for run in found.runs)
    misfit, mounts = _misfit_of(spec, found, share), _of_mounts(spec, found, means)
    mounts = mounts if spec.estimated or _shows(found, spec, means, prior, mounts) else {}
    if not mounts and misfit is None:
        return found
    tell("what the bench and the library lack")
    bench = {"reference": {**_stated(spec), **mounts}, "estimated": frozenset(mounts)}
    wider = replace(spec, runs=_scattering(spec, found, means, mounts), **bench)
    made, left = found, misfit
    with suppress(ConvergenceError, UnobservableError):  # what is lacking looks like far too large turns
        made = _summarized(wider, means, prior, tell, scattering=True)
        left = _misfit_of(spec, made, share) if misfit else None
    if left is not None:
        of = _to_absorb(means, spec.library.own, left)
        unit, sd = OUTPUT_UNIT[spec.kind], HIDDEN * _scatter(found, prior)
        beside = functions_of(means, of, spec.library, unit, sd)
        with suppress(ConvergenceError, UnobservableError):  # too little is left to tell their sizes by
            made = _summarized(wider, means, prior, tell, beside=beside, scattering=True)
    if made is found:
        return found
    scatter = tuple(
        one for pair in zip(found.summary.runs, made.summary.runs, strict=True) if (one := scatter_of(*pair))
    )
    told = {"source": found.source, "distrusted": found.distrusted, "scatter": scatter}
    return replace(made, absorbed=misfit if made.summary.extras else None, **told)


def _scattering(
    spec: SensorSpec, found: Prepared, means: Sequence[Run], mounts: Mapping[str, float]
) -> tuple[RunSpec, ...]:
    """Runs whose noise is what their dwells scatter by, or that of their samples where dwells are too few."""
    noise: dict[str, NoiseRule] = {}
    for run, one in zip(means, found.summary.runs, strict=True):
        turned = len(errors_of([run], mounts)) if effective([run], mounts) else 0
        columns = int(np.sum(one.reach[: len(spec.library.names)] > 0.0)) + turned
        if run.samples < columns + SPARE:
            noise[run.name] = NoiseRule("fixed", one.noise)
    return tuple(replace(one, noise=noise.get(one.name, one.noise)) for one in spec.runs)


def _to_absorb(runs: Sequence[Run], own: str, misfit: Misfit) -> list[tuple[str, str]]:
    """Functions (run, input) for what the library lacks: of the own input, and of what shows it."""
    named = {run.name: run for run in runs}
    shown = [(one.run, one.input) for one in misfit.found]
    of = dict.fromkeys((*((name, own) for name in named), *shown))
    return [(name, channel) for name, channel in of if varies(named[name], channel)]


def _misfit_of(spec: SensorSpec, found: Prepared, share: int) -> Misfit | None:
    """What the library lacks; None where residuals are what the noise leaves."""
    seen = {"rng": np.random.default_rng(share), "share": share}
    channels = [run.inputs.channels for run in found.runs]
    misfit = find_misfit(found.rows, channels, found.summary, found.prior.sd, **seen)
    theta, cov = loose_fit(found.summary, found.prior)
    level, pairs = level_of(share, len(found.runs)), zip(found.rows, found.summary.runs, strict=True)
    fit = all(check_residuals(r, theta, one, cov=cov, level=level).fits for r, one in pairs)
    return None if fit and not misfit.found else misfit


def _of_mounts(spec: SensorSpec, found: Prepared, means: Sequence[Run]) -> dict[str, float]:
    """Typical size of the rotation from mount to mount, where nobody stated it and mounts can tell it."""
    stated, kind = _stated(spec), KINDS["fixture"]
    if spec.estimated:
        return {name: size for name, size in spec.reference.items() if name in spec.estimated}
    if "fixture" in stated or any(run.stream for run in means) or not effective(means, ["fixture"]):
        return {}
    if len({(error.run, error.mount) for error in errors_of(means, ["fixture"])}) < FEWEST:
        return {}
    return {"fixture": kind.default or 0.0}


def _shows(
    found: Prepared, spec: SensorSpec, means: Sequence[Run], prior: ScalePrior, mounts: Mapping[str, float]
) -> bool:
    """Whether dwells are likelier with rotations from mount to mount than without."""
    if not mounts or found.summary.extras:
        return bool(mounts and spec.estimated)
    extras = extras_for(means, mounts, sensor=spec.kind)
    theta = loose_fit(found.summary, prior)[0]
    parts = rows_with(means, spec.library, extras, theta, np.zeros(len(extras)))
    pairs = zip(parts, found.summary.runs, strict=True)
    factor = reduce(add, (whitened_factor(part, run.noise)[0] for part, run in pairs))
    sd = np.concatenate((prior.sd, [extra.sd for extra in extras]))
    return odds_of(factor, sd, extras, "fixture") > SHOWN


def _scatter(found: Prepared, prior: ScalePrior) -> float:
    """Rms of what the library leaves of the dwells, SI."""
    theta = loose_fit(found.summary, found.prior)[0]
    left = [residuals(dwells_of(rows).means, theta) for rows in found.rows]
    return math.sqrt(float(np.mean(np.concatenate(left) ** 2)))


def _summarized(
    spec: SensorSpec,
    runs: Sequence[Run],
    prior: ScalePrior,
    tell: Progress,
    kinds: Mapping[str, float] | None = None,
    *,
    beside: Beside = NOTHING,
    scattering: bool = False,
) -> Prepared:
    """Factor of the runs, with the errors of the bench that the study allows for, or `kinds` of them.

    With `beside` the model has further columns. Rows may scatter as they will where that is `scattering`:
    the class says what samples do.
    """
    rules, sensor = _rules(spec, runs), None if scattering else spec.sensor_class
    wanted = dict(spec.reference if kinds is None else kinds)
    if not wanted and not beside.extras:
        rows = tuple(linear_of(run, spec.library) for run in runs)
        summary = summarize(runs, spec.library, sensor=sensor, rules=rules, rows=rows)
        return Prepared(tuple(runs), summary, rows, prior, "")
    if wanted:
        tell("errors of the test bench")
    typical = {kind: size for kind, size in wanted.items() if kind in spec.estimated}
    typical |= {extra.kind: extra.sd for extra in beside.extras}
    sizes = {**wanted, **typical}
    for _ in range(ROUNDS):
        bench = {kind: sizes[kind] for kind in wanted}
        given: dict[str, Any] = {"sensor": sensor, "rules": rules, "beside": beside.scaled(sizes)}
        summary, rows = solve(runs, spec.library, prior.sd, bench, **given)
        few = {kind for kind in wanted if sum(extra.kind == kind for extra in summary.extras) < FEWEST}
        for kind in few & typical.keys():
            raise StudyError(
                f"sensor '{spec.id}': reference: {kind} is to be estimated from fewer than {FEWEST} mounts:"
                " expected its size, a quantity"
            )
        whole = _with_extras(prior, summary.extras)
        told = spreads(at_found_noise(summary, whole).factor, whole.sd, summary.extras, typical)
        before, sizes = sizes, {**sizes, **{one.kind: one.mean for one in told}}
        if all(abs(math.log(sizes[kind] / before[kind])) < SETTLED for kind in typical):
            return Prepared(tuple(runs), summary, rows, whole, "", spreads=told)
    raise ConvergenceError(
        f"sensor '{spec.id}': how far mounts differ ({', '.join(typical)}) did not settle in {ROUNDS} rounds:"
        " state its size in reference, a quantity",
        wanted,
    )


def _noise_of(spec: SensorSpec, found: Prepared) -> NoiseOf:
    """Give the noise of parts of the runs, by the study's rules."""

    def noise_of(runs: Sequence[Run], rows: Sequence[Linear]) -> list[Noise]:
        summary = summarize(
            runs,
            spec.library,
            sensor=spec.sensor_class,
            rules=_rules(spec, runs),
            rows=rows,
            extras=found.summary.extras,
        )
        return [run.noise for run in summary.runs]

    return noise_of


def before_fit(spec: SensorSpec, runs: Sequence[Run]) -> Prepared:
    """Runs as a linear problem without a look at what the sensor said."""
    rows, prior, extras = rows_before(spec, runs)
    summary = summarize(
        runs,
        spec.library,
        sensor=spec.sensor_class,
        rules=_noise_before_fit(spec),
        rows=rows,
        extras=extras,
    )
    return Prepared(runs, summary, rows, prior, component_prior(spec, runs)[1])


def rows_before(
    spec: SensorSpec, runs: Sequence[Run]
) -> tuple[Sequence[Linear], ScalePrior, tuple[Extra, ...]]:
    """Rows of runs with known inputs where all coefficients are zero, prior of the columns, and the extras.

    Of a whole IMU they are component by component, and in each run by run, over the columns of all.
    """
    if spec.gyroscope:
        halves = (spec, spec.gyroscope)
        return blind_rows(
            runs, *(Asked(one.library, _triad_prior(one)[0], reference=one.reference) for one in halves)
        )
    prior, _ = component_prior(spec, runs)
    extras = extras_for(runs, spec.reference, sensor=spec.kind) if spec.reference else ()
    rows: Sequence[Linear] = [linear_of(run, spec.library) for run in runs]
    if extras:
        rows = rows_with(runs, spec.library, extras, np.zeros(len(prior.sd)), np.zeros(len(extras)))
    return rows, _with_extras(prior, extras), extras


def before_tumble(spec: SensorSpec) -> tuple[FloatArray, tuple[Extra, ...]]:
    """Prior sd of the terms of a free tumble's components, SI, and the errors of what it leans on."""
    halves = (spec, spec.gyroscope) if spec.gyroscope else (spec,)
    return np.concatenate([_triad_prior(one)[0].sd for one in halves]), _leant_on(spec)


def libraries_of(spec: SensorSpec) -> Mapping[str, Library]:
    """Candidates of each component by its name, which is that of its columns; empty of a single one."""
    if not (spec.gyroscope or spec.runs[0].procedure in CASES):
        return {"": spec.library}
    halves = (spec, spec.gyroscope) if spec.gyroscope else (spec,)
    triads = [triad_of(one.library, referenced=_referenced(one)) for one in halves]
    return {name: lib for one in triads for name, lib in zip(one.components, one.libraries, strict=True)}


def _with_extras(prior: ScalePrior, extras: Sequence[Extra]) -> ScalePrior:
    return ScalePrior([*prior.sd, *(extra.sd for extra in extras)])


def prepare_case(
    spec: SensorSpec, runs: Sequence[Run], rng: np.random.Generator | None = None
) -> tuple[Case, Prepared]:
    """Linearise runs of several components in one case, and give the linear problem that comes of it.

    Runs are free tumbles of a triad; of an IMU all free tumbles, all with known sections, or all with known
    inputs. Without an `rng`, which dwells that are not trusted need, what the sensor said is left out where
    inputs are known, so that nothing is fitted.

    Raises
    ------
    StudyError : if the study names no class.
    ConvergenceError : if a linearisation does not settle.
    """
    prior, source = _triad_prior(spec)
    distrusted: tuple[Distrusted, ...] = ()
    free: Case | None = None
    asked = Asked(spec.library, prior, spec.sensor_class, _rules(spec, runs))
    if spec.robust and rng is not None and not _referenced(spec):
        runs, distrusted, free = trusted_stills(runs, asked, extras=_leant_on(spec), rng=rng)
    if spec.gyroscope:
        own, beside = _triad_prior(spec.gyroscope)
        source = source if source == beside else f"accelerometers: {source}; gyroscopes: {beside}"
        case = _imu_case(spec, runs, (prior, own), rng, free)
        prior = ScalePrior([*prior.sd, *own.sd])
    elif _referenced(spec):
        case = _of_sections(spec, runs, asked)
    else:
        case = free or solve_free_tumble(runs, asked, extras=_leant_on(spec))
    whole = _with_extras(prior, case.summary.extras)
    if _referenced(spec):
        case = replace(case, angles=angles_of(case.triads, case.summary, whole.sd))
    return case, Prepared(runs, case.summary, case.rows, whole, source, (*case.distrusted, *distrusted))


def _imu_case(
    spec: SensorSpec,
    runs: Sequence[Run],
    priors: tuple[ScalePrior, ScalePrior],
    rng: np.random.Generator | None,
    free: Case | None,
) -> Case:
    """Characterise an IMU in one piece, by what its runs know."""
    known = runs[0].known
    asked = [
        Asked(
            one.library,
            prior,
            one.sensor_class,
            _noise_before_fit(one) if rng is None and known else _rules(one, runs),
            one.reference,
        )
        for one, prior in zip((spec, spec.of("gyroscope")), priors, strict=True)
    ]
    if known:
        return solve_known_case(runs, *asked, blind=rng is None, rng=rng if spec.robust else None)
    if runs[0].procedure == FERRARIS:
        return _of_sections(spec, runs, *asked)
    return solve_imu_tumble(runs, *asked, extras=_leant_on(spec), free=free)


def _of_sections(spec: SensorSpec, runs: Sequence[Run], *asked: Asked) -> Case:
    """Characterise what has known positions and turns."""
    return solve_ferraris(runs, *asked, extras=_leant_on(spec), fixture=spec.reference.get("fixture"))


def _referenced(spec: SensorSpec) -> bool:
    """Whether a triad's directions are known, and not only the size of gravity or of a table's rate.

    In the hand the gyroscopes of a whole IMU know them by its accelerometers.
    """
    by_others = spec.kind == "gyroscope" and not spec.runs[0].turntable
    return spec.runs[0].procedure != FREE_TUMBLE or by_others


def _leant_on(spec: SensorSpec) -> tuple[Extra, ...]:
    """Errors of what partly known runs lean on, where the study allows for them; `ferraris` has a fixture."""
    kinds = [KINDS[name] for name in spec.reference if KINDS[name].each != "mount"]
    return tuple(
        Extra(kind.name, kind.name, spec.reference[kind.name], kind.unit, kind.printed, kind.text)
        for kind in kinds
    )


def _rules(spec: SensorSpec, runs: Sequence[Run]) -> dict[str, NoiseRule]:
    """Noise rules of the study; a run whose noise was to be that of a run left out has its own."""
    return rules_among({s.name: s.noise for s in spec.runs}, {run.name for run in runs})


def _noise_before_fit(spec: SensorSpec) -> dict[str, NoiseRule]:
    """Noise rules that need no fit: what the study gives, else the class's typical noise, else white."""
    typical = typical_noise(spec.sensor_class) if spec.sensor_class else None
    usual = NoiseRule("fixed", typical) if typical else NoiseRule("white")
    return {s.name: s.noise if s.noise.rule == "fixed" and s.noise.value else usual for s in spec.runs}


def component_prior(spec: SensorSpec, runs: Sequence[Run]) -> tuple[ScalePrior, str]:
    """Physical prior of a component, and where it comes from in words."""
    if spec.sensor_class:
        return _overridden(class_sd(spec.sensor_class, spec.library), spec, [spec.library])
    swing = max(swing_of(run, spec.library) for run in runs)
    reach = np.max([reach_of(linear_of(run, spec.library)) for run in runs], axis=0)
    return _overridden(weak_sd(reach, swing), spec, [spec.library])


def _triad_prior(spec: SensorSpec) -> tuple[ScalePrior, str]:
    """Physical prior of the terms of all three components, and where it comes from in words.

    Raises
    ------
    StudyError : if the study names no class.
    """
    libraries = triad_of(spec.library, referenced=_referenced(spec)).libraries
    if spec.sensor_class is None:
        raise StudyError(
            f"sensor '{spec.id}': several components in one case need a class, which gives their priors:"
            ' add class = "..." (imubayes catalogue lists them)'
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
        found = recover(_over_record(case, selections, walking), runs, ready.prior.sd, np.array(flown))
    except ConvergenceError:  # data and prior disagree, which the report says first of all
        found = ()
    rows = compensation(spec, case, [term.mean for one in selections for term in one.terms])
    spreads = {"accelerometer": _between_stills(runs, ready.summary, found)}
    kinds = [one.library.kind for one in case.components]
    return [
        {"calibration": row, "recovered": found, "spreads": spreads.get(kind, ())}
        for row, kind in zip(rows, kinds, strict=True)
    ]


def _between_stills(runs: Sequence[Run], summary: Summary, found: Sequence[Recovered]) -> tuple[Spread, ...]:
    """Sd from still to still of every run in which gravity is known."""
    named, noise = {run.name: run for run in runs}, {run.name: run.noise.N for run in summary.runs}
    told: list[Spread | None] = []
    for one in found:
        if one.what == "gravity" and one.run in noise:
            times = np.array(times_of(named[one.run], find_stills(named[one.run])))
            told.append(between_stills(one, times[:, 1] - times[:, 0], noise[one.run]))
    return tuple(one for one in told if one is not None)


def _over_record(case: Case, selections: Sequence[Selection], walking: Sequence[bool]) -> Case:
    """Case whose triads have the b0 that is told of components whose bias is walking."""
    told = {
        column: term.full_mean
        for one, walks in zip(selections, walking, strict=True)
        for column, term in zip(one.columns, one.terms, strict=True)
        if walks and term.name == "b0"
    }

    def moved(triad: Triad) -> Triad:
        theta = [told.get(name, value) for name, value in zip(triad.names, triad.theta.tolist(), strict=True)]
        return replace(triad, theta=np.array(theta))

    return replace(case, triads=tuple(map(moved, case.triads)))
