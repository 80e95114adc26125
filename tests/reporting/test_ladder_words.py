from __future__ import annotations

from dataclasses import replace

import pytest

from imubayes.campaign.fidelity import NEEDS_ROWS, Choice
from imubayes.reporting.ladder_words import choice_sentences, published_choice

CHEAP = Choice(
    "sparse", "a budget of 1 s", 0.4, 0.5, (), "plug-in", 0.9, (0.1, 0.3), "neighbours", budget=1.0
)
CLIMBED = Choice(
    "raw",
    "an accuracy of 0.1 posterior sd",
    4.0,
    9.0,
    (("means", 0.0, 0.0), ("full", 0.2, 0.1), ("raw", 0.05, 0.01)),
    None,
    0.0,
    (0.0, 0.0),
    "there is no better rung",
    accuracy=0.1,
)


@pytest.mark.parametrize(
    ("choice", "words", "met"),
    [
        (CHEAP, "the best that fits a budget of 1 s (0.4 s)", True),
        (
            replace(CHEAP, foreseen=2.0, seconds=1.2),
            "the cheapest: none fits a budget of 1 s (it took 1.2 s)",
            False,
        ),
        (replace(CHEAP, seconds=1.6), "foreseen to fit a budget of 1 s; it took longer, 1.6 s", False),
        (CLIMBED, "reached an accuracy of 0.1 posterior sd (4 s)", True),
        (
            replace(CLIMBED, accuracy=0.01),
            "the last that there is: an accuracy of 0.1 posterior sd was not reached (4 s)",
            False,
        ),
        (replace(CHEAP, budget=None), "as asked (0.4 s)", True),
    ],
)
def test_what_was_asked_for_is_claimed_only_where_it_came_true(choice, words, met):
    assert words in choice_sentences(choice)[0]
    record = published_choice(choice)
    assert record is not None
    assert record["met"] is met


def test_a_rung_that_is_no_choice_says_why():
    top = replace(CLIMBED, rung="full", next_reason=f"raw is no choice here: {NEEDS_ROWS}")
    (said,) = [text for text in choice_sentences(top) if text.startswith("Raw")]
    assert "a run that is read a part at a time does not hold them" in said
