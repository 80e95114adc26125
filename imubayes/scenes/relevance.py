"""Which terms a scene requires: what each costs there, and the smallest model that stays within a budget.

Everything is linear in the coefficients. With ``A`` the rows of what is budgeted (the scene's factor over
``sqrt(n)`` for an error of the output, `Propagation.errors` at times over the mission for attitude, velocity
and position), a sensor whose coefficients are theta and that is compensated with the posterior mean m of the
terms of a model S is left with ``A (theta - m_S)``. Of the terms that are left out, those that are kept take
up what they can: a smaller model is calibrated as such, at best over the very scene, or as this test would
calibrate it, so that m_S holds the least-squares share of the others on the output. What is left is what
nothing that is kept stands for, and what the calibration does not know. Its size is the rms for the output
and the largest value over the mission otherwise. theta is uncertain: all of it is computed over posterior
draws.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from imubayes.algebra import BoolArray, FloatArray
from imubayes.scenes import Scene
from imubayes.scenes.effects import (
    SURE,
    ComponentInScene,
    Knowledge,
    SceneEffects,
    budget_effects,
    half_and_most,
    left_over,
    names_of,
    output_effects,
    propagations,
    smallest_model,
)
from imubayes.scenes.propagation import Budget, noise_growth
from imubayes.selection.decision import Selection
from imubayes.sensors.equations.basic import TERMS
from imubayes.sensors.noise import FLOOR, Noise
from imubayes.sensors.terms import Kind, Library

INTERVAL = (0.05, 0.5, 0.95)
"""Quantiles of a share of the budget: median and 90 % interval."""

MATTERS = 0.1
"""Share of the budget from which a term matters."""

OUTPUT_TIME = 1.0
"""s; averaging time at which noise is set beside an error of the output."""

THERE = 0.5
"""Inclusion from which a term is there: the median probability model."""

QUADRANTS = ("there and matters", "there, does not matter", "not shown, could matter", "neither")
"""What inclusion and relevance say of a term together."""


def known(selection: Selection, draws: FloatArray) -> Knowledge:
    """Collect what a decision and its posterior draws (m, p) say."""
    inclusion, limit = (
        np.array([getattr(t, key) for t in selection.terms]) for key in ("inclusion", "limit95")
    )
    return Knowledge(draws, inclusion, limit)


@dataclass(frozen=True, slots=True)
class TermRelevance:
    """What one term costs in a scene.

    Attributes
    ----------
    inclusion : posterior probability that it is there.
    rms : rms effect on the output, root mean square over the draws, m/s^2 or rad/s.
    effect : median size on what is budgeted, SI.
    share_q05, share_of_budget, share_q95 : quantiles of its share of the budget, the median without a number.
    share_at_limit95 : share of the budget at its limit with 95 %, if it is there.
    share_unknown : share of the budget of one sd of its posterior: what stays of it when it is kept.
    kept : whether the scene's model has it.
    quadrant : one of `QUADRANTS`.
    """

    name: str
    inclusion: float
    rms: float
    effect: float
    share_q05: float
    share_of_budget: float
    share_q95: float
    share_at_limit95: float
    share_unknown: float
    kept: bool
    quadrant: str


@dataclass(frozen=True, slots=True, eq=False)
class Relevance:
    """Which terms a scene requires of a component; sizes are SI of the budget, pairs at 50 % and 95 %.

    Attributes
    ----------
    axis : case axis that the component lies along.
    duration : of the mission, s.
    budget : that the model has to stay within.
    terms : in the order of the library.
    model : the smallest that stays within the budget with 95 %; where the calibration lets none, the smallest
        of which the terms left out stay within it.
    within_budget : whether the calibration lets a model stay within the budget with 95 %.
    left : of the error with this model: the terms left out, and what the calibration does not know of those
        kept.
    left_out : of the terms left out alone.
    left_out_rms : their rms effect on the output, root mean square over the draws, m/s^2 or rad/s.
    calibrated : what would be left with every term kept.
    uncompensated : what would be left with none.
    path : (number of terms, term dropped to get there, bound of the error at 95 %, see `smallest_model`),
        from all terms down to none.
    noise : sd that N, B and K bring about; zeros where no noise was given.
    tested_model : the smallest where the terms kept take up the others over the inputs of the test, as a
        calibration with these terms would; None where the test's inputs are not known.
    tested_left_out : of the terms that it leaves out; NaN likewise.
    notes : of the scene.
    """

    scene: str
    axis: str
    kind: Kind
    duration: float
    budget: Budget
    terms: tuple[TermRelevance, ...]
    model: tuple[str, ...]
    within_budget: bool
    left: tuple[float, float]
    left_out: tuple[float, float]
    left_out_rms: float
    calibrated: tuple[float, float]
    uncompensated: tuple[float, float]
    path: tuple[tuple[int, str, float], ...]
    noise: tuple[float, float, float]
    tested_model: tuple[str, ...] | None = None
    tested_left_out: tuple[float, float] = (math.nan, math.nan)
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Exposure:
    """What a scene makes of the terms of a library, along a case axis: the same for every unit.

    Effects on the `output`, and on what is budgeted; `noise` is the sd that a unit of N, B and K brings about
    in that, in the draw where it is largest.
    """

    scene: Scene
    lib: Library
    budget: Budget
    axis: str
    output: SceneEffects
    budgeted: SceneEffects
    noise: tuple[float, float, float]

    def noise_of(self, noise: Noise | None) -> tuple[float, float, float]:
        """Sd that N, B and K of a component bring about, SI of the budget; zeros for none."""
        white, flicker, walk = self.noise
        return (0.0, 0.0, 0.0) if noise is None else (white * noise.N, flicker * noise.B, walk * noise.K)


def exposure(scene: Scene, lib: Library, budget: Budget, *, axis: str = "x") -> Exposure:
    """Work out the effects of a library's terms in a scene, once for all units that are weighed with it."""
    output = output_effects(scene, lib, axis)
    if budget.quantity == "output":
        # of an average over a second; of a random walk the rms over the mission
        noise = 1.0 / math.sqrt(OUTPUT_TIME), FLOOR, math.sqrt(0.5 * scene.duration)
        return Exposure(scene, lib, budget, axis, output, output, noise)
    budgeted = budget_effects(scene, lib, budget, axis)
    passed = propagations(lib.kind, scene, budget.schuler)
    grown = [noise_growth(propagation, axis, budget.quantity) for propagation in passed]
    white, flicker, walk = np.max(grown, axis=0).tolist()
    return Exposure(scene, lib, budget, axis, output, budgeted, (white, flicker, walk))


