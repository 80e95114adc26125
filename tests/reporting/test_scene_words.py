"""What a scene requires, in words."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scenes_found import a_relevance

from imubayes.reporting.rounding import duration, share
from imubayes.reporting.scene_words import scene_sentences
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


def test_shares_are_percentages_up_to_twice_the_budget() -> None:
    assert [share(v) for v in (0.0, 0.0021, 1.94, 1.96, 250.0)] == [
        "below 0.1 %", "0.21 %", "190 %", "2.0 times", "250 times",
    ]  # fmt: skip
    assert [duration(v) for v in (0.5, 119.0, 120.0, 7199.0, 86400.0)] == [
        "0.5 s",
        "119 s",
        "2 min",
        "120 min",
        "24 h",
    ]
