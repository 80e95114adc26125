"""Turns, absences and the machine; exponents of times whose law is known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from studies.speed.contests import Contest, Entrant, Ladder, Self
from studies.speed.growth import fitted
from studies.speed.measure import held


def _contest(*entrants: Entrant) -> Contest:
    return Contest("subsets", 3, "title", "error", "time", entrants)


def test_entrants_take_turns_and_the_first_does_not_count():
    order: list[str] = []
    entrants = [Entrant(name, lambda name=name: order.append(name), lambda _: 0.0) for name in "ab"]
    found = held(_contest(*entrants), 3)
    assert order == ["a", "b"] * 4
    assert [len(place.seconds) for place in found.places] == [3, 3]


@pytest.mark.parametrize(
    ("first", "then", "counted"),
    [(3.4, 1e-3, [1e-3] * 5), (5.0, 4.0, [4.0] * 2), (19.0, 1e-3, [1e-3] * 5), (30.0, 29.0, [30.0])],
)
def test_a_first_turn_that_compiles_is_in_no_time(first, then, counted):
    turns = iter([first, *[then] * 9])
    slow = Entrant("slow", lambda: Self(1, next(turns)), lambda _: 0.0)
    (place,) = held(_contest(slow), 5).places
    assert [*place.seconds] == counted


def test_an_entrant_that_is_not_installed_is_left_out_with_the_reason(monkeypatch):
    there = Entrant("there", lambda: 1, lambda _: 0.5, ours=True)
    gone = Entrant("gone", lambda: 1, lambda _: 0.0, ("no_such_module_anywhere",))
    found = held(_contest(there, gone), 2)
    assert found.places[1].seconds == ()
    assert "no_such_module_anywhere is not installed" in found.places[1].absent
    assert math.isnan(found.ratio(found.places[1]))
    assert found.places[0].error == 0.5
    monkeypatch.setattr("studies.speed.peers.shutil.which", lambda _: None)
    without_r = held(_contest(there, Entrant("R", lambda: 1, lambda _: 0.0, ("R:BAS",))), 1)
    assert "no Rscript" in without_r.places[1].absent


SIZES = (10, 100, 1_000, 10_000, 100_000)


def _ladder() -> Ladder:
    return Ladder("rows", "work", 1.0, tuple((size, lambda: None) for size in SIZES))


@pytest.mark.parametrize("exponent", [0.5, 1.0, 2.0])
def test_an_exact_power_is_found_with_no_error(exponent):
    seconds = 1e-6 * np.array(SIZES, dtype=float)[:, None] ** exponent * np.ones(3)
    law = fitted(_ladder(), seconds)
    assert law.exponent == pytest.approx(exponent, rel=1e-12)
    assert law.at_one == pytest.approx(1e-6, rel=1e-10)
    assert law.sd < 1e-12


def test_overhead_does_not_hide_the_exponent():
    """A fixed tenth of a second under n microseconds: 1e5 rows take as long again, and only they tell."""
    sizes = np.array([1e4, 1e5, 1e6, 1e7, 1e8])
    steps = tuple((int(size), lambda: None) for size in sizes)
    law = fitted(Ladder("rows", "work", 1.0, steps), (0.1 + 1e-6 * sizes)[:, None])
    assert law.used.tolist() == [False, False, True, True, True]
    assert law.exponent == pytest.approx(1.0, abs=0.03)


def test_error_of_the_exponent_is_that_of_its_scatter():
    """Error over its estimate is Student's t; of the four points that count two degrees of freedom are left,
    for which half of all lie within sqrt(2/3).
    """
    rng = np.random.default_rng(1)
    ratios = []
    for _ in range(2_000):
        seconds = 1e-6 * np.array(SIZES) * np.exp(0.05 * rng.normal(size=len(SIZES)))
        law = fitted(_ladder(), 1e3 * seconds[:, None] * np.array([1.0, 1.5]))
        ratios.append((law.exponent - 1.0) / law.sd)
    assert np.median(np.abs(ratios)) == pytest.approx(math.sqrt(2.0 / 3.0), rel=0.15)
