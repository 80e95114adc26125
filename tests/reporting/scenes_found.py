"""A relevance made by hand."""

import numpy as np

from imubayes.scenes import History, history
from imubayes.scenes.propagation import Budget
from imubayes.scenes.relevance import QUADRANTS, CaseRelevance, Relevance, TermRelevance
from imubayes.scenes.trajectories import generated, scene_named

TERMS = (
    # name, inclusion, share (5 %, 50 %, 95 %), at the limit, kept
    ("b0", 1.0, (1.1, 1.3, 1.5), 1.6, True, 0),
    ("b1", 1.0, (1e-3, 2e-3, 3e-3), 4e-3, False, 1),
    ("b2", 0.97, (0.2, 0.3, 0.4), 0.5, True, 0),
    ("b3", 0.03, (0.0, 0.0, 0.0), 1e-5, False, 3),
    ("c_jk", 0.35, (0.0, 0.0, 0.4), 2.6, False, 2),
)


def _term(name, inclusion, shares, possible, kept, quadrant):
    return TermRelevance(
        name, inclusion, 1e-4, 100.0 * shares[1], *shares, share_at_limit95=possible,
        share_unknown=0.9 if name == "c_jk" else 0.01, kept=kept, quadrant=QUADRANTS[quadrant],
    )  # fmt: skip


def a_relevance() -> Relevance:
    """Three terms that are there, one that is not, and one that nobody can tell."""
    return Relevance(
        scene="quadrotor", axis="z", kind="accelerometer", duration=600.0, budget=Budget("position", 100.0),
        terms=tuple(_term(*row) for row in TERMS), model=("b0", "b2"), within_budget=True, left=(20.0, 41.0),
        left_out=(3.2, 9.0), left_out_rms=2e-4, calibrated=(18.0, 38.0), uncompensated=(160.0, 180.0),
        path=((5, "", 38.0), (4, "b3", 38.0), (3, "b1", 39.0), (2, "c_jk", 41.0), (1, "b2", 70.0),
              (0, "b0", 180.0)),
        noise=(3.0, 4.0, 0.0), tested_model=("b0", "b2", "c_jk"), tested_left_out=(4.1, 9.9),
        notes=("a record of 60 s, repeated 10 times",),
    )  # fmt: skip


def a_case(name: str, scene: str = "quadrotor") -> CaseRelevance:
    """A triad that needs two terms of x, and one of z."""
    models = {f"{name}.ax": ("b0", "b2"), f"{name}.ay": (), f"{name}.az": ("b0",)}
    return CaseRelevance(
        scene=scene, duration=600.0, budget=Budget("position", 100.0), models=models, candidates=15,
        within_budget=True, left=(40.0, 83.0), left_out=(6.0, 17.0), calibrated=(30.0, 66.0),
        uncompensated=(210.0, 270.0), noise=(5.0, 7.0, 0.0),
    )  # fmt: skip


def a_history() -> History:
    """What a case meets in half a minute."""
    return history(generated(scene_named("quadrotor"), np.random.default_rng(1), duration=30.0))
