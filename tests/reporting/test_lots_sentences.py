import re
from dataclasses import replace

import pytest
from lots_found import SIZES, lot_result

from imubayes.inference.intervals import Share
from imubayes.population.lots import Against, Coverage
from imubayes.population.needs import NEEDED, NOT_NEEDED, UNTOLD, terms_of
from imubayes.reporting.lots_sentences import (
    check_sentences,
    class_sentences,
    contrast_sentence,
    contrasts,
    lots_answer,
    own_scene_sentences,
    scene_sentences,
)
from imubayes.reporting.lots_words import MOST_WORDS, headline, simulated, status
from imubayes.reporting.rounding import NARROW


@pytest.fixture(scope="module")
def result():
    return lot_result()


def _plain(texts) -> str:
    return " ".join(texts).replace(NARROW, " ")


def test_classes_that_need_the_same_terms_are_told_from_those_that_do_not(result):
    (one,) = contrasts(result, 0)
    assert one.terms == ("g_i", "g_k")
    assert one.needing == ("consumer MEMS", "tactical MEMS")
    assert (one.without, one.between) == (("navigation FOG",), ())
    # the least of 1.0 and 0.3, and the 95 % point over units of the only class that does not need them
    assert (one.least, one.most) == (0.3, pytest.approx(0.003))


def test_every_sentence_of_the_answer_has_its_numbers(result):
    anchors = [anchor for _, anchor in lots_answer(result)]
    assert anchors == ["needed-terms", "needed-terms", "scene-helicopter", "basic", "check"]
    assert len(lots_answer(lot_result(basic=False))) == 4


def test_class_in_which_some_units_come_near_the_budget_is_in_between(result):
    scene = result.classes[2].missions[0]
    near = tuple(replace(term, share=replace(term.share, high=0.5)) for term in scene.terms)
    last = replace(result.classes[2], missions=(replace(scene, terms=near), *result.classes[2].missions[1:]))
    (one,) = contrasts(replace(result, classes=(*result.classes[:2], last)), 0)
    assert (one.without, one.between) == ((), ("navigation FOG",))
    assert (
        contrast_sentence(one)
        == "consumer MEMS and tactical MEMS need g_i and g_k; in between: navigation FOG."
    )


def test_scene_in_which_noise_is_more_than_the_budget_says_so(result):
    loud = replace(result.classes[0].missions[0], noise_share=2.5, within=0.1)
    first = replace(result.classes[0], missions=(loud, *result.classes[0].missions[1:]))
    text = _plain(scene_sentences(replace(result, classes=(first, *result.classes[1:])), 0))
    assert "Noise alone is more than the budget: consumer MEMS (2.5 times the budget)." in text
    assert "For most units of consumer MEMS the test leaves more than the budget open" in text


@pytest.mark.parametrize(
    ("recall", "coverage", "said"),
    [
        (0.97, 0.90, "Both reach the 0.95 that was asked of them."),
        (0.90, 0.90, "Not both reach the 0.95"),
        (0.97, 0.80, "which this is outside of"),
    ],
)
def test_check_is_passed_only_where_it_is(result, recall, coverage, said):
    check = replace(
        result.check,
        untold=7,
        recall=Share(recall, 0.8, 1.0),
        population_spread=Coverage(33, 40, Share(coverage, coverage - 0.1, coverage + 0.05)),
    )
    text = _plain(check_sentences(replace(result, check=check)))
    assert said in text
    assert ("outside" in text) == (coverage < 0.86)
    assert "Of 7 more cells the tests cannot tell." in text
    assert "population spread in 33 of 40 cases" in text and "population mean in 27 of 33 cases" in text


def test_class_whose_tests_leave_a_term_open_is_not_said_to_do_without_it(result):
    last = result.classes[2]
    hidden = replace(last, terms=tuple(replace(term, open=0.9) for term in last.terms))
    (one,) = contrasts(replace(result, classes=(*result.classes[:2], hidden)), 0)
    assert (one.without, one.untold, one.between) == ((), ("navigation FOG",), ())
    assert contrast_sentence(one).endswith("; of navigation FOG the test cannot tell.")


