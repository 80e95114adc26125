"""Over sensors of every class: is the decision the cheapest, and are its verdicts right?"""

from pathlib import Path

import numpy as np
import pytest

from imubayes.quality.measure import measure
from imubayes.quality.scores import RATIOS
from imubayes.quality.trials import DECISION, MODELLED, SURE, QualityStudy

SENSORS = 44
"""Of each kind: four of each class of gyroscopes."""


@pytest.fixture(scope="module")
def told():
    study = QualityStudy(
        title="slow",
        seed=11,
        sensors=SENSORS,
        treatments=(MODELLED,),
        misspecified=SENSORS,
        powers=3,
        asymmetry=0,
        resamples=10,
        processes=2,
        classes=(),
        path=Path("slow.toml"),
        text="",
    )
    return measure(study).scores[0]


@pytest.mark.slow
def test_no_zero_term_is_called_needed_and_no_strong_one_is_dropped(told):
    assert told.of(SURE).false_keeps.value <= 0.02
    assert told.of(DECISION).false_drops[-1].value <= 0.02
    assert told.of(SURE).false_drops[-1].value <= 0.02


@pytest.mark.slow
def test_decision_costs_less_than_every_other_method(told):
    rivals = [score for score in told.methods if score.method != DECISION]
    assert min(score.excess.value for score in rivals) > 0.0


@pytest.mark.slow
@pytest.mark.parametrize("k", range(len(RATIOS)))
def test_decision_is_not_dearer_than_any_other_method_at_any_ratio_of_costs(told, k):
    rivals = [score for score in told.methods if score.method not in (DECISION, SURE)]
    # an interval that lies below zero would be a method that is cheaper
    assert all(score.weighed_excess[k].high > 0.0 for score in rivals)


@pytest.mark.slow
def test_inclusion_is_the_frequency_of_truth(told):
    # binomial spread, doubled because terms of one sensor share its noise and its model size
    pulls = [
        (b.true.events - b.true.of * b.inclusion)
        / np.sqrt(2.0 * b.true.of * b.inclusion * (1.0 - b.inclusion) + 1.0)
        for b in told.calibration
    ]
    assert np.max(np.abs(pulls)) < 3.5
