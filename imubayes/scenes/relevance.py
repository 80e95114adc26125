"""Which terms a scene requires: what each costs there, and the smallest model that stays within a budget.

Everything is linear in the coefficients. With ``A`` the rows of what is budgeted (the scene's factor over
``sqrt(n)`` for an error of the output, `propagation.errors_at` times over the mission for attitude, velocity
and position), a sensor whose coefficients are theta and that is compensated with the posterior mean m of the
terms of a model S is left with ``A (theta - m_S)``. Of the terms that are left out, those that are kept take
up what they can: a smaller model is calibrated as such, at best over the very scene, so that m_S holds the
least-squares share of the others on the output. What is left is what nothing that is kept stands for, and
what the calibration does not know. Its size is the rms for the output and the largest value over the mission
otherwise. theta is uncertain: all of it is computed over posterior draws.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from imubayes.algebra.arrays import BoolArray, FloatArray
from imubayes.errors import InputError
from imubayes.scenes.effects import SceneEffects, budget_effects, output_effects
from imubayes.scenes.propagation import Budget, noise_growth, output_noise, propagation
from imubayes.scenes.record import Scene
from imubayes.selection.decision import Selection
from imubayes.sensors.noise import Noise
from imubayes.sensors.terms import Kind, Library

SURE = 0.95
"""Share of the posterior draws that must stay within the budget."""

INTERVAL = (0.05, 0.5, 0.95)
"""Quantiles of a share of the budget: median and 90 % interval."""

MATTERS = 0.1
"""Share of the budget from which a term matters."""

THERE = 0.5
"""Inclusion from which a term is there: the median probability model."""

ALIKE = 1e-9
"""Singular values, over the largest, below which terms that are kept do the same in a scene."""

EQUAL = 6
"""Digits after the point to which costs, as shares of the limit, are told apart."""

QUADRANTS = ("there and matters", "there, does not matter", "not shown, could matter", "neither")
"""What inclusion and relevance say of a term together."""


@dataclass(frozen=True, slots=True, eq=False)
class Knowledge:
    """What is known of a component's coefficients, in the order of its library.

    Attributes
    ----------
    draws : (m, p) of the posterior, averaged over models: zero where a draw's model lacks the term.
    inclusion : (p,) posterior probability of each term.
    limit95 : (p,) what |theta| stays below with 95 % if the term is in the model.
    """

    draws: FloatArray
    inclusion: FloatArray
    limit95: FloatArray


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
    name : of the term.
    inclusion : posterior probability that it is there.
    rms : rms effect on the output, root mean square over the draws, m/s^2 or rad/s.
    effect : median size on what is budgeted, SI.
    share : 5 %, 50 % and 95 % quantiles of its share of the budget.
    possible : share of the budget at its limit with 95 %, if it is there.
    unknown : share of the budget of one sd of its posterior: what stays of it when it is kept.
    kept : whether the scene's model has it.
    quadrant : one of `QUADRANTS`.
    """

    name: str
    inclusion: float
    rms: float
    effect: float
    share: tuple[float, float, float]
    possible: float
    unknown: float
    kept: bool
    quadrant: str


@dataclass(frozen=True, slots=True, eq=False)
class Relevance:
    """Which terms a scene requires of a component.

    Attributes
    ----------
    scene, axis : of which scene, and along which case axis.
    kind : of the component.
    duration : of the mission, s.
    budget : that the model has to stay within.
    terms : in the order of the library.
    model : the smallest that stays within the budget with 95 %; where the calibration lets none, the smallest
        of which the terms left out stay within it.
    met : whether the calibration lets a model stay within the budget with 95 %.
    left : size of the error with this model at 50 % and 95 %, SI of the budget: the terms left out, and what
        the calibration does not know of those kept.
    left_out : size of the terms left out alone, at 50 % and 95 %.
    left_out_rms : their rms effect on the output, root mean square over the draws, m/s^2 or rad/s.
    calibrated : what would be left with every term kept, at 50 % and 95 %.
    uncompensated : what would be left with none.
    path : (number of terms, term dropped to get there, bound of the error at 95 % in SI, see
        `smallest_model`), from all terms down to none.
    noise : sd that N, B and K bring about in the unit of the budget; zeros where no noise was given.
    notes : of the scene.
    """

    scene: str
    axis: str
    kind: Kind
    duration: float
    budget: Budget
    terms: tuple[TermRelevance, ...]
    model: tuple[str, ...]
    met: bool
    left: tuple[float, float]
    left_out: tuple[float, float]
    left_out_rms: float
    calibrated: tuple[float, float]
    uncompensated: tuple[float, float]
    path: tuple[tuple[int, str, float], ...]
    noise: tuple[float, float, float]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Exposure:
    """What a scene makes of the terms of a library: the same for every unit.

    Attributes
    ----------
    scene, lib, budget, axis : of which scene, component and budget, along which case axis.
    output : effect on the output.
    budgeted : effect on what is budgeted.
    noise : sd that a unit of N, B and K brings about in what is budgeted.
    """

    scene: Scene
    lib: Library
    budget: Budget
    axis: str
    output: SceneEffects
    budgeted: SceneEffects
    noise: tuple[float, float, float]


