from __future__ import annotations

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from imubayes.reporting import figures, fit_figures, noise_figures, rows
from imubayes.reporting.canvas import SERIES, VERDICT_COLOURS, WARNING, draw
from studies.decision_quality import figures as quality_figures


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
