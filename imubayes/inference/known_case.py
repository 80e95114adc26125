"""A whole IMU with known inputs: six components that share the motion, and the errors of the bench.

Each component sees the case's inputs along its own axes: x: (xyz), y: (yzx), z: (zxy). An error of the
bench is one column for all six: turned into their axes, a rotation of the case moves each of them as it
must. What is a component's own, its offset since it was turned on and the tilt of the axes that its
coefficients refer to, has a column of its own.

A shock to the case or a slip of the table spoils a dwell of the components that it reaches: each is judged by
itself, under what the bench may have to do with it, and goes on without its own (`robust`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import accumulate, pairwise

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import FloatArray
from imubayes.algebra.factor import noise_scale
from imubayes.inference.case import Case, Told, TriadSpec, case_of
from imubayes.inference.free_functions import NOTHING, Beside
from imubayes.inference.linear import Extra, Linear, among, widened_factor
from imubayes.inference.noise_model import NoiseEstimate
from imubayes.inference.nuisances import Linearisation, Taken, all_rows, settled_rows, tangent, tilt_of
from imubayes.inference.prior import ScalePrior
from imubayes.inference.robust import Trusted, robust_rows
from imubayes.inference.settle import Round
from imubayes.inference.summary import Rules, RunSummary, Summary, joined, rules_among, summarize
from imubayes.inference.triad import triad_of
from imubayes.rig.bench import OFFSET, Error, errors_of, for_sensor, kind_of, refuse_idle
from imubayes.rig.inputs import Facts, Run, facts_of
from imubayes.sensors.imu import COMPONENTS, axes_of
from imubayes.sensors.imu import kind_of as kind_of_component
from imubayes.sensors.noise import Noise
from imubayes.sensors.terms import AXES, Kind, Library


@dataclass(frozen=True, slots=True, eq=False)
class Own:
    """What is a component's own: its runs, how their noise is known, and what stands beside its library.

    `bench` has prior sds, SI, of errors of the bench that no other component shares, by kind. Where rows are
    `scattering`, the class says nothing of their noise.
    """

    runs: tuple[Run, ...]
    rules: Rules
    bench: Mapping[str, float] = field(default_factory=dict)
    beside: Beside = NOTHING
    scattering: bool = False


def solve_known_case(
    runs: Sequence[Run],
    accelerometer: TriadSpec,
    gyroscope: TriadSpec,
    *,
    blind: bool = False,
    rng: np.random.Generator | None = None,
    own: Mapping[str, Own] | None = None,
) -> Case:
    """Characterise the six components of an IMU from runs with known inputs.

    Parameters
    ----------
    accelerometer, gyroscope : what is asked of the components of each kind; priors are of whole triads
        (``triad_of(lib, referenced=True)``).
    blind : linearise where every coefficient and error is zero, without a look at what the IMU said; the
        noise is then as the rules say.
    rng : with which dwells that are contaminated are looked for; None trusts all of them.
    own : what components have by themselves, by name, in place of what all have.

    It is an `UnobservableError` if an error of the bench changes nothing in any run, or rows are fewer than
    terms, a `DataError` if it needs what a run does not tell, and a `ConvergenceError` if nothing settles.
    """
    problem = _problem(runs, {"accelerometer": accelerometer, "gyroscope": gyroscope}, own or {})
    settled = problem.settled(blind=blind)
    if blind or rng is None:
        return _case(problem, settled)
    trusted = _trusted(problem, settled, rng)
    kept = zip(problem.parts, trusted, strict=True)
    problem = replace(problem, parts=tuple(_among(part, one.noted) for part, one in kept))
    named = [(part.name, one) for part, one in zip(problem.parts, trusted, strict=True)]
    distrusted = [replace(d, run=title(d.run, name)) for name, one in named for d in one.distrusted]
    return replace(_case(problem, problem.settled()), distrusted=tuple(distrusted))


def blind_rows(
    runs: Sequence[Run], accelerometer: TriadSpec, gyroscope: TriadSpec
) -> tuple[tuple[Linear, ...], ScalePrior, tuple[Extra, ...]]:
    """Rows where every coefficient and error is zero, over all columns, component by component.

    With them come the prior of the columns, and the errors of the bench among these, which are last.
    """
    problem = _problem(runs, {"accelerometer": accelerometer, "gyroscope": gyroscope}, {})
    rows = tuple(
        among(replace(one, names=part.columns), problem.names)
        for part in problem.parts
        for one in _rows(part, np.zeros(len(part.columns)), None)
    )
    return rows, ScalePrior(problem.sd), problem.extras


def _trusted(problem: _Problem, settled: Round, rng: np.random.Generator) -> list[Trusted]:
    """Runs of each component without its dwells that are contaminated."""
    trusted = []
    for part, numbers in zip(problem.parts, problem.numbers, strict=True):
        rows = [among(settled.rows[k], part.columns) for k in numbers]

        def noise_of(runs: Sequence[Run], rows: Sequence[Linear], part: _Part = part) -> list[Noise]:
            return [run.noise for run in _summary(_among(part, runs), rows).runs]

        trusted.append(robust_rows(part.runs, rows, problem.sd[problem.where(part)], noise_of, rng=rng))
    return trusted


def _among(part: _Part, runs: Sequence[Run]) -> _Part:
    """A component in some of its runs; one whose noise was to be that of a run left out has its own."""
    there = {run.name for run in runs}
    rules = rules_among({name: part.asked.rule(name) for name in there}, there)
    return replace(part, runs=tuple(runs), asked=replace(part.asked, rules=rules))


def _summary(part: _Part, rows: Sequence[Linear], known: Sequence[NoiseEstimate] = ()) -> Summary:
    asked = part.asked
    given = {"sensor": asked.sensor, "rules": asked.rules, "rows": rows, "known": known, "bench": part.bench}
    return summarize(part.runs, part.library, **given)


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """One component of the case: runs and errors of the bench in its own axes.

    `bench` has the prior sds, SI, of these errors and of what is `beside` them, by the names of the columns.
    """

    name: str
    runs: tuple[Run, ...]
    asked: TriadSpec
    errors: tuple[Error, ...]
    bench: Mapping[str, float]
    beside: Beside

    @property
    def columns(self) -> tuple[str, ...]:
        """Those of its terms, then of the errors, then of what is beside them."""
        return (*(f"{self.name}.{term}" for term in self.library.names), *self.bench)

    @property
    def library(self) -> Library:
        """Candidate terms."""
        return self.asked.library

    @property
    def facts(self) -> Facts:
        """What its inputs have in common."""
        return facts_of([run.extremes for run in self.runs], self.library.kind)


@dataclass(frozen=True, slots=True, eq=False)
class _Problem:
    """Six components, the errors of the bench, and all columns: names (p + q,), prior sds."""

    parts: tuple[_Part, ...]
    extras: tuple[Extra, ...]
    names: tuple[str, ...]
    sd: FloatArray

    def where(self, part: _Part) -> NDArray[np.intp]:
        """Places of a component's columns among all."""
        return np.array([self.names.index(name) for name in part.columns])

    @property
    def numbers(self) -> list[range]:
        """Of each component, which of all rows are its own."""
        ends = list(accumulate((len(part.runs) for part in self.parts), initial=0))
        return [range(a, b) for a, b in pairwise(ends)]

    def at(
        self, taken: Taken, place: FloatArray, noise: Sequence[NoiseEstimate], leaning: FloatArray | None
    ) -> Round:
        """Linearise the rows of all components that are taken, as `settle.At` says."""
        runs, every, found, first = [], [], [], self.parts[0]
        for part, numbers in zip(self.parts, self.numbers, strict=True):
            own = self.where(part)
            lean = None if leaning is None else leaning[own]
            rows = [replace(taken(one), names=part.columns) for one in _rows(part, place[own], lean)]
            summary = _summary(part, rows, noise[numbers.start : numbers.stop])
            found += [run.found for run in summary.runs]
            runs += [_of_component(run, part.name, self.names) for run in summary.runs]
            every += [among(one, self.names) for one in rows]
        summary = joined(runs, first.library, first.facts, self.extras)
        return Round(place, summary, tuple(every), found, noise_scale(summary.factor, self.sd))

    def settled(self, *, blind: bool = False) -> Round:
        """Linearise where that settles; without errors of the bench all is linear."""
        if blind or not self.extras:
            return self.at(all_rows, np.zeros(len(self.sd)), (), None)
        return settled_rows(self.at, self.sd, self.parts[0].runs)


