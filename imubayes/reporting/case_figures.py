"""Errors of a known quantity after compensation, beside what the posterior predicts for them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from imubayes.reporting.canvas import ACCENT, GREY, PALE, SERIES, Axes, Margins, Panel, draw, few_ticks
from imubayes.reporting.case_words import UNITS
from imubayes.reporting.rounding import per_unit, pretty

if TYPE_CHECKING:
    from imubayes.inference.recovered import Recovered

SHAPES = ("o", "s", "^")
"""Marker of each component, so that colour is not alone."""

AXES = {"gravity": "|f| − g", "rest": "rate", "closure": "error of up", "turn": "error of the turn"}
PLACES = {"gravity": "still", "rest": "still", "closure": "turn", "turn": "turn"}


def recovered_panel(one: Recovered, key: str) -> Panel:
    """Draw each still or turn with the band of ± 2 sd that is predicted."""
    share = f"{one.inside} of {one.after.size} within 2 sd"
    place = PLACES[one.what]
    return draw(
        lambda axes: _paint(axes, one),
        title=f"{AXES[one.what]} after compensation: {share}",
        alt=f"{AXES[one.what]} by {place}, {len(one.after)} of them, with the predicted ± 2 sd: {share}",
        key=key,
        height=170,
        margins=Margins(left=54),
    )


def _paint(axes: Axes, one: Recovered) -> None:
    unit, si = UNITS[one.what]
    scale = per_unit(unit, si)
    count, width = one.after.shape
    number = np.arange(1, count + 1, dtype=float)
    band = 2.0 * one.expected.max(axis=1) / scale
    axes.fill_between(number, -band, band, color=PALE, linewidth=0.0, step="mid")
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    for c in range(width):
        colour = ACCENT if width == 1 else SERIES[c]
        axes.plot(number, one.after[:, c] / scale, SHAPES[c], color=colour, markersize=3.5)
    axes.set(xlim=(0.4, count + 0.6), xlabel=PLACES[one.what], ylabel=f"{AXES[one.what]}, {pretty(unit)}")
    few_ticks(axes, 5, 4)
    axes.set_xticks(np.unique(np.linspace(1, count, min(count, 6)).round().astype(int)))
