"""Heat maps of correct digits at the extremes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from imubayes.reporting.canvas import INK, PALE, Axes, Drawing, Room, draw
from studies.extremes.digits import MOST

if TYPE_CHECKING:
    from studies.extremes.measure import Outcome

COLOURS = "cividis"
"""Sequential, alike to people with any colour vision."""

DARK = 7.0
"""Digits below which a number in a cell is written in white."""

ROW = 24
"""px of a quantity's row."""

ACROSS = 30
"""Letters that fit below the figure; where the labels have more, some are left out."""

LETTER = 7
"""px of a letter."""

BESIDE = 18
"""Labels that stand upright below the figure."""

UPRIGHT = 6
"""Letters of a label beyond which labels stand upright."""


def digits_panel(outcomes: Sequence[Outcome], key: str) -> Drawing:
    """Correct digits of every quantity (rows) for every case of a family (columns)."""
    names = tuple(outcomes[0].told)
    correct = np.array([[one.told[name].correct for one in outcomes] for name in names])

    def paint(axes: Axes) -> None:
        shown = np.ma.masked_invalid(correct)
        axes.pcolormesh(shown, cmap=COLOURS, vmin=0.0, vmax=MOST, edgecolors="white", linewidth=0.8)
        for (row, column), value in np.ndenumerate(correct):
            _write(axes, row, column, float(value))
        labels = [_short(one.label) for one in outcomes]
        upright = max(map(len, labels)) > UPRIGHT
        fit = BESIDE if upright else ACROSS / max(map(len, labels))
        step = math.ceil(len(outcomes) / fit)
        where = np.arange(0, len(outcomes), step)
        axes.set_yticks(np.arange(len(names)) + 0.5, names)
        axes.set_xticks(where + 0.5, [labels[k] for k in where])
        axes.tick_params(axis="x", labelrotation=90 if upright else 0)
        axes.tick_params(length=0)
        axes.invert_yaxis()
        axes.spines[["left", "bottom"]].set_visible(False)

    least = np.nanmin(correct) if np.isfinite(correct).any() else math.nan
    title = (
        f"{outcomes[0].family}: at least {math.floor(least)} digits"
        if math.isfinite(least)
        else outcomes[0].family
    )
    alt = f"Correct digits, {outcomes[0].family}: " + "; ".join(
        f"{one.label} " + ", ".join(f"{name} {_digits(one.told[name].correct)}" for name in names)
        for one in outcomes
    )
    longest = max(len(one.label) for one in outcomes)
    bottom = LETTER * longest if longest > UPRIGHT else 24
    height = ROW * len(names) + bottom + 6
    return draw(paint, title=title, alt=alt, key=key, room=Room(height=height, left=92, bottom=bottom))


def _write(axes: Axes, row: int, column: int, value: float) -> None:
    colour = "white" if value < DARK else INK
    if math.isnan(value):
        axes.fill(
            [column + 0.05, column + 0.95, column + 0.95, column + 0.05],
            [row + 0.05, row + 0.05, row + 0.95, row + 0.95],
            color=PALE,
        )
        colour = INK
    axes.text(column + 0.5, row + 0.5, _digits(value), ha="center", va="center", color=colour, fontsize=9)


def _digits(value: float) -> str:
    if math.isnan(value):
        return "–"
    return "!" if value == -math.inf else f"{math.floor(value)}"


def _short(label: str) -> str:
    return label.replace("-", "−").replace("columns", "X").replace("response", "y")
