"""What the rungs got right on simulated repeats, whose truth is known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from imubayes.algebra.arrays import BoolArray
from imubayes.campaign.fidelity import RungName
from imubayes.inference.intervals import Share, frequency
from imubayes.ladder.trade.measurement import Measured
from imubayes.ladder.trade.repeats import Repeat
from imubayes.scenes.relevance import Exposure, Knowledge, Relevance, weigh
from imubayes.selection.verdicts import TENTH, Costs

INTERVAL = 0.9
"""Share of the truths that an interval is meant to hold."""

WIDTH = 1.6448536269514722
"""Half of such an interval of a normal distribution, in sd."""

SMALL = 1.0
"""Posterior sd below which a coefficient is too small for the test, so that 'needed' is a false alarm."""

LARGE = 8.0
"""Posterior sd above which no method should leave a term out."""

Exposed = Mapping[str, Mapping[str, Exposure]]
"""What each scene makes of a component's terms: by component, by scene."""


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


def score(rung: RungName, repeats: Sequence[Repeat], costs: Costs, exposed: Exposed) -> Score | None:
    """Score a rung over the repeats that it answered; None where there are none."""
    pairs = [(one, found) for one in repeats for found in one.answers if found.rung == rung]
    if not pairs:
        return None
    off, told, size, held, kept, above, needed, not_needed = map(
        np.concatenate, zip(*(_terms(one, found) for one, found in pairs), strict=True)
    )
    false_needed, false_not_needed = _rate(needed, size < SMALL), _rate(not_needed, above)
    cost = costs.false_keep * false_needed.events + costs.false_drop * false_not_needed.events
    other = [terms for one, found in pairs for terms in _other_terms(exposed[one.subject], one, found)]
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


def _terms(one: Repeat, found: Measured) -> tuple[np.ndarray, ...]:
    """Every term (p,) of a repeat, as a rung sees it.

    Returns
    -------
    difference from the truth over the best rung's sd; whether the test tells it; size of the truth in sd of
    the best; whether the interval holds the truth; whether the model has it; whether the truth is above a
    tenth of the prior sd; whether the verdict is "needed"; and "not needed".
    """
    best, off, verdicts = one.answers[-1], found.full_mean - one.truth, np.array(found.verdicts)
    return (
        off / best.full_sd,
        best.resolved,
        np.abs(one.truth) / best.full_sd,
        np.abs(off) <= WIDTH * found.full_sd,
        np.isin(found.names, found.model),
        np.abs(one.truth) > TENTH * found.prior_sd,
        verdicts == "needed",
        verdicts == "not needed",
    )


def _rate(happened: BoolArray, where: BoolArray) -> Rate:
    events, of = int(np.sum(happened & where)), int(np.sum(where))
    return Rate(events, of, frequency(events, of))


def _other_terms(exposed: Mapping[str, Exposure], one: Repeat, found: Measured) -> list[int]:
    """By how many terms the model that each scene requires is another than by the truth."""
    truth = Knowledge(one.truth[None, :], (one.truth != 0.0).astype(float), np.abs(one.truth))
    said, true = required(exposed, found), {name: weigh(seen, truth) for name, seen in exposed.items()}
    return [len(set(said[name].model) ^ set(true[name].model)) for name in exposed]


def required(exposed: Mapping[str, Exposure], found: Measured) -> dict[str, Relevance]:
    """What every scene requires of a component, by what a rung knows of it."""
    knowledge = Knowledge(found.draws, found.inclusion, found.limit95)
    return {name: weigh(seen, knowledge) for name, seen in exposed.items()}
