"""Linear effect of coefficients in a scene: on the output, or on what the output is integrated to.

The smallest model that stays within a budget follows from it, of one component or of a case. Of the terms
that are left out, those that are kept take up what they can: a smaller model is calibrated as such. What that
is says a least-squares fit over inputs: the scene's own, at best, or those of a test.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from imubayes.algebra import BoolArray, FloatArray
from imubayes.algebra.factor import row_blocks, triangular
from imubayes.rig.inputs import Inputs
from imubayes.scenes import Scene, in_case
from imubayes.scenes.propagation import Budget, Propagation, propagation
from imubayes.sensors.equations.mapping import absorbing
from imubayes.sensors.terms import InputPower, Kind, Library, Term, column, columns, tied

TIMES = 120
"""Times over the mission at which an error is looked at."""


@dataclass(frozen=True, slots=True, eq=False)
class SceneEffects:
    """Linear effect of a library's coefficients on one quantity.

    `rows` (q, p) are the effects of a unit of each of p coefficients, SI. So many `components` after another
    are those of a vector, at one time after the other: an effect's size is that of the largest of these
    vectors; with 0 it is the root sum of squares of all rows.
    """

    names: tuple[str, ...]
    rows: FloatArray
    components: int = 0

    def size(self, theta: FloatArray) -> FloatArray:
        """Size (...) of the effect of coefficients (..., p), those that are left out being zero."""
        return self.sized(theta @ self.rows.T)

    def single(self, theta: FloatArray) -> FloatArray:
        """Size (..., p) of each coefficient's own effect."""
        return np.abs(theta) * self.sized(self.rows.T)

    def sized(self, effect: FloatArray) -> FloatArray:
        """Size (...) of effects (..., q)."""
        if not self.components:
            return np.linalg.norm(effect, axis=-1)
        vectors = effect.reshape(*effect.shape[:-1], -1, self.components)
        return np.linalg.norm(vectors, axis=-1).max(axis=-1)


def output_effects(scene: Scene, lib: Library, axis: str = "x") -> SceneEffects:
    """Rms effect on the output over a scene: ``|R_S theta_S| / sqrt(n)`` for any set S of terms.

    n are the rows of all draws of the scene, vibration included; `axis` is the case axis of the input.

    Examples
    --------
    >>> from imubayes.sensors.terms import library
    >>> desk = Scene("desk", Inputs(np.arange(5.0), {"f_k": np.full(5, 2.0)}, 1.0), 5.0)
    >>> e = output_effects(desk, library("accelerometer", powers=2, asymmetry=-1), "z")
    >>> e.single(np.ones(len(e.names)))[:3].round(9).tolist()
    [1.0, 2.0, 4.0]
    """
    drawn = [in_case(one.inputs, axis) for one in scene.draws]
    blocks = (
        columns(lib, inputs.kept(slice(i, j)).channels, j - i)
        for inputs in drawn
        for i, j in row_blocks(len(inputs))
    )
    return SceneEffects(lib.names, triangular(blocks, len(lib.terms)) / np.sqrt(sum(map(len, drawn))))


def budget_effects(scene: Scene, lib: Library, budget: Budget, axis: str = "x") -> SceneEffects:
    """Effect on what is budgeted, over a scene, of a component whose input lies along a case axis.

    For attitude, velocity and position it is the largest error over the mission and over the scene's draws:
    of the columns averaged over vibration, whose oscillations integrate to nothing. Where the mission repeats
    its record, temperature runs on.
    """
    if budget.quantity == "output":
        return output_effects(scene, lib, axis)
    passed = propagations(lib.kind, scene, budget.schuler)
    rows = [_errors(one, lib, axis, along) for one, along in zip(scene.draws, passed, strict=True)]
    read = passed[0].read(budget.quantity)
    J = read @ np.concatenate(rows)
    return SceneEffects(lib.names, tied(lib, J.reshape(-1, len(lib.terms))), len(read))


@lru_cache(maxsize=2)  # the axes of a case follow one another
def propagations(kind: Kind, scene: Scene, schuler: bool) -> tuple[Propagation, ...]:
    """How errors of a component pass through a mission in each of a scene's draws, at `TIMES` times of it."""
    times = (scene.duration * np.arange(1, TIMES + 1) / TIMES).tolist()
    return tuple(propagation(kind, one, times, schuler=schuler) for one in scene.draws)


