"""One rung on one component: what it says, and what it takes in a process of its own.

Times are without imports and compilation: a process warms up on a small problem first.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from imubayes.algebra import BoolArray, FloatArray
from imubayes.algebra.factor import posterior
from imubayes.campaign import SensorSpec
from imubayes.inference.mcmc.ensembles import LONG, Limits
from imubayes.ladder import NAMES, RungName
from imubayes.ladder.costs import with_peak
from imubayes.ladder.problem import Answer, Ground, Problem, ground_of, problem_of
from imubayes.ladder.rungs import foresee, stand
from imubayes.rig.recordings import RunSpec
from imubayes.rig.simulate import simulate
from imubayes.rig.tumbles import tumble
from imubayes.scenes.relevance import Relevance
from imubayes.selection.decision import posterior_draws
from imubayes.sensors.catalogue import sensor
from imubayes.sensors.terms import library
from imubayes.work import Lost, elsewhere, silent

TURNS, ENOUGH = 5, 2.0
"""Times that a rung is timed, and seconds of it from which it is timed no more: the fastest counts."""

BRIEF = Limits(ess=50.0, time_limit=0.3, seed=1)
"""Of chains that only warm up."""

DRAWS = 500
"""Draws of the coefficients and of the noise that are kept."""

HOLDS = 400.0
"""Effective sample size from which chains can be what others are held against: they are off by 0.05 sd."""

RESOLVED = ("needed", "not needed", "undecided")
"""Verdicts on terms that the test tells."""


class SceneChange(NamedTuple):
    """What a scene requires by one rung and not by the best, and the largest change of a budget's share."""

    scene: str
    terms: tuple[str, ...]
    share: float


@dataclass(frozen=True, slots=True)
class Difference:
    """A rung against the best on the same component.

    Coefficients differ, over the tested terms, by `largest` (of the term `worst`) and by `rms`, in posterior
    sd of the best; of the averaged and the full-library ones, the larger. The inclusion is the largest
    difference of one; verdicts are (name, the rung's, the best's) of terms where they differ.
    """

    largest: float
    rms: float
    worst: str
    inclusion: float
    verdicts: tuple[tuple[str, str, str], ...]
    scenes: tuple[SceneChange, ...]


SAME = Difference(0.0, 0.0, "", 0.0, (), ())
"""Of an answer that is held against nothing."""


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """A rung on one component; without the models behind it, small enough to pass between processes.

    Attributes
    ----------
    mean, inclusion : (p,) of the terms `names`, averaged over models, SI; `full_mean`, `full_sd` under the
        full library; `model` are those that are kept.
    draws : (m, p) of the coefficients, averaged over models.
    noises : (k, g, 3) draws of N, B, K of each run; one where the rung knows one noise.
    monte_carlo : (p,) error that few draws leave in the means, in posterior sd; 0 without draws.
    ess : least effective sample size of the chains; infinite without.
    wanting : times that the chains would have to be as long as they are, to reach what was asked; 1 at least.
    chain_seconds : that the chains took.
    seconds, processor_seconds : wall time, the shortest, and that of the same turn over all threads.
    memory : bytes at the peak, beside what the process held before; NaN where nobody measured.
    foreseen : what the rung itself says that the next one would change: coefficients in posterior sd, and
        inclusions; NaN at the top.
    difference : from the best on the same component.
    """

    rung: RungName
    names: tuple[str, ...]
    mean: FloatArray
    inclusion: FloatArray
    full_mean: FloatArray
    full_sd: FloatArray
    prior_sd: FloatArray
    limit95: FloatArray
    verdicts: tuple[str, ...]
    model: tuple[str, ...]
    draws: FloatArray
    noises: FloatArray
    monte_carlo: FloatArray
    ess: float
    wanting: float
    chain_seconds: float
    seconds: float
    processor_seconds: float = math.nan
    memory: float = math.nan
    foreseen: tuple[float, float] = (math.nan, math.nan)
    difference: Difference = SAME

    @property
    def whole_seconds(self) -> float:
        """Wall time until the chains have reached what was asked of them: more than was spent, if short."""
        return self.seconds + (self.wanting - 1.0) * self.chain_seconds

    @property
    def tested(self) -> BoolArray:
        """Which terms (p,) the runs excite."""
        return np.array([verdict != "untested" for verdict in self.verdicts])

    @property
    def resolved(self) -> BoolArray:
        """Which terms (p,) the test can tell."""
        return np.array([verdict in RESOLVED for verdict in self.verdicts])


def measured(problem: Problem, rung: RungName, limits: Limits, seed: tuple[int, ...]) -> Measured | None:
    """Measure a rung in a new process; None where the process did not survive it."""
    outcome = elsewhere(here, problem, rung, limits, seed)
    return None if isinstance(outcome, Lost) else outcome


