"""What the residuals say: whether the model explains the data, and what it lacks."""

from __future__ import annotations

from dataclasses import replace

import pytest
from block_readings import panels, rows, said

from imubayes.reporting.fit_figures import channel_of, dependence_words
from imubayes.reporting.fit_views import (
    MOST_DEPENDENCES,
    dwell_sections,
    fit_sentence,
    found_sentence,
    misfit_sections,
    missing_sentence,
    nothing_sentence,
    predictive_sentence,
    temperature_sentence,
)
from imubayes.reporting.words import answer
from imubayes.sensors.terms import library


def test_answer_claims_a_fit_only_when_every_run_fits(make_sensor) -> None:
    good, bad = make_sensor(), make_sensor(misfit="centrifuge")
    assert "to the noise floor (residual over noise 1.02, white, p " in fit_sentence(good)
    assert (
        "does not explain run centrifuge (residual over noise 1.83, not white, p < 0.001, "
        "1 block stands out by up to 7 sd)" in answer(bad)[-1]
    )
    assert "tumble" not in fit_sentence(bad)


@pytest.mark.parametrize(
    ("scale", "p", "outliers", "words"),
    [
        (1.5, 0.4, (), "error bars are too small"),
        (1.0, 1e-5, (), "error bars are too small"),
        (0.7, 0.4, (), "error bars are wider than they need be"),
        (1.0, 0.4, ((1.0, 2.0, -9.0),), "1 block stands out by up to 9 sd"),
    ],
)
def test_each_way_of_not_fitting_has_its_own_consequence(make_sensor, scale, p, outliers, words: str) -> None:
    sensor = make_sensor(runs=("tumble",))
    check = replace(sensor.checks[0], scale=scale, whiteness_p=p, outliers=outliers, fits=False)
    assert words in fit_sentence(replace(sensor, checks=(check,)))


def test_residual_over_noise_of_all_runs_is_weighted_by_samples(make_sensor) -> None:
    sensor = make_sensor()
    runs = (replace(sensor.runs[0], samples=9), replace(sensor.runs[1], samples=1))
    checks = (replace(sensor.checks[0], scale=1.0), replace(sensor.checks[1], scale=2.0))
    # sqrt((9 * 1 + 1 * 4) / 10) = 1.14
    assert "residual over noise 1.14" in fit_sentence(replace(sensor, runs=runs, checks=checks))


def test_first_paragraph_says_where_something_is_missing_and_only_then(make_judged) -> None:
    sensor = make_judged()
    text = " ".join(answer(sensor))
    assert "Yet the data hold something the library does not contain" in text
    assert "T between heating and cooling in run tumble" in text
    assert "something the library does not contain" not in " ".join(answer(replace(sensor, misfit=None)))
    settled = replace(sensor.misfit, found=())
    assert "something the library does not contain" not in " ".join(answer(replace(sensor, misfit=settled)))
    assert "The data hold" in " ".join(answer(make_judged(misfit="centrifuge")))


def test_the_first_paragraph_answers_whether_a_polynomial_in_temperature_is_enough(make_judged) -> None:
    sensor = make_judged(lib=library("accelerometer", temperature=3, rate_of=()))
    terms = tuple(replace(term, verdict="needed") for term in sensor.selection.terms)
    sensor = replace(sensor, selection=replace(sensor.selection, terms=terms))
    assert temperature_sentence(sensor) == (
        f"{sensor.id}: a polynomial of degree 3 in T is not enough: it leaves 28 µg rms in T between heating"
        " and cooling in run tumble."
    )
    assert temperature_sentence(sensor) in answer(sensor)
    settled = replace(sensor, misfit=replace(sensor.misfit, found=()))
    assert "a polynomial of degree 3 in T is enough" in temperature_sentence(settled)
    blind = replace(sensor, misfit=replace(sensor.misfit, found=(), dependences=()))
    assert temperature_sentence(blind) == ""
    assert temperature_sentence(make_judged()) == ""


