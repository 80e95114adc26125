"""What a rung of the ladder is asked, what the rungs share, and what every one of them gives."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, TypeVar

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.campaign import SensorSpec
from imubayes.campaign.preparation import prepare
from imubayes.campaign.prepared import Doubt, Prepared, component_prior
from imubayes.errors import ConvergenceError, InputError
from imubayes.inference.case import Case, components_of
from imubayes.inference.mcmc import Chains, NoiseDraw
from imubayes.inference.mcmc.ensembles import Limits
from imubayes.inference.mcmc.run import Method, Sampled, sample
from imubayes.inference.nuisances import extras_for
from imubayes.inference.prior import ScalePrior
from imubayes.inference.reproducibility import over_spreads
from imubayes.ladder import RungName, Size
from imubayes.rig.inputs import Run
from imubayes.selection.decision import Selection, select
from imubayes.selection.enumerate import LARGEST
from imubayes.selection.verdicts import EQUAL, Costs
from imubayes.sensors.noise import NoiseRule
from imubayes.sensors.terms import Library
from imubayes.units import counted
from imubayes.work import Progress, silent

Made = TypeVar("Made")

DRAWN = ("averaged", "raw")
"""Rungs that draw by themselves: each has a source of randomness of its own, so that no answer depends on
what was climbed before."""


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """One component and its runs with known inputs, or a linearised case of several, which has no runs.

    The prior is that of every term of the library, or of every column of a case, SI. If `hierarchical`, a
    term may only be in a model that has what it modifies. `doubt` is how it is asked what bench and library
    lack; None asks nothing.
    """

    spec: SensorSpec
    runs: tuple[Run, ...]
    prior: ScalePrior
    costs: Costs = EQUAL
    hierarchical: bool = False
    case: Case | None = None
    doubt: Doubt | None = None

    @property
    def library(self) -> Library:
        """Candidate terms."""
        return self.spec.library


def problem_of(
    spec: SensorSpec, runs: Sequence[Run], *, costs: Costs = EQUAL, hierarchical: bool = False
) -> Problem:
    """Problem of a sensor and its runs.

    Raises
    ------
    InputError : if a run is one of several components, such as a free tumble, or there is no run.
    """
    free = [run.name for run in runs if run.of_case]
    if free or not runs:
        what = f"run '{free[0]}' is one of several components" if free else "there is no run"
        raise InputError(
            f"sensor '{spec.id}': {what}, and methods are traded on runs of one component with known inputs"
        )
    return Problem(spec, tuple(runs), component_prior(spec, runs)[0], costs, hierarchical)


def size_of(problem: Problem) -> Size:
    """What the time of every rung depends on, from the inputs alone."""
    if problem.case is not None:
        return _size_of_case(problem.case)
    moved = {name for run in problem.runs for name, values in run.extremes.items() if np.any(values != 0.0)}
    terms, reference = problem.library.terms, problem.spec.reference
    own = zip(problem.library.carriers, terms, strict=True)
    extras = extras_for(problem.runs, reference, sensor=problem.spec.kind) if reference else ()
    return Size(
        rows=sum(run.samples for run in problem.runs),
        columns=len(terms) + len(extras),
        candidates=len({leader for leader, term in own if all(f.channel in moved for f in term.factors)}),
        runs=len(problem.runs),
        streamed=sum(run.samples for run in problem.runs if run.stream),
    )


def _size_of_case(case: Case) -> Size:
    reach, runs = case.summary.reach, case.summary.runs
    moved = [
        {name for name in component.library.carriers if reach[component.column(name)]}
        for component in case.components
    ]
    models = sum(2.0 ** min(len(names), LARGEST) for names in moved) / len(moved)
    return Size(
        rows=sum(run.samples for run in runs),
        columns=len(case.summary.names),
        candidates=math.log2(models),
        runs=len(runs),
        streamed=sum(rows.samples for rows in case.rows if rows.stream),
        components=len(case.components),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """A problem with what its rungs share, which is computed once: the factor, and the chains.

    Of randomness the factor and each of the rungs that are `DRAWN` have their own source. `shared` is what
    was computed, with the seconds that it took, by name.
    """

    problem: Problem
    rngs: dict[str, np.random.Generator]
    tell: Progress
    limits: Limits
    shared: dict[str, tuple[Any, float]] = field(default_factory=dict)


def ground_of(problem: Problem, rng: np.random.Generator, tell: Progress, limits: Limits | None) -> Ground:
    """Ground on which no rung has been yet."""
    own = dict(zip(DRAWN, rng.spawn(len(DRAWN)), strict=True))
    return Ground(problem, {"factor": rng, **own}, tell, limits or Limits(seed=int(rng.integers(2**32))))


def prepared(ground: Ground) -> Prepared:
    """Noise, whitening and factor of the runs."""

    def make() -> Prepared:
        ground.tell("noise and factor")
        problem = ground.problem
        return prepare(problem.spec, problem.runs, ground.tell, ground.rngs["factor"], problem.doubt)

    return once(ground, "factor", make)


def plainly_prepared(problem: Problem) -> Prepared:
    """Factor of the runs as if their noise were white, and the bench without errors."""
    white = NoiseRule("white")
    spec = replace(problem.spec, runs=tuple(replace(run, noise=white) for run in problem.spec.runs))
    spec = replace(spec, reference={}, robust=False)
    return prepare(spec, problem.runs, silent, np.random.default_rng(0))


def chained(ground: Ground, method: Method) -> tuple[Sampled, bool]:
    """Chains of emcee, and whether they have converged; what they are at the time limit is taken too."""

    def make() -> tuple[Sampled, bool]:
        ready = prepared(ground)
        given = (ready.summary, ready.rows, ready.prior.sd)
        try:
            return sample(*given, method=method, limits=ground.limits, progress=ground.tell), True
        except ConvergenceError as unfinished:
            if not isinstance(unfinished.estimate, Sampled):
                raise
            return unfinished.estimate, False

    return once(ground, method, make)


def once(ground: Ground, name: str, make: Callable[[], Made]) -> Made:
    """What was made under a name, or is now."""
    if name not in ground.shared:
        start = time.perf_counter()
        made = make()
        ground.shared[name] = (made, time.perf_counter() - start)
    return ground.shared[name][0]


@dataclass(frozen=True, slots=True, eq=False)
class Posterior:
    """What a rung says of the noise, N, B, K (g, 3) of each run, SI, and of the full library over it.

    A method that knows only white noise has 0 for B and K. The decision averages over `noises`, draws of the
    noise, where there are any: `log_evidence` is that of the full library, these integrated out. `moments`
    are mean and sd (columns,) of that library's coefficients, None for those at the estimate; `converged`
    says whether chains of emcee reached what was asked.
    """

    rung: RungName
    noise: FloatArray
    noises: tuple[NoiseDraw, ...] = ()
    log_evidence: float = 0.0
    moments: tuple[FloatArray, FloatArray] | None = None
    chains: Chains | None = None
    converged: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """What a rung says of one component, or of those of a case: on each a decision as the report shows it.

    Cheap rungs give one too, with the method's own means, inclusions and verdicts. `full_mean` and `full_sd`
    (p,) are of all components under the full library, SI; `ready` is what the answer rests on, None of a
    method that has no use for it; it took `seconds` from rows to decision.
    """

    posterior: Posterior
    selections: tuple[Selection, ...]
    full_mean: FloatArray
    full_sd: FloatArray
    ready: Prepared | None = None
    seconds: float = 0.0

    @property
    def rung(self) -> RungName:
        """Rung that was taken."""
        return self.posterior.rung

    @property
    def selection(self) -> Selection:
        """Decision on the one component."""
        (only,) = self.selections
        return only

    @property
    def names(self) -> tuple[str, ...]:
        """Of the p terms of all components, in the order of the columns."""
        return tuple(name for selection in self.selections for name in selection.columns)

    @property
    def model(self) -> tuple[str, ...]:
        """Terms of the one component that are kept."""
        return self.selection.model

    @property
    def mean(self) -> FloatArray:
        """Coefficients (p,) averaged over models, SI."""
        return np.array([term.mean for selection in self.selections for term in selection.terms])

    @property
    def inclusion(self) -> FloatArray:
        """Probability (p,) of each term; of a method that gives none, 0 or 1."""
        return np.array([term.inclusion for selection in self.selections for term in selection.terms])


def answer_of(posterior: Posterior, selections: Sequence[Selection], ready: Prepared | None) -> Answer:
    """Answer that says what decisions say, of the full library what the noise's posterior does."""
    full = np.array(
        [(term.full_mean, term.full_sd) for selection in selections for term in selection.terms]
    ).T
    mean, sd = (
        full if posterior.moments is None else (values[: full.shape[1]] for values in posterior.moments)
    )
    return Answer(posterior, tuple(selections), mean, sd, ready)


