import re
from dataclasses import replace

import pytest
from lots_found import SIZES, lot_result

from imubayes.inference.intervals import Share
from imubayes.population.lots import Against
from imubayes.population.needs import NEEDED, NOT_NEEDED, UNTOLD, terms_of
from imubayes.reporting.lots_sentences import lots_answer
from imubayes.reporting.lots_words import MOST_WORDS, headline, simulated, status

FOG_OR_MEMS = Against(("fog_navigation",), ("mems_consumer", "mems_tactical"))
MEMS_OR_FOG = Against(("mems_consumer", "mems_tactical"), ("fog_navigation",))


@pytest.fixture(scope="module")
def result():
    return lot_result()


def _asking(result, asks):
    return replace(result, study=replace(result.study, asks=asks))


def _with(result, k, **answers):
    """The k-th class with other shares of units that need a term."""
    one = result.classes[k]
    terms = tuple(
        replace(t, needed=Share(answers[t.name], 0.0, 1.0), open=0.0) if t.name in answers else t
        for t in one.terms
    )
    classes = list(result.classes)
    classes[k] = replace(one, terms=terms)
    return replace(result, classes=tuple(classes))


@pytest.mark.parametrize("asks", ["classes", "scenes", "triad", FOG_OR_MEMS, MEMS_OR_FOG])
def test_answer_names_terms_in_no_more_words_than_it_may_have(result, asks):
    text = headline(_asking(result, asks)).text
    assert len(text.split()) <= MOST_WORDS
    assert any(name in re.findall(r"\w+", text) for name in result.study.library.names)
    assert text.endswith(".") and ".." not in text


def test_what_all_classes_need_comes_before_what_some_do(result):
    shared = _with(result, 2, b0=1.0, b1=1.0)
    text = headline(shared).text
    assert text.startswith("Every class needs b0 and b1. Consumer MEMS and tactical MEMS need b2, b0p, m_j,")


def test_scenes_are_asked_of_half_of_the_classes(result):
    text = headline(_asking(result, "scenes")).text
    assert (
        text == "Of half of the classes or more: helicopter requires g_i and g_k. Fixed wing requires none."
    )


def test_triad_falls_short_where_it_leaves_more_than_the_budget(result):
    assert headline(_asking(result, "triad")).text.replace("\xa0", " ") == (
        "In 5 of 6 pairs of class and scene, yes. In 1, no: consumer MEMS in helicopter (3.0 times the"
        " budget). There g_i and g_k are needed too."
    )


def test_term_that_one_class_needs_and_the_others_are_shown_to_do_without_is_the_answer(result):
    fog = _with(result, 2, c_kk=1.0)
    assert headline(_asking(fog, FOG_OR_MEMS)).text.startswith(
        "Navigation FOG needs c_kk, and MEMS does not. Some MEMS need b0, b1, b2, b0p, m_k, c_ij, g_i and"
        " g_k, and navigation FOG does not. Some MEMS need m_j; of navigation FOG the tests cannot tell."
    )


def test_term_that_others_may_need_too_is_no_difference(result):
    assert headline(_asking(result, FOG_OR_MEMS)).text.startswith(
        "None is shown to be needed by navigation FOG alone."
    )


def test_counts_of_the_first_screen_are_those_of_the_classes(result):
    counted = re.findall(r"needs (\d+), cannot tell (\d+)", lots_answer(result)[1].text)
    assert counted == [
        (str(len(terms_of(one, NEEDED))), str(len(terms_of(one, UNTOLD)))) for one in result.classes
    ]
    sums = [sum(len(terms_of(one, a)) for one in result.classes) for a in (NEEDED, NOT_NEEDED, UNTOLD)]
    assert [int(n) for n in re.findall(r"(\d+) (?:not needed|needed|cannot tell)", status(result))] == sums
    assert sum(sums) == len(SIZES) * len(result.study.library.names)


def test_one_class_is_not_each_of_several(result):
    assert status(replace(result, classes=result.classes[:1])).endswith(" terms of 1 class)")
    assert status(result).endswith(f" terms of each of {len(result.classes)} classes)")


def test_first_screen_says_that_it_is_simulated_from_how_many_and_how_far_that_goes(result):
    sure = replace(
        result,
        study=replace(result.study, units=1000),
        classes=tuple(
            replace(one, terms=tuple(replace(t, needed=Share(1.0, 0.9, 1.0), open=0.0) for t in one.terms))
            for one in result.classes
        ),
    )
    assert simulated(sure).startswith("Simulated: one lot of 1000 gyroscopes of each class. With other units")
    assert " 0 of the 69 answers could change" in simulated(sure)
    assert " 0 of the 69" not in simulated(result)
