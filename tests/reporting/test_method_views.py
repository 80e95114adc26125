from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from block_readings import rows, said, words
from page_reading import printed

from imubayes.reporting.document import report_html
from imubayes.reporting.method_views import (
    MOST_DISAGREEMENTS,
    criterion_row,
    decided,
    disagreement_sentences,
    methods_sections,
    prior_sentence,
    reduced_sentence,
    sparse_row,
    vote_table,
    votes_title,
)
from imubayes.reporting.results import result_json
from imubayes.reporting.tables import terminal_summary
from imubayes.selection.panel import Unasked
from imubayes.selection.verdicts import EQUAL, Costs
from imubayes.selection.votes import Votes


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


def test_every_vote_has_its_mark_and_what_the_decision_does_not_share_stands_out(make_judged) -> None:
    sensor = make_judged()
    votes = sensor.panel.votes
    table = vote_table(votes, sensor.selection, {})
    found = {row[0]: row[1:] for row in rows([table])}
    assert list(found) == list(votes.terms)
    apart = {
        (votes.methods[k], name) for name, row in found.items() for k, one in enumerate(row) if "≠" in one
    }
    assert apart == {("aic", "b3"), ("waic", "b3"), ("sr3", "b3")}
    marks = {"●": 1.0, "○": 0.0}
    for name, (*cells, word) in found.items():
        keeps = votes.keeps[:, votes.terms.index(name)]
        told = [marks.get(one[-1], np.nan) for one in cells]
        np.testing.assert_array_equal(told, keeps)
        assert word.endswith({t.name: t.verdict for t in sensor.selection.terms}[name])


def test_criteria_are_printed_as_their_difference_from_the_decision(make_judged) -> None:
    panel = make_judged().panel
    decided = ("b0", "b1", "b2", "m_j", "m_k")
    rows = {one.name: tuple(map(words, criterion_row(one, decided, {}))) for one in panel.criteria}
    assert rows["aic"][:2] == ("AIC", "+ b3")
    assert rows["bic"][1:] == ("as decided", "−8,102.0", "4.5", "412", "all 2^10")
    assert rows["loo"][-2:] == ("–", "1,024 likely ones")


def test_criterion_that_was_not_compared_has_no_model(
    make_judged,
) -> None:
    loo = next(one for one in make_judged().panel.criteria if one.name == "loo")
    one = replace(loo, compared=0, note="too many subsets, -3 nats")
    none = criterion_row(one, ("b0",), {})
    assert (none[1], none[-1]) == ("–", "none")
    sensor = make_judged()
    panel = replace(sensor.panel, criteria=(one,))
    told = said(methods_sections(sensor, panel, drawn=True))
    assert "Dwell left out: too many subsets, −3 nats." in told


def test_columns_of_a_triad_are_printed_by_their_own_names(make_judged) -> None:
    sparse = make_judged().panel.sindy[0]
    far = replace(sparse, model=("ay.b0", "ay.b2"), stable=("ay.b0",))
    row = sparse_row(far, ("b0", "b1"), {"ay.b0": "b0", "ay.b2": "b2"})
    assert row[1:3] == ("+ b2, − b1", "− b1")


def test_many_disagreements_are_counted(make_judged) -> None:
    sensor = make_judged()
    votes = sensor.panel.votes
    many = tuple(replace(votes.disagreements[0], text=f"reason {k}") for k in range(MOST_DISAGREEMENTS + 3))
    panel = replace(sensor.panel, votes=replace(votes, disagreements=many))
    told = said(methods_sections(sensor, panel, drawn=True))
    assert told.count("Reason ") == MOST_DISAGREEMENTS and "3 more are in result.json." in told


@pytest.mark.parametrize("many", [False, True])
def test_report_holds_what_the_methods_say_in_the_section_on_the_choice(
    make_judged, make_study, many
) -> None:
    sensors = [make_judged(f"ACC-{k}") for k in range(13 if many else 1)]
    html = report_html(make_study(*sensors))
    assert html.count("What other methods say") == html.count("How much the prior matters") == len(sensors)
    assert html.count("● a term in the method") == (3 if many else 1)
    places = [
        html.index(text)
        for text in ('id="s1-tell"', "At least one of c_jj and c_kk", 'id="s1-fit"', "Does the library miss",
                     'id="s1-choice"', "What other methods say", "AIC, WAIC, SR3 keep b3",
                     "The smallest model that predicts", 'id="s1-posterior"')
    ]  # fmt: skip
    assert places == sorted(places)
    assert 'class="answer misfit"' in html


def test_opinion_that_could_not_be_had_is_named_in_report_terminal_and_file(make_judged, make_study) -> None:
    sensor = make_judged()
    unasked = (Unasked("ssr", "ValueError, <nothing> to drop"), Unasked("reduced model", "no room"))
    panel = replace(sensor.panel, sindy=sensor.panel.sindy[:2], reduced=None, unasked=unasked)
    result = make_study(replace(sensor, panel=panel))
    html = report_html(result)
    assert (
        "Left out: SSR (ValueError, &lt;nothing&gt; to drop)." in html and "Left out: reduced model" in html
    )
    assert "Left out: SSR (ValueError, <nothing> to drop)." in printed(terminal_summary(result))
    (written,) = json.loads(result_json(result))["sensors"]
    assert written["reduced"] is None and set(written["sindy"]) == {"stlsq", "sr3"}
    assert written["unasked"][0] == {"method": "ssr", "reason": "ValueError, <nothing> to drop"}
