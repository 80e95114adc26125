"""What a trade measures: components of a study, rungs that are held against each other, and repeats.

Repeats are sensors after the same tests whose truth is known, by which is told what the rungs get right.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from imubayes.algebra import BoolArray, FloatArray
from imubayes.campaign import Mission, SensorSpec, Study
from imubayes.campaign.preparation import runs_of
from imubayes.errors import InputError, hint
from imubayes.inference import SIDE, Rate, rate
from imubayes.inference.mcmc.ensembles import Limits
from imubayes.ladder import NAMES, RungName, rung_of
from imubayes.ladder.costs import cores
from imubayes.ladder.problem import Problem, ground_of, problem_of
from imubayes.ladder.rungs import stand
from imubayes.ladder.trade.measurement import Measured, measured_of
from imubayes.population import simulate_unit
from imubayes.population.lots import LARGE, SMALL, LotStudy, lot_of
from imubayes.rig.inputs import Run, Source
from imubayes.rig.simulate import drawn_errors, simulated_over
from imubayes.scenes.effects import Knowledge
from imubayes.scenes.relevance import Exposure, Relevance, weigh
from imubayes.selection.verdicts import TENTH, Costs
from imubayes.sensors.lots import Lot
from imubayes.sensors.noise import Noise
from imubayes.work import silent

DEFAULT: RungName = "collapsed"
"""What a run takes that is not asked for a budget."""

REPEATS = 20
"""Simulated repeats of a study, where none are asked for."""

LIMIT = 300.0
"""s; time of a trade, where none is asked for."""

ESS = 1000.0
"""Effective sample size that chains are asked for, where the study does not say."""

FREE = "a trade measures single components with known inputs, and no free tumbles or whole IMUs"


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """A component that the rungs answer for.

    The name is that of the sensor, or of the class that it is a unit of. A sensor of a study has no lot: its
    repeats are drawn from its posterior.
    """

    name: str
    problem: Problem
    lot: Lot | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Trade:
    """What is measured: `rungs` on the components of a study, and on simulated repeats of them.

    Attributes
    ----------
    subjects : that the rungs answer for, in the order in which time is spent on them.
    missions : scenes that the answers are held against.
    repeats : simulated sensors that every rung that can be afforded answers for, too; 0 or more.
    limit : s, of all.
    ess : effective sample size asked of chains.
    processes : that share the repeats.
    left_out : components that no rung answers for, each with the reason.
    only : sensors or classes that were asked for by name; none for all.
    """

    title: str
    seed: int
    path: Path
    text: str
    subjects: tuple[Subject, ...]
    missions: tuple[Mission, ...] = ()
    rungs: tuple[RungName, ...] = NAMES
    repeats: int = REPEATS
    limit: float = LIMIT
    ess: float = ESS
    processes: int = 1
    left_out: tuple[tuple[str, str], ...] = ()
    only: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.repeats < 0:
            raise InputError(f"{self.repeats} repeats: expected 0 (none) or more, such as {REPEATS}")


def rungs_of(asked: Sequence[str]) -> tuple[RungName, ...]:
    """Rungs by name, in the order of the ladder.

    Raises
    ------
    InputError : if one is not known, or there are fewer than two.

    Examples
    --------
    >>> rungs_of(["plug-in", "means"])
    ('means', 'plug-in')
    """
    wanted = {rung_of(name.strip()) for name in asked}
    if len(wanted) < 2:
        raise InputError(f"rungs '{', '.join(asked)}': expected two or more of {', '.join(NAMES)}")
    return tuple(name for name in NAMES if name in wanted)


def of_study(study: Study, only: Collection[str] = ()) -> Trade:
    """Trade of a study's sensors, those that are named or all.

    Raises
    ------
    InputError : if a sensor is not in the study, or none has runs with known inputs.
    """
    _check_named(only, [spec.id for spec in study.sensors], "sensor")
    subjects: list[Subject] = []
    left_out: list[tuple[str, str]] = []
    for k, spec in enumerate(study.sensors):
        if only and spec.id not in only:
            continue
        runs = runs_of(spec, study.seed, k)
        if not all(run.known for run in runs):
            left_out.append((spec.id, FREE))
            continue
        problem = problem_of(spec, runs, costs=study.costs, hierarchical=study.hierarchical)
        subjects.append(Subject(spec.id, problem))
    if not subjects:
        raise InputError(f"{study.path}: {FREE}")
    given = study.title, study.seed, study.path, study.text, tuple(subjects), tuple(study.scenes)
    return Trade(
        *given, ess=study.sampling.ess or ESS, processes=cores(), left_out=tuple(left_out), only=tuple(only)
    )


def of_lots(study: LotStudy, only: Collection[str] = (), repeats: int = REPEATS) -> Trade:
    """Trade of one unit of each class of a class-level study, those that are named or all.

    Further units of each lot are the repeats, so that lots are drawn as large as `repeats` asks.

    Raises
    ------
    InputError : if a class is not in the study.
    """
    _check_named(only, [entry.id for entry in study.classes], "class")
    chosen = [k for k, entry in enumerate(study.classes) if not only or entry.id in only]
    larger = replace(study, units=1 + math.ceil(repeats / len(chosen)))
    subjects = []
    for k in chosen:
        lot, rng = lot_of(larger, k), np.random.default_rng([study.seed, k, 1, 0, 0])
        problem = unit_of(lot, 0, study.specs[k], rng)
        subjects.append(Subject(lot.sensor_class.id, problem, lot))
    given = study.title, study.seed, study.path, study.text, tuple(subjects), tuple(study.missions)
    return Trade(*given, processes=cores(), only=tuple(only))


def unit_of(lot: Lot, number: int, spec: SensorSpec, rng: np.random.Generator) -> Problem:
    """Problem of one unit of a lot after its campaign, on a bench with errors; `spec` is of any unit."""
    own = replace(spec, truth=lot.truth(number))
    return problem_of(own, simulate_unit(own, lot, number, rng))


def _check_named(only: Collection[str], known: Sequence[str], what: str) -> None:
    for name in only:
        if name not in known:
            raise InputError(f"no {what} of the study is called '{name}': {hint(name, known)}")


SIMULATED = Source(notes=("simulated: drawn from the posterior",))

FEWEST = 5
"""Simulated repeats that are worth a rate."""


@dataclass(frozen=True, slots=True, eq=False)
class Repeat:
    """A simulated sensor: whose tests it goes through, its truth, and what the rungs say of it.

    The number is that of the draw, or of the unit of a lot; `truth` (p,) are its coefficients, SI, `noises`
    N, B, K of each run (a unit of a lot has its own), `answers` those of the rungs, from the cheapest.
    """

    subject: str
    number: int
    truth: FloatArray
    noises: tuple[tuple[float, float, float], ...] = ()
    answers: tuple[Measured, ...] = ()


def afforded(
    seconds: Mapping[RungName, float], repeats: int, left: float, processes: int
) -> dict[RungName, int]:
    """How many repeats each rung answers in the seconds that are left, the cheapest first.

    Examples
    --------
    >>> afforded({"means": 0.1, "averaged": 5.0, "raw": 100.0}, 20, 60.0, 2)
    {'means': 20, 'averaged': 20}
    """
    room, counts = left * processes, dict[RungName, int]()
    for rung, each in seconds.items():
        most = min(repeats, int(room / max(each, 1e-9)))
        if most < min(FEWEST, repeats) or not most:
            break
        counts[rung] = most
        room -= most * each
    return counts


def drawn(subject: Subject, best: Measured | None, number: int) -> Repeat:
    """Draw a sensor: a further unit of a lot, or a draw of the component's posterior by its best rung."""
    if subject.lot is not None:
        return Repeat(subject.name, number + 1, subject.lot.theta[number + 1])
    if best is None:
        raise ValueError(f"component {subject.name} has no posterior to draw from")
    # draws far apart: those of a chain beside each other are alike
    k = number * 7919 % len(best.draws)
    noises = best.noises[k % len(best.noises)].tolist()
    return Repeat(subject.name, number, best.draws[k], tuple((N, B, K) for N, B, K in noises))


