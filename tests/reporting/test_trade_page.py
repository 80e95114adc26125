import pytest
from trades_found import traded

from imubayes.ladder.trade.table import faults
from imubayes.reporting.trade_page import trade_answer


@pytest.fixture(scope="module")
def found():
    return traded()


def test_the_answer_names_the_recommended_rung_with_its_reasons(found):
    assert found.recommended == "collapsed"
    # 50 s, and 1.5 times 40 s more: from 20 ms to 110 s are 3.7 decades
    assert "3.7 decades" in " ".join(trade_answer(found))


def test_intervals_that_are_too_short_rule_rungs_out():
    found = traded(held=120)
    assert found.recommended == "raw"  # it answered no repeat, and nothing is known against it
    rungs = [one.rung for one in found.places if found.score(one.rung)]
    told = [[*faults(found.place(rung), found.score(rung), found.floor[0])][-1] for rung in rungs]
    assert len(told) == 3 and all("90 % intervals hold only" in fault for fault in told)
