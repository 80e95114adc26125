"""Laws of the extremes: nothing is NaN or wrong in silence, and ordinary problems keep their digits."""

from __future__ import annotations

import math

import numpy as np
import pytest

from imubayes.selection import lanes
from studies.extremes.cases import FAMILIES, Case, cases
from studies.extremes.digits import digits_of, of_coefficients
from studies.extremes.measure import Outcome, outcome

THIN = 16
"""Every so many cases of a family in the default run, and its first and last."""

KEPT = 5.0
"""Digits of coefficients that independent columns up to `ORDINARY` keep."""

KEPT_INCLUSION = 4.0
ORDINARY = 1e10


def _holds(one: Outcome) -> None:
    where = f"{one.family} {one.label}: {one.told} {one.refused}"
    assert one.silent == (), where
    told = one.told
    if not one.full_rank:
        assert math.isnan(told["least squares"].correct), where
    if one.full_rank and one.condition <= ORDINARY and one.family != "noise 0":
        assert one.refused == (), where
        assert told["least squares"].correct >= KEPT, where
        assert told["averaged"].correct >= KEPT, where
        assert told["inclusion"].correct >= KEPT_INCLUSION, where
    if one.refused and one.label != "no response":
        assert "x1" in one.refused[0] or "x2" in one.refused[0], where


LONGEST = "eight candidates"
"""Family whose references take a quarter of a minute each."""


@pytest.mark.parametrize("family", [name for name in FAMILIES if name != LONGEST])
def test_no_answer_at_the_extremes_is_wrong_in_silence(family):
    for case in cases([family], seed=11, every=THIN):
        _holds(outcome(case))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("family", FAMILIES)
def test_no_answer_on_the_entire_grid_is_wrong_in_silence(family, seed):
    for case in cases([family], seed=seed):
        _holds(outcome(case))


def test_a_term_that_is_all_but_excluded_keeps_the_digits_that_are_stated():
    """Its inclusion is 6e-9: scales that have 1e-12 of all have 1e-6 of its variance."""
    wide = next(case for case in cases(["prior width"], seed=1) if case.label == "1e12")
    _holds(outcome(wide))


def test_eight_nearly_dependent_candidates_of_a_run_keep_their_digits():
    *_, last = FAMILIES[LONGEST](np.random.default_rng(4))
    assert len(last.names) - last.always >= lanes.FEWEST
    _holds(outcome(last))


def test_an_exact_fit_is_told_for_what_it_is():
    X = np.random.default_rng(2).integers(-9, 10, size=(40, 3)).astype(float)
    one = outcome(Case("noise 0", "integers", X, X @ [2.0, -1.0, 3.0], np.ones(3)))
    assert one.silent == ()
    assert one.told["least squares"].correct >= 14.0
    assert one.told["inclusion"].correct >= 14.0


@pytest.mark.parametrize(
    ("found", "reference", "size", "digits"),
    [([1.0], [1.0], [1.0], 15.0), ([1.0, 1.01], [1.0, 1.0], [1.0, 10.0], 3.0), ([5.0], [1.0], [1.0], 0.0)],
)
def test_digits_are_those_of_the_worst_element(found, reference, size, digits):
    assert digits_of(found, reference, size) == pytest.approx(digits, abs=1e-9)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_what_is_no_number_has_no_digits(value):
    assert of_coefficients([1.0, value], [1.0, 1.0], [1.0, 1.0]) == -math.inf
