"""Turns, absences and the machine."""

from __future__ import annotations

import math
import time

import pytest

from studies.speed import peers
from studies.speed.contests import Contest, Entrant
from studies.speed.measure import held


def _contest(*entrants: Entrant) -> Contest:
    return Contest("subsets", 3, "title", "error", "time", entrants)


def test_entrants_take_turns_and_the_first_does_not_count():
    order: list[str] = []
    entrants = [Entrant(name, lambda name=name: order.append(name), lambda _: 0.0) for name in "ab"]
    found = held(_contest(*entrants), 3)
    assert order == ["a", "b"] * 4
    assert [len(place.seconds) for place in found.places] == [3, 3]


def test_an_entrant_that_is_not_installed_is_left_out_with_the_reason():
    there = Entrant("there", lambda: 1, lambda _: 0.5, ours=True)
    gone = Entrant("gone", lambda: 1, lambda _: 0.0, ("no_such_module_anywhere",))
    found = held(_contest(there, gone), 2)
    assert found.places[1].seconds == ()
    assert "no_such_module_anywhere is not installed" in found.places[1].absent
    assert math.isnan(found.ratio(found.places[1]))
    assert found.places[0].error == 0.5


def test_r_that_is_not_there_is_named(monkeypatch):
    monkeypatch.setattr(peers.shutil, "which", lambda _: None)
    assert "no Rscript" in peers.missing(("R:BAS",))
    assert peers.missing(("math",)) == ""


def test_a_ratio_is_that_of_the_shortest_times():
    slow = Entrant("slow", lambda: time.sleep(0.02), lambda _: 0.0)
    fast = Entrant("fast", lambda: time.sleep(0.001), lambda _: 0.0, ours=True)
    found = held(_contest(fast, slow), 3)
    assert found.ratio(found.places[1]) == pytest.approx(
        min(found.places[1].seconds) / min(found.places[0].seconds)
    )
    assert found.ratio(found.places[1]) > 2.0
