"""Figures of lots and fleets: matrices of terms by class, in themselves and in a scene, and verdicts.

The matrices are drawn here and not by the plotting library: each of their cells is a link to its numbers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING

from imubayes.population.needs import (
    NEEDED,
    UNTOLD,
    WOULD_MATTER,
    in_scene,
    of_class,
    terms_in,
    terms_of,
)
from imubayes.reporting.canvas import (
    ACCENT,
    GREY,
    WARNING,
    WIDTH,
    Panel,
)
from imubayes.reporting.lots_words import class_name, of_budget, scene_name, slug
from imubayes.reporting.rounding import percent, percents
from imubayes.scenes.relevance import MATTERS
from imubayes.units import counted

if TYPE_CHECKING:
    from imubayes.population.lots import LotResult, MissionFound, MissionTerm
    from imubayes.population.needs import ClassFound
    from imubayes.population.spreads import PopulationTerm

OPEN = "#E69F00"
"""Colour of what a test cannot tell; a question mark goes with it."""

EMPTY = "#eceef1"
"""Colour of the units that do not need a term."""

LEAST = 0.01
"""Share of a budget below which a cell is a point."""

LABEL, LETTER = 46, 6.6
"""px left of a matrix for the terms, and of a letter of a heading."""

ROW, NARROWEST, WIDEST = 19, 20, 40
"""px of a matrix's rows, and of its narrowest and widest columns."""

Cell = tuple[str, str, str]
"""SVG about the middle of a column by `ROW` px, what it shows in words, and the anchor of its numbers.

The words are empty where the drawing says all there is."""


def needed_matrix(result: LotResult, key: str) -> Panel:
    """Share of the units of each class in which each term is needed, or open."""
    names, columns = result.study.library.names, [class_name(one.sensor_class) for one in result.classes]
    wide = _column(len(columns))
    cells = [[_needed_cell(one, one.terms[row], wide) for one in result.classes] for row in range(len(names))]
    needed = [terms_of(one, NEEDED) for one in result.classes]
    all_of = [name for name in names if all(name in own for own in needed)]
    title = f"{len(all_of)} of {len(names)} terms are needed by every class"
    alt = "Terms needed, and count of those that the tests cannot tell: " + "; ".join(
        f"{column}: {' '.join(own) or 'none'}, cannot tell {len(terms_of(one, UNTOLD))}"
        for column, own, one in zip(columns, needed, result.classes, strict=True)
    )
    return Panel(title, _matrix(key, names, columns, cells, alt))


def _needed_cell(found: ClassFound, term: PopulationTerm, wide: int) -> Cell:
    room, tall = wide - 4.0, ROW - 5.0
    first = room * term.needed.value
    second = min(room * term.open, room - first)
    boxes = [(0.0, room, EMPTY), (0.0, first, ACCENT), (first, second, OPEN)]
    drawing = "".join(
        f'<rect x="{x - room / 2:.1f}" y="{-tall / 2:.1f}" width="{w:.1f}" height="{tall:.1f}" fill="{c}"/>'
        for x, w, c in boxes
        if w > 0.0
    )
    if of_class(term) == UNTOLD:
        drawing += f'<text x="{first + second / 2 - room / 2:.1f}" y="4" text-anchor="middle">?</text>'
    name = class_name(found.sensor_class)
    title = (
        f"{term.name}, {name}: needed in {percents(term.needed)} of the units, open in {percent(term.open)}"
    )
    return drawing, title, slug("class", found.sensor_class.id, term.name)


def scene_matrix(result: LotResult, k: int, key: str) -> Panel:
    """Share of the budget of the k-th scene that each term takes in each class."""
    columns = [class_name(one.sensor_class) for one in result.classes]
    found = [one.missions[k] for one in result.classes]
    needs = sum(bool(terms_in(one, one.missions[k], NEEDED)) for one in result.classes)
    scene = scene_name(found[0].mission)
    classes = f"{counted(len(found), 'class')} need{'s' if needs == 1 else ''}"
    title = f"{needs} of {classes} a model in the scene {scene}"
    return Panel(title, _share_matrix(key, found, columns, result.classes))


