from __future__ import annotations

from imubayes.reporting import noise_views
from imubayes.reporting.canvas import SERIES, VERDICT_COLOURS, WARNING, draw
from studies.decision_quality import figures as quality_figures


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
