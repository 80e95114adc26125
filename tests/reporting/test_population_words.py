from __future__ import annotations

from dataclasses import replace

from populations_found import class_found, term_found

from imubayes.inference.intervals import Share
from imubayes.reporting.population_words import class_sentences, resolved, spread_text


def said(found) -> str:
    return " ".join(class_sentences(found))


def test_findings_are_said_in_the_order_of_need_doubt_spread_and_turn_on() -> None:
    text = said(class_found())
    parts = (
        "8 accelerometers of class mems_consumer, in 3 sessions.",
        "The class needs b0.",
        "It does not need ax.m_j.",
        "This test cannot tell of c_jj (seen only in combination): more units do not change that.",
        "From unit to unit (sd) b0 differs by",
        "From one session to the next b0 changes by",
        "The rest comes back within the error bars: the sd between sessions is ax.m_j below",
        "Of the variance between sessions all units have in common, as temperature would make it: 90 % (60",
    )
    places = [text.find(part) for part in parts]
    assert -1 not in places and places == sorted(places), parts[places.index(-1)] if -1 in places else text


def test_sessions_in_which_all_units_are_off_are_named_with_their_sizes() -> None:
    text = said(class_found())
    assert "of ax.b0 (1 of 3 sessions off their mean: session friday by -1530 +- 190 ug)" in text


def test_sessions_that_agree_better_than_by_chance_are_a_finding_on_the_error_bars() -> None:
    found = class_found()
    steady = replace(found.terms[3], spreads=replace(found.terms[3].spreads, p_value=0.9995))
    said_of = "The sessions of ax.m_j agree better than by chance"
    assert said_of in said(replace(found, terms=(*found.terms[:3], steady, *found.terms[4:])))
    assert said_of not in said(found)


def test_axes_with_different_answers_are_named_one_by_one() -> None:
    found = class_found()
    other = replace(found.terms[2], need=replace(found.terms[2].need, verdict="not needed"))
    text = said(replace(found, terms=(*found.terms[:2], other, *found.terms[3:])))
    assert "The class needs ax.b0." in text and "It does not need az.b0 and ax.m_j." in text


def test_units_of_one_session_each_do_not_tell_of_turn_on() -> None:
    text = said(class_found(sessions=("",)))
    assert "sessions" not in text and "both what a unit is and what a turn-on does" in text


def test_spread_that_may_be_nothing_is_printed_as_a_limit_no_smaller_than_it_is() -> None:
    assert not resolved(Share(1.0, 0.1, 3.0)) and resolved(Share(1.0, 0.5, 3.0))
    assert spread_text(Share(1.0, 0.1, 3.01), "ug", 1.0, there=False) == "below 3.1 ug"


def test_terms_of_which_no_unit_tells_are_not_said_to_spread() -> None:
    found = class_found()
    silent = tuple(term_found(name, verdict="cannot tell") for name in ("c_jj", "c_kk"))
    text = said(replace(found, terms=silent, components=("",)))
    assert "c_jj and c_kk" in text and "From unit to unit" not in text