def exposure(scene: Scene, lib: Library, budget: Budget, *, axis: str = "x") -> Exposure:
    """Work out the effects of a library's terms in a scene, once for all units that are weighed with it."""
    output = output_effects(scene, lib, axis)
    if budget.quantity == "output":
        return Exposure(scene, lib, budget, axis, output, output, output_noise(scene.duration))
    passed = propagation(lib.kind, scene, axis, schuler=budget.schuler)
    budgeted = budget_effects(scene, lib, budget, axis, passed)
    noise = noise_growth(passed, budget.quantity, scene.duration)
    return Exposure(scene, lib, budget, axis, output, budgeted, noise)


def relevance(
    scene: Scene,
    lib: Library,
    knowledge: Knowledge,
    budget: Budget,
    *,
    axis: str = "x",
    noise: Noise | None = None,
) -> Relevance:
    """Weigh every term of a component over a scene, and choose the smallest model that it requires.

    Parameters
    ----------
    scene : what the sensor will see.
    lib : of the component.
    knowledge : of its coefficients, in the order of `lib`.
    budget : what the error may come to.
    axis : case axis of the component's input.
    noise : of the component, to set beside.

    Raises
    ------
    InputError : if the knowledge is not of this library.
    """
    return weigh(exposure(scene, lib, budget, axis=axis), knowledge, noise=noise)


def weigh(exposed: Exposure, knowledge: Knowledge, *, noise: Noise | None = None) -> Relevance:
    """Weigh one unit's terms over a scene whose effects are known: `relevance` in its second half."""
    lib, scene, budget = exposed.lib, exposed.scene, exposed.budget
    if knowledge.draws.ndim != 2 or knowledge.draws.shape[1] != len(lib.terms):
        raise InputError(
            f"draws of shape {knowledge.draws.shape}: expected (m, {len(lib.terms)}), a column for each term"
        )
    output, effects = exposed.output, exposed.budgeted
    keep, path = smallest_model(effects, knowledge, budget.limit, output)
    theta, mean = knowledge.draws, knowledge.draws.mean(axis=0)
    white, flicker, walk = exposed.noise
    N, B, K = (0.0, 0.0, 0.0) if noise is None else (noise.N, noise.B, noise.K)
    left_out = left_over(output, keep, theta)
    return Relevance(
        scene=scene.name,
        axis=exposed.axis,
        kind=lib.kind,
        duration=scene.duration,
        budget=budget,
        terms=_terms(output, effects, knowledge, budget.limit, keep),
        model=tuple(name for name, kept in zip(lib.names, keep, strict=True) if kept),
        met=path[0][2] <= budget.limit,
        left=_half_and_most(effects.size(theta - mean + left_over(output, keep, mean))),
        left_out=_half_and_most(effects.size(left_out)),
        left_out_rms=_rms(output.size(left_out)),
        calibrated=_half_and_most(effects.size(theta - mean)),
        uncompensated=_half_and_most(effects.size(theta)),
        path=path,
        noise=(white * N, flicker * B, walk * K),
        notes=(*scene.notes, *_forceless(exposed), *_reheated(scene, lib)),
    )


def _forceless(exposed: Exposure) -> tuple[str, ...]:
    """Say where an error of attitude meets a force that the scene does not know."""
    known = any(name.startswith("f_") for name in exposed.scene.inputs.channels)
    if known or exposed.lib.kind != "gyroscope" or exposed.budget.quantity not in ("velocity", "position"):
        return ()
    return ("it has no force: 1 g is taken to act upwards",)


