from __future__ import annotations

import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.textpath import TextPath
from scipy.optimize import isotonic_regression
from test_any_result import FIGURES

from imubayes.reporting import method_figures
from imubayes.reporting.canvas import WIDTH
from imubayes.reporting.method_glance import glance, laid_out, shade


def test_no_text_of_a_panel_is_cut_off_at_its_sides(make_judged) -> None:
    for panel in FIGURES["methods"][1](make_judged()):
        for text in ElementTree.fromstring(panel.svg).iter("text"):
            style, said = text.get("style", ""), text.text or ""
            turn = re.search(r"rotate\((-?\d+)", text.get("transform", ""))
            x = _place(text)
            if turn and int(turn[1]) == -90:
                continue
            share = 0.5 if "middle" in style else 1.0 if "end" in style else 0.0
            wide = float(TextPath((0.0, 0.0), said, size=11).get_extents().width)
            assert x - share * wide > -1.0 and x + (1.0 - share) * wide < WIDTH + 1.0, (panel.title, said)


def _place(text: ElementTree.Element) -> float:
    moved = re.search(r"translate\((-?[\d.]+)", text.get("transform", ""))
    return float(text.get("x") or (moved[1] if moved else 0.0))


def test_colour_scale_darkens_all_the_way() -> None:
    colours = np.array([[int(shade(s)[k : k + 2], 16) for k in (1, 3, 5)] for s in np.linspace(0.0, 1.0, 41)])
    # relative luminance of sRGB, WCAG 2.1
    channel = colours / 255.0
    linear = np.where(channel <= 0.04045, channel / 12.92, ((channel + 0.055) / 1.055) ** 2.4)
    assert np.all(np.diff(linear @ [0.2126, 0.7152, 0.0722]) < 0.0)


def test_every_excited_term_has_a_row_under_its_part_of_the_equation(make_judged) -> None:
    sensor = make_judged()
    shown = laid_out(sensor.panel.votes, sensor.selection, {})
    excited = [term for term in sensor.selection.terms if term.verdict != "untested"]
    assert list(shown.down) == [term.name for term in excited]
    rows = sorted([*shown.down.values(), *(row for row, _ in shown.headings)])
    assert rows == list(range(shown.rows))
    for term in excited:
        above = max(row for row, _ in shown.headings if row < shown.down[term.name])
        assert dict(shown.headings)[above] == term.group


def test_votes_that_the_decision_does_not_share_are_framed(make_judged) -> None:
    sensor = make_judged()
    shown = laid_out(sensor.panel.votes, sensor.selection, {})
    framed = {(sensor.panel.votes.methods[i], shown.names[j]) for i, j in shown.apart}
    assert framed == {("aic", "b3"), ("waic", "b3"), ("sr3", "b3")}
    assert "≠" in glance(sensor.panel.votes, sensor.selection, {}, "g").svg
    agreed = replace(sensor.panel.votes, disagreements=())
    assert "≠" not in glance(agreed, sensor.selection, {}, "g").svg


def test_methods_that_say_nothing_still_leave_a_figure(make_judged) -> None:
    sensor = make_judged()
    nothing = np.full(sensor.panel.votes.keeps.shape, np.nan)
    silent = replace(sensor.panel.votes, strength=nothing, keeps=nothing, disagreements=())
    assert (
        glance(silent, sensor.selection, {}, "g").title
        == "All 0 methods keep no terms; the test cannot tell 3 more"
    )


def test_path_names_the_terms_that_matter_and_not_the_others(make_judged) -> None:
    sensor = make_judged()
    stlsq, sr3 = (method_figures.threshold_path(one, sensor.selection.model, {}, "h")
                  for one in sensor.panel.sindy[:2])  # fmt: skip
    named = {text.text for text in ElementTree.fromstring(stlsq.svg).iter("text")}
    assert {"b0", "b1", "b2", "m_j", "m_k"} <= named and not named & {"b0p", "c_jk"}
    assert stlsq.title.endswith("keeps the decision's 5 terms")
    assert sr3.title.endswith("keeps 6 terms: + b3")


def test_labels_keep_their_gap_and_their_order_and_move_as_little_as_that_takes() -> None:
    rng = np.random.default_rng(2)
    for _ in range(200):
        n = int(rng.integers(1, 12))
        wanted, gap = rng.uniform(0.3, 0.7, n), 0.02
        places = method_figures.spread(wanted, gap)
        order = np.argsort(wanted)
        assert np.all(np.diff(places[order]) >= gap - 1e-12)
        # least squares under the gaps is isotonic regression of what is wanted less the gaps
        steps = gap * np.arange(n)
        best = isotonic_regression(wanted[order] - steps).x + steps
        assert places[order] == pytest.approx(best, abs=1e-12)


def test_labels_at_the_ends_stay_inside_while_they_fit() -> None:
    places = method_figures.spread(np.array([0.99, 1.0, 0.98, 0.0]), 0.1)
    assert places.max() <= 1.0 + 1e-12 and places.min() >= 0.0
    assert np.diff(np.sort(places)).min() >= 0.1 - 1e-12


def test_path_of_the_reduced_model_names_what_each_row_adds(make_judged) -> None:
    sensor = make_judged()
    reduced = sensor.panel.reduced
    panel = method_figures.reduced_path(reduced, sensor.kind, "e")
    one = method_figures.reduced_path(replace(reduced, terms=reduced.terms[:1]), sensor.kind, "e")
    assert panel.title.startswith("4 terms predict within") and one.title.startswith("1 term predicts within")
    named = [text.text for text in ElementTree.fromstring(panel.svg).iter("text")]
    assert {"none", "+ b0", "+ b1", "+ b2", "+ m_j", "+ m_k"} <= set(named)
    # the same sizes, but the pair has none of the single one
    other = (reduced.path[0], reduced.path[1], (("b1", "b2"), reduced.path[2][1]), *reduced.path[3:])
    panel = method_figures.reduced_path(replace(reduced, path=other), sensor.kind, "e")
    assert "best 2" in [text.text for text in ElementTree.fromstring(panel.svg).iter("text")]


def test_hysteresis_shows_both_branches_by_name_and_other_inputs_have_none(make_judged) -> None:
    sensor = make_judged()
    loop, flat = (method_figures.dependence(one, sensor.kind, "m") for one in sensor.misfit.dependences)
    assert ">heating<" in loop.svg and ">cooling<" in loop.svg and "T, °C" in loop.svg
    assert ">heating<" not in flat.svg and ">rising<" not in flat.svg
    assert "28 µg rms, 41% of the residual, p <0.001" in loop.title
