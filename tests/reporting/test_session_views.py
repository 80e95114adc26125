import json
import math
from dataclasses import replace

import pytest
from populations_found import SESSIONS, UNITS, class_found
from results_found import repeatability

from imubayes.reporting.population_views import largest_pull
from imubayes.reporting.results import result_json


def test_largest_pull_is_the_largest_difference_over_its_sd() -> None:
    one = repeatability("b0", units=4)
    by_hand = {
        (u, s, r): abs(one.mean[u, s] - one.mean[u, r]) / math.hypot(one.sd[u, s], one.sd[u, r])
        for u in range(4)
        for s in range(3)
        for r in range(s + 1, 3)
        if math.isfinite(one.mean[u, s] + one.mean[u, r])
    }
    (u, s, r), size = max(by_hand.items(), key=lambda entry: entry[1])
    pull, where = largest_pull(one)
    assert pull == pytest.approx(size, rel=1e-12)
    assert where == f"{one.units[u]}, {one.sessions[s]} to {one.sessions[r]}"


def test_population_is_in_the_results_in_si(result) -> None:
    found = class_found()
    (entry,) = json.loads(result_json(replace(result, classes=(found,))))["population"]
    assert (entry["class"], entry["units"], entry["sessions"]) == ("mems_consumer", [*UNITS], [*SESSIONS])
    whole, one = entry["terms"][:2]
    assert whole["mean"]["median"] is None and one["parameter"] == "ax.b0"
    assert one["mean"]["median"] == pytest.approx(found.terms[1].spreads.mean.value)
    assert one["unit_to_unit"]["q95"] == pytest.approx(found.terms[1].spreads.unit_to_unit.high)
    assert one["session_shift"]["sessions"] == [*SESSIONS] and len(one["session_shift"]["mean"]) == 3
    assert (one["verdict"], one["answers"]) == ("needed", {"needed": 8})
    assert one["needed"]["q05"] == pytest.approx(found.terms[1].need.share.low)