def decided(ground: Ground, posterior: Posterior) -> Answer:
    """Decision on every component from every submodel, weighed over the noise's posterior."""
    ready, problem, noises = prepared(ground), ground.problem, posterior.noises
    summary = ready.summary
    if noises and ready.spreads:
        rng = np.random.default_rng(ground.limits.seed)
        noises = over_spreads(noises, ready.spreads, ready.prior.sd, rng)
    decide = partial(
        select,
        prior=ready.prior,
        noises=noises,
        log_evidence=posterior.log_evidence,
        costs=problem.costs,
        hierarchical=problem.hierarchical,
    )
    where = (
        counted(len(posterior.noises), "draw") + " of the noise"
        if posterior.noises
        else "the estimated noise"
    )
    selections = []
    for component in components_of(problem.case, summary):
        of = f" of {component.name}" if component.name else ""
        ground.tell(f"every model of {counted(len(component.library.terms), 'term')}{of} at {where}")
        own = replace(summary, library=component.library, facts=component.facts)
        selections.append(decide(own, component=component.name))
    return answer_of(posterior, selections, ready)


def change(before: Answer, after: Answer) -> tuple[float, float]:
    """How far two answers are apart: coefficients in posterior sd of the second, and inclusions.

    The largest over terms; of the averaged and the full-library coefficients, the larger.
    """
    apart = np.maximum(np.abs(after.mean - before.mean), np.abs(after.full_mean - before.full_mean))
    return float(np.max(apart / after.full_sd)), float(np.max(np.abs(after.inclusion - before.inclusion)))
