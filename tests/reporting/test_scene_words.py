"""What a scene requires, in words, in the report, and as it is published."""

from __future__ import annotations

from dataclasses import replace

import pytest
from block_readings import panels, rows, said
from scenes_found import TERMS, a_relevance

from imubayes.reporting.figures import scene_path
from imubayes.reporting.scene_words import published_scene, scene_section
from imubayes.scenes.propagation import Budget


@pytest.fixture
def found():
    return a_relevance()


def test_published_scene_is_that_of_the_component(found) -> None:
    scene = published_scene(found, "ACC-07")
    assert (scene.name, scene.sensor, scene.model) == ("quadrotor", "ACC-07", ("b0", "b2"))
    assert [term.name for term in scene.terms] == [row[0] for row in TERMS]
    assert scene.terms[0].share_of_budget == 1.3 and scene.budget["limit"] == 100.0


def test_view_lists_what_costs_most_first_with_the_shape_of_its_quadrant(found) -> None:
    section = [scene_section(found, "ACC-07", {"b0": "K0"}, "s1")]
    view = rows(section)
    assert [row[0] for row in view] == ["c_jk", "b0", "b2", "b1", "b3"]
    assert (view[0][1], *view[1][1:5]) == ("", "K0", view[1][2], "10 µg", "130 m")
    assert [row[-1][0] for row in view] == ["▲", "●", "●", "○", "×"]
    words = said(section)
    assert "Budget 100 m." in words and "with this model at most 41 m" in words
    assert "N 3.0 m, B 4.0 m, K 0 m" in words


def test_figure_says_how_many_terms_stay_within_the_budget(found) -> None:
    (panel,) = panels([scene_section(found, "ACC-07", {}, "s1")])
    assert panel.title == "2 terms stay within the budget"
    worse = replace(found, met=False, budget=Budget("position", 10.0))
    title = scene_path(worse, "m", 1.0, "k").title
    assert title == "No model stays within the budget: 3.8 times is left at least"
    nothing = replace(found, path=((1, "", 0.0), (0, "b0", 0.0)), model=())
    assert scene_path(nothing, "m", 1.0, "k").svg
