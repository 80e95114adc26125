from __future__ import annotations

import math
from dataclasses import replace

from imubayes.population.sessions import level_among
from imubayes.reporting.session_views import session_sentence


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
