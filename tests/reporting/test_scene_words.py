"""What a scene requires, in words, in the report, and as it is published."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from block_readings import panels, rows, said
from scenes_found import TERMS, a_relevance

from imubayes.reporting.figures import scene_path
from imubayes.reporting.scene_words import published_scene, scene_section, scene_sentences
from imubayes.scenes.propagation import Budget


@pytest.fixture
def found():
    return a_relevance()


def test_words_say_the_model_what_is_left_what_is_idle_and_what_could_matter(found) -> None:
    model, costs, idle, could, noise = scene_sentences(found, "ACC-07")
    assert (
        model
        == "ACC-07 in quadrotor (10 min, budget 100 m of position): 2 of 5 terms, b0 and b2, are enough."
    )
    assert costs == (
        "What is left stays below 41 m with 95 %; leaving out the other 3 costs 3.2 m,"
        " without any compensation it would be 160 m."
    )
    assert idle == "b1 is there and takes up to 0.30 % of the budget."
    assert could == (
        "c_jk is not shown to be there, nor to be small enough: it could take 2.6 times the budget."
    )
    assert noise == "Noise comes to 5.0 m (one sd)."


def test_words_say_that_no_model_is_good_enough_and_what_would_help(found) -> None:
    first = scene_sentences(replace(found, met=False, calibrated=(90.0, 140.0)), "ACC-07")[0]
    assert "no model of this library stays within the budget" in first and "up to 140 m" in first
    assert "most of it in c_jk." in first
    assert "Calibrate better" in first and "b0 and b2, are enough" in first


def test_words_say_that_nothing_needs_to_be_modelled(found) -> None:
    quiet = replace(found, model=(), terms=found.terms[3:4], noise=(300.0, 0.0, 0.0))
    first, second, noise = scene_sentences(quiet, "ACC-07")
    assert first.endswith("no term needs to be modelled.") and second.endswith("below 41 m with 95 %.")
    assert "more than the whole budget" in noise


@pytest.mark.parametrize(
    ("quantity", "kind", "size", "text"),
    [
        ("output", "accelerometer", 9.80665e-6, "1.0 ug"),
        ("output", "gyroscope", np.pi / 180.0 / 3600.0, "1.0 deg/h"),
        ("attitude", "gyroscope", math.radians(1.0), "1.0 deg"),
        ("velocity", "gyroscope", 1.0, "1.0 m/s"),
    ],
)
def test_budget_is_printed_in_the_unit_that_people_use(found, quantity, kind, size, text) -> None:
    other = replace(found, kind=kind, budget=Budget(quantity, size))
    assert f"budget {text} of " in scene_sentences(other, "X")[0]


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
