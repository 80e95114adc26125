"""How far the rungs are apart on one component, and in what a scene requires of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from imubayes.algebra.arrays import BoolArray, FloatArray
from imubayes.ladder.trade.told import Told
from imubayes.scenes.relevance import Exposure, Knowledge, weigh

ENOUGH = 400.0
"""Effective sample size from which chains can be what others are held against: they are off by 0.05 sd."""

RESOLVED = ("needed", "not needed", "undecided")
"""Verdicts on terms that the test tells."""


@dataclass(frozen=True, slots=True)
class SceneNeed:
    """What a rung says that a scene requires.

    Attributes
    ----------
    scene : name.
    model : terms of the smallest model for the scene.
    shares : median share of the budget of each term of the library.
    """

    scene: str
    model: tuple[str, ...]
    shares: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class SceneChange:
    """What a scene requires by one rung and not by the best, and the largest change of a budget's share."""

    scene: str
    terms: tuple[str, ...]
    share: float


@dataclass(frozen=True, slots=True)
class Difference:
    """A rung against the best on the same component.

    Attributes
    ----------
    largest, rms : difference of the coefficients over the tested terms, in posterior sd of the best; of the
        averaged and the full-library ones, the larger.
    worst : the term whose difference is the largest.
    inclusion : largest difference of an inclusion.
    verdicts : terms with another verdict: (name, the rung's, the best's).
    scenes : what the scenes require.
    """

    largest: float
    rms: float
    worst: str
    inclusion: float
    verdicts: tuple[tuple[str, str, str], ...]
    scenes: tuple[SceneChange, ...]


def best_of(told: Sequence[Told]) -> Told:
    """The highest rung whose chains, where it has any, are long enough to hold others against it."""
    return [one for one in told if one.ess >= ENOUGH][-1]


def tested(told: Told) -> BoolArray:
    """Which terms (p,) the runs excite."""
    return np.array([verdict != "untested" for verdict in told.verdicts])


def resolved(told: Told) -> BoolArray:
    """Which terms (p,) the test can tell."""
    return np.array([verdict in RESOLVED for verdict in told.verdicts])


def apart(one: Told, best: Told) -> FloatArray:
    """Differences (p,) of the coefficients in posterior sd of the best."""
    away = np.maximum(np.abs(one.mean - best.mean), np.abs(one.full_mean - best.full_mean))
    return np.asarray(away / best.full_sd, dtype=float)


def difference(
    one: Told, best: Told, needs: Sequence[SceneNeed] = (), best_needs: Sequence[SceneNeed] = ()
) -> Difference:
    """Hold what a rung says against what the best says.

    Parameters
    ----------
    one, best : on the same runs.
    needs, best_needs : what the scenes require by either (see `scene_needs`).
    """
    asked = tested(best)
    away = np.where(asked, apart(one, best), 0.0)
    other = zip(one.names, one.verdicts, best.verdicts, strict=True)
    return Difference(
        largest=float(away.max(initial=0.0)),
        rms=float(np.sqrt(np.mean(away[asked] ** 2))) if asked.any() else 0.0,
        worst=one.names[int(np.argmax(away))],
        inclusion=float(np.max(np.abs(one.inclusion - best.inclusion)[asked], initial=0.0)),
        verdicts=tuple((name, said, right) for name, said, right in other if said != right),
        scenes=tuple(scene_change(a, b, one.names) for a, b in zip(needs, best_needs, strict=True)),
    )


def scene_needs(exposed: Mapping[str, Exposure], knowledge: Knowledge) -> tuple[SceneNeed, ...]:
    """What every scene requires of a component, of which so much is known."""
    found = [(name, weigh(seen, knowledge)) for name, seen in exposed.items()]
    return tuple(
        SceneNeed(name, one.model, tuple(term.share[1] for term in one.terms)) for name, one in found
    )


def knowledge_of(told: Told) -> Knowledge:
    """What a rung knows of the coefficients."""
    return Knowledge(told.draws, told.inclusion, told.limit95)


def knowledge_of_truth(truth: FloatArray) -> Knowledge:
    """What somebody knows who knows the coefficients (p,)."""
    return Knowledge(truth[None, :], (truth != 0.0).astype(float), np.abs(truth))


def scene_change(one: SceneNeed, other: SceneNeed, names: Sequence[str]) -> SceneChange:
    """Terms of one model and not of the other, and the largest change of a share."""
    terms = tuple(name for name in names if (name in one.model) != (name in other.model))
    share = float(np.max(np.abs(np.subtract(one.shares, other.shares)), initial=0.0))
    return SceneChange(one.scene, terms, share)
