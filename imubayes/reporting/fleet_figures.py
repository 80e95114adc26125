"""Figures of a fleet: shares of verdicts by term, and the population of each term."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from imubayes.population.needs import NEEDED, VERDICTS, ClassFound, of_class
from imubayes.reporting.canvas import (
    ACCENT,
    PALE,
    VERDICT_COLOURS,
    Axes,
    Margins,
    Panel,
    areas,
    draw,
    few_ticks,
)
from imubayes.reporting.lots_figures import LETTER, LINE, population_panel

if TYPE_CHECKING:
    from imubayes.population.fleet import FleetResult

SHOWN = (
    (("needed",), ACCENT),
    (("undecided",), VERDICT_COLOURS["undecided"]),
    (("inseparable", "unresolved", "untested"), VERDICT_COLOURS["inseparable"]),
    (("not needed",), PALE),
)
"""Verdicts that share a colour, in the order of a bar from the left."""

HALF_BAR = 0.36
"""Half height of a bar, in rows."""


def verdict_panel(result: FleetResult, key: str) -> Panel:
    """Share of the units with each verdict, a bar for each term."""
    answer, names = result.answer, result.study.spec.library.names
    counts: dict[str, np.ndarray] = dict(zip(VERDICTS, answer.counts, strict=True))
    mostly = sum(of_class(term) == NEEDED for term in answer.terms)

    def paint(axes: Axes) -> None:
        left = np.zeros(len(names))
        for verdicts, colour in SHOWN:
            right = left + 100.0 * np.sum([counts[verdict] for verdict in verdicts], axis=0) / answer.units
            rows = enumerate(zip(left.tolist(), right.tolist(), strict=True))
            areas(axes, [(a, b, row - HALF_BAR, row + HALF_BAR) for row, (a, b) in rows if b > a], colour)
            left = right
        few_ticks(axes, 4, len(names))
        axes.set(xlabel="units, %", xlim=(0.0, 100.0), ylim=(len(names) - 0.4, -0.6))
        axes.set_yticks(range(len(names)), names)
        axes.tick_params(axis="y", length=0)

    alt = "Units in which each term is needed: " + "; ".join(
        f"{term.name} {100.0 * term.needed.value:.0f} %" for term in answer.terms
    )
    title = f"{mostly} of {len(names)} terms are needed by most units"
    height, margins = LINE * len(names) + 50, Margins(left=int(14 + LETTER * max(map(len, names))))
    return draw(paint, title=title, alt=alt, key=key, height=height, margins=margins)


def fleet_population_panel(result: FleetResult, key: str) -> Panel:
    """Population of each term beside the class's typical size."""
    found = ClassFound(result.study.sensor_class, (), result.answer.terms, result.answer.order, ())
    return population_panel(found, result.study.spec.library, key)
