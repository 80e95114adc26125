"""Small, complete results of the studies about the tool, made by hand."""

from __future__ import annotations

import math

import numpy as np

from imubayes.ladder.costs import Machine
from studies.decision_quality.measure import Quality
from studies.decision_quality.page import quality_page
from studies.decision_quality.scores import scores, treated
from studies.decision_quality.trials import MODELLED, OWN, WHITE, QualityStudy, Trial
from studies.extremes.measure import QUANTITIES, Extremes, ExtremesStudy, Outcome, Told
from studies.extremes.page import extremes_page
from studies.ranks.measure import Ranks, RanksStudy
from studies.ranks.page import ranks_page
from studies.speed.contests import Ladder, SpeedStudy
from studies.speed.growth import fitted
from studies.speed.measure import Found, Place, Speed
from studies.speed.page import speed_page

METHODS = (*OWN, "aic", "ebic", "bic", "leave_one_run_out", "stlsq")


def _trial(number: int, treatment: str, wrong: float) -> Trial:
    """Every method errs on a share of the terms; the decision on half as many."""
    rng = np.random.default_rng([number, treatment == WHITE])
    true = rng.random(10) < 0.5
    odds = np.array([*[wrong / 2.0] * 3, *[wrong] * (len(METHODS) - 3)])[:, None]
    keeps = np.where(rng.random((len(METHODS), 10)) < odds, ~true, true).astype(float)
    effect = np.where(true, np.resize([0.5, 1.5, 3.0, 6.0, 20.0], 10), 0.0)
    own, pulls = np.arange(len(METHODS))[:, None] < 3, rng.standard_normal(keeps.shape)
    return Trial(
        ("accelerometer", "gyroscope")[number % 2], number, "x", treatment, tuple(f"t{k}" for k in range(10)),
        true * 1.0, effect, METHODS, keeps, np.clip(keeps, 0.1, 0.9), keeps, np.where(own, pulls, np.nan),
    )  # fmt: skip


def made_quality() -> Quality:
    """Twenty sensors under each of two treatments."""
    study = QualityStudy(seed=3, sensors=20, treatments=(MODELLED, WHITE), misspecified=20, processes=1)
    tried = tuple(_trial(k, t, w) for t, w in ((MODELLED, 0.2), (WHITE, 0.5)) for k in range(20))
    rng = np.random.default_rng(1)
    told = scores(tried, MODELLED, rng=rng)
    return Quality(study, tried, told, tuple(treated(tried, t, rng=rng) for t in (MODELLED, WHITE)), 120.0)


def made_speed() -> Speed:
    """A contest with a wrong answer and one who is not there, a large one, and a law."""
    contest = Found(
        "least squares", 1_000, "Least squares of <rows>", "error in sd", "solution",
        (
            Place("imubayes", True, "", (0.002, 0.003), 1e-9, ""),
            Place("right", False, "", (0.02, 0.05), 0.01, ""),
            Place("far off", False, "", (0.001, 0.001), 28.0, ""),
            Place("R, BAS", False, "", (), math.nan, "R is not installed"),
        ),
    )  # fmt: skip
    models = Found(
        "enumeration", 20, "Models", "difference", "posterior",
        (
            Place("imubayes, noise given", True, "", (0.01048576,), 0.0, ""),
            Place("imubayes, noise scale integrated", True, "", (0.1,), math.nan, ""),
        ),
    )  # fmt: skip
    trade = Found(
        "trade", 1_000, "a class, 994 rows", "difference", "the way",
        (
            Place("collapsed", True, "", (2.0,), 0.0, ""),
            Place("plug-in", True, "", (0.5,), 0.2, ""),
            Place("OLS", False, "on every row", (0.001,), 14.0, ""),
            Place("NUTS", False, "", (), math.nan, "nutpie is not installed"),
        ),
    )  # fmt: skip
    ladder = Ladder("rows", "work", 1.0, tuple((n, lambda: None) for n in (1_000, 10_000, 100_000)))
    law = fitted(ladder, np.array([[1e-3, 2e-3], [1e-2, 2e-2], [1e-1, 2e-1]]))
    machine = Machine("A processor", "System 1", 2, {"linear algebra": 1}, math.nan, {"numpy": "2.0"})
    study = SpeedStudy(repeats=2, contests={}, growth={})
    return Speed(study, (contest, models, trade), (law,), machine, 1.0)


def an_outcome(
    family: str, case: str, told: Told, *, rows: int = 40, refused: tuple[str, ...] = ()
) -> Outcome:
    """A problem, and the same digits of every quantity."""
    return Outcome(family, case, 2.0, True, dict.fromkeys(QUANTITIES, told), refused, rows)


RIGHT, REFUSED = Told(9.0, 8.0), Told(math.nan, math.nan)


def made_extremes(*outcomes: Outcome) -> Extremes:
    """One problem that is right, one that is refused, and one whose answer is no number, unless given."""
    usual = (
        an_outcome("noise", "1", RIGHT),
        an_outcome("rows", "2", REFUSED, rows=50, refused=("why",)),
        an_outcome("rows", "3", Told(-math.inf, 5.0), rows=60),
    )
    return Extremes(ExtremesStudy(families=("noise", "rows"), every=4), outcomes or usual, 1.0)


def made_ranks(**ranks: np.ndarray) -> Ranks:
    """Even ranks of two quantities, unless given."""
    even = {name: np.arange(40) * 2 for name in ("b0", "N.tumble")}
    return Ranks(RanksStudy(campaigns=40, bins=4), even | ranks, 1.0)


OF_THE_TOOL = {
    "quality": lambda: quality_page(made_quality()),
    "extremes": lambda: extremes_page(made_extremes()),
    "ranks": lambda: ranks_page(made_ranks()),
    "speed": lambda: speed_page(made_speed()),
}
"""A small page of each study about the tool."""
