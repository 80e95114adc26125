import itertools
import math

import pytest
from scipy.stats import beta

from imubayes.population.needs import CANNOT_TELL, class_need, unit_answer

WORDS = ("needed", "not needed", "undecided", *sorted(CANNOT_TELL))


@pytest.mark.parametrize("verdicts", list(itertools.product(WORDS, repeat=3)))
def test_unit_answers_yes_or_no_only_where_its_sessions_do_not_contradict_each_other(verdicts):
    sure = {"needed", "not needed"}.intersection(verdicts)
    found = unit_answer(verdicts)
    assert (found in {"needed", "not needed"}) == (len(sure) == 1)
    assert found == unit_answer(verdicts[::-1]) or found in CANNOT_TELL
    assert found in verdicts or found == "undecided"


def test_most_units_that_cannot_tell_leave_the_class_untold_whatever_the_pooled_model_says():
    for word in CANNOT_TELL:
        need = class_need([word] * 5 + ["needed"] * 3, 1.0)
        assert need.verdict == "cannot tell" and word in need.reason
        assert need.share.high == 1.0 and need.share.low == pytest.approx(beta(3.5, 5.5).ppf(0.05))


@pytest.mark.parametrize(
    ("answers", "pooled", "verdict"),
    [
        (["needed"] * 8, 1.0, "needed"),
        (["needed"] * 8, None, "needed"),
        (["needed"] * 7 + ["not needed"], 1.0, "needed"),
        (["needed"] * 2 + ["not needed"] * 6, 1.0, "some need it"),
        (["needed"] * 6 + ["not needed"] * 2, 0.4, "some need it"),
        (["not needed"] * 5 + ["undecided"] * 3, 0.2, "not needed"),
        (["not needed"] * 5 + ["undecided"] * 3, 0.9, "undecided"),
        (["undecided"] * 6 + ["needed"] * 2, 0.99, "undecided"),
    ],
)
def test_class_answers_as_most_of_its_units_and_their_common_model_do(answers, pooled, verdict):
    assert class_need(answers, pooled).verdict == verdict


def test_share_is_of_those_that_answer_and_its_interval_reaches_over_those_that_do_not():
    need = class_need(["needed"] * 3 + ["not needed"] + ["inseparable"] * 4, None)
    assert need.share.value == pytest.approx(0.75)
    assert need.share.low == pytest.approx(beta(3.5, 5.5).ppf(0.05))
    assert need.share.high == pytest.approx(beta(7.5, 1.5).ppf(0.95))
    nothing = class_need(["untested"] * 4, None)
    assert math.isnan(nothing.share.value) and (nothing.share.low, nothing.share.high) == (0.0, 1.0)
    assert sum(need.answers.values()) == 8
