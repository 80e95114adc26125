from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from block_readings import panels, rows, said

from imubayes.population.sessions import level_among
from imubayes.reporting.session_views import largest_pull, session_section, session_sentence


def viewed(result, *found):
    return [session_section(replace(result, sessions=found))]


def untold(one):
    nothing = (math.nan, math.nan, math.nan)
    return replace(
        one, p_value=math.nan, between=nothing, pulls=np.full_like(one.pulls, np.nan), exceeds=False
    )


def test_study_without_sessions_has_no_section(result) -> None:
    assert session_section(result) is None


def test_largest_pull_is_the_largest_difference_over_its_sd(make_sessions) -> None:
    one = make_sessions("b0", units=4)
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


def test_axes_of_a_triad_stand_under_the_parameter_that_holds_them_all(result, make_sessions) -> None:
    alone = viewed(result, make_sessions("ax.b0"), make_sessions("ay.b0"))
    together = viewed(result, make_sessions("b0"), make_sessions("ax.b0"), make_sessions("ay.b0"))
    assert [row[0] for row in rows(alone)] == ["ax.b0", "ay.b0"]
    assert [row[0] for row in rows(together)] == ["b0"]
    assert "2 more parameters are in result.json" in said(together)


def test_at_most_twelve_parameters_are_drawn(result, make_sessions) -> None:
    found = [replace(make_sessions("b0", units=24), parameter=f"p{k}") for k in range(14)]
    view = viewed(result, *found)
    assert len(rows(view)) == 14 and len(panels(view)) == 12
    assert "unit, 1 IMU-1 to 24 IMU-24" in panels(view)[0].svg


def test_parameters_of_which_the_sessions_cannot_tell_are_not_drawn(result, make_sessions) -> None:
    view = viewed(result, untold(make_sessions("c_jj")))
    assert rows(view) == panels(view) == []
    assert "cannot tell of c_jj" in said(view)


def test_sentence_names_what_changes_between_sessions_with_its_size(make_sessions) -> None:
    found = (
        make_sessions("b0"),
        make_sessions("b1", exceeds=False),
        replace(make_sessions("c_jj"), p_value=math.nan, exceeds=False),
    )
    text = session_sentence(found)
    assert text.startswith("1 of 2 parameters changes between sessions by more than the error bars allow:")
    assert "b0 (sd 55 ug)" in text and text.endswith("The sessions cannot tell of c_jj.")
    level = " Each test alarms below p 0.005, so that chance alone makes 1 % of studies at most do so."
    found = tuple(replace(one, level=level_among([1e-9, 0.41])) for one in found)
    assert level in session_sentence(found)


def test_sentence_says_so_when_everything_repeats(make_sessions) -> None:
    text = session_sentence((make_sessions("b1", exceeds=False),))
    assert text.startswith("Of 1 parameter none changes between sessions by more than its error bars allow.")


def test_scatter_that_all_units_have_in_common_is_said_and_that_of_chance_is_not(make_sessions) -> None:
    one = make_sessions("b0", units=8)
    said = "All units have 93% of the scatter of b0 in common"
    assert said in session_sentence((replace(one, shared=0.93),))
    for share in (0.12, math.nan):
        assert "in common" not in session_sentence((replace(one, shared=share),))