def _reheated(scene: Scene, lib: Library) -> tuple[str, ...]:
    """Say where a record of temperature ends before the mission does."""
    heated = any(f.channel in ("T", "dT") for term in lib.terms for f in term.factors)
    motion, logged = scene.mean_motion, scene.course is None and "T" in scene.inputs.channels
    if not (heated and logged) or scene.duration <= 1.01 * len(motion) * motion.interval:
        return ()
    return ("motion repeats the record, and from its end on temperature stays as it is there",)


def smallest_model(
    effects: SceneEffects, knowledge: Knowledge, limit: float, output: SceneEffects
) -> tuple[BoolArray, tuple[tuple[int, str, float], ...]]:
    """Drop the term that costs least, one after the other, until the budget would be exceeded.

    The error of a model is bounded by what the calibration leaves of all terms, with 95 %, and what the means
    of the terms left out add up to, as vectors, less what those kept take up of them.

    Parameters
    ----------
    effects : of every term on what is budgeted.
    knowledge : of the coefficients.
    limit : of this error, SI. Where the calibration alone exceeds it, it is the limit of the terms left out.
    output : effects on the output, over which terms take up others.

    Returns
    -------
    (keep, path) : (p,) of the smallest model of the path that stays within the limit, and the whole path.

    Examples
    --------
    >>> e = SceneEffects(("a", "b", "c"), np.eye(3), components=1)
    >>> k = Knowledge(np.tile([5.0, 0.1, 2.0], (3, 1)), np.ones(3), np.ones(3))
    >>> smallest_model(e, k, 1.0, e)[0].tolist()
    [True, False, True]
    """
    mean = knowledge.draws.mean(axis=0)
    least = float(np.quantile(effects.size(knowledge.draws - mean), SURE))
    room = limit - least if least <= limit else limit
    keep = np.ones(len(mean), dtype=bool)
    chosen, path = keep.copy(), [(len(mean), "", least)]
    while keep.any():
        without = {j: keep & (np.arange(len(mean)) != j) for j in np.flatnonzero(keep).tolist()}
        costs = {j: float(effects.size(left_over(output, kept, mean))) for j, kept in without.items()}
        # of equal costs the term that is less likely there goes first, then the later one of the library
        dropped = min(costs, key=lambda j: (round(costs[j] / limit, EQUAL), knowledge.inclusion[j], -j))
        keep = without[dropped]
        path.append((int(keep.sum()), effects.names[dropped], least + costs[dropped]))
        if costs[dropped] <= room:
            chosen = keep
    return chosen, tuple(path)


def left_over(output: SceneEffects, keep: BoolArray, theta: FloatArray) -> FloatArray:
    """Coefficients (..., p) of a model's error: the terms left out, less what those kept take up of them.

    Parameters
    ----------
    output : effects on the output, over which the terms kept are fitted to the others by least squares.
    keep : (p,) terms of the model.
    theta : (..., p) coefficients.

    Examples
    --------
    >>> alike = SceneEffects(("a", "b"), np.array([[1.0, 2.0]]))
    >>> left_over(alike, np.array([True, False]), np.array([5.0, 3.0])).round(9).tolist()
    [-6.0, 3.0]
    """
    out = np.where(keep, 0.0, theta)
    if keep.any():
        kept = output.rows[:, keep]
        size = np.linalg.norm(kept, axis=0)
        size[size == 0.0] = 1.0
        # a scene in which kept terms do the same shares what they take up between them
        taken = np.linalg.lstsq(kept / size, (out @ output.rows.T).reshape(-1, len(kept)).T, rcond=ALIKE)[0]
        out[..., keep] = -(taken / size[:, None]).T.reshape(*theta.shape[:-1], len(size))
    return out


def _half_and_most(sizes: FloatArray) -> tuple[float, float]:
    half, most = np.quantile(sizes, (0.5, SURE)).tolist()
    return half, most


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


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
            share=(float(low[j]), float(half[j]), float(high[j])),
            possible=float(possible[j]),
            unknown=float(unknown[j]),
            kept=bool(keep[j]),
            quadrant=_quadrant(float(knowledge.inclusion[j]), float(half[j]), float(possible[j])),
        )
        for j, name in enumerate(effects.names)
    )


def _quadrant(inclusion: float, share: float, possible: float) -> str:
    if inclusion >= THERE:
        return QUADRANTS[0] if share >= MATTERS else QUADRANTS[1]
    return QUADRANTS[2] if possible >= MATTERS else QUADRANTS[3]
