"""The smallest model that stays within a budget, of one component or of a case.

Of the terms that are left out, those that are kept take up what they can: a smaller model is calibrated as
such. What that is says a least-squares fit over inputs: the scene's own, at best, or those of a test.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from imubayes.algebra.arrays import BoolArray, FloatArray
from imubayes.scenes.effects import SceneEffects
from imubayes.sensors.equations.mapping import absorbing
from imubayes.sensors.terms import Library

SURE = 0.95
"""Share of the posterior draws that must stay within the budget."""

EQUAL = 6
"""Digits after the point to which costs, as shares of the limit, are told apart."""


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


class Weighed(NamedTuple):
    """A component in a scene: effects on what is budgeted, and those over which terms take up others."""

    effects: SceneEffects
    over: SceneEffects
    knowledge: Knowledge


def smallest_model(
    components: Sequence[Weighed], limit: float, least: float
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
    >>> smallest_model([Weighed(e, e, k)], 1.0, 0.0)[0][0].tolist()
    [True, False, True]
    """
    room = limit - least if least <= limit else limit
    keep = [np.ones(len(one.effects.names), dtype=bool) for one in components]
    left = [np.zeros(len(one.effects.rows)) for one in components]
    without = [_without(*each) for each in zip(components, keep, strict=True)]
    chosen, path = tuple(keep), [(sum(map(len, keep)), "", least)]
    while any(kept.any() for kept in keep):
        whole = np.sum(left, axis=0)
        costs = {
            (c, j): float(one.effects.sized(whole - left[c] + error))
            for c, one in enumerate(components)
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


def _without(component: Weighed, keep: BoolArray) -> dict[int, FloatArray]:
    """Error (q,) that a component's means leave without each of the terms that are kept."""
    effects, over, knowledge = component
    mean, number = knowledge.draws.mean(axis=0), np.arange(len(keep))
    kept = np.flatnonzero(keep).tolist()
    return {j: left_over(over, keep & (number != j), mean) @ effects.rows.T for j in kept}


def _cheapest(
    costs: Mapping[tuple[int, int], float], components: Sequence[Weighed], limit: float
) -> tuple[int, int]:
    """Of equal costs the term that is less likely there goes first, then the later one of the library."""

    def order(at: tuple[int, int]) -> tuple[float, float, int, int]:
        c, j = at
        return round(costs[at] / limit, EQUAL), float(components[c].knowledge.inclusion[j]), -c, -j

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
