"""One figure that shows what every method says of every term: terms down, methods across."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import groupby, pairwise
from typing import TYPE_CHECKING

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.reporting.canvas import (
    GREY,
    INK,
    VERDICT_COLOURS,
    WARNING,
    Axes,
    Margins,
    Panel,
    areas,
    dots,
    draw,
    no_ticks,
)
from imubayes.reporting.figures import SHAPES
from imubayes.reporting.method_words import called, votes_title

if TYPE_CHECKING:
    from imubayes.selection.decision import Selection
    from imubayes.selection.verdicts import TermVerdict
    from imubayes.selection.votes import Votes


ROW = 18
"""px of a row."""

LEVELS = 10
"""Steps of the colour scale."""

SCALE = np.array([[243, 246, 249], [158, 202, 225], [0, 114, 178], [3, 52, 84]], dtype=float)
"""Light to dark in one hue: lightness falls all the way, so it reads in grey and with any colour vision."""

DARK = 0.5
"""Strength from which a mark on a cell is white."""

GAP = 0.6
"""Columns between kinds of methods."""

KINDS = (frozenset({"evidence", "g-prior"}), frozenset({"stlsq", "sr3", "ssr", "frols"}))
"""Methods that stand apart from the criteria."""


@dataclass(frozen=True, slots=True, eq=False)
class Glance:
    """Votes as they are laid out.

    Attributes
    ----------
    votes : of the methods.
    across : (m,) column of each method.
    down : row of each term, by its name in print.
    headings : (row, name) of each part of the model equation.
    verdicts : of the terms that were voted on, by name.
    names : of the terms in print, in the order of the votes.
    apart : (method, term) indices of the votes that the decision does not share.
    """

    votes: Votes
    across: FloatArray
    down: Mapping[str, int]
    headings: tuple[tuple[int, str], ...]
    verdicts: Mapping[str, TermVerdict]
    names: tuple[str, ...]
    apart: tuple[tuple[int, int], ...]

    @property
    def rows(self) -> int:
        """Rows of terms and headings."""
        return len(self.down) + len(self.headings)


def glance(votes: Votes, selection: Selection, own: Mapping[str, str], key: str) -> Panel:
    """Draw what every method says of every term that the test excites.

    Parameters
    ----------
    own : names of the terms in print, by the names that the votes have.
    """
    shown = laid_out(votes, selection, own)
    longest = max(len(name) for name in shown.names)
    widest = max(len(called(method)) for method in votes.methods)
    return draw(
        lambda axes: _paint(axes, shown),
        title=votes_title(votes, selection, own),
        alt=_alt(shown),
        key=key,
        height=ROW * (shown.rows + 1) + 6 * widest + 24,
        margins=Margins(left=max(34, 7 * longest + 6), right=96, top=6 * widest + 10, bottom=ROW + 14),
    )


def laid_out(votes: Votes, selection: Selection, own: Mapping[str, str]) -> Glance:
    """Give every method its column and every term its row, under the part of the equation it belongs to."""
    names = tuple(own.get(name, name) for name in votes.terms)
    verdicts = {term.name: term for term in selection.terms if term.name in names}
    down: dict[str, int] = {}
    headings: list[tuple[int, str]] = []
    for group, members in groupby(verdicts.values(), key=lambda term: term.group):
        headings.append((len(down) + len(headings), group))
        for term in members:
            down[term.name] = len(down) + len(headings)
    apart = (
        (votes.methods.index(method), votes.terms.index(one.term))
        for one in votes.disagreements
        for method in one.methods
        if method in votes.methods and one.term in votes.terms
    )
    return Glance(votes, _columns(votes), down, tuple(headings), verdicts, names, tuple(apart))


def _columns(votes: Votes) -> FloatArray:
    kinds = [next((k for k, kind in enumerate(KINDS) if m in kind), -1) for m in votes.methods]
    steps = [0.0, *(1.0 + GAP * (a != b) for a, b in pairwise(kinds))]
    return np.cumsum(steps)


def _paint(axes: Axes, g: Glance) -> None:
    width = float(g.across[-1]) + 1.0
    axes.set(xlim=(-0.5, width - 0.5), ylim=(g.rows - 0.5, -0.5))
    _paint_cells(axes, g)
    _paint_marks(axes, g)
    for place, method in zip(g.across, g.votes.methods, strict=True):
        axes.text(place, -0.75, called(method), rotation=90, ha="center", va="bottom", color=INK)
    for row, name in g.headings:
        axes.text(-0.5, row, name, ha="left", va="center", color=GREY, style="italic")
    for name, row in g.down.items():
        _paint_verdict(axes, g, name, row, width)
    axes.set_yticks(list(g.down.values()), list(g.down))
    axes.tick_params(axis="y", length=0)
    no_ticks(axes, "x")
    axes.spines[["left", "bottom"]].set_visible(False)
    _paint_scale(axes, g.rows + 0.25, width)


def _cells(g: Glance) -> Iterator[tuple[int, int, float, float]]:
    """Indices and place of every vote on a term that has a row."""
    for j, name in enumerate(g.names):
        if name in g.down:
            for i, x in enumerate(g.across.tolist()):
                yield i, j, x, float(g.down[name])


def _paint_cells(axes: Axes, g: Glance) -> None:
    level = np.full(g.votes.strength.shape, -1)
    known = np.isfinite(g.votes.strength)
    level[known] = np.rint(LEVELS * np.clip(g.votes.strength[known], 0.0, 1.0)).astype(np.int64)
    for k in range(LEVELS + 1):
        areas(axes, [_box(x, y) for i, j, x, y in _cells(g) if level[i, j] == k], shade(k / LEVELS))
    outlined = [_box(x, y) for i, j, x, y in _cells(g) if (i, j) in g.apart]
    for left, right, bottom, top in outlined:
        ring = [left, right, right, left, left], [bottom, bottom, top, top, bottom]
        axes.plot(*ring, color=WARNING, linewidth=1.6, clip_on=False)


def _box(x: float, y: float) -> tuple[float, float, float, float]:
    return x - 0.44, x + 0.44, y - 0.44, y + 0.44


def shade(strength: float) -> str:
    """Colour of a strength from 0 to 1.

    Examples
    --------
    >>> shade(0.0), shade(1.0)
    ('#f3f6f9', '#033454')
    """
    stops = np.linspace(0.0, 1.0, len(SCALE))
    red, green, blue = (round(float(np.interp(strength, stops, SCALE[:, k]))) for k in range(3))
    return f"#{red:02x}{green:02x}{blue:02x}"


def _paint_marks(axes: Axes, g: Glance) -> None:
    kept = [(g.votes.strength[i, j], x, y) for i, j, x, y in _cells(g) if g.votes.keeps[i, j] == 1.0]
    for colour, some in (
        ("white", [(x, y) for strength, x, y in kept if strength >= DARK]),
        (INK, [(x, y) for strength, x, y in kept if not strength >= DARK]),
    ):
        if some:
            dots(axes, *np.array(some).T, color=colour, size=5.5)
    silent = np.array([(x, y) for i, j, x, y in _cells(g) if np.isnan(g.votes.keeps[i, j])])
    if len(silent):
        gap = np.full(len(silent), np.nan)
        line = np.column_stack([silent[:, 0] - 0.2, silent[:, 0] + 0.2, gap]).ravel()
        axes.plot(line, np.repeat(silent[:, 1], 3), color=GREY, linewidth=1.0)


def _paint_verdict(axes: Axes, g: Glance, name: str, row: int, width: float) -> None:
    word = g.verdicts[name].verdict
    marker, fill = SHAPES.get(word, ("s", "none"))
    colour = VERDICT_COLOURS.get(word, GREY)
    if any(g.names[j] == name for _, j in g.apart):
        axes.text(width - 0.3, row, "≠", color=WARNING, ha="left", va="center", weight="bold")
    place = axes.get_yaxis_transform()
    start = 18.0 / _px(axes)
    axes.plot(
        1.0 + start, row, marker, fillstyle=fill, color=colour, markersize=6.5, clip_on=False, transform=place
    )
    axes.text(1.0 + start + 7.0 / _px(axes), row, word, ha="left", va="center", color=INK, transform=place)


def _px(axes: Axes) -> float:
    """Width of the axes in px."""
    return float(axes.get_window_extent().width)


def _paint_scale(axes: Axes, y: float, width: float) -> None:
    """Legend below the cells: the colour scale from 0 to 1, and what marks mean."""
    step = 0.16 * width / (LEVELS + 1)
    for k in range(LEVELS + 1):
        box = axes.fill(
            [k * step, (k + 1) * step, (k + 1) * step, k * step],
            [y - 0.25, y - 0.25, y + 0.25, y + 0.25],
            color=shade(k / LEVELS),
            linewidth=0.0,
        )
        box[0].set_clip_on(False)
    end = (LEVELS + 1) * step
    axes.text(-0.2, y, "0", ha="right", va="center", color=INK)
    axes.text(end + 0.2, y, "1 strength", ha="left", va="center", color=INK)


def _alt(g: Glance) -> str:
    parts: list[str] = []
    for j, name in enumerate(g.names):
        kept = int(np.nansum(g.votes.keeps[:, j]))
        told = int(np.isfinite(g.votes.keeps[:, j]).sum())
        word = g.verdicts[name].verdict if name in g.verdicts else "not voted on"
        parts.append(f"{name} kept by {kept} of {told}, {word}")
    return "Votes of the methods by term: " + "; ".join(parts)
