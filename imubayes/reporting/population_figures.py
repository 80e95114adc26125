"""Figure of the units of a class: each unit with its sessions, against where the next one will be."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from imubayes.reporting.canvas import (
    ACCENT,
    GREY,
    INK,
    PALE,
    Axes,
    Margins,
    Panel,
    areas,
    dots,
    draw,
    few_ticks,
    no_ticks,
    sticks,
)
from imubayes.reporting.population_words import short_title
from imubayes.reporting.rounding import per_unit, pretty
from imubayes.units import counted

if TYPE_CHECKING:
    from imubayes.population.classes import TermInClass

ROW, TALLEST = 9.0, 420.0
"""px of a unit, and of all of them at most."""

GAP = 1.5
"""Rows between components."""

BAR = 0.42
"""Half height of a session's bar, in rows."""


def units_panel(first: TermInClass, parts: tuple[TermInClass, ...], key: str) -> Panel:
    """One term: a lane for each component, in it a row for each unit.

    Parameters
    ----------
    first : the term for all components together, or the only one.
    parts : by component.
    """
    unit = per_unit(first.parameter.printed, first.parameter.unit)
    rows = sum(len(part.units) for part in parts) + GAP * (len(parts) - 1)
    title = pretty(short_title(first))
    return draw(
        lambda axes: _paint(axes, parts, unit, rows),
        title=title,
        alt=f"{title}, of {counted(len(parts[0].units), 'unit')}",
        key=key,
        height=int(min(max(ROW * rows, 60.0), TALLEST)) + 44,
        margins=Margins(left=34),
    )


def _paint(axes: Axes, parts: tuple[TermInClass, ...], unit: float, rows: float) -> None:
    top, ticks = 0.0, []
    for part in parts:
        n = len(part.units)
        place = top + np.arange(n, dtype=float)
        _lane(axes, part, place, unit)
        ticks.append((float(place.mean()), part.component))
        top += n + GAP
    few_ticks(axes, 5, len(parts))
    axes.set(ylim=(rows - 0.4, -0.6), xlabel=f"{parts[0].term}, {pretty(parts[0].parameter.printed)}")
    if all(name for _, name in ticks):
        axes.set_yticks([at for at, _ in ticks], [name for _, name in ticks])
        axes.tick_params(axis="y", length=0)
    else:
        no_ticks(axes)


def _lane(axes: Axes, part: TermInClass, place: np.ndarray, unit: float) -> None:
    """Band of the next unit, mean of the population, and each unit with its sessions."""
    low, high = place[0] - 0.6, place[-1] + 0.6
    span, mean = part.spreads.next_unit, part.spreads.mean
    areas(axes, [(span.low / unit, span.high / unit, low, high)], PALE)
    sticks(axes, np.array([mean.value / unit]), np.array([low]), np.array([high]), GREY)
    known = np.isfinite(part.value)
    weight = np.where(known, 1.0 / np.where(known, part.error, 1.0) ** 2, 0.0)
    total = weight.sum(axis=1)
    there = total > 0.0
    middle = (weight * np.nan_to_num(part.value)).sum(axis=1)[there] / total[there]
    row = np.broadcast_to(place[:, None], part.value.shape)[known]
    sticks(axes, part.value[known] / unit, row - BAR, row + BAR, INK, 0.9)
    dots(axes, middle / unit, place[there], ACCENT, 4.0)