def weigh(
    exposed: Exposure, knowledge: Knowledge, *, noise: Noise | None = None, tested: SceneEffects | None = None
) -> Relevance:
    """Weigh every term of a component over a scene, and choose the smallest model that it requires.

    The `knowledge` is of the coefficients in the order of the library; `tested` are the terms' columns over
    the inputs of the test, or a factor of them.
    """
    lib, output, effects = exposed.lib, exposed.output, exposed.budgeted
    part, limit, theta = ComponentInScene(effects, output, knowledge), exposed.budget.limit, knowledge.draws
    (keep,), path, found = _smallest([exposed], [part])
    as_tested: dict[str, Any] = {}
    if tested is not None:
        (held,), _ = smallest_model([part._replace(over=tested)], limit, found["calibrated"][1])
        lost = half_and_most(effects.size(left_over(tested, held, theta)))
        as_tested = {"tested_model": names_of(lib, held), "tested_left_out": lost}
    return Relevance(
        **found,
        axis=exposed.axis,
        kind=lib.kind,
        terms=_terms(output, effects, knowledge, limit, keep),
        model=names_of(lib, keep),
        left_out_rms=float(np.sqrt(np.mean(output.size(left_over(output, keep, theta)) ** 2))),
        path=path,
        noise=exposed.noise_of(noise),
        **as_tested,
        notes=(*exposed.scene.notes, *_assumed(exposed)),
    )


def _smallest(
    exposed: Sequence[Exposure], parts: Sequence[ComponentInScene]
) -> tuple[tuple[BoolArray, ...], tuple[tuple[int, str, float], ...], dict[str, Any]]:
    """Smallest model of components that err together, and what it, all terms, and none leave of the error."""
    scene, budget, sized = exposed[0].scene, exposed[0].budget, exposed[0].budgeted.sized
    m = min(len(part.knowledge.draws) for part in parts)
    errors = [(k.draws[:m] - k.draws.mean(axis=0)) @ effects.rows.T for effects, _, k in parts]
    unknown = np.sum(errors, axis=0)
    calibrated = half_and_most(sized(unknown))
    keep, path = smallest_model(parts, budget.limit, calibrated[1])
    each: list[list[FloatArray]] = []
    for (effects, over, knowledge), kept in zip(parts, keep, strict=True):
        theta, mean = knowledge.draws[:m], knowledge.draws.mean(axis=0)
        sides = left_over(over, kept, theta), left_over(over, kept, mean), theta
        each.append([side @ effects.rows.T for side in sides])
    lost, means, whole = (np.sum(errors, axis=0) for errors in zip(*each, strict=True))
    sizes = {"left": unknown + means, "left_out": lost, "uncompensated": whole}
    found: dict[str, Any] = {name: half_and_most(sized(error)) for name, error in sizes.items()}
    found |= {"within_budget": calibrated[1] <= budget.limit, "calibrated": calibrated}
    return keep, path, {"scene": scene.name, "duration": scene.duration, "budget": budget, **found}