def _rows(part: _Part, place: FloatArray, leaning: FloatArray | None) -> list[Linear]:
    """Rows of a component's runs, linearised at its coefficients and errors."""
    p = len(part.library.terms)
    q, lean = p + len(part.errors), place if leaning is None else leaning
    there = Linearisation(part.library, part.errors, place[:p], place[p:q], lean[:p], {})
    return [part.beside.added(run, tangent(run, there)) for run in part.runs]


def _of_component(run: RunSummary, component: str, names: Sequence[str]) -> RunSummary:
    """Summary of a component's run, under a name of its own, among all columns."""
    factor, reach = run.factor, np.zeros(len(names))
    reach[[names.index(name) for name in factor.names]] = run.reach
    return replace(
        run,
        name=title(run.name, component),
        found=replace(run.found, run=title(run.noise_run, component)),
        factor=widened_factor(factor, names),
        reach=reach,
    )


def title(run: str, component: str) -> str:
    """Name of what a run says of one component."""
    return f"{run} ({component})"


def _problem(runs: Sequence[Run], asked: Mapping[Kind, TriadSpec], own: Mapping[str, Own]) -> _Problem:
    """Components, errors and columns of an IMU."""
    shared = _shared(runs, asked)
    parts, own_extras = [], []
    for name in COMPONENTS:
        spec, of_component = asked[kind_of_component(name)], tuple(run.component(name) for run in runs)
        alone = own.get(name) or Own(of_component, spec.rules or {})
        theirs = tuple(_own(name, of_component, spec, alone.bench))
        beside = alone.beside.of(name)
        turned = []
        for error, _ in shared:  # about an axis of the case, or of this component
            part = axes_of(name).index(error.part) if len(kind_of(error.kind).parts) > 1 else error.part
            turned.append(replace(error, part=part))
        errors, extras = (*turned, *(error for error, _ in theirs)), [extra for _, extra in theirs]
        own_extras += [*extras, *beside.extras]
        bench = {one.name: one.sd for one in (*(extra for _, extra in shared), *extras, *beside.extras)}
        spec = replace(spec, rules=alone.rules, sensor=None if alone.scattering else spec.sensor)
        parts.append(_Part(name, alone.runs, spec, errors, bench, beside))
    extras = (*(extra for _, extra in shared), *own_extras)
    p = [len(part.library.terms) for part in parts]
    terms = [column for part, k in zip(parts, p, strict=True) for column in part.columns[:k]]
    sd = np.concatenate([*(asked[kind].prior.sd for kind in asked), [extra.sd for extra in extras]])
    return _Problem(tuple(parts), extras, (*terms, *(extra.name for extra in extras)), sd)


