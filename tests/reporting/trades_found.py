"""A small, complete trade between the rungs of the ladder, made by hand."""

import numpy as np
from trades import told, trade

from imubayes.inference import Rate, frequency
from imubayes.ladder import RungName
from imubayes.ladder.costs import Machine
from imubayes.ladder.trade import Traded, standing_of
from imubayes.ladder.trade.components import Score

RUNGS = ("means", "plug-in", "collapsed", "raw")
NOTHING = Rate(0, 40, frequency(0, 40))


def _score(rung: RungName, held: int) -> Score:
    return Score(rung, 20, Rate(held, 200, frequency(held, 200)), 1.0, NOTHING, NOTHING, NOTHING, 0.0, 1.5)


def traded(held: int = 180, name: str = "<ACC>", first: float = 1.1) -> Traded:
    """Four rungs on one component: the second is right within half an sd, the last is dear."""
    wrong = {"mean": np.array([first, 0.0, 0.0]), "inclusion": np.array([1.0, 0.5, 0.4])}
    each = [
        told("means", 0.02, **wrong),
        told("plug-in", 0.3, mean=np.array([1.005, 0.0, 0.0])),
        told("collapsed", 5.0, monte_carlo=np.full(3, 0.02), ess=2000.0),
        told("raw", 50.0, monte_carlo=np.full(3, 0.03), ess=400.0, wanting=2.5, chain_seconds=40.0),
    ]
    one = trade(title=name, rungs=RUNGS, missions=())
    standing = standing_of(name, each, {}, [("averaged", "it takes about 90 s, and 20 s were left")])
    scores = (_score("means", 100), _score("plug-in", held), _score("collapsed", held))
    machine = Machine("A processor", "System 1", 2, {"linear algebra": 1}, 0.1, {"numpy": "2.0"})
    return Traded(one, (standing,), scores, machine, 70.0)
