from __future__ import annotations

import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from imubayes.reporting import figures, fit_figures, noise_figures, quality_figures, rows
from imubayes.reporting.canvas import SERIES, VERDICT_COLOURS, WARNING, Panel, draw
from imubayes.sensors.terms import library


def every_panel(sensor) -> list[Panel]:
    singles = (figures.inclusion, figures.model_size, figures.best_models, figures.correlations)
    panels = [paint(sensor, f"a{number}") for number, paint in enumerate(singles)]
    panels += figures.posteriors(sensor, "p") + fit_figures.against_inputs(sensor, "i")
    for number, check in enumerate(sensor.checks):
        panels.append(fit_figures.over_time(check, f"t{number}"))
        panels.append(fit_figures.autocorrelation(check, f"c{number}"))
        panels.append(fit_figures.allan(check, sensor.kind, f"l{number}"))
    return panels


@pytest.mark.parametrize("kind", ["accelerometer", "gyroscope"])
def test_every_panel_is_small_vector_svg_with_text_as_text(make_sensor, kind: str) -> None:
    for panel in every_panel(
        make_sensor(lib=library(kind, set="extended", temperature=1), misfit="centrifuge")
    ):
        root = ElementTree.fromstring(panel.svg)
        assert root.get("role") == "img" and len(root.get("aria-label")) > 20 and panel.title
        assert not list(root.iter("image")) and not list(root.iter("style")) and list(root.iter("text"))
        assert len(panel.svg) < 20_000


def test_figures_are_the_same_bytes_for_the_same_result(make_sensor) -> None:
    assert every_panel(make_sensor()) == every_panel(make_sensor())


def test_every_reference_in_a_panel_points_into_it(make_sensor) -> None:
    for panel in every_panel(make_sensor()):
        ids = re.findall(r'\bid="([^"]+)"', panel.svg)
        used = set(re.findall(r'(?:href="#|url\(#)([\w.-]+)', panel.svg))
        assert used == set(ids) and len(ids) == len(set(ids))


def test_alternative_text_is_escaped() -> None:
    panel = draw(lambda axes: None, title="", alt='"><script>alert(1)</script>', key="k")
    assert "<script" not in panel.svg
    assert ElementTree.fromstring(panel.svg).get("aria-label") == '"><script>alert(1)</script>'


def test_a_residual_s_title_and_the_sentence_on_what_is_missing_are_one_decision(make_judged) -> None:
    sensor = make_judged()
    found = sensor.misfit.found[0]

    def titles(*found, **changes) -> dict[str, str]:
        misfit = replace(sensor.misfit, found=found, **changes)
        panels = fit_figures.against_inputs(replace(sensor, misfit=misfit), "k")
        return {panel.title.split(":")[0].removeprefix("Against "): panel.title for panel in panels}

    some = titles(found)
    assert some["f_i"].endswith("nothing is left beyond chance (p 0.40)")
    assert some["T"].endswith("28 µg rms are left between heating and cooling")
    # one that goes with another is neither found nor nothing
    assert titles(dependences=(replace(found, input="T"),))["T"].endswith("goes with what is found elsewhere")
    assert titles(dependences=())["T"].endswith("not tested by itself")


def test_models_disagree_only_on_terms_that_are_neither_in_nor_out(make_sensor, monkeypatch) -> None:
    sensor = make_sensor()
    names = rows.candidates(sensor.selection)
    sure = [(names[:3], 0.99), *((names[:k], 1e-6) for k in (0, 1, 2, 4, 5))]
    monkeypatch.setattr(rows, "best_models", lambda selection: sure)
    assert figures.best_models(sensor, "k").title == "The best model holds 99\xa0% of the probability"
    split = [(names[:3], 0.6), (names[:4], 0.3), (names[:2], 1e-4)]
    monkeypatch.setattr(rows, "best_models", lambda selection: split)
    assert figures.best_models(sensor, "k").title.endswith(f"and disagree on {names[3]}")


def test_the_prior_s_width_matters_only_where_it_changes_a_printed_digit(make_sensor) -> None:
    sensor = make_sensor()

    def title(low: float) -> str:
        terms = tuple(replace(term, inclusion_range=(low, 1.0)) for term in sensor.selection.terms)
        return figures.inclusion(replace(sensor, selection=replace(sensor.selection, terms=terms)), "k").title

    assert title(0.9999).endswith("the prior's width matters for none")
    assert "(0.90 to 1.00)" in title(0.9)


def test_binned_means_keep_the_mean_of_all_points() -> None:
    rng = np.random.default_rng(5)
    x, y = rng.standard_normal(250), rng.standard_normal(250)
    _, mean, sd = fit_figures.binned_means(x, y)
    # sd is 1/sqrt(count): weights are counts
    assert np.sum(mean / sd**2) == pytest.approx(y.sum(), abs=1e-10)
    assert np.sum(1.0 / sd**2) == pytest.approx(250.0)


def test_runs_that_fit_worst_are_drawn_when_there_are_many(make_sensor) -> None:
    sensor = make_sensor(runs=tuple(f"r{k}" for k in range(12)), misfit="r7")
    shown = [check.run for check in fit_figures.shown_runs(sensor, 3)]
    assert len(shown) == 3 and "r7" in shown and shown == sorted(shown, key=lambda run: int(run[1:]))


def test_strongest_pairs_agree_with_the_correlation_of_the_draws(make_sensor) -> None:
    sensor = make_sensor()
    draws = sensor.draws.copy()
    draws[:, 2] = -draws[:, 0]
    pairs = figures.strongest_pairs(replace(sensor, draws=draws))
    assert pairs[0][:2] == ("b0", "b2") and pairs[0][2] == pytest.approx(-1.0)


def test_terms_that_never_vary_have_no_correlation(make_sensor) -> None:
    sensor = make_sensor()
    assert figures.correlations(replace(sensor, draws=np.zeros_like(sensor.draws)), "k") is None


def test_one_colour_has_one_meaning() -> None:
    """What is undecided, cannot be told, or calls for attention has a colour that nothing else has."""
    kept = {VERDICT_COLOURS["undecided"], VERDICT_COLOURS["inseparable"], WARNING}
    assert len(kept) == 3
    assert kept.isdisjoint(SERIES) and kept.isdisjoint(noise_figures.COLOURS.values())
    assert len(quality_figures.LABELLED) < len(SERIES)
