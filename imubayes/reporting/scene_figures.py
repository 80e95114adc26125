"""Figures on what a scene requires: inclusion against relevance, and error against the size of the model."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.reporting.canvas import (
    ACCENT,
    GREY,
    INK,
    PALE,
    WARNING,
    WIDTH,
    Axes,
    Margins,
    Panel,
    draw,
    few_ticks,
    log_scale,
)
from imubayes.reporting.rounding import pretty, share
from imubayes.reporting.scene_words import printed_unit
from imubayes.scenes.relevance import MATTERS, QUADRANTS, THERE

if TYPE_CHECKING:
    from imubayes.scenes.relevance import Relevance, TermRelevance


HEIGHT = 330
"""px of the panel of quadrants."""

SPACE = Margins(left=46, right=12, top=8, bottom=38)

LEAST, MOST = 1e-4, 1e2
"""Shares of the budget at the ends of the axis; what lies beyond is drawn at the end."""

LETTER, LINE = 7.3, 13.0
"""px of a letter and of a line of labels."""

MARK = 5.0
"""px from the middle of a marker to where a label may begin."""

MARKERS = {
    QUADRANTS[0]: ("o", "full", ACCENT),
    QUADRANTS[1]: ("o", "none", ACCENT),
    QUADRANTS[2]: ("^", "full", WARNING),
    QUADRANTS[3]: ("x", "full", GREY),
}
"""Marker, fill and colour of each quadrant."""

SIGNS: dict[str, str] = dict(zip(QUADRANTS, ("●", "○", "▲", "×"), strict=True))
"""The same shapes as text."""


def quadrants(found: Relevance, key: str) -> Panel:
    """Inclusion of each term against its share of the budget."""
    of = {name: [t.name for t in found.terms if t.quadrant == name] for name in QUADRANTS}
    there = len(of[QUADRANTS[0]]) + len(of[QUADRANTS[1]])
    title = (
        f"{len(of[QUADRANTS[0]])} of {there} terms that are there matter;"
        f" {len(of[QUADRANTS[2]])} not shown could"
    )
    return draw(
        lambda axes: _paint_quadrants(axes, found),
        title=title,
        alt="Inclusion and share of the budget by term. "
        + "; ".join(f"{name}: {' '.join(names) or 'none'}" for name, names in of.items()),
        key=key,
        height=HEIGHT,
        margins=SPACE,
    )


def shown_share(term: TermRelevance) -> float:
    """Share of the budget that a term is drawn at: its median, or its limit where it is not shown."""
    return term.share[1] if term.inclusion >= THERE else term.possible


def _across(value: float) -> float:
    """Place of a share in px from the left of the axes."""
    room = WIDTH - SPACE.left - SPACE.right
    inside = min(max(value, LEAST), MOST)
    return room * float(np.log(inside / LEAST) / np.log(MOST / LEAST))


def _up(inclusion: float) -> float:
    """Place of an inclusion in px above the bottom of the axes."""
    return 14.0 + (HEIGHT - SPACE.top - SPACE.bottom - 28.0) * inclusion


def _paint_quadrants(axes: Axes, found: Relevance) -> None:
    room = (float(WIDTH - SPACE.left - SPACE.right), float(HEIGHT - SPACE.top - SPACE.bottom))
    axes.axvline(_across(MATTERS), color=PALE, linewidth=1.0, zorder=0)
    axes.axhline(_up(THERE), color=PALE, linewidth=1.0, zorder=0)
    axes.axvline(_across(1.0), color=GREY, linewidth=1.0, linestyle=(0, (4, 2)), zorder=0)
    points = np.array([(_across(shown_share(t)), _up(t.inclusion)) for t in found.terms])
    labels = placed(points, [term.name for term in found.terms], room)
    for term, point, label in zip(found.terms, points, labels, strict=True):
        marker, fill, colour = MARKERS[term.quadrant]
        axes.plot(point[0], point[1], marker, fillstyle=fill, color=colour, markersize=6, clip_on=False)
        _tie(axes, point, label)
        axes.text(label[0], label[1], term.name, color=INK if term.kept else GREY, ha="center", va="center")
    decades = (1e-4, 1e-3, 1e-2, 1e-1, 1.0, 1e1, 1e2)
    names = ("0.01 %", "", "1 %", "", "100 %", "", "")
    axes.set(xlim=(0.0, room[0]), ylim=(0.0, room[1]), ylabel="inclusion", xlabel="share of the budget")
    axes.set_xticks([_across(value) for value in decades], names)
    axes.set_yticks([_up(value) for value in (0.0, 0.5, 1.0)], ["0", "0.5", "1"])


def _tie(axes: Axes, point: FloatArray, label: FloatArray) -> None:
    """Line from a marker to its label where they are apart."""
    away = label - point
    length = float(np.hypot(*away))
    if length > 3.0 * LINE:
        ends = np.array([point + away * MARK / length, label - away * 0.7 * LINE / length])
        axes.plot(*ends.T, color=PALE, linewidth=0.8, zorder=0)


def placed(points: FloatArray, names: list[str], room: tuple[float, float]) -> FloatArray:
    """Places of labels, near their points, that overlap neither each other nor any point.

    Parameters
    ----------
    points : (m, 2) px.
    names : m labels.
    room : width and height that the labels stay in, px.

    Returns
    -------
    (m, 2) middles of the labels, px. Where no place is free the nearest one inside is taken.
    """
    blocked = np.column_stack((points, np.full((len(points), 2), 2.0 * MARK)))
    out = np.empty_like(points, dtype=float)
    for k in _crowded_last(points):
        size = np.array([LETTER * len(names[k]), LINE])
        slots = _slots(size, room)
        # a label a little above or beside its point is nearer than its middle says
        order = np.argsort(np.hypot(*((slots - points[k]) / (1.0 + size / 30.0)).T), kind="stable")
        slots = slots[order]
        gaps = np.abs(slots[:, None, :] - blocked[None, :, :2]) - 0.5 * (size + blocked[None, :, 2:])
        free = (gaps.max(axis=2) >= 0.0).min(axis=1)
        out[k] = slots[int(np.argmax(free))]
        blocked = np.vstack((blocked, np.concatenate((out[k], size))))
    return out


def _slots(size: FloatArray, room: tuple[float, float]) -> FloatArray:
    """Middles (q, 2) that keep a label inside."""
    half = 0.5 * size
    x = np.arange(half[0], room[0] - half[0] + 1e-9, 3.0)
    y = np.arange(half[1], room[1] - half[1] + 1e-9, 3.0)
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def _crowded_last(points: FloatArray) -> list[int]:
    """Points in the order in which they are labelled: from left to right."""
    return np.argsort(points[:, 0], kind="stable").tolist()


def path(found: Relevance, key: str) -> Panel:
    """Bound of the error against the number of terms, each step without the term that costs least."""
    unit, size = printed_unit(found)
    count = np.array([step[0] for step in found.path], dtype=float)
    error = np.array([step[2] for step in found.path]) / size
    kept = len(found.model)
    least = share(error.min() * size / found.budget.limit)
    title = (
        f"{kept} {'term stays' if kept == 1 else 'terms stay'} within the budget"
        if found.met
        else f"No model stays within the budget: {least} is left at least"
    )
    return draw(
        lambda axes: _paint_path(axes, (count, error), found.budget.limit / size, kept, pretty(unit)),
        title=title,
        alt=f"Bound of the error with 95 %, {unit}, by number of terms: "
        + ", ".join(f"{n:.0f}: {value:.3g}" for n, value in zip(count, error, strict=True)),
        key=key,
        height=220,
        margins=Margins(left=66),
    )


def _paint_path(axes: Axes, steps: tuple[FloatArray, FloatArray], limit: float, kept: int, unit: str) -> None:
    count, error = steps
    floor = 1e-3 * limit
    drawn = np.maximum(error, floor)
    axes.plot(count, drawn, "o-", color=GREY, markersize=4, linewidth=1.0)
    axes.plot(kept, drawn[count == kept], "o", color=ACCENT, markersize=8)
    axes.axhline(limit, color=WARNING, linewidth=1.0, linestyle=(0, (4, 2)))
    axes.set_ylim(0.6 * min(float(drawn.min()), limit), 1.6 * max(float(drawn.max()), limit))
    axes.set(xlabel="number of terms in the model", ylabel=f"error with 95 %, {unit}")
    few_ticks(axes, 6, counts=True)
    log_scale(axes, "y", 5)
