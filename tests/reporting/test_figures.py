from __future__ import annotations

from dataclasses import replace

from results_found import sensor_result

from imubayes.reporting import figures, noise_views
from imubayes.reporting.canvas import SERIES, VERDICT_COLOURS, WARNING, draw
from studies.decision_quality import figures as quality_figures


def test_models_disagree_only_on_terms_that_are_neither_in_nor_out() -> None:
    sensor = sensor_result()
    selection = sensor.selection
    names = selection.models.candidates.names

    def title(best) -> str:
        found = replace(selection, models=replace(selection.models, best=tuple(best)))
        return figures.best_models(replace(sensor, selection=found), "k").title

    sure = [(names[:3], 0.99), *((names[:k], 1e-6) for k in (0, 1, 2, 4, 5))]
    assert title(sure) == "The best model holds 99\xa0% of the probability"
    split = [(names[:3], 0.6), (names[:4], 0.3), (names[:2], 1e-4)]
    assert title(split).endswith(f"and disagree on {names[3]}")


def test_the_prior_s_width_matters_only_where_it_changes_a_printed_digit() -> None:
    sensor = sensor_result()

    def title(low: float) -> str:
        terms = tuple(replace(term, inclusion_range=(low, 1.0)) for term in sensor.selection.terms)
        return figures.inclusion(replace(sensor, selection=replace(sensor.selection, terms=terms)), "k").title

    assert title(0.9999).endswith("the prior's width matters for none")
    assert "(0.90 to 1.00)" in title(0.9)


def test_one_colour_has_one_meaning() -> None:
    """What is undecided, cannot be told, or calls for attention has a colour that nothing else has."""
    kept = {VERDICT_COLOURS["undecided"], VERDICT_COLOURS["inseparable"], WARNING}
    assert len(kept) == 3
    assert kept.isdisjoint(SERIES) and kept.isdisjoint(noise_views.COLOURS.values())
    assert len(quality_figures.LABELLED) < len(SERIES)


def test_small_number_beside_an_axis_is_drawn_as_it_is() -> None:
    """Coordinates are shortened to hundredths of a pixel, texts are not."""
    panel = draw(lambda axes: axes.set_xticks([0.001, 0.125]), title="", alt="", key="a")
    assert ">0.001</text>" in panel.svg and ">0.125</text>" in panel.svg
