"""A sensor's runs as a linear Gaussian problem: factor, priors, noise rules, errors of the test bench.

Where the data show that bench or library lack something, what stands beside the terms then, and its size.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.algebra.factor import add, noise_scale, posterior, posterior_root
from imubayes.campaign import SensorSpec
from imubayes.errors import ConvergenceError, StudyError, UnobservableError
from imubayes.inference.case import Case, CaseComponent, components_of
from imubayes.inference.dwells import dwells_of, whitened_factor
from imubayes.inference.free_functions import NOTHING, Beside, functions_of, lacked, of_own_input, values_of
from imubayes.inference.linear import Extra, Linear, linear_of, reach_of, residuals, swing_of
from imubayes.inference.mcmc import at_found_noise
from imubayes.inference.misfit import Dependence, Misfit, find_misfit
from imubayes.inference.nuisances import extras_for, rows_with, solve
from imubayes.inference.prior import ScalePrior, class_sd, weak_sd
from imubayes.inference.reproducibility import FEWEST, SHOWN, WIDTH, Spread, odds_of, scatter_of, spreads
from imubayes.inference.residuals import ResidualCheck, check_runs, excess
from imubayes.inference.robust import Distrusted
from imubayes.inference.summary import Rules, Summary, rules_among, summarize
from imubayes.inference.triad import triad_of
from imubayes.rig.bench import KINDS, effective, errors_of
from imubayes.rig.filtering import dwell_means
from imubayes.rig.inputs import Run
from imubayes.rig.recordings import FREE_TUMBLE, OUTPUT_UNIT, RunSpec
from imubayes.selection.decision import loose_fit
from imubayes.sensors.noise import NoiseRule
from imubayes.sensors.terms import Library
from imubayes.work import Progress

SETTLED = 0.05
"""Change of ln of an estimated sd that is none: its own uncertainty is larger."""

ROUNDS = 20
"""Most rounds in which estimated sds must settle; they take two or three."""


class Doubt(NamedTuple):
    """How it is asked what the library lacks: share of the tests' level, and seed of predictive draws."""

    share: int
    seed: tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """Runs as a linear Gaussian problem: factor, rows, prior of every column, and where it comes from.

    Attributes
    ----------
    spreads : sds that the data tell of errors of the bench and of what the library lacks.
    scatter : of dwells beyond the noise of their samples.
    misfit, checks : what residuals say that the library does not contain, and their tests by run, where that
        was asked of these rows.
    absorbed : what they said before something stood beside the library; None where nothing does.
    beside, rules : what stands beside library and bench, and how the noise of these rows is known.
    parts : of a case its components by name, with what was asked and told of each by itself.
    """

    runs: Sequence[Run]
    summary: Summary
    rows: Sequence[Linear]
    prior: ScalePrior
    source: str
    distrusted: tuple[Distrusted, ...] = ()
    spreads: tuple[Spread, ...] = ()
    scatter: tuple[Spread, ...] = ()
    misfit: Misfit | None = None
    checks: tuple[ResidualCheck, ...] = ()
    absorbed: Misfit | None = None
    beside: Beside = NOTHING
    rules: Rules = field(default_factory=dict)
    parts: Mapping[str, Prepared] = field(default_factory=dict)

    @property
    def off(self) -> frozenset[str]:
        """Runs whose residuals, where they were asked, hold more than the noise leaves; "" for all."""
        shown = (dependence.run for dependence in (self.misfit.found if self.misfit else ()))
        return frozenset((*shown, *(check.run for check in self.checks if not (check.fits or check.weak))))

    @property
    def fits(self) -> bool:
        """Whether residuals, where they were asked, hold no more than the noise leaves."""
        return not self.off

    @property
    def doubtful(self) -> bool:
        """Whether the library by itself was found wanting, whether or not something stands beside it now."""
        return self.absorbed is not None or not self.fits

    def part(self, component: CaseComponent) -> Prepared:
        """Runs and rows of one component; the factor is that of all."""
        if component.name in self.parts:
            return self.parts[component.name]
        runs = tuple(self.summary.runs[k] for k in component.parts)
        named = {run.name for run in runs}
        alone = not component.name  # what is left out of a sensor's runs is its own
        return replace(
            self,
            summary=replace(self.summary, library=component.library, facts=component.facts, runs=runs),
            rows=[self.rows[k] for k in component.parts],
            distrusted=tuple(dwell for dwell in self.distrusted if alone or dwell.run in named),
        )


