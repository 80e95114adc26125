from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from block_readings import rows, said
from results_found import repeatability

from imubayes.reporting.population_views import largest_pull, session_section


def viewed(result, *found):
    return [session_section(replace(result, sessions=found))]


def untold(one):
    nothing = (math.nan, math.nan, math.nan)
    return replace(
        one, p_value=math.nan, between=nothing, pulls=np.full_like(one.pulls, np.nan), exceeds=False
    )


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


def test_axes_of_a_triad_stand_under_the_parameter_that_holds_them_all(result) -> None:
    alone = viewed(result, repeatability("ax.b0"), repeatability("ay.b0"))
    together = viewed(result, repeatability("b0"), repeatability("ax.b0"), repeatability("ay.b0"))
    assert [row[0] for row in rows(alone)] == ["ax.b0", "ay.b0"]
    assert [row[0] for row in rows(together)] == ["b0"]
    assert "2 more parameters are in result.json" in said(together)


def test_parameters_of_which_the_sessions_cannot_tell_have_no_row(result) -> None:
    view = viewed(result, untold(repeatability("c_jj")))
    assert rows(view) == []
    assert "cannot tell of c_jj" in said(view)
