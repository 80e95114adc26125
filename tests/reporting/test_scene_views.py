"""What the report shows and keeps of a scene."""

from __future__ import annotations

import pytest
from block_readings import rows, said
from scenes_found import TERMS, a_relevance

from imubayes.reporting.scene_views import published_scene, scene_section


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