def _errors(scene: Scene, lib: Library, axis: str, passed: Propagation) -> FloatArray:
    """Errors (TIMES, 9, p) per unit of each coefficient over one draw of a scene."""
    inputs = in_case(scene.mean_motion, axis)
    heated = np.array([any(_is_heat(factor) for factor in term.factors) for term in lib.terms])
    still = _some(lib, ~heated)
    J = np.empty((TIMES, 9, len(lib.terms)))
    J[..., ~heated] = passed.errors(axis, lambda _, rows: _mean_motion(scene, still, inputs, rows))
    if heated.any():
        columns_of = mission_columns(scene, _some(lib, heated), inputs)
        J[..., heated] = passed.errors(axis, columns_of, repeated=False)
    return J


def _is_heat(factor: InputPower) -> bool:
    return factor.channel in ("T", "dT")


def _some(lib: Library, chosen: BoolArray) -> Library:
    return Library(lib.kind, tuple(term for term, one in zip(lib.terms, chosen, strict=True) if one))


def _mean_motion(scene: Scene, lib: Library, inputs: Inputs, rows: slice) -> FloatArray:
    """Columns (m, p) of terms without temperature in some rows, averaged over the scene's vibration."""
    return mean_columns(lib, inputs.kept(rows), scene.vibration if scene.slow else 0.0)


def mission_columns(scene: Scene, lib: Library, inputs: Inputs) -> Callable[[int, slice], FloatArray]:
    """Columns (m, p) of terms with temperature in rows of each repetition of the record: products of two.

    The motion is the record's, the temperature that of the mission.
    """
    moving, warm = (_factored(lib, heat=heat) for heat in (False, True))
    start, course = inputs.t - inputs.t[0], scene.temperature
    length = float(start[-1]) + inputs.interval

    def columns_of(record: int, rows: slice) -> FloatArray:
        heat = course.at(start[rows] + record * length)
        return _mean_motion(scene, moving, inputs, rows) * columns(warm, heat, len(start[rows]))

    return columns_of


def _factored(lib: Library, *, heat: bool) -> Library:
    """Terms with only those factors that are a temperature, or with only the others."""
    parts = (tuple(f for f in term.factors if _is_heat(f) is heat) for term in lib.terms)
    return Library(lib.kind, tuple(replace(t, factors=p) for t, p in zip(lib.terms, parts, strict=True)))


def mean_columns(lib: Library, inputs: Inputs, vibration: float) -> FloatArray:
    """Regressors (n, p) averaged over Gaussian vibration of the force, independent from axis to axis.

    This is what remains of a term at frequencies far below the vibration's: K2's rectification, and the
    smoothing of a sign (erf). `vibration` is its rms along each axis, m/s^2; 0 gives the plain columns.

    Examples
    --------
    >>> from imubayes.sensors.terms import library
    >>> still = Inputs(np.zeros(1), {"f_i": np.zeros(1)}, 1.0)
    >>> mean_columns(library("accelerometer", asymmetry=-1), still, 2.0)[0, :4].tolist()
    [1.0, 0.0, 4.0, 0.0]
    """
    X = np.empty((len(inputs), len(lib.terms)), order="F")
    for j, term in enumerate(lib.terms):
        X[:, j] = _mean_column(term, inputs, vibration) if vibration > 0.0 else column(term, inputs.channels)
    return X


def _mean_column(term: Term, inputs: Inputs, vibration: float) -> FloatArray:
    """Product of the factors' means: no channel comes twice in a term, and channels are independent."""
    value = np.ones(len(inputs))
    for factor in term.factors:
        if factor.channel.startswith("f_"):
            level = inputs.channels.get(factor.channel, np.zeros(len(inputs)))
            value = value * _moment(level, vibration, factor)
        else:
            value = value * column(replace(term, factors=(factor,)), inputs.channels)
    return value


def _moment(level: FloatArray, rms: float, factor: InputPower) -> FloatArray:
    """Mean of x^n, or of sgn(x) x^n, for x normal about a level.

    Stein's identity E[(x - m) g(x)] = s^2 E[g'(x)] gives ``M_n = m M_(n-1) + (n - 1) s^2 M_(n-2)`` for both;
    the jump of the sign adds to |x| alone.
    """
    from scipy.special import erf

    if factor.signed:
        before = erf(level / (math.sqrt(2.0) * rms))
        jump = math.sqrt(2.0 / math.pi) * rms * np.exp(-0.5 * (level / rms) ** 2)
    else:
        before, jump = np.ones_like(level), 0.0
    if factor.power == 0:
        return before
    here = level * before + jump
    for n in range(2, factor.power + 1):
        before, here = here, level * here + (n - 1) * rms**2 * before
    return here


SURE = 0.95
"""Share of the posterior draws that must stay within the budget."""

EQUAL = 6
"""Digits after the point to which costs, as shares of the limit, and inclusions are told apart."""


