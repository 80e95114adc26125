"""What the pages about the tool say, to the letter, and in cases that the page of a made result has not."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from page_reading import said, told_of
from tool_results import OF_THE_TOOL, REFUSED, RIGHT, an_outcome, made_extremes, made_quality, made_ranks

from imubayes.reporting.blocks import page_html
from studies.decision_quality.page import quality_page
from studies.decision_quality.questions import Interval
from studies.decision_quality.trials import OWN
from studies.decision_quality.words import quality_answer, targets
from studies.extremes.measure import Told
from studies.extremes.page import extremes_answer
from studies.ranks.page import ranks_answer

Sayings = Iterator[tuple[str, Any]]


def _judged(one: Any, share: float, rms: float, left: int, missed: int) -> Any:
    """A treatment with these rates of the decision; four terms are left open by every other judge."""

    def changed(told: Any) -> Any:
        opened = Interval(0.1, 0.0, 0.2, left if told.method == OWN[0] else 4, 40)
        dropped = Interval(missed / 40.0, 0.0, 0.2, missed, 40)
        return replace(told, false_keeps=Interval(share, 0.0, 0.1), rms=rms, left=opened, false_drops=dropped)

    return replace(one, verdicts=tuple(map(changed, one.verdicts)))


def quality() -> Sayings:
    found = made_quality()
    for case, rates in (
        ("every target is met", (0.01, 1.2, 4, 0)),
        ("every one is missed", (0.05, 3.0, 5, 2)),
    ):
        yield case, targets(replace(found, treated=tuple(_judged(one, *rates) for one in found.treated)))
    first = found.scores
    cheap = replace(first.methods[3], cost=Interval(0.01, 0.0, 0.1), excess=Interval(-1.0, -2.0, -0.5))
    beaten = replace(first, methods=(*first.methods[:3], cheap, *first.methods[4:]))
    yield "another method costs less", quality_answer(replace(found, scores=beaten))
    bad = replace(found.treated[1], refused=("3 rows leave nothing to judge", "no"))
    page = said(page_html(quality_page(replace(found, treated=(found.treated[0], bad)))))
    yield "sensors are refused", [line for line in page.splitlines() if "sensors were refused" in line]


def extremes() -> Sayings:
    right = an_outcome("noise", "1", RIGHT)
    yield "all is right", extremes_answer(made_extremes(right))
    yield (
        "too much is claimed",
        extremes_answer(made_extremes(right, an_outcome("noise", "2", Told(3.0, 5.0)))),
    )
    lost = an_outcome("noise", "2", Told(-math.inf, 5.0))
    yield "an answer is no number", extremes_answer(made_extremes(right, lost))
    refused = an_outcome("noise", "2", REFUSED, refused=("why",))
    yield "one is refused", extremes_answer(made_extremes(right, refused))
    long, copies = replace(right, rows=100_000), replace(right, family="rows", rows=10**9)
    yield "copies of a short record", extremes_answer(made_extremes(right, long, copies))


def ranks() -> Sayings:
    yield "one is uneven", ranks_answer(made_ranks(b1=np.zeros(40, dtype=int)))


TOPICS = {one.__name__: one for one in (quality, extremes, ranks)}


@pytest.mark.parametrize("name", OF_THE_TOOL)
def test_page_says_what_it_said(name, golden):
    golden(f"pages/{name}.txt", said(page_html(OF_THE_TOOL[name]())))


@pytest.mark.parametrize("topic", TOPICS)
def test_what_is_said_is_what_was_said(topic, golden):
    golden(f"sayings/tool_{topic}.txt", told_of(TOPICS[topic]()))
