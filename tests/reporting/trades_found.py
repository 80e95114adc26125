"""A small, complete trade between the rungs of the ladder, made by hand."""

from __future__ import annotations

import numpy as np
from trades import measured, told, trade

from imubayes.campaign.fidelity import RungName
from imubayes.inference.intervals import frequency
from imubayes.ladder.trade.machine import Machine
from imubayes.ladder.trade.measure import standing_of
from imubayes.ladder.trade.recommend import front, recommended
from imubayes.ladder.trade.record import Traded, places
from imubayes.ladder.trade.score import Rate, Score

RUNGS = ("means", "plug-in", "collapsed", "raw")
NOTHING = Rate(0, 40, frequency(0, 40))


def _score(rung: RungName, held: int) -> Score:
    return Score(rung, 20, Rate(held, 200, frequency(held, 200)), 1.0, NOTHING, NOTHING, NOTHING, 0.0, 1.5)


def traded(held: int = 180, name: str = "<ACC>") -> Traded:
    """Four rungs on one component: the second is right within half an sd, the last is dear."""
    each = [
        measured(told("means", mean=np.array([1.1, 0.0, 0.0]), inclusion=np.array([1.0, 0.5, 0.4])), 0.02),
        measured(told("plug-in", mean=np.array([1.005, 0.0, 0.0])), 0.3),
        measured(told("collapsed", monte_carlo=np.full(3, 0.02), ess=2000.0), 5.0),
        measured(told("raw", monte_carlo=np.full(3, 0.03), ess=400.0, wanting=2.5, chain_seconds=40.0), 50.0),
    ]
    one = trade(title=name, rungs=RUNGS, missions=())
    standing = standing_of(name, each, {}, [("averaged", "it takes about 90 s, and 20 s were left")])
    found = places([standing], RUNGS)
    scores = (_score("means", 100), _score("plug-in", held), _score("collapsed", held))
    return Traded(
        trade=one,
        standings=(standing,),
        places=found,
        best=standing.best,
        floor=standing.floor,
        front=front(found, standing.floor[0]),
        recommended=recommended(found, scores, standing.best, standing.floor[0]),
        scores=scores,
        dear=("raw",),
        machine=Machine("A processor", "System 1", 2, {"linear algebra": 1}, 0.1, {"numpy": "2.0"}),
        seconds=70.0,
    )
