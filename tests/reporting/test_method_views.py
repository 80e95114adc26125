from __future__ import annotations

import json
from dataclasses import replace

import pytest
from block_readings import panels, said, words
from page_reading import printed

from imubayes.reporting.document import report_html
from imubayes.reporting.method_views import (
    MOST_DISAGREEMENTS,
    criterion_row,
    methods_sections,
    misfit_sections,
    sparse_row,
)
from imubayes.reporting.results import result_json
from imubayes.reporting.tables import terminal_summary
from imubayes.selection.panel import Unasked


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
    told = said(methods_sections(sensor, panel, "s1", drawn=True))
    assert "Dwell left out: too many subsets, −3 nats." in told


def test_columns_of_a_triad_are_printed_by_their_own_names(make_judged) -> None:
    sparse = make_judged().panel.sindy[0]
    far = replace(sparse, model=("ay.b0", "ay.b2"), stable=("ay.b0",))
    row = sparse_row(far, ("b0", "b1"), {"ay.b0": "b0", "ay.b2": "b2"})
    assert row[1:3] == ("+ b2, − b1", "− b1")


def test_figures_are_drawn_only_where_the_component_has_figures(make_judged) -> None:
    sensor = make_judged()
    drawn, plain = (list(methods_sections(sensor, sensor.panel, "s1", drawn=some)) for some in (True, False))
    # votes, two paths, prior widths, the reduced model
    assert len(panels(drawn)) == 5 and not panels(plain)
    assert f"{panels(drawn)[0].title}." in said(plain)
    own, shared = (list(misfit_sections(sensor, "s1", drawn=some)) for some in (True, False))
    assert len(panels(own)) == 1 and not panels(shared) and said(own).startswith(said(shared))


def test_inclusion_over_widths_is_a_sentence_where_no_verdict_hangs_on_it(make_judged) -> None:
    sensor = make_judged()
    settled = tuple(
        replace(t, verdict="needed") if t.verdict == "undecided" else t for t in sensor.selection.terms
    )
    sensor = replace(sensor, selection=replace(sensor.selection, terms=settled))
    panel = replace(sensor.panel, sensitivity=replace(sensor.panel.sensitivity, swing=()))
    sections = {one.title: [one] for one in methods_sections(sensor, panel, "s1", drawn=True)}
    prior = sections["How much the prior matters"]
    assert not panels(prior) and said(prior).startswith("No verdict depends on the prior")


def test_many_disagreements_are_counted(make_judged) -> None:
    sensor = make_judged()
    votes = sensor.panel.votes
    many = tuple(replace(votes.disagreements[0], text=f"reason {k}") for k in range(MOST_DISAGREEMENTS + 3))
    panel = replace(sensor.panel, votes=replace(votes, disagreements=many))
    told = said(methods_sections(sensor, panel, "s1", drawn=True))
    assert told.count("Reason ") == MOST_DISAGREEMENTS and "3 more are in result.json." in told


def test_component_without_other_methods_has_no_section_on_them(make_sensor, make_study) -> None:
    html = report_html(make_study(make_sensor()))
    assert "What other methods say" not in html and "Does the library miss something?" not in html


@pytest.mark.parametrize("many", [False, True])
def test_report_holds_what_the_methods_say_in_the_section_on_the_choice(
    make_judged, make_study, many
) -> None:
    sensors = [make_judged(f"ACC-{k}") for k in range(13 if many else 1)]
    html = report_html(make_study(*sensors))
    assert html.count("What other methods say") == html.count("How much the prior matters") == len(sensors)
    assert html.count("A row a term, a column a method") == (3 if many else 1)
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
