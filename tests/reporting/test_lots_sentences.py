from dataclasses import replace

import pytest
from lots_found import lot_result

from imubayes.inference.intervals import Share
from imubayes.population.lots import Coverage
from imubayes.reporting.lots_sentences import (
    basic_sentences,
    check_sentences,
    class_sentences,
    contrast_sentence,
    contrasts,
    lots_answer,
    own_scene_sentences,
    scene_sentences,
)
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


def test_answer_says_who_needs_what_and_how_little_it_is_to_the_others(result):
    text = _plain(said.text for said in lots_answer(result))
    assert "Of 23 terms: consumer MEMS needs 9, cannot tell 3; tactical MEMS needs 9, cannot tell 3;" in text
    assert (
        "In the scene helicopter consumer MEMS and tactical MEMS need g_i and g_k; navigation FOG does not:"
        " in 95 % of the units each takes less than 0.30 % of the budget." in text
    )


def test_every_sentence_of_the_answer_has_its_numbers(result):
    anchors = [said.anchor for said in lots_answer(result)]
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


def test_scene_that_requires_nothing_says_so(result):
    assert scene_sentences(result, 1) == ("No class is shown to need any term.",)


def test_scene_in_which_noise_is_more_than_the_budget_says_so(result):
    loud = replace(result.classes[0].missions[0], noise_share=2.5, within=0.1)
    first = replace(result.classes[0], missions=(loud, *result.classes[0].missions[1:]))
    text = _plain(scene_sentences(replace(result, classes=(first, *result.classes[1:])), 0))
    assert "Noise alone is more than the budget: consumer MEMS (2.5 times the budget)." in text
    assert "For most units of consumer MEMS the test leaves more than the budget open" in text


def test_class_is_told_by_what_it_always_needs_never_needs_and_hides(result):
    found = result.classes[0]
    text = _plain(class_sentences(found, 23))
    assert text.startswith("The class needs b0, b1, b2, b0p, m_j, m_k, c_ij, g_i and g_k, 9 of 23 terms.")
    assert "Needed in 95 % of the units or more: b0, g_i and g_k." in text
    assert "Of 3 the tests cannot tell: c_jk, S_ij and S_kk." in text
    assert "A single unit needs 12 (3 to 14) (median, and 90 % of the units)" in text


def test_triad_is_short_where_it_leaves_more_than_the_budget(result):
    consumer, tactical, _ = basic_sentences(result)
    assert consumer.endswith("the triad is not enough in helicopter (3.0 times the budget).")
    assert tactical.endswith("the triad is enough in every scene.")


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