@dataclass(frozen=True, slots=True, eq=False)
class Knowledge:
    """What is known of a component's coefficients, in the order of its library.

    `draws` (m, p) are of the posterior, averaged over models: zero where a draw's model lacks the term. With
    them come the `inclusion` (p,) of each term, and what |theta| stays below with 95 % if the term is in the
    model.
    """

    draws: FloatArray
    inclusion: FloatArray
    limit95: FloatArray


class ComponentInScene(NamedTuple):
    """A component in a scene: effects on what is budgeted, and those over which terms take up others."""

    effects: SceneEffects
    over: SceneEffects
    knowledge: Knowledge


def smallest_model(
    components: Sequence[ComponentInScene], limit: float, least: float
) -> tuple[tuple[BoolArray, ...], tuple[tuple[int, str, float], ...]]:
    """Drop the term that costs least, one after the other, until the budget would be exceeded.

    The error of a model is bounded by what the calibration leaves of all terms, with 95 % (`least`), and what
    the means of the terms left out add up to, as vectors, less what those kept take up of them. The
    components of a case err together: their errors add up too. Where the calibration alone exceeds the
    `limit` of the error, SI, that is the limit of the terms left out.

    Returns
    -------
    (keep, path) : (p,) for each component of the smallest model of the path that stays within the limit, and
        the whole path.

    Examples
    --------
    >>> e = SceneEffects(("a", "b", "c"), np.eye(3), components=1)
    >>> k = Knowledge(np.tile([5.0, 0.1, 2.0], (3, 1)), np.ones(3), np.ones(3))
    >>> smallest_model([ComponentInScene(e, e, k)], 1.0, 0.0)[0][0].tolist()
    [True, False, True]
    """
    room = limit - least if least <= limit else limit
    keep = [np.ones(len(component.effects.names), dtype=bool) for component in components]
    left = [np.zeros(len(component.effects.rows)) for component in components]
    without = [_without(*each) for each in zip(components, keep, strict=True)]
    chosen, path = tuple(keep), [(sum(map(len, keep)), "", least)]
    while any(kept.any() for kept in keep):
        whole = np.sum(left, axis=0)
        costs = {
            (c, j): float(component.effects.sized(whole - left[c] + error))
            for c, component in enumerate(components)
            for j, error in without[c].items()
        }
        c, j = _cheapest(costs, components, limit)
        keep[c] = keep[c] & (np.arange(len(keep[c])) != j)
        left[c], without[c] = without[c][j], _without(components[c], keep[c])
        cost = costs[c, j]
        path.append((int(sum(kept.sum() for kept in keep)), components[c].effects.names[j], least + cost))
        if cost <= room:
            chosen = tuple(keep)
    return chosen, tuple(path)


def _without(component: ComponentInScene, keep: BoolArray) -> dict[int, FloatArray]:
    """Error (q,) that a component's means leave without each of the terms that are kept."""
    effects, over, knowledge = component
    mean, number = knowledge.draws.mean(axis=0), np.arange(len(keep))
    kept = np.flatnonzero(keep).tolist()
    return {j: left_over(over, keep & (number != j), mean) @ effects.rows.T for j in kept}


def _cheapest(
    costs: Mapping[tuple[int, int], float], components: Sequence[ComponentInScene], limit: float
) -> tuple[int, int]:
    """Of equal costs the term that is less likely there goes first, then the later one of the library."""

    def order(at: tuple[int, int]) -> tuple[float, float, int, int]:
        c, j = at
        inclusion = float(components[c].knowledge.inclusion[j])
        return round(costs[at] / limit, EQUAL), round(inclusion, EQUAL), -c, -j

    return min(costs, key=order)


def left_over(output: SceneEffects, keep: BoolArray, theta: FloatArray) -> FloatArray:
    """Coefficients (..., p) of a model's error: the terms left out, less what those kept take up of them.

    Over the effects on the `output` the terms kept are fitted to the others by least squares.

    Examples
    --------
    >>> alike = SceneEffects(("a", "b"), np.array([[1.0, 2.0]]))
    >>> left_over(alike, np.array([True, False]), np.array([5.0, 3.0])).round(9).tolist()
    [-6.0, 3.0]
    """
    out = np.where(keep, 0.0, theta)
    if keep.any():
        kept, dropped = np.flatnonzero(keep).tolist(), np.flatnonzero(~keep).tolist()
        out[..., keep] = -out[..., dropped] @ absorbing(output.rows, kept, dropped).T
    return out


def names_of(lib: Library, keep: BoolArray) -> tuple[str, ...]:
    """Names of the terms (p,) that are kept."""
    return tuple(name for name, kept in zip(lib.names, keep, strict=True) if kept)


def half_and_most(sizes: FloatArray) -> tuple[float, float]:
    """Size that half of the draws stay within, and that 95 % do."""
    half, most = np.quantile(sizes, (0.5, SURE)).tolist()
    return half, most