def _share_matrix(
    key: str, found: Sequence[MissionFound], columns: Sequence[str], owners: Sequence[ClassFound]
) -> str:
    """Matrix of the terms that take something anywhere, a column for each scene of a class."""
    rows = [
        j
        for j in range(len(found[0].terms))
        if any(max(one.terms[j].share.value, one.terms[j].required) >= LEAST for one in found)
    ]
    wide = _column(len(columns))
    cells = [
        [
            (
                _share_drawing(one.terms[j], in_scene(owner.terms[j], one.terms[j]), min(wide, ROW) - 4.0),
                _share_title(one.terms[j], column, in_scene(owner.terms[j], one.terms[j])),
                slug("class", owner.sensor_class.id, one.mission),
            )
            for one, column, owner in zip(found, columns, owners, strict=True)
        ]
        for j in rows
    ]
    names = [found[0].terms[j].name for j in rows]
    alt = "Terms needed, and by the catalogue alone: " + "; ".join(
        f"{column}: {' '.join(terms_in(owner, one, NEEDED)) or 'none'},"
        f" {' '.join(terms_in(owner, one, WOULD_MATTER)) or 'none'}"
        for one, column, owner in zip(found, columns, owners, strict=True)
    )
    return _matrix(key, names, columns, cells, alt)


def _share_title(term: MissionTerm, column: str, answer: str) -> str:
    """Answer, share and need in words, where they are worth it."""
    share = term.share.value
    if term.required == 0.0 and (share < LEAST or answer == UNTOLD):
        return ""
    modelled = f"in the smallest model of {percent(term.required)}"
    return f"{term.name}, {column}: {answer}, {of_budget(share)}, {modelled}"


def _share_drawing(term: MissionTerm, answer: str, largest: float) -> str:
    """Square whose side is a logarithm of the share, framed where the term is needed.

    What the tests cannot tell is a question mark, or hatched where it would matter by the catalogue.
    """
    share = term.share.value
    if answer == UNTOLD:
        return '<text class="open">?</text>'
    side = max(2.0, largest * min(math.log10(max(share, LEAST) / LEAST) / 2.0, 1.0))
    if answer == WOULD_MATTER:
        return _hatched(max(side, 0.5 * largest))
    colour = WARNING if share >= 1.0 else ACCENT if share >= MATTERS else GREY
    drawing = _square(side, f'fill="{colour}"')
    return drawing + _square(largest + 3.0, 'class="frame"') if answer == NEEDED else drawing


def _hatched(side: float) -> str:
    h, s = f"{side / 2:.3g}", f"{side:.3g}"
    lines = f"M-{h} 0L0-{h}M-{h} {h}L{h}-{h}M0 {h}L{h} 0"
    return f'<path d="M-{h}-{h}h{s}v{s}h-{s}z{lines}" class="hatch"/>'


def _square(side: float, style: str) -> str:
    """Square about the origin, in as few letters as may be: a report has thousands."""
    half, whole = f"{side / 2:.3g}", f"{side:.3g}"
    return f'<path d="M-{half}-{half}h{whole}v{whole}h-{whole}z" {style}/>'


def _column(count: int) -> int:
    return max(NARROWEST, min(WIDEST, (WIDTH - LABEL) // max(count, 1)))


def _matrix(
    key: str, rows: Sequence[str], columns: Sequence[str], cells: Sequence[Sequence[Cell]], alt: str
) -> str:
    """SVG of a matrix; headings stand upright.

    A heading is a link where all cells below it have one target, else each cell is.
    """
    wide, head = _column(len(columns)), 12 + LETTER * max(len(name) for name in columns)
    width, height = max(LABEL + wide * len(columns), WIDTH), math.ceil(head + ROW * len(rows) + 6)
    middle = [f"{LABEL + wide * (c + 0.5):.4g}" for c in range(len(columns))]
    ends = [{row[c][2] for row in cells} for c in range(len(columns))]
    parts = [
        _linked(
            f'<text transform="translate({float(x) + 4.0:.1f} {head - 6.0:.1f}) rotate(-90)">'
            f"{escape(name)}</text>",
            *(end if len(end) == 1 else ()),
        )
        for x, name, end in zip(middle, columns, ends, strict=True)
    ]
    for r, (name, row) in enumerate(zip(rows, cells, strict=True)):
        y = head + ROW * (r + 0.5)
        parts.append(f'<text x="{LABEL - 6}" y="{y + 4:.1f}" text-anchor="end">{escape(name)}</text>')
        parts.append(f'<g transform="translate(0 {y:.1f})">')
        parts.extend(
            _linked(
                f'<g transform="translate({x})">{_titled(*cell[:2])}</g>',
                *(() if len(end) == 1 else (cell[2],)),
            )
            for x, cell, end in zip(middle, row, ends, strict=True)
        )
        parts.append("</g>")
    size = f'viewBox="0 0 {width} {height}" width="{width}" height="{height}"'
    return f'<svg id="{key}" {size} role="img" aria-label="{escape(alt)}">{"".join(parts)}</svg>'


def _titled(drawing: str, title: str) -> str:
    return f"<title>{escape(title)}</title>{drawing}" if title else drawing


def _linked(drawing: str, anchor: str = "") -> str:
    return f'<a href="#{anchor}">{drawing}</a>' if anchor else drawing
