import numpy as np
import pytest
from trades import told

from imubayes.inference.intervals import SIDE
from imubayes.ladder.trade.components import Repeat, score
from imubayes.selection.verdicts import EQUAL, Costs

NONE = {"<ACC>": {}}


def _repeats(*pairs):
    return [Repeat("<ACC>", 0, np.array(truth), answers=(one,)) for truth, one in pairs]


def test_a_rung_that_draws_from_its_own_posterior_holds_nine_in_ten():
    rng = np.random.default_rng(1)
    means = rng.normal([1.0, 0.0, 0.0], 0.01, size=(400, 3))
    repeats = _repeats(*(([1.0, 0.0, 0.0], told(full_mean=mean)) for mean in means))
    found = score("plug-in", repeats, EQUAL, NONE)
    # of the third term the test cannot tell: two terms a repeat count
    assert found.coverage.of == 800
    held = np.abs(means[:, :2] - [1.0, 0.0]) <= SIDE * 0.01
    assert found.coverage.events == held.sum()
    assert abs(found.coverage.share.value - 0.9) < 4.0 * np.sqrt(0.09 / 800)
    assert abs(found.error - 1.0) < 4.0 / np.sqrt(2 * 800)


def test_wrong_verdicts_are_counted_against_the_truth():
    right = ([1.0, 0.0, 0.0], told())
    alarm = ([0.0, 0.0, 0.0], told())  # b0 is needed, and zero
    silent = ([1.0, 0.5, 0.0], told())  # b1 is not needed, and half of its prior sd
    found = score("plug-in", _repeats(right, alarm, silent), Costs(1.0, 4.0), NONE)
    assert (found.false_needed.events, found.false_needed.of) == (1, 1 + 2 + 3)
    assert (found.false_not_needed.events, found.false_not_needed.of) == (1, 3)
    assert (found.missed_large.events, found.missed_large.of) == (1, 3)
    assert found.cost == pytest.approx((1.0 * 1 + 4.0 * 1) / 3)
    assert np.isnan(found.scene_terms)


def test_errors_are_counted_in_the_sd_of_the_best_rung_that_answered():
    wide = told("means", full_mean=np.array([1.03, 0.0, 0.0]), full_sd=np.array([0.1, 0.1, 1.0]))
    one = Repeat("<ACC>", 0, np.array([1.0, 0.0, 0.0]), answers=(wide, told()))
    found = score("means", [one], EQUAL, NONE)
    assert found.error == pytest.approx(3.0 / np.sqrt(2.0))
    assert found.coverage.events == 2


def test_a_rung_that_answered_nothing_has_no_score():
    assert score("raw", _repeats(([0.0, 0.0, 0.0], told())), EQUAL, NONE) is None
