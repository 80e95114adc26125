"""What a trade found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from imubayes.campaign.fidelity import RungName
from imubayes.ladder.trade.alone import Measured
from imubayes.ladder.trade.differ import Difference
from imubayes.ladder.trade.machine import Machine
from imubayes.ladder.trade.plan import Trade
from imubayes.ladder.trade.score import Score


@dataclass(frozen=True, slots=True, eq=False)
class Standing:
    """The rungs on one component of the study.

    Attributes
    ----------
    subject : name of the component.
    measured : every rung that was measured, from the cheapest.
    differences : of each of them, against the best.
    best : the rung that the others are held against.
    floor : largest and rms Monte Carlo error of a difference of two answers like its own, over the tested
        terms, in posterior sd: smaller differences mean nothing.
    skipped : rungs that were not measured, each with the reason.
    """

    subject: str
    measured: tuple[Measured, ...]
    differences: tuple[Difference, ...]
    best: RungName
    floor: tuple[float, float]
    skipped: tuple[tuple[RungName, str], ...] = ()


@dataclass(frozen=True, slots=True)
class Place:
    """A rung over all components that it was measured on.

    Attributes
    ----------
    rung : by name.
    seconds : wall time, the median over components.
    whole_seconds : the same if chains went on until they have reached what was asked of them.
    processor_seconds : over all threads.
    memory : bytes, the largest.
    largest, rms : difference of the coefficients from the best rung's, in posterior sd: largest over terms
        and components, and rms; 0 of the best rung itself.
    inclusion : largest difference of an inclusion.
    verdicts : how many differ, over all components.
    scene_share : largest change of a share of a scene's budget; 0 without scenes.
    scene_terms : by how many terms the models that the scenes require differ, over all.
    monte_carlo : rms Monte Carlo error of its own coefficients.
    foreseen : what it foresees that the next one would change, in posterior sd, the largest.
    components : that it was measured on.
    """

    rung: RungName
    seconds: float
    whole_seconds: float
    processor_seconds: float
    memory: float
    largest: float
    rms: float
    inclusion: float
    verdicts: int
    scene_share: float
    scene_terms: int
    monte_carlo: float
    foreseen: float
    components: int


@dataclass(frozen=True, slots=True, eq=False)
class Traded:
    """Result of a trade.

    Attributes
    ----------
    trade : that was asked for.
    standings : component by component.
    places : rung by rung, from the cheapest.
    best : the highest rung that others were held against.
    floor : that of the components, the largest of each.
    front : rungs that no other beats in time and error together, from the cheapest.
    recommended : the cheapest rung that is good enough, and why (see `imubayes.ladder.trade.recommend`).
    scores : of the rungs that answered simulated repeats.
    dear : rungs that no repeat could afford.
    machine : that the times belong to, as it was before the first.
    seconds : that all of it took.
    """

    trade: Trade
    standings: tuple[Standing, ...]
    places: tuple[Place, ...]
    best: RungName
    floor: tuple[float, float]
    front: tuple[RungName, ...]
    recommended: RungName
    scores: tuple[Score, ...]
    dear: tuple[RungName, ...]
    machine: Machine
    seconds: float

    def place(self, rung: RungName) -> Place | None:
        """The rung's place; None where it was not measured."""
        return next((one for one in self.places if one.rung == rung), None)

    def score(self, rung: RungName) -> Score | None:
        """The rung's score; None where it answered no repeat."""
        return next((one for one in self.scores if one.rung == rung), None)


def places(standings: Sequence[Standing], rungs: Sequence[RungName]) -> tuple[Place, ...]:
    """Put the components together, rung by rung."""
    return tuple(_place(rung, pairs) for rung in rungs if (pairs := _answers(standings, rung)))


def _answers(standings: Sequence[Standing], rung: RungName) -> list[tuple[Measured, Difference]]:
    """What a rung says of each component that it was measured on."""
    return [
        (one, apart)
        for standing in standings
        for one, apart in zip(standing.measured, standing.differences, strict=True)
        if one.told.rung == rung
    ]


def _place(rung: RungName, found: Sequence[tuple[Measured, Difference]]) -> Place:
    measured, apart = [one for one, _ in found], [one for _, one in found]
    own = [float(np.sqrt(np.mean(one.told.monte_carlo**2))) for one in measured]
    scenes = [scene for one in apart for scene in one.scenes]
    return Place(
        rung=rung,
        seconds=float(np.median([one.seconds for one in measured])),
        whole_seconds=float(np.median([one.whole_seconds for one in measured])),
        processor_seconds=float(np.median([one.processor_seconds for one in measured])),
        memory=float(np.max([one.memory for one in measured])),
        largest=max(one.largest for one in apart),
        rms=float(np.sqrt(np.mean([one.rms**2 for one in apart]))),
        inclusion=max(one.inclusion for one in apart),
        verdicts=sum(len(one.verdicts) for one in apart),
        scene_share=max((scene.share for scene in scenes), default=0.0),
        scene_terms=sum(len(scene.terms) for scene in scenes),
        monte_carlo=float(np.sqrt(np.mean(np.square(own)))),
        foreseen=max(one.foreseen[0] for one in measured),
        components=len(found),
    )