def answered(
    repeat: Repeat, subject: Subject, rungs: Iterable[RungName], limits: Limits, seed: tuple[int, ...]
) -> Repeat:
    """Simulate a sensor's tests, and let rungs answer, which share what they have in common."""
    rng, rungs_rng, kept = (np.random.default_rng([*seed, k]) for k in range(3))
    if subject.lot is not None:
        problem = unit_of(subject.lot, repeat.number, subject.problem.spec, rng)
    else:
        problem = simulated_again(subject.problem, repeat.truth, repeat.noises, rng)
    limits = replace(limits, seed=int(rungs_rng.integers(2**32)))
    ground = ground_of(problem, rungs_rng, silent, limits)
    return replace(
        repeat, answers=tuple(measured_of(stand(name, ground), limits.ess, kept) for name in rungs)
    )


def simulated_again(
    problem: Problem,
    theta: FloatArray,
    noises: Sequence[tuple[float, float, float]],
    rng: np.random.Generator,
) -> Problem:
    """Problem whose runs are simulated with the inputs of the given one, and new errors of its bench.

    Parameters
    ----------
    theta : (p,) coefficients, SI.
    noises : N, B, K of each run, SI.
    """
    reference, lib = problem.spec.reference, problem.library
    errors = drawn_errors(problem.runs, reference, rng)

    def again(run: Run, noise: Noise) -> Run:
        made = simulated_over(run, lib, theta, noise=noise, errors=errors, rng=rng)
        return replace(made, source=SIMULATED)

    pairs = zip(problem.runs, noises, strict=True)
    return replace(problem, runs=tuple(again(run, Noise(*noise)) for run, noise in pairs))