def _shared(runs: Sequence[Run], asked: Mapping[Kind, TriadSpec]) -> list[tuple[Error, Extra]]:
    """Errors of the bench that are the same for all components, in case axes, and their columns."""
    sds = {kind: sd for spec in asked.values() for kind, sd in spec.reference.items()}
    as_case = [run.component("ax") for run in runs]
    refuse_idle(as_case, sds)
    found = []
    for error in errors_of(as_case, [kind for kind in sds if kind != OFFSET]):
        kind = kind_of(error.kind)
        text = error.text.replace(f"about {AXES[error.part]}", f"about {'xyz'[error.part]}", 1)
        found.append((error, Extra.of(error.name, kind, sds[kind.name], text)))
    return found


def _own(
    name: str, runs: Sequence[Run], asked: TriadSpec, bench: Mapping[str, float]
) -> Iterator[tuple[Error, Extra]]:
    """Errors of one component alone: of the `bench`, offsets since it was turned on, the tilt of its axes."""
    lib, p = asked.library, len(asked.library.terms)
    first = COMPONENTS.index(name) % 3 * p
    sds = {kind: sd for kind, sd in asked.reference.items() if kind == OFFSET} | dict(bench)
    sds |= tilt_of(lib, asked.prior.sd[first : first + p], {**asked.reference, **bench})
    for error in errors_of(runs, sds):
        kind = for_sensor(kind_of(error.kind), lib.kind)
        own = replace(error, name=f"{error.name}.{name}")
        yield own, Extra.of(own.name, kind, sds[kind.name], f"{error.text}, {name}")


def _case(problem: _Problem, settled: Round) -> Case:
    """Components after their runs are summarized, at the coefficients of the full library."""
    every = [(part, run) for part in problem.parts for run in part.runs]
    told = [
        Told(summary, replace(rows, name=summary.name), dict(run.inputs.channels), (part.name,))
        for summary, rows, (part, run) in zip(settled.summary.runs, settled.rows, every, strict=True)
    ]
    triads = [triad_of(problem.parts[k].library, referenced=True) for k in (0, 3)]
    facts = {part.name: part.facts for part in problem.parts}
    case = case_of(told, triads, facts, problem.extras, sd=problem.sd)
    return replace(case, runs=tuple(run for _, run in every))