def here(problem: Problem, rung: RungName, limits: Limits, seed: tuple[int, ...]) -> Measured:
    """Measure a rung in this process, warmed up on a small problem; memory is that of the first turn."""
    # A problem so small that a rung's first turn on it is all imports and compilation
    entry = sensor("mems_tactical", kind="accelerometer")
    lib = library("accelerometer", powers=1, asymmetry=-1)
    plan = tumble(angles=8, planes=2, dwell=2.0, rate=4.0)
    runs = simulate(entry, [plan], seed=1, truth={"b0": 0.01})
    specs = (RunSpec("tumble", "tumble"),)
    _turn(problem_of(SensorSpec("warm-up", entry.kind, entry, lib, specs, {}), runs), rung, BRIEF, (0,))
    turn = partial(_turn, problem, rung, limits, seed)
    (ground, answer, *first), memory = with_peak(turn)
    times = [first]
    while len(times) < TURNS and sum(seconds for seconds, _ in times) < ENOUGH:
        times.append([*turn()[2:]])
    seconds, processor_seconds = min(times)
    return replace(
        measured_of(answer, limits.ess, np.random.default_rng([*seed, 1])),
        seconds=seconds,
        processor_seconds=processor_seconds,
        memory=memory,
        foreseen=(math.nan, math.nan) if rung == NAMES[-1] else foresee(ground, answer)[0],
    )


def _turn(
    problem: Problem, rung: RungName, limits: Limits, seed: tuple[int, ...]
) -> tuple[Ground, Answer, float, float]:
    """What one turn gives, its wall time and its processor time, s."""
    processor, start = time.process_time(), time.perf_counter()
    ground = ground_of(problem, np.random.default_rng(seed), silent, limits)
    answer = stand(rung, ground)
    return ground, answer, time.perf_counter() - start, time.process_time() - processor


def measured_of(answer: Answer, ess: float, rng: np.random.Generator) -> Measured:
    """What others compare of an answer; `ess` was asked of chains, `rng` draws from the posterior."""
    terms, chains, noises = answer.selection.terms, answer.posterior.chains, answer.posterior.noise[None]
    if chains is not None:
        every = chains.noise.reshape(-1, *chains.noise.shape[2:])
        noises = every[np.linspace(0, len(every) - 1, DRAWS).astype(int)]
    diagnostics = chains.diagnostics if chains else None
    reached, wanting = float(diagnostics.ess.min()) if diagnostics else math.inf, 1.0
    if diagnostics and not answer.posterior.converged:
        wanting = max(1.0, ess / reached, LONG * float(diagnostics.tau.max()) / diagnostics.steps)
    return Measured(
        rung=answer.rung,
        names=answer.names,
        mean=answer.mean,
        inclusion=answer.inclusion,
        full_mean=answer.full_mean,
        full_sd=answer.full_sd,
        prior_sd=np.array([term.prior_sd for term in terms]),
        limit95=np.array([term.limit95 for term in terms]),
        verdicts=tuple(term.verdict for term in terms),
        model=answer.model,
        draws=posterior_draws(answer.selection, DRAWS, rng),
        noises=np.asarray(noises, dtype=float),
        monte_carlo=monte_carlo(answer),
        ess=reached,
        wanting=wanting,
        chain_seconds=diagnostics.seconds if diagnostics else 0.0,
        seconds=answer.seconds,
    )


def monte_carlo(answer: Answer) -> FloatArray:
    """Error (p,) that few draws leave in the coefficients' means, in posterior sd.

    An average over n draws of the noise is off by the sd of the mean given the noise over sqrt(n), where of
    draws that were taken several times fewer count; one over chains by one over the root of their effective
    size, and of the draws that are kept of them.
    """
    p, noises, chains = len(answer.names), answer.posterior.noises, answer.posterior.chains
    few, own = np.zeros(p), 0.0
    if noises and answer.ready is not None:
        each = [posterior(noise.factor, answer.ready.prior.sd)[0][:p] for noise in noises]
        often = np.array(list(Counter(map(id, noises)).values()), dtype=float)
        count = often.sum() ** 2 / float(np.sum(often**2))
        few = np.std(each, axis=0) / answer.full_sd / math.sqrt(max(count - 1.0, 1.0))
    if chains is not None:
        own = 1.0 / math.sqrt(min(float(chains.diagnostics.ess.min()), chains.theta[..., 0].size))
    return np.maximum(few, own)


def best_of(trials: Sequence[Measured]) -> Measured:
    """The highest rung whose chains, where it has any, are long enough to hold others against it."""
    return [trial for trial in trials if trial.ess >= HOLDS][-1]


def difference(
    trial: Measured, best: Measured, needs: Mapping[str, Relevance], best_needs: Mapping[str, Relevance]
) -> Difference:
    """Hold what a rung says against the best on the same runs, and what each scene requires by either."""
    asked = best.tested
    apart = (
        np.maximum(np.abs(trial.mean - best.mean), np.abs(trial.full_mean - best.full_mean)) / best.full_sd
    )
    away = np.where(asked, apart, 0.0)
    other = zip(trial.names, trial.verdicts, best.verdicts, strict=True)
    scenes = list[SceneChange]()
    for scene, mine in needs.items():
        right = best_needs[scene]
        changed = {*mine.model} ^ {*right.model}
        terms = tuple(term.name for term in mine.terms if term.name in changed)
        pairs = zip(mine.terms, right.terms, strict=True)
        share = max((abs(term.share_of_budget - other.share_of_budget) for term, other in pairs), default=0.0)
        scenes.append(SceneChange(scene, terms, float(share)))
    return Difference(
        largest=float(away.max(initial=0.0)),
        rms=float(np.sqrt(np.mean(away[asked] ** 2))) if asked.any() else 0.0,
        worst=trial.names[int(np.argmax(away))],
        inclusion=float(np.max(np.abs(trial.inclusion - best.inclusion)[asked], initial=0.0)),
        verdicts=tuple((name, said, right) for name, said, right in other if said != right),
        scenes=tuple(scenes),
    )
