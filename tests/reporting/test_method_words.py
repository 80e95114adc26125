from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from imubayes.reporting.method_words import (
    decided,
    dependence_words,
    depending,
    disagreement_sentences,
    found_sentence,
    missing_sentence,
    predictive_sentence,
    prior_sentence,
    reduced_sentence,
    temperature_sentence,
    votes_title,
)
from imubayes.reporting.words import answer
from imubayes.selection.verdicts import EQUAL, Costs
from imubayes.selection.votes import Votes
from imubayes.sensors.terms import library


def _votes(keeps: list[list[float]]) -> Votes:
    """Votes of a method a row on the terms b0, b1, ... of its columns."""
    table = np.array(keeps)
    methods, terms = (
        tuple(f"{letter}{k}" for k in range(n)) for letter, n in zip("mb", table.shape, strict=True)
    )
    return Votes(terms, methods, table, table, ())


NAN = float("nan")


@pytest.mark.parametrize(
    ("keeps", "title"),
    [
        ([[1, 1, 0], [1, 1, 0]], "All 2 methods keep the same 2 terms"),
        ([[1, 1, 0], [1, 0, 0]], "All 2 methods keep 1 term in common; 1 of 2 keep b1"),
        ([[1, 1, 0], [1, 0, NAN]], "All 2 methods keep 1 term in common; 1 of 2 keep b1"),
        ([[0, 1, 0], [1, 0, 0]], "All 2 methods keep no terms in common; they differ on b0 and b1"),
        ([[1, 1, 1, 1, 1], [1, 0, 0, 0, 0]], "All 2 methods keep 1 term in common; they differ on 4 others"),
        ([[1, 1, 0], [NAN, NAN, NAN], [1, 1, 0]], "All 2 methods keep the same 2 terms"),
        ([[0, 0], [0, 0]], "All 2 methods keep no terms"),
    ],
)
def test_title_counts_what_methods_share_and_names_what_they_do_not(keeps, title) -> None:
    assert votes_title(_votes(keeps), SimpleNamespace(terms=(), model=()), {}) == title


def test_terms_that_the_test_cannot_tell_are_no_disagreement_but_counted(make_judged) -> None:
    sensor = make_judged()
    votes = sensor.panel.votes
    assert votes_title(votes, sensor.selection, {}) == (
        "All 14 methods keep 5 terms in common; 3 of 14 keep b3; the test cannot tell 3 more"
    )
    keeps = votes.keeps.copy()
    keeps[0, votes.terms.index("c_jj")] = 1.0
    assert votes_title(replace(votes, keeps=keeps), sensor.selection, {}) == votes_title(
        votes, sensor.selection, {}
    )


def test_disagreements_on_what_the_test_cannot_tell_are_put_together(make_judged) -> None:
    sensor = make_judged()
    votes = sensor.panel.votes
    (weak,) = votes.disagreements
    more = [replace(weak, term=name, methods=("evidence",), text="long") for name in ("c_jj", "c_kk", "c_jk")]
    said = disagreement_sentences(replace(votes, disagreements=(*more, weak)), sensor.selection)
    assert said == (
        "AIC, WAIC, SR3 keep b3: 0.1 sd from zero.",
        "Evidence keeps c_jj and c_kk, which the test sees only in combination with others.",
        "Evidence keeps c_jk, which the noise hides.",
    )


def test_methods_are_held_against_what_the_decision_keeps_and_can_tell(make_judged) -> None:
    selection = make_judged().selection
    assert decided(selection) == ("b0", "b1", "b2", "m_j", "m_k")
    likely = replace(selection, model=(*selection.model, "c_jj", "c_ij", "b0p"))
    # c_jj is inseparable and c_ij untested; b0p is undecided
    assert decided(likely) == ("b0", "b1", "b2", "m_j", "m_k", "b0p")


def test_terms_that_hang_on_the_prior_are_those_that_swing_or_are_undecided(make_judged) -> None:
    sensor = make_judged()
    found = sensor.panel.sensitivity
    names = [found.names[j] for j in depending(found, sensor.selection, {})]
    # b0p is undecided, b3 swings; b0p goes over the wider range
    assert names == ["b0p", "b3"]
    assert np.ptp(found.inclusion[:, found.names.index("b0p")]) > np.ptp(
        found.inclusion[:, found.names.index("b3")]
    )


def test_prior_sentence_says_which_terms_move_over_which_thresholds(make_judged) -> None:
    found = make_judged().panel.sensitivity
    assert "b3 crosses a threshold of inclusion (0.05, 0.5 or 0.95)." in prior_sentence(found, EQUAL, {})
    dear = prior_sentence(found, Costs(false_keep=1.0, false_drop=4.0), {})
    assert "or 0.83)" in dear  # 19 / (19 + 4)
    assert "differs on" not in prior_sentence(replace(found, g_prior=found.inclusion[4]), EQUAL, {})
    still = prior_sentence(replace(found, swing=()), EQUAL, {})
    assert still.startswith("No verdict depends on the prior")


def test_g_prior_that_thinks_otherwise_is_named_and_one_that_cannot_is_excused(make_judged) -> None:
    found = make_judged().panel.sensitivity
    other = found.inclusion[4].copy()
    other[0], other[-1] = 0.02, np.nan
    told = prior_sentence(replace(found, g_prior=other, left_out=(found.names[-1],)), EQUAL, {})
    assert "differs on b0." in told and f"cannot have {found.names[-1]}," in told


def test_reduced_model_is_said_in_printed_units(make_judged) -> None:
    sensor = make_judged()
    told = reduced_sentence(sensor.panel.reduced, sensor.kind)
    # 9e-4 * 0.2^4 and 2e-6 m/s^2, of 9.80665e-6 each
    assert "4 terms predict" in told and "lose 0.15 µg rms, of 0.20 µg" in told
    one = reduced_sentence(replace(sensor.panel.reduced, terms=("b0",)), sensor.kind)
    assert one.startswith("1 term predicts") and "b0 loses 0.15" in one
    nothing = replace(sensor.panel.reduced, terms=(), lost=1e-6)
    assert reduced_sentence(nothing, sensor.kind).startswith("No term is worth keeping")


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
