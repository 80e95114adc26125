"""Figures of a scene: shapes, vectors, and labels that do not overlap."""

from __future__ import annotations

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from block_readings import panels as drawn
from scenes_found import TERMS, a_relevance

from imubayes.reporting import scene_figures
from imubayes.reporting.scene_figures import LINE, MARKERS, SIGNS, placed, shown_share
from imubayes.reporting.scene_views import scene_section
from imubayes.scenes.propagation import Budget
from imubayes.scenes.relevance import QUADRANTS


@pytest.fixture
def found():
    return a_relevance()


def test_every_quadrant_has_a_marker_and_the_same_shape_as_text() -> None:
    assert set(MARKERS) == set(SIGNS) == set(QUADRANTS)
    assert len({(marker, fill) for marker, fill, _ in MARKERS.values()}) == len(QUADRANTS)


def test_panels_say_what_matters_and_name_every_term(found) -> None:
    panels = drawn([scene_section(found, "ACC-07", {}, "s1")])
    assert panels[0].title == "2 of 3 terms that are there matter; 1 not shown could"
    assert panels[1].title == "2 terms stay within the budget"
    words = "".join(ElementTree.fromstring(panels[0].svg).itertext())
    assert all(row[0] in words for row in TERMS)


def test_panel_of_errors_that_vanish_is_drawn(found) -> None:
    nothing = replace(found, path=((1, "", 0.0), (0, "b0", 0.0)), model=())
    assert ElementTree.fromstring(scene_figures.path(nothing, "k").svg) is not None
    worse = replace(found, met=False, budget=Budget("position", 10.0))
    assert (
        scene_figures.path(worse, "k").title == "No model stays within the budget: 3.8 times is left at least"
    )


def test_terms_that_are_not_shown_stand_at_what_they_could_cost(found) -> None:
    assert [shown_share(one) for one in found.terms] == [1.3, 2e-3, 0.3, 1e-5, 2.6]


def boxes(middles, names):
    size = np.array([[6.7 * len(name), LINE] for name in names])  # px; 6.7 is the font's widest mean letter
    return middles - 0.5 * size, middles + 0.5 * size


@pytest.mark.parametrize("seed", range(6))
def test_labels_overlap_neither_each_other_nor_a_point_however_crowded(seed) -> None:
    """30 terms of which most lie in one corner, as terms do that are surely there."""
    rng = np.random.default_rng(seed)
    points = rng.uniform((0.0, 14.0), (292.0, 270.0), (30, 2))
    points[:20] = points[0] + rng.normal(0.0, 1.0, (20, 2)) * (1.0 if seed % 2 else 20.0)
    points = np.clip(points, (0.0, 14.0), (292.0, 270.0))
    names = [("b0", "m_k", "c_jk", "b0*dT")[k % 4] for k in range(30)]
    low, high = boxes(placed(points, names, (292.0, 284.0)), names)
    assert low.min() >= 0.0 and (high <= (292.0, 284.0)).all()
    apart = np.maximum(low[:, None] - high[None], low[None] - high[:, None]).max(axis=-1)
    assert (apart + 1e3 * np.eye(30) >= 0.0).all()
    outside = np.maximum(low[:, None] - points[None], points[None] - high[:, None]).max(axis=-1)
    assert (outside >= 3.0).all()


def test_label_stands_next_to_its_point_where_there_is_room() -> None:
    points = np.array([[100.0, 100.0], [200.0, 200.0]])
    away = np.hypot(*(placed(points, ["b0", "b1"], (292.0, 284.0)) - points).T)
    assert (away < 25.0).all()