def _assumed(exposed: Exposure) -> Iterator[str]:
    """Say where an error of attitude meets a force that is not known, and what is repeated."""
    scene, lib, channels = exposed.scene, exposed.lib, exposed.scene.inputs.channels
    forceless = not scene.inputs.has("f")
    if forceless and lib.kind == "gyroscope" and exposed.budget.quantity in ("velocity", "position"):
        yield "it has no force: 1 g is taken to act upwards"
    heated = any(f.channel in ("T", "dT") for term in lib.terms for f in term.factors)
    motion, logged = scene.mean_motion, scene.course is None and "T" in channels
    # the record of temperature ends before the mission does
    if heated and logged and scene.duration > 1.01 * len(motion) * motion.interval:
        yield "motion repeats the record, and from its end on temperature stays as it is there"


def _terms(
    output: SceneEffects, effects: SceneEffects, knowledge: Knowledge, limit: float, keep: BoolArray
) -> tuple[TermRelevance, ...]:
    rms = output.single(np.sqrt(np.mean(knowledge.draws**2, axis=0)))
    sizes = effects.single(knowledge.draws) / limit
    low, half, high = np.quantile(sizes, INTERVAL, axis=0)
    possible = effects.single(knowledge.limit95) / limit
    unknown = effects.single(knowledge.draws.std(axis=0)) / limit
    return tuple(
        TermRelevance(
            name=name,
            inclusion=float(knowledge.inclusion[j]),
            rms=float(rms[j]),
            effect=float(half[j] * limit),
            share_q05=float(low[j]),
            share_of_budget=float(half[j]),
            share_q95=float(high[j]),
            share_at_limit95=float(possible[j]),
            share_unknown=float(unknown[j]),
            kept=bool(keep[j]),
            quadrant=quadrant(float(knowledge.inclusion[j]), float(half[j]), float(possible[j])),
        )
        for j, name in enumerate(effects.names)
    )


def basic_left(seen: Exposure, draws: FloatArray) -> float:
    """Size that the error of a triad of twelve parameters stays below in a scene with 95 %, SI of the budget.

    Bias, scale and misalignment of the triad take up what they can of the other terms' rms over the scene.
    The error is what they leave, of terms as uncertain as the draws (m, p) of the test: what it does not know
    of bias, scale and misalignment, it does not know under the larger model either.
    """
    basic = np.isin(seen.lib.names, TERMS)
    return float(np.quantile(seen.budgeted.size(left_over(seen.output, basic, draws)), SURE))


def quadrant(inclusion: float, share: float, possible: float) -> str:
    """What inclusion and relevance say of a term: the share of the budget that it takes, or could take."""
    if inclusion >= THERE:
        return QUADRANTS[0] if share >= MATTERS else QUADRANTS[1]
    return QUADRANTS[2] if possible >= MATTERS else QUADRANTS[3]


@dataclass(frozen=True, slots=True, eq=False)
class CaseRelevance:
    """Which terms of which components a scene requires, so that the case stays within a budget.

    `models` are the terms to keep of each component, by its id, of so many `candidates` of all; the `noise`
    is that of all components together. All else is as in `Relevance`; the budget is not of the output.
    """

    scene: str
    duration: float
    budget: Budget
    models: Mapping[str, tuple[str, ...]]
    candidates: int
    within_budget: bool
    left: tuple[float, float]
    left_out: tuple[float, float]
    calibrated: tuple[float, float]
    uncompensated: tuple[float, float]
    noise: tuple[float, float, float]

    @property
    def kind(self) -> None:
        """Return nothing: it is of both."""


def weigh_case(
    exposed: Mapping[str, Exposure], knowledge: Mapping[str, Knowledge], noise: Mapping[str, Noise]
) -> CaseRelevance:
    """Choose the terms of all components of a case, by their ids, that one scene requires.

    The budget is not of the output, which every component has for itself; the components' draws count as
    independent.
    """
    parts = [ComponentInScene(seen.budgeted, seen.output, knowledge[name]) for name, seen in exposed.items()]
    keep, _, found = _smallest(tuple(exposed.values()), parts)
    grown = [seen.noise_of(noise[name]) for name, seen in exposed.items()]
    white, flicker, walk = np.linalg.norm(grown, axis=0).tolist()
    models = zip(exposed.items(), keep, strict=True)
    return CaseRelevance(
        **found,
        models={name: names_of(seen.lib, kept) for (name, seen), kept in models},
        candidates=sum(len(seen.lib.terms) for seen in exposed.values()),
        noise=(white, flicker, walk),
    )
