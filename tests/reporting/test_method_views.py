from __future__ import annotations

import json
from dataclasses import replace

import pytest
from page_reading import printed

from imubayes.reporting.document import report_html
from imubayes.reporting.method_views import (
    MOST_DISAGREEMENTS,
    beside_view,
    criterion_row,
    methods_view,
    sparse_row,
)
from imubayes.reporting.results import result_json
from imubayes.reporting.tables import terminal_summary
from imubayes.selection.panel import Unasked


def test_criteria_are_printed_as_their_difference_from_the_decision(make_judged) -> None:
    panel = make_judged().panel
    decided = ("b0", "b1", "b2", "m_j", "m_k")
    rows = {one.name: criterion_row(one, decided, {}) for one in panel.criteria}
    assert (rows["aic"].name, rows["aic"].model) == ("AIC", "+ b3")
    assert rows["bic"].model == "as decided"
    assert (rows["bic"].value, rows["bic"].lead, rows["bic"].samples) == ("-8,102.0", "4.5", "412")
    assert (rows["bic"].compared, rows["loo"].compared) == ("all 2^10", "1,024 likely ones")
    assert rows["loo"].samples == "–"


def test_criterion_that_was_not_compared_has_no_model(
    make_judged,
) -> None:
    loo = next(one for one in make_judged().panel.criteria if one.name == "loo")
    none = criterion_row(replace(loo, compared=0, note="too many subsets, -3 nats"), ("b0",), {})
    assert (none.model, none.compared) == ("–", "none")
    assert none.note == "Dwell left out: too many subsets, −3 nats."


def test_columns_of_a_triad_are_printed_by_their_own_names(make_judged) -> None:
    sparse = make_judged().panel.sindy[0]
    far = replace(sparse, model=("ay.b0", "ay.b2"), stable=("ay.b0",))
    row = sparse_row(far, ("b0", "b1"), {"ay.b0": "b0", "ay.b2": "b2"})
    assert (row.model, row.stable) == ("+ b2, - b1", "- b1")


def test_figures_are_drawn_only_where_the_component_has_figures(make_judged) -> None:
    sensor = make_judged()
    drawn, plain = (beside_view(sensor, "s1", drawn=some, own_rows=True) for some in (True, False))
    assert drawn.methods.glance and len(drawn.methods.paths) == 2 and drawn.methods.widths
    assert drawn.methods.reduced_path and len(drawn.misfit.panels) == 1
    figures = (plain.methods.glance, plain.methods.widths, plain.methods.reduced_path)
    assert figures == (None, None, None) and not plain.methods.paths and not plain.misfit.panels
    assert plain.methods.title == drawn.methods.glance.title
    shared = beside_view(sensor, "s1", drawn=True, own_rows=False)
    assert not shared.misfit.panels and shared.misfit.sentences == drawn.misfit.sentences


def test_inclusion_over_widths_is_a_sentence_where_no_verdict_hangs_on_it(make_judged) -> None:
    sensor = make_judged()
    settled = tuple(
        replace(t, verdict="needed") if t.verdict == "undecided" else t for t in sensor.selection.terms
    )
    sensor = replace(sensor, selection=replace(sensor.selection, terms=settled))
    panel = replace(sensor.panel, sensitivity=replace(sensor.panel.sensitivity, swing=()))
    view = methods_view(sensor, panel, "s1", drawn=True)
    assert view.widths is None and view.prior.startswith("No verdict depends on the prior")


def test_many_disagreements_are_counted(make_judged) -> None:
    sensor = make_judged()
    votes = sensor.panel.votes
    many = tuple(replace(votes.disagreements[0], text=f"reason {k}") for k in range(MOST_DISAGREEMENTS + 3))
    view = methods_view(
        sensor, replace(sensor.panel, votes=replace(votes, disagreements=many)), "s1", drawn=True
    )
    assert len(view.disagreements) == MOST_DISAGREEMENTS and view.more_disagreements == 3


def test_component_without_other_methods_has_no_section_on_them(make_sensor, make_study) -> None:
    view = beside_view(make_sensor(), "s1", drawn=True, own_rows=True)
    assert (view.methods, view.misfit, view.groups) == (None, None, ())
    html = report_html(make_study(make_sensor()))
    assert "What other methods say" not in html and "Does the library miss something?" not in html


@pytest.mark.parametrize("many", [False, True])
def test_report_holds_what_the_methods_say_in_the_section_on_the_choice(
    make_judged, make_study, many
) -> None:
    sensors = [make_judged(f"ACC-{k}") for k in range(13 if many else 1)]
    html = report_html(make_study(*sensors))
    assert html.count("What other methods say") == html.count("How much the prior matters") == len(sensors)
    assert html.count('class="panels glance"') == (3 if many else 1)
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