def summarized(
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
    rules, sensor = rules_of(spec, runs), None if scattering else spec.sensor_class
    wanted = dict(spec.reference if kinds is None else kinds)
    if not wanted and not beside.extras:
        rows = tuple(linear_of(run, spec.library) for run in runs)
        summary = summarize(runs, spec.library, sensor=sensor, rules=rules, rows=rows)
        return Prepared(tuple(runs), summary, rows, prior, "", rules=rules)
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
        whole = with_extras(prior, summary.extras)
        told = spreads(at_found_noise(summary, whole).factor, whole.sd, summary.extras, typical)
        before, sizes = sizes, {**sizes, **{spread.kind: spread.mean for spread in told}}
        if all(abs(math.log(sizes[kind] / before[kind])) < SETTLED for kind in typical):
            there = {"beside": beside.scaled(sizes), "rules": rules}
            return Prepared(tuple(runs), summary, rows, whole, "", spreads=told, **there)
    raise ConvergenceError(
        f"sensor '{spec.id}': how far mounts differ ({', '.join(typical)}) did not settle in {ROUNDS} rounds:"
        " state its size in reference, a quantity",
        wanted,
    )


def with_extras(prior: ScalePrior, extras: Sequence[Extra]) -> ScalePrior:
    """Prior of the terms and, after them, of what is none."""
    return ScalePrior([*prior.sd, *(extra.sd for extra in extras)])


def rules_of(spec: SensorSpec, runs: Sequence[Run]) -> dict[str, NoiseRule]:
    """Noise rules of the study; a run whose noise was to be that of a run left out has its own."""
    return rules_among({s.name: s.noise for s in spec.runs}, {run.name for run in runs})


def component_prior(spec: SensorSpec, runs: Sequence[Run]) -> tuple[ScalePrior, str]:
    """Physical prior of a component, and where it comes from in words."""
    if spec.sensor_class:
        return _overridden(class_sd(spec.sensor_class, spec.library), spec, [spec.library])
    swing = max(swing_of(run, spec.library) for run in runs)
    reach = np.max([reach_of(linear_of(run, spec.library)) for run in runs], axis=0)
    return _overridden(weak_sd(reach, swing), spec, [spec.library])


def triad_prior(spec: SensorSpec) -> tuple[ScalePrior, str]:
    """Physical prior of the terms of all three components, and where it comes from in words."""
    libraries = triad_of(spec.library, referenced=referenced(spec)).libraries
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


def referenced(spec: SensorSpec) -> bool:
    """Whether a triad's directions are known, and not only the size of gravity or of a table's rate.

    In the hand the gyroscopes of a whole IMU know them by its accelerometers.
    """
    by_others = spec.kind == "gyroscope" and not spec.runs[0].turntable
    return spec.runs[0].procedure != FREE_TUMBLE or by_others


HIDDEN = 30.0
"""Typical size of what the library lacks over what it leaves of that: powers take the place of most of it."""

NOT_TOLD = (ConvergenceError, UnobservableError, np.linalg.LinAlgError)
"""What ends a search for sizes that the dwells do not tell."""

ALONE = "radius"
"""Error of a machine that looks like a scale factor: there is one arm, so that nothing repeats its error."""

LARGEST = 5.0
"""Sds of its prior beyond which an error of the bench is not what a test lacks."""

SPARE = 8
"""Dwells beyond the columns that a run excites from which their scatter is told."""


def absorbing(spec: SensorSpec, ready: Prepared, prior: ScalePrior, tell: Progress, doubt: Doubt) -> Prepared:
    """Problem with what nobody stated of the bench, and what the library lacks, where the data show it.

    Dwells are then what counts: their scatter is the noise. A stated noise that samples exceed is told
    first: beside one that is far too small everything would stand out.
    """
    means, ready = tuple(dwell_means(run) for run in ready.runs), examined(ready, doubt)
    if not ready.fits and (told := _misstated(spec, ready, prior, tell, doubt)):
        return told
    mounts = _of_mounts(spec, ready, means)
    # steps so coarse that nothing moves say no scatter
    still = any(np.ptp(run.output) == 0.0 for run in means)
    if still or (not mounts and ready.fits):
        return ready
    tell("what the bench and the library lack")
    bench = {"reference": {**stated(spec), **mounts}, "estimated": frozenset(mounts)}
    wider = replace(spec, runs=_scattering(spec, ready, means, mounts), **bench)
    made = left = ready
    # turns of mounts may explain what a term does that is lacking: it stands beside them from the beginning
    others = {t.name for t in lacked(spec.library).terms if not of_own_input(t, spec.library.own)}
    terms = [one for one in (ready.misfit.found if ready.misfit else ()) if one.input in others]
    beside = _functions(ready, means, spec, terms)
    with suppress(*NOT_TOLD):  # what is lacking looks like far too large turns
        made = _likely(summarized(wider, means, prior, tell, beside=beside, scattering=True), beside)
        made = left = made if ready.fits else examined(made, doubt)
    if left.misfit and not left.fits:
        beside = _functions(ready, means, spec, [*terms, *left.misfit.found], off=left.off)
        with suppress(*NOT_TOLD):
            made = _likely(summarized(wider, means, prior, tell, beside=beside, scattering=True), beside)
    if made is ready:
        if spec.estimated:
            raise ConvergenceError(
                f"sensor '{spec.id}': how far mounts differ ({', '.join(mounts)}) cannot be told from this"
                " test: state its size in reference, a quantity",
                mounts,
            )
        return ready
    scatter = tuple(
        spread
        for pair in zip(ready.summary.runs, made.summary.runs, strict=True)
        if (spread := scatter_of(*pair))
    )
    more = len(made.summary.extras) > len(ready.summary.extras)
    told = {"source": ready.source, "distrusted": ready.distrusted, "scatter": scatter}
    return replace(made, absorbed=ready.misfit if more and not ready.fits else None, **told)


def _misstated(
    spec: SensorSpec, ready: Prepared, prior: ScalePrior, tell: Progress, doubt: Doubt
) -> Prepared | None:
    """The same where samples scatter by more than the study states, with what residuals say by their own."""
    given = {asked.name for asked in spec.runs if asked.noise.value}
    theta = loose_fit(ready.summary, ready.prior)[0]
    by_run = zip(ready.rows, ready.summary.runs, strict=True)
    off = {run.name: excess(rows, theta, run) for rows, run in by_run if run.name in given}
    if all(ratio == 1.0 for ratio in off.values()):
        return None
    runs = tuple(replace(asked, noise=NoiseRule()) if asked.name in given else asked for asked in spec.runs)
    own = replace(spec, runs=runs, reference=stated(spec), estimated=frozenset())
    misfit = ready.misfit
    with suppress(*NOT_TOLD):
        bench = {name: own.reference[name] for name in effective(ready.runs, own.reference)}
        misfit = examined(summarized(own, ready.runs, prior, tell, bench), doubt).misfit
    checks = tuple(replace(check, misstated=off.get(check.run, 1.0)) for check in ready.checks)
    return replace(ready, misfit=misfit, checks=checks)


def _likely(made: Prepared, beside: Beside = NOTHING) -> Prepared:
    """The same; an `UnobservableError` where an error of the bench would be far larger than is likely."""
    factor, sd = made.summary.factor, made.prior.sd
    sizes = np.abs(posterior(factor, sd, noise_scale(factor, sd))[0] / sd)
    functions = {extra.name for extra in beside.extras}
    bench = [extra.name for extra in made.summary.extras if extra.name not in functions]
    far = tuple(name for name in bench if sizes[made.summary.names.index(name)] > LARGEST)
    if far:
        raise UnobservableError(f"{', '.join(far)} would be more than {LARGEST:g} sd of the prior", far)
    return made


def _scattering(
    spec: SensorSpec, ready: Prepared, means: Sequence[Run], mounts: Mapping[str, float]
) -> tuple[RunSpec, ...]:
    """Runs whose noise is what their dwells scatter by, or that of their samples where dwells are too few."""
    noise: dict[str, NoiseRule] = {}
    for run, summary in zip(means, ready.summary.runs, strict=True):
        turned = len(errors_of([run], mounts)) if effective([run], mounts) else 0
        columns = int(np.sum(summary.reach[: len(spec.library.names)] > 0.0)) + turned
        if run.samples < columns + SPARE:
            noise[run.name] = NoiseRule("fixed", summary.noise)
        elif summary.noise_run != summary.name or summary.found.origin == "white":
            # another run's samples say nothing of its dwells, nor does what was assumed of its own
            noise[run.name] = NoiseRule()
    return tuple(replace(asked, noise=noise.get(asked.name, asked.noise)) for asked in spec.runs)


def _functions(
    ready: Prepared,
    runs: Sequence[Run],
    spec: SensorSpec,
    found: Sequence[Dependence],
    *,
    off: frozenset[str] = frozenset(),
) -> Beside:
    """Functions for what the library lacks: of the own input in each run, and of what shows it.

    Where neither a run that is `off` drives the own input nor a power of it shows, nothing of it is in doubt.
    """
    lib = spec.library
    driven = {run.name for run in runs if np.ptp(values_of(run, lib.own)) > 0.0}
    shown = {one.input for one in found if not one.run}
    terms = [term for term in lacked(lib).terms if term.name in shown]
    others = [term for term in terms if not of_own_input(term, lib.own)]
    doubted = off & driven or len(others) < len(terms)
    own = ((run.name, lib.own) for run in runs if doubted)
    of = dict.fromkeys((*own, *((one.run, one.input) for one in found if one.run)))
    theta = loose_fit(ready.summary, ready.prior)[0]
    left = np.concatenate([residuals(dwells_of(rows).means, theta) for rows in ready.rows])
    size = HIDDEN * math.sqrt(float(np.mean(left**2)))
    return functions_of(runs, [*of], lib, OUTPUT_UNIT[spec.kind], size, others)


def examined(ready: Prepared, doubt: Doubt, case: Case | None = None) -> Prepared:
    """The same with what residuals say that the library lacks, and their tests by run; of a case its parts.

    What components with the same runs lack is asked of them together.
    """
    theta, cov = fit_of(ready, case)
    checks = check_runs(ready.rows, theta, ready.summary.runs, cov=cov, share=doubt.share)
    channels = case.inputs if case else [run.inputs.channels for run in ready.runs]
    asked: dict[tuple[int, ...], Misfit] = {}
    components = components_of(case, ready.summary)
    different, parts = len({one.parts for one in components}), dict[str, Prepared]()
    for one in components:
        part = ready.part(one)
        if one.parts not in asked:
            given, inputs = (part.summary, part.prior.sd), [channels[k] for k in one.parts]
            rng = np.random.default_rng(doubt.seed)
            asked[one.parts] = find_misfit(part.rows, inputs, *given, rng=rng, share=doubt.share * different)
        own = tuple(checks[k] for k in one.parts)
        parts[one.name] = replace(part, misfit=asked[one.parts], checks=own)
    return parts[""] if case is None else replace(ready, parts=parts)


def fit_of(ready: Prepared, case: Case | None) -> tuple[FloatArray, FloatArray]:
    """Coefficients of all columns, of a case those that its linearisation settled at, and their covariance.

    The covariance is that by the noise that the rows were whitened with.
    """
    if case is None:
        return loose_fit(ready.summary, ready.prior, whitened=True)
    root = posterior_root(case.summary.factor, ready.prior.sd)[1]
    return case.theta, root @ root.T


def _of_mounts(spec: SensorSpec, ready: Prepared, means: Sequence[Run]) -> dict[str, float]:
    """Typical size of the rotation from mount to mount, where nobody stated it and mounts can tell it.

    Where errors of the bench are stated, the rows must not fit with these alone; where none are, the dwells
    must be likelier with the rotation.
    """
    if spec.estimated:
        return {name: size for name, size in spec.reference.items() if name in spec.estimated}
    if "fixture" in stated(spec) or not effective(means, ["fixture"]):
        return {}
    if len({(error.run, error.mount) for error in errors_of(means, ["fixture"])}) < FEWEST:
        return {}
    mounts = {"fixture": KINDS["fixture"].default or 0.0}
    shown = not ready.fits if spec.bench_stated else _shows(ready, spec, means, mounts)
    return mounts if shown else {}


def _shows(ready: Prepared, spec: SensorSpec, means: Sequence[Run], mounts: Mapping[str, float]) -> bool:
    """Whether dwells are likelier with rotations from mount to mount than without."""
    there, more = ready.summary.extras, extras_for(means, mounts, sensor=spec.kind)
    theta, nu = np.split(loose_fit(ready.summary, ready.prior)[0], [len(spec.library.names)])
    rows = rows_with(means, spec.library, (*there, *more), theta, np.append(nu, np.zeros(len(more))))
    pairs = zip(rows, ready.summary.runs, strict=True)
    factor = add(*(whitened_factor(part, run.noise) for part, run in pairs))
    return odds_of(factor, with_extras(ready.prior, more).sd, more, "fixture") > SHOWN


def stated(spec: SensorSpec) -> dict[str, float]:
    """Errors of the bench whose prior sd the study states, SI."""
    return {kind: size for kind, size in spec.reference.items() if kind not in spec.estimated}


def unstated(spec: SensorSpec, runs: Sequence[Run]) -> dict[str, float]:
    """Prior sd, SI, of the arm's radius for an accelerometer whose study says nothing of its bench.

    Its size is log-normal about the catalogue's typical one, as that of all errors which nobody stated; no
    data tell it, so that its rms stands for it.
    """
    whirled = [run for run in runs if run.procedure in KINDS[ALONE].procedures]
    told = all(run.inputs.has("w") for run in whirled)
    if spec.kind != "accelerometer" or spec.bench_stated or spec.reference or not told:
        return {}
    size = (KINDS[ALONE].default or 0.0) * math.exp(WIDTH**2)
    return dict.fromkeys(effective(whirled, [ALONE]), size)
