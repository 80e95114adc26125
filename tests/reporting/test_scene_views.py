"""What the report shows and keeps of a scene."""

from __future__ import annotations

import pytest
from scenes_found import TERMS, a_relevance

from imubayes.reporting.scene_views import published_scene, scene_view


@pytest.fixture
def found():
    return a_relevance()


def test_published_scene_is_that_of_the_component(found) -> None:
    scene = published_scene(found, "ACC-07")
    assert (scene.name, scene.sensor, scene.model) == ("quadrotor", "ACC-07", ("b0", "b2"))
    assert [term.name for term in scene.terms] == [row[0] for row in TERMS]
    assert scene.terms[0].share_of_budget == 1.3 and scene.budget["limit"] == 100.0


def test_view_lists_what_costs_most_first_with_the_shape_of_its_quadrant(found) -> None:
    view = scene_view(found, "ACC-07", {"b0": "K0"}, "s1")
    assert [row.name for row in view.rows] == ["c_jk", "b0", "b2", "b1", "b3"]
    assert view.rows[1].symbol == "K0" and view.rows[0].symbol == "-"
    assert [row.sign for row in view.rows] == ["▲", "●", "●", "○", "×"]
    assert str(view.rows[1].effect) == "130 m" and str(view.rows[1].rms) == "10 ug"
    assert view.budget == "100 m" and view.left == "41 m" and view.noise == ("3.0 m", "4.0 m", "0 m")
