"""The committed report on sensors of all classes: is the decision the cheapest, are its verdicts right?"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from studies.decision_quality.scores import RATIOS
from studies.decision_quality.trials import MODELLED, OWN

REPORT = Path(__file__).parents[2] / "reports" / "decision_quality" / "result.json"
SCORES = json.loads(REPORT.read_text(encoding="utf-8"))["scores"][0]
METHODS = {score["method"]: score for score in SCORES["methods"]}
RIVALS = [score for name, score in METHODS.items() if name not in OWN]


def test_first_scores_are_as_modelled():
    assert SCORES["treatment"] == MODELLED


def test_no_zero_term_is_called_needed_and_no_strong_one_is_dropped():
    assert SCORES["verdicts"]["false_keeps"]["value"] <= 0.02
    assert SCORES["verdicts"]["false_drops"]["value"] <= 0.02
    assert SCORES["methods"][0]["false_drops"][-1]["value"] <= 0.02


def test_decision_costs_less_than_every_other_method():
    assert min(score["excess"]["value"] for score in RIVALS) > 0.0


@pytest.mark.parametrize("k", range(len(RATIOS)))
def test_decision_is_not_dearer_than_any_other_method_at_any_ratio_of_costs(k):
    # an interval that lies below zero would be a method that is cheaper
    assert all(score["weighed_excess"][k]["high"] > 0.0 for score in RIVALS)


def test_inclusion_is_the_frequency_of_truth():
    # binomial spread, doubled because terms of one sensor share its noise and its model size
    pulls = [
        (b["true"]["events"] - b["true"]["of"] * b["inclusion"])
        / np.sqrt(2.0 * b["true"]["of"] * b["inclusion"] * (1.0 - b["inclusion"]) + 1.0)
        for b in SCORES["calibration"]
    ]
    assert np.max(np.abs(pulls)) < 3.5