INTERVAL = 0.9
"""Share of the truths that an interval is meant to hold."""

Exposed = Mapping[str, Mapping[str, Exposure]]
"""What each scene makes of a component's terms: by component, by scene."""


@dataclass(frozen=True, slots=True)
class Score:
    """One rung over simulated repeats.

    Attributes
    ----------
    coverage : of its 90 % intervals under the full library, over the terms that the test tells.
    error : rms of its full-library coefficients against the truth there, in posterior sd of the best rung
        that answered the same repeat: about 1 for a right method.
    false_needed, false_not_needed : "needed", of terms that are zero, or below `SMALL`; "not needed", of
        terms above a tenth of the prior sd.
    missed_large : left out of the model, of terms above `LARGE`.
    cost : of both false verdicts a sensor, as the study weighs them.
    scene_terms : terms a scene by which the model that it requires is another than by the truth, on average;
        NaN without scenes.
    """

    rung: RungName
    repeats: int
    coverage: Rate
    error: float
    false_needed: Rate
    false_not_needed: Rate
    missed_large: Rate
    cost: float
    scene_terms: float


def score(rung: RungName, repeats: Sequence[Repeat], costs: Costs, exposed: Exposed) -> Score | None:
    """Score a rung over the repeats that it answered; None where there are none."""
    pairs = [(repeat, answer) for repeat in repeats for answer in repeat.answers if answer.rung == rung]
    if not pairs:
        return None
    off, told, size, held, kept, above, needed, not_needed = map(
        np.concatenate, zip(*(_terms(repeat, answer) for repeat, answer in pairs), strict=True)
    )
    false_needed, false_not_needed = _rate(needed, size < SMALL), _rate(not_needed, above)
    cost = costs.false_keep * false_needed.events + costs.false_drop * false_not_needed.events
    other = list[int]()  # terms by which the model that each scene requires is another than by the truth
    for repeat, trial in pairs:
        truth = Knowledge(repeat.truth[None, :], (repeat.truth != 0.0).astype(float), np.abs(repeat.truth))
        said = required(exposed[repeat.subject], trial)
        true = {name: weigh(seen, truth) for name, seen in exposed[repeat.subject].items()}
        other += [len(set(said[name].model) ^ set(true[name].model)) for name in true]
    return Score(
        rung=rung,
        repeats=len(pairs),
        coverage=_rate(held, told),
        error=float(np.sqrt(np.mean(off[told] ** 2))) if told.any() else float("nan"),
        false_needed=false_needed,
        false_not_needed=false_not_needed,
        missed_large=_rate(~kept, told & (size > LARGE)),
        cost=cost / len(pairs),
        scene_terms=float(np.mean(other)) if other else float("nan"),
    )


def _terms(repeat: Repeat, trial: Measured) -> tuple[np.ndarray, ...]:
    """Every term (p,) of a repeat, as a rung sees it.

    Returns
    -------
    difference from the truth over the best rung's sd; whether the test tells it; size of the truth in sd of
    the best; whether the interval holds the truth; whether the model has it; whether the truth is above a
    tenth of the prior sd; whether the verdict is "needed"; and "not needed".
    """
    best, off, verdicts = repeat.answers[-1], trial.full_mean - repeat.truth, np.array(trial.verdicts)
    return (
        off / best.full_sd,
        best.resolved,
        np.abs(repeat.truth) / best.full_sd,
        np.abs(off) <= SIDE * trial.full_sd,
        np.isin(trial.names, trial.model),
        np.abs(repeat.truth) > TENTH * trial.prior_sd,
        verdicts == "needed",
        verdicts == "not needed",
    )


def _rate(happened: BoolArray, where: BoolArray) -> Rate:
    return rate(int(np.sum(happened & where)), int(np.sum(where)))


def required(exposed: Mapping[str, Exposure], trial: Measured) -> dict[str, Relevance]:
    """What every scene requires of a component, by what a rung knows of it."""
    knowledge = Knowledge(trial.draws, trial.inclusion, trial.limit95)
    return {name: weigh(seen, knowledge) for name, seen in exposed.items()}