def test_a_residual_s_title_and_the_sentences_on_what_is_missing_are_one_decision(make_judged) -> None:
    """What is drawn as found is in the sentence on what is missing, and not in that on what is not."""
    sensor = make_judged()
    some = sensor.misfit
    assert some.found
    none = replace(some, found=(), dependences=[replace(one, p=0.4) for one in some.dependences])
    for misfit in (some, none):
        (section,) = misfit_sections(replace(sensor, misfit=misfit), "k", drawn=True)
        text, nothing, figure = section.blocks
        titles = [panel.title for panel in figure.panels]
        assert len(titles) == (min(len(misfit.found), MOST_DEPENDENCES) or 1)
        for title, one in zip(titles, misfit.found or misfit.dependences[:1], strict=False):
            where = dependence_words(one)
            assert title.startswith(f"{where}: ") and (where in str(text.texts)) is bool(misfit.found)
            assert (f"{channel_of(one)} (p" in str(nothing.texts)) is (not misfit.found)


def test_missing_sentence_counts_what_it_does_not_name(make_judged) -> None:
    misfit = make_judged().misfit
    loop = misfit.found[0]
    many = tuple(replace(loop, input=name) for name in ("f_i", "f_j", "f_k", "t", "w_i"))
    told = missing_sentence(replace(misfit, found=many), fits=False)
    assert told.endswith("it shows in f_i in run tumble; f_j in run tumble; f_k in run tumble and 2 more.")
    assert dependence_words(many[3]) == "time in run tumble"
    assert dependence_words(replace(loop, input="hysteresis of f_i")) == (
        "f_i between rising and falling in run tumble"
    )


def test_what_is_missing_is_said_in_printed_units_where_it_shows(make_judged) -> None:
    misfit = make_judged().misfit
    told = found_sentence(misfit, "accelerometer")
    assert told.endswith("it shows in T between heating and cooling in run tumble (28 µg rms).")
    assert found_sentence(replace(misfit, found=(), text="Nothing."), "accelerometer") == "Nothing."


def test_residuals_of_a_size_that_the_posterior_does_not_predict_are_named(make_judged) -> None:
    misfit = make_judged().misfit
    assert predictive_sentence(misfit).endswith("of the size of those seen (p 0.30).")
    odd = predictive_sentence(replace(misfit, predictive_p={"tumble": 2e-4, "centrifuge": 0.4}))
    assert odd.endswith("of another size in tumble (p below 0.001).")
    assert predictive_sentence(replace(misfit, predictive_p={})) == ""


def test_inputs_against_which_nothing_is_left_are_those_that_the_tests_acquit(make_judged) -> None:
    """What a sentence says of an input, the sentence on what is missing and the figure are one decision."""
    misfit = make_judged().misfit
    assert nothing_sentence(misfit) == "Nothing is left beyond chance against f_i (p 0.40)."
    # one that goes with another is neither found nor nothing
    other = replace(misfit.found[0], input="T")
    assert nothing_sentence(replace(misfit, found=(), dependences=(other,))) == ""


def test_what_is_found_is_drawn_else_the_input_against_which_most_is_left(make_judged) -> None:
    sensor = make_judged()
    (found,) = panels(misfit_sections(sensor, "s1", drawn=True))
    assert found.title.startswith("T between heating and cooling") and "28 µg rms, 41% of" in found.title
    settled = replace(sensor, misfit=replace(sensor.misfit, found=()))
    assert len(panels(misfit_sections(settled, "s1", drawn=True))) == 1
    assert not panels(misfit_sections(sensor, "s1", drawn=False))


@pytest.mark.parametrize(("kind", "si"), [("accelerometer", 9.80665e-6), ("gyroscope", 4.84813681109536e-6)])
def test_offset_of_a_dwell_is_in_the_unit_of_the_output(make_sampled, kind, si) -> None:
    sensor = make_sampled()
    dwell = replace(sensor.distrusted[0], offset=120.0 * si, sd=3.0 * si)
    (row,) = rows(dwell_sections(replace(sensor, kind=kind, distrusted=(dwell,))))
    assert row[-1].startswith("120.0 ± 3.0 ")


def test_long_list_of_dwells_is_cut_and_counted(make_sampled) -> None:
    sensor = make_sampled()
    found = list(dwell_sections(replace(sensor, distrusted=sensor.distrusted * 30)))
    assert 0 < len(rows(found)) < 60 and f"{60 - len(rows(found))} more are in result.json" in said(found)
