"""What a scene requires, in words, in the report, and as it is published."""

from __future__ import annotations

from dataclasses import replace

import pytest
from block_readings import panels
from scenes_found import a_relevance

from imubayes.reporting.figures import scene_path
from imubayes.reporting.scene_words import scene_section
from imubayes.scenes.propagation import Budget


@pytest.fixture
def found():
    return a_relevance()


def test_figure_says_how_many_terms_stay_within_the_budget(found) -> None:
    (panel,) = panels([scene_section(found, "ACC-07", {}, "s1")])
    assert panel.title == "2 terms stay within the budget"
    worse = replace(found, met=False, budget=Budget("position", 10.0))
    title = scene_path(worse, "m", 1.0, "k").title
    assert title == "No model stays within the budget: 3.8 times is left at least"
    nothing = replace(found, path=((1, "", 0.0), (0, "b0", 0.0)), model=())
    assert scene_path(nothing, "m", 1.0, "k").svg
