"""What a class needs, and what published statements say of it."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lot_studies import record, small
from lots_found import counted, lot_result
from scipy.stats import beta

from imubayes.inference import Share
from imubayes.inference.mcmc.ensembles import Limits, Target, run_ensembles
from imubayes.population import Record, needs
from imubayes.population.lots import MissionTerm, lot_of, unit_of
from imubayes.population.needs import (
    BEYOND,
    CANNOT_TELL,
    CONFIRMED,
    CONTRADICTED,
    DECISION,
    NEEDED,
    NOT_NEEDED,
    UNTOLD,
    WOULD_MATTER,
    agreements,
    class_need,
    could_change,
    judged,
    of_class,
    unit_answer,
)
from imubayes.population.pooled import Pooled
from imubayes.population.spreads import InLot, PopulationTerm
from imubayes.selection.panel import Votes
from imubayes.sensors.catalogue import classes
from imubayes.sensors.catalogue_file import KINDS, packaged_tables
from imubayes.sensors.terms import library
from imubayes.units import factor

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
    answer = of_class(_term(needed, hidden, units))
    assert (answer == UNTOLD) == (2 * hidden >= units)
    if answer != UNTOLD:
        assert (answer == NEEDED) == (needed >= units - hidden - needed)


@given(COUNTS, st.floats(0.0, 1e4), st.floats(0.0, 1.0))
def test_what_the_tests_do_not_show_is_never_said_to_be_needed_in_a_scene(counts, share, required):
    term = _term(*counts)
    answer = _cell(term, share, required).answer
    if answer == NEEDED:
        assert of_class(term) == NEEDED
    if of_class(term) == UNTOLD:
        assert answer in (UNTOLD, WOULD_MATTER)
    if of_class(term) == NEEDED:
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
        assert of_class(replace(term, pooled=Pooled(inclusion, share, 1.0))) == answer


def test_lots_that_differ_leave_an_answer_open_that_alike_ones_do_not():
    alike, apart = (
        replace(_term(0, 0, 20), lots=tuple(InLot(k, 0, NOTHING, NOTHING) for k in counts))
        for counts in ((19, 20, 20), (18, 5, 20))
    )
    assert of_class(alike) == of_class(apart) == NEEDED
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


FOG, MEMS = "fog_navigation", "mems_consumer"


def test_statements_of_the_catalogue_are_about_its_classes_and_terms() -> None:
    for kind in KINDS:
        names = library(kind, set="extended", temperature=2, gradient_of=("b0",)).names
        known = {entry.id for entry in classes(kind)}
        own = [one for one in packaged_tables()["statement"] if one["kind"] == kind]
        assert len(own) >= (10 if kind == "gyroscope" else 5)
        for one in own:
            assert set(one["classes"]) <= known and set(one["terms"]) <= set(names)
            assert one["claims"] in ("needed", "small", "size", "open") and one["source"] and one["text"]
            assert bool(one.get("why")) == (not one["terms"]) == (one["claims"] == "open")
            assert ("range" in one) == (one["claims"] == "size") and len(one["terms"]) < 2 + 9 * (
                one["claims"] != "size"
            )
            if "range" in one:
                low, high, unit = one["range"]
                assert low <= high and factor(unit, like=unit) > 0.0


def told(monkeypatch, table, change=lambda one: one):
    """What the made-up study says of one statement, after its classes were changed."""
    whole = {"kind": "gyroscope", "text": "so it is", "source": "a book", **table}
    monkeypatch.setattr(needs, "packaged_tables", lambda: {"statement": [whole]})
    found = judged("gyroscope", [change(one) for one in lot_result().classes])
    return found[0] if found else None


@pytest.mark.parametrize(
    ("needed", "hidden", "verdict"), [(100, 0, CONFIRMED), (0, 0, CONTRADICTED), (0, 100, BEYOND)]
)
def test_term_that_is_said_to_be_needed(monkeypatch, needed, hidden, verdict) -> None:
    table = {"classes": [MEMS], "terms": ["g_i", "g_j"], "claims": "needed"}
    assert told(monkeypatch, table, lambda one: counted(one, needed, hidden)).verdict == verdict


@pytest.mark.parametrize(
    ("share", "most", "hidden", "verdict"),
    [
        (0.01, 0.05, 0, CONFIRMED),
        (0.2, 0.5, 0, CONTRADICTED),
        (0.2, 0.5, 100, BEYOND),
        (0.01, 0.5, 0, BEYOND),
    ],
)
def test_effect_that_is_said_to_be_none(monkeypatch, share, most, hidden, verdict) -> None:
    def change(one):
        shown = counted(one, 100 - hidden, hidden)
        scene = shown.missions[1]
        terms = tuple(replace(t, share=Share(share, share, share), most_of_budget=most) for t in scene.terms)
        quiet = tuple(replace(t, share=Share(0.0, 0.0, 0.0), most_of_budget=0.0) for t in scene.terms)
        missions = (replace(scene, terms=quiet), replace(scene, terms=terms))
        return replace(shown, missions=missions)

    found = told(monkeypatch, {"classes": [FOG], "terms": ["g_i"], "claims": "small"}, change)
    assert (found.verdict, found.sizes) == (verdict, {FOG: (share, most)})


@pytest.mark.parametrize(
    ("stated", "verdict"), [([0.1, 2.0], CONFIRMED), ([20.0, 30.0], CONTRADICTED), ([0.0, 1.0], CONTRADICTED)]
)
def test_size_that_is_said_is_one_that_units_can_have(monkeypatch, stated, verdict) -> None:
    dph = factor("deg/h/g", like="deg/h/g")
    lot = InLot(100, 0, Share(0.0, -3.0 * dph, dph), Share(2.0 * dph, 1.5 * dph, 4.0 * dph))

    def change(one):
        return replace(one, terms=tuple(replace(term, lots=(lot,)) for term in one.terms))

    table = {"classes": [MEMS], "terms": ["g_i"], "claims": "size", "range": [*stated, "deg/h/g"]}
    found = told(monkeypatch, table, change)
    assert found.verdict == verdict
    assert found.sizes[MEMS] == pytest.approx((1.5, 5.0))


def test_one_class_that_contradicts_is_enough_and_others_are_left_out(monkeypatch) -> None:
    table = {"classes": [MEMS, FOG, "rlg_navigation"], "terms": ["g_i"], "claims": "needed"}
    found = told(monkeypatch, table)
    assert found.classes == {MEMS: CONFIRMED, FOG: CONTRADICTED} and found.verdict == CONTRADICTED
    assert told(monkeypatch, {**table, "classes": ["rlg_navigation"]}) is None
    absent = told(monkeypatch, {**table, "terms": ["b0*dT"]})
    assert absent.verdict == BEYOND and absent.why == "no such term is in the study"


NAMES = ("b0", "b1", "b2", "b3")
SURE = ("needed", "needed", "not needed", "undecided")


def voted(keeps, truth, verdicts=SURE) -> Record:
    """A unit of sds of 1, about which the decision and BIC have voted on b0, b1, b2 and b3."""
    table = np.array([[1.0, 1.0, 0.0, 1.0], keeps])
    votes = Votes(NAMES, (DECISION, "bic"), table, table, ())
    return record(np.array(truth), verdicts=verdicts, votes=votes)


def test_a_planted_disagreement_is_counted_by_term_direction_and_truth():
    """BIC drops b1 twice, once of 20 sd; it keeps b2 once, of half a sd; b3 is left open."""
    units = [voted([1, 0, 1, 1], [9, 20, 0.5, 5]), voted([1, 0, 0, 0], [9, 2, 0.5, 9])]
    assert agreements([replace(units[0], votes=None)], NAMES) == ()
    decision, bic = agreements([*units, replace(units[0], votes=None)], NAMES)
    assert (decision.method, decision.share.value, decision.of) == (DECISION, 1.0, 6)
    assert (bic.units, bic.of, bic.share.value) == (2, 6, 0.5)
    assert (bic.drops, bic.keeps) == ({"b1": 2}, {"b2": 1})
    assert (bic.false, bic.missed) == ((1, 2), (2, 4))
    assert (decision.false, decision.missed) == ((0, 2), (0, 4))


def test_the_first_units_of_each_lot_are_asked_and_their_records_stay_what_they_were():
    study = small(methods=1)
    lot = lot_of(study, 0)
    asked, second = (unit_of(study, 0, number, lot) for number in range(2))
    alone = unit_of(replace(study, methods=0), 0, 0, lot)
    assert second.votes is None and alone.votes is None
    assert np.array_equal(asked.draws, alone.draws) and asked.verdicts == alone.verdicts
    methods = {one.method: one for one in agreements([asked, second], study.library.names)}
    assert {"bic", "loo", "stlsq", "collapsed"} <= methods.keys() and methods["bic"].units == 1
    assert 0.99 < asked.rhat < 1.05 and np.isnan(second.rhat)
    pulls = np.abs(asked.full_mean / asked.full_sd)
    told = dict(zip(asked.votes.terms, asked.votes.keeps[-1], strict=True))
    plain = {
        name: pull > 1.96 for name, pull in zip(study.library.names, pulls, strict=True) if abs(pull - 2) > 1
    }
    assert len(plain) > 4 and all(told[name] == kept for name, kept in plain.items() if name in told)


def test_chains_end_after_so_many_steps_whether_they_have_mixed_or_not():
    moves = ((None, 1.0),)
    target = Target(
        ("x",), lambda x: -0.5 * x[:, 0] ** 2, moves, lambda rng, n: rng.normal(size=(n, 1)), np.copy
    )
    found = run_ensembles(target, Limits(seed=1, steps=100)).found
    assert not found.converged and found.steps == 90  # a tenth is dropped
