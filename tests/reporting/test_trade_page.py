from trades_found import traded

from imubayes.ladder.trade.table import faults


def test_intervals_that_are_too_short_rule_rungs_out():
    found = traded(held=120)
    assert found.recommended == "raw"  # it answered no repeat, and nothing is known against it
    rungs = [one.rung for one in found.places if found.score(one.rung)]
    told = [[*faults(found.place(rung), found.score(rung), found.floor[0])][-1] for rung in rungs]
    assert len(told) == 3 and all("90 % intervals hold only" in fault for fault in told)
