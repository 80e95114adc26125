"""What a class needs."""

import itertools
import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import beta

from imubayes.inference import Share
from imubayes.population.needs import (
    CANNOT_TELL,
    NEEDED,
    NOT_NEEDED,
    UNTOLD,
    WOULD_MATTER,
    InLot,
    MissionTerm,
    PopulationTerm,
    class_need,
    could_change,
    unit_answer,
)
from imubayes.population.pooled import Pooled

NOTHING = Share(0.0, 0.0, 0.0)


def _term(needed: int, hidden: int, units: int) -> PopulationTerm:
    return PopulationTerm("b0", units, (InLot(needed, hidden, NOTHING, NOTHING),), Pooled(0.5, NOTHING, 1.0))


def _cell(known: PopulationTerm, share: float, required: float) -> MissionTerm:
    return MissionTerm(known, 1.0, Share(share, share, share), required, share)


COUNTS = st.integers(1, 40).flatmap(
    lambda units: st.integers(0, units).flatmap(
        lambda hidden: st.tuples(st.integers(0, units - hidden), st.just(hidden), st.just(units))
    )
)


@given(COUNTS)
def test_class_has_an_answer_only_where_most_units_tell_and_then_that_of_most_of_these(counts):
    needed, hidden, units = counts
    answer = _term(needed, hidden, units).answer
    assert (answer == UNTOLD) == (2 * hidden >= units)
    if answer != UNTOLD:
        assert (answer == NEEDED) == (needed >= units - hidden - needed)


@given(COUNTS, st.floats(0.0, 1e4), st.floats(0.0, 1.0))
def test_what_the_tests_do_not_show_is_never_said_to_be_needed_in_a_scene(counts, share, required):
    term = _term(*counts)
    answer = _cell(term, share, required).answer
    if answer == NEEDED:
        assert term.answer == NEEDED
    if term.answer == UNTOLD:
        assert answer in (UNTOLD, WOULD_MATTER)
    if term.answer == NEEDED:
        assert answer in (NEEDED, NOT_NEEDED)


@pytest.mark.parametrize(
    ("needed", "hidden", "share", "required", "answer"),
    [
        (10, 0, 0.5, 1.0, NEEDED),
        (10, 0, 0.5, 0.4, NOT_NEEDED),
        (0, 0, 0.01, 0.0, NOT_NEEDED),
        (0, 0, 0.01, 0.6, WOULD_MATTER),  # too small for the test to show, and not for this budget
        (0, 10, 0.01, 0.0, UNTOLD),
        (0, 10, 0.01, 0.5, WOULD_MATTER),
        (0, 10, 0.1, 0.0, WOULD_MATTER),
        (5, 5, 0.5, 1.0, WOULD_MATTER),
    ],
)
def test_answer_in_a_scene_by_what_is_shown_and_what_it_takes(needed, hidden, share, required, answer):
    assert _cell(_term(needed, hidden, 10), share, required).answer == answer


def test_answer_of_few_units_that_are_not_of_one_mind_could_change_and_that_of_many_could_not():
    assert could_change(_term(6, 0, 10)) and could_change(_term(0, 6, 10))
    assert not could_change(_term(10, 0, 10)) and not could_change(_term(0, 10, 10))
    assert not could_change(_term(600, 0, 1000))


def test_what_most_tests_leave_open_is_needed_where_all_units_together_show_it():
    """Mutation: without its inclusion, or its share, the pooled evidence would decide alone."""
    term, most = _term(0, 10, 10), Share(0.9, 0.7, 1.0)
    for inclusion, share, answer in ((0.99, most, NEEDED), (0.9, most, UNTOLD), (0.99, NOTHING, UNTOLD)):
        assert replace(term, pooled=Pooled(inclusion, share, 1.0)).answer == answer


def test_lots_that_differ_leave_an_answer_open_that_alike_ones_do_not():
    alike, apart = (
        replace(_term(0, 0, 20), lots=tuple(InLot(k, 0, NOTHING, NOTHING) for k in counts))
        for counts in ((19, 20, 20), (18, 5, 20))
    )
    assert alike.answer == apart.answer == NEEDED
    assert could_change(apart) and not could_change(alike)


WORDS = ("needed", "not needed", "undecided", *sorted(CANNOT_TELL))


def test_unit_answers_yes_or_no_only_where_its_sessions_do_not_contradict_each_other():
    for verdicts in itertools.product(WORDS, repeat=3):
        found, sure = unit_answer(verdicts), {"needed", "not needed"}.intersection(verdicts)
        assert (found in {"needed", "not needed"}) == (len(sure) == 1), verdicts
        assert found == unit_answer(verdicts[::-1]) or found in CANNOT_TELL, verdicts
        assert found in verdicts or found == "undecided", verdicts


@pytest.mark.parametrize(
    ("answers", "pooled", "verdict"),
    [
        (["needed"] * 8, 1.0, "needed"),
        (["needed"] * 8, None, "needed"),
        (["needed"] * 7 + ["not needed"], 1.0, "needed"),
        (["needed"] * 2 + ["not needed"] * 6, 1.0, "some need it"),
        (["needed"] * 6 + ["not needed"] * 2, 0.4, "needed"),
        (["not needed"] * 5 + ["undecided"] * 3, 0.2, "not needed"),
        (["not needed"] * 5 + ["undecided"] * 3, 0.9, "undecided"),
        (["undecided"] * 6 + ["needed"] * 2, 0.99, "undecided"),
        (["unresolved"] * 8, 0.99, "needed"),
        (["unresolved"] * 8, 0.9, "cannot tell"),
        (["unresolved"] * 8, None, "cannot tell"),
    ],
)
def test_class_answers_as_most_of_its_units_do_and_all_of_them_together(answers, pooled, verdict):
    together = None if pooled is None else Pooled(pooled, Share(0.8, 0.6, 0.9), 1.0)
    assert class_need(answers, together).verdict == verdict
    few = together and replace(together, share=NOTHING)
    assert answers != ["unresolved"] * 8 or class_need(answers, few).verdict == "cannot tell"


def test_share_is_of_those_that_answer_and_its_interval_reaches_over_those_that_do_not():
    need = class_need(["needed"] * 3 + ["not needed"] + ["inseparable"] * 4, None)
    assert need.share.value == pytest.approx(0.75)
    assert need.share.low == pytest.approx(beta(3.5, 5.5).ppf(0.05))
    assert need.share.high == pytest.approx(beta(7.5, 1.5).ppf(0.95))
    nothing = class_need(["untested"] * 4, None)
    assert math.isnan(nothing.share.value) and (nothing.share.low, nothing.share.high) == (0.0, 1.0)
    assert sum(need.answers.values()) == 8
