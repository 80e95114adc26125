"""What the committed reports about the tool must show."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from studies.decision_quality.scores import RATIOS
from studies.decision_quality.trials import MODELLED, OWN
from studies.ranks.measure import Ranks, RanksStudy
from studies.ranks.page import DOUBTFUL
from studies.speed.contests import SpeedStudy
from studies.speed.words import WRONG

REPORTS = Path(__file__).parents[2] / "reports"
QUALITY, RANKS, SPEED = (
    json.loads((REPORTS / name / "result.json").read_text(encoding="utf-8"))
    for name in ("decision_quality", "ranks", "speed")
)
SCORES = QUALITY["scores"][0]


def test_decision_keeps_no_zero_drops_no_strong_term_and_is_dearer_than_no_other_method():
    assert SCORES["treatment"] == MODELLED
    assert SCORES["verdicts"]["false_keeps"]["value"] <= 0.02
    assert SCORES["verdicts"]["false_drops"]["value"] <= 0.02
    assert SCORES["methods"][0]["false_drops"][-1]["value"] <= 0.02
    rivals = [score for score in SCORES["methods"] if score["method"] not in OWN]
    assert min(score["excess"]["value"] for score in rivals) > 0.0
    # at any ratio of costs an interval that lies below zero would be a method that is cheaper
    assert all(each["high"] > 0.0 for score in rivals for each in score["weighed_excess"])
    assert {len(score["weighed_excess"]) for score in rivals} == {len(RATIOS)}


def test_inclusion_is_the_frequency_of_truth():
    # binomial spread, doubled because terms of one sensor share its noise and its model size
    pulls = [
        (b["true"]["events"] - b["true"]["of"] * b["inclusion"])
        / np.sqrt(2.0 * b["true"]["of"] * b["inclusion"] * (1.0 - b["inclusion"]) + 1.0)
        for b in SCORES["calibration"]
    ]
    assert np.max(np.abs(pulls)) < 3.5


def test_ranks_of_the_committed_campaigns_are_uniform():
    told, study = RANKS, RanksStudy()
    for one in told["quantities"]:
        ranks = np.repeat(np.arange(study.bins) * (study.draws + 1) // study.bins, one["counts"])
        assert len(ranks) == study.campaigns == told["campaigns"]
        p = Ranks(study, {"any": ranks}, 0.0).p_value("any")
        assert p == pytest.approx(one["p_value"], rel=1e-9)
        assert p > DOUBTFUL


def test_ranks_of_an_overconfident_posterior_are_refused():
    rng, study = np.random.default_rng(1), RanksStudy()
    truth, draws = (
        rng.standard_normal(study.campaigns),
        0.7 * rng.standard_normal((study.campaigns, study.draws)),
    )
    center = truth + rng.standard_normal(study.campaigns)
    ranks = np.sum(draws < (truth - center)[:, None], axis=1)
    assert Ranks(study, {"b0": ranks}, 0.0).p_value("b0") < 0.01


CONTESTS = SPEED["contests"]

SECONDS = {("enumeration", 26): 3.0}
"""Time that a problem takes at most, however ours solves it."""

AHEAD = {("subsets", "statsmodels OLS"): 100.0, ("g-prior", "numpy, one by one"): 20.0}
AHEAD |= {("g-prior", "R, BAS"): 10.0, ("g-prior", "R, BMS"): 10.0, ("posterior", "nutpie, NUTS"): 5.0}
"""Times ours that a peer takes at least, where that is the point."""


def test_report_has_every_contest_of_the_study():
    asked = [(subject, size) for subject, sizes in SpeedStudy().contests.items() for size in sizes]
    assert [(one["subject"], one["size"]) for one in CONTESTS] == asked


@pytest.mark.parametrize("contest", CONTESTS, ids=lambda one: one["title"])
def test_our_answer_is_right_in_time_and_ahead_of_those_who_took_part(contest):
    own = contest["places"][0]
    assert own["ours"] and (own["error"] or 0.0) < WRONG.get(contest["subject"], math.inf)
    limit = SECONDS.get((contest["subject"], contest["size"]), math.inf)
    assert all(min(place["seconds"]) <= limit for place in contest["places"] if place["ours"])
    for peer in contest["places"]:
        if peer["seconds"]:
            ratio = min(peer["seconds"]) / min(own["seconds"])
            assert ratio >= AHEAD.get((contest["subject"], peer["name"]), 0.0), peer["name"]
