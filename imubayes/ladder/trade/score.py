"""What the rungs got right on simulated repeats, whose truth is known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from imubayes.algebra.arrays import BoolArray, FloatArray
from imubayes.campaign.fidelity import RungName
from imubayes.inference.intervals import Share, frequency
from imubayes.ladder.trade.again import Repeat
from imubayes.ladder.trade.differ import knowledge_of, knowledge_of_truth, resolved, scene_needs
from imubayes.ladder.trade.told import Told
from imubayes.scenes.relevance import Exposure
from imubayes.selection.verdicts import TENTH, Costs

INTERVAL = 0.9
"""Share of the truths that an interval is meant to hold."""

WIDTH = 1.6448536269514722
"""Half of such an interval of a normal distribution, in sd."""

SMALL = 1.0
"""Posterior sd below which a coefficient is too small for the test, so that 'needed' is a false alarm."""

LARGE = 8.0
"""Posterior sd above which no method should leave a term out."""


@dataclass(frozen=True, slots=True)
class Rate:
    """How often something happened, out of how many, with the 90 % interval of its share."""

    events: int
    of: int
    share: Share


@dataclass(frozen=True, slots=True)
class Score:
    """One rung over simulated repeats.

    Attributes
    ----------
    rung : by name.
    repeats : that it answered.
    coverage : of its 90 % intervals under the full library, over the terms that the test tells.
    error : rms of its full-library coefficients against the truth there, in posterior sd of the best rung
        that answered the same repeat: about 1 for a right method.
    false_needed : "needed", of terms that are zero, or below `SMALL`.
    false_not_needed : "not needed", of terms above a tenth of the prior sd.
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


@dataclass(frozen=True, slots=True, eq=False)
class _Asked:
    """Every term of the repeats of one rung.

    Attributes
    ----------
    away : difference from the truth over the best rung's sd, where the test tells; NaN elsewhere.
    held : whether the interval holds the truth.
    size : of the truth, in sd of the best.
    above : whether the truth is above a tenth of the prior sd.
    kept : whether the model has it.
    needed, not_needed : verdicts.
    """

    away: FloatArray
    held: BoolArray
    size: FloatArray
    above: BoolArray
    kept: BoolArray
    needed: BoolArray
    not_needed: BoolArray


def score(
    rung: RungName, repeats: Sequence[Repeat], costs: Costs, exposed: Mapping[str, Mapping[str, Exposure]]
) -> Score | None:
    """Score a rung over the repeats that it answered; None where there are none.

    Parameters
    ----------
    rung : by name.
    repeats : of all components.
    costs : of wrong choices.
    exposed : what each scene makes of the terms, by component.
    """
    pairs = [(one, told) for one in repeats for told in one.told if told.rung == rung]
    if not pairs:
        return None
    each = [_asked(one, told) for one, told in pairs]
    a = _Asked(*(np.concatenate([getattr(x, key) for x in each]) for key in _Asked.__slots__))
    told = np.isfinite(a.away)
    false_needed = _rate(a.needed, a.size < SMALL)
    false_not_needed = _rate(a.not_needed, a.above)
    cost = costs.false_keep * false_needed.events + costs.false_drop * false_not_needed.events
    return Score(
        rung=rung,
        repeats=len(pairs),
        coverage=_rate(a.held, told),
        error=float(np.sqrt(np.mean(a.away[told] ** 2))) if told.any() else float("nan"),
        false_needed=false_needed,
        false_not_needed=false_not_needed,
        missed_large=_rate(~a.kept, told & (a.size > LARGE)),
        cost=cost / len(pairs),
        scene_terms=_scene_terms(pairs, exposed),
    )


def _asked(one: Repeat, told: Told) -> _Asked:
    best = one.told[-1]
    off, size = told.full_mean - one.truth, np.abs(one.truth) / best.full_sd
    return _Asked(
        away=np.where(resolved(best), off / best.full_sd, np.nan),
        held=np.abs(off) <= WIDTH * told.full_sd,
        size=size,
        above=np.abs(one.truth) > TENTH * told.prior_sd,
        kept=np.array([name in told.model for name in told.names]),
        needed=np.array([verdict == "needed" for verdict in told.verdicts]),
        not_needed=np.array([verdict == "not needed" for verdict in told.verdicts]),
    )


def _rate(happened: BoolArray, where: BoolArray) -> Rate:
    events, of = int(np.sum(happened & where)), int(np.sum(where))
    return Rate(events, of, frequency(events, of))


def _scene_terms(
    pairs: Sequence[tuple[Repeat, Told]], exposed: Mapping[str, Mapping[str, Exposure]]
) -> float:
    other = [
        len(set(said.model) ^ set(true.model))
        for one, told in pairs
        for said, true in zip(
            scene_needs(exposed[one.subject], knowledge_of(told)),
            scene_needs(exposed[one.subject], knowledge_of_truth(one.truth)),
            strict=True,
        )
    ]
    return float(np.mean(other)) if other else float("nan")