def test_term_that_no_unit_is_shown_to_need_is_not_needed_however_many_models_have_it(result):
    every = tuple(
        replace(
            one,
            terms=tuple(replace(t, needed=Share(0.0, 0.0, 0.2), open=1.0) for t in one.terms),
            missions=tuple(
                replace(m, terms=tuple(replace(t, required=1.0) for t in m.terms)) for m in one.missions
            ),
        )
        for one in result.classes
    )
    dark = replace(result, classes=every)
    assert contrasts(dark, 0) == ()
    first, second, *_ = scene_sentences(dark, 0)
    assert first == "No class is shown to need any term."
    assert second.startswith(
        "The tests cannot tell, and by the catalogue it would matter: consumer MEMS b0, b1"
    )
    assert "needs no term; by the catalogue b0" in " ".join(class_sentences(every[0], 23))


def test_terms_of_the_class_and_size_of_a_unit_s_model_are_told_apart(result):
    found = result.classes[0]
    scene = replace(found.missions[0], within=0.5, order=Share(1.5, 0.0, 4.0))
    text = _plain(own_scene_sentences(found, scene))
    assert text.startswith("The class needs g_i and g_k here (2): its tests show them,")
    assert "by the catalogue it would matter: S_kk." in text
    assert "Counted unit by unit, the smallest model has 1.5 (0 to 4) terms" in text
    assert "50 % of the units have a model that stays within the budget with 95 %; of the others" in text


FOG_OR_MEMS = Against(("fog_navigation",), ("mems_consumer", "mems_tactical"))
MEMS_OR_FOG = Against(("mems_consumer", "mems_tactical"), ("fog_navigation",))


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
    text = headline(_asking(result, asks))[0]
    assert len(text.split()) <= MOST_WORDS
    assert any(name in re.findall(r"\w+", text) for name in result.study.library.names)
    assert text.endswith(".") and ".." not in text


def test_what_all_classes_need_comes_before_what_some_do(result):
    shared = _with(result, 2, b0=1.0, b1=1.0)
    text = headline(shared)[0]
    assert text.startswith("Every class needs b0 and b1. Consumer MEMS and tactical MEMS need b2, b0p, m_j,")


def test_scenes_are_asked_of_half_of_the_classes(result):
    text = headline(_asking(result, "scenes"))[0]
    assert (
        text == "Of half of the classes or more: helicopter requires g_i and g_k. Fixed wing requires none."
    )


def test_triad_falls_short_where_it_leaves_more_than_the_budget(result):
    assert headline(_asking(result, "triad"))[0].replace("\xa0", " ") == (
        "In 5 of 6 pairs of class and scene, yes. In 1, no: consumer MEMS in helicopter (3.0 times the"
        " budget). There g_i and g_k are needed too."
    )


def test_term_that_one_class_needs_and_the_others_are_shown_to_do_without_is_the_answer(result):
    fog = _with(result, 2, c_kk=1.0)
    assert headline(_asking(fog, FOG_OR_MEMS))[0].startswith(
        "Navigation FOG needs c_kk, and MEMS does not. Some MEMS need b0, b1, b2, b0p, m_k, c_ij, g_i and"
        " g_k, and navigation FOG does not. Some MEMS need m_j; of navigation FOG the tests cannot tell."
    )


def test_term_that_others_may_need_too_is_no_difference(result):
    assert headline(_asking(result, FOG_OR_MEMS))[0].startswith(
        "None is shown to be needed by navigation FOG alone."
    )


def test_counts_of_the_first_screen_are_those_of_the_classes(result):
    counted = re.findall(r"needs (\d+), cannot tell (\d+)", lots_answer(result)[1][0])
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
