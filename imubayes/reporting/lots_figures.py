"""Figures of lots: a slide, tiles of classes by scene and by term; and matrices of terms by class in a scene.

The matrices are drawn here and not by the plotting library: each cell says its share where a pointer rests.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING

from imubayes.population.needs import (
    NEEDED,
    NOT_NEEDED,
    UNTOLD,
    WOULD_MATTER,
    answers_in,
    in_scene,
    of_class,
    terms_in,
    terms_of,
)
from imubayes.reporting.canvas import (
    ACCENT,
    GREY,
    INK,
    NO_MARGINS,
    SHADES,
    SLIDE,
    SOFT,
    WARNING,
    WIDTH,
    Axes,
    Box,
    Panel,
    draw,
    tile,
)
from imubayes.reporting.lots_words import class_name, of_budget, scene_name
from imubayes.reporting.rounding import percent
from imubayes.scenes.relevance import MATTERS
from imubayes.units import counted

if TYPE_CHECKING:
    from imubayes.population.lots import LotResult, MissionFound, MissionTerm
    from imubayes.population.needs import ClassFound

TILES, KEY = 112, 65
"""px above the tiles, and of their key below them."""

ROOM, TALL = 350, 52
"""px that all tiles, and one, may be high."""

NARROW = 54
"""px of a tile below which what would matter stands under what is needed."""

LEAST = 0.01
"""Share of a budget below which a cell is a point."""

LABEL, LETTER = 46, 6.6
"""px left of a matrix for the terms, and of a letter of a heading."""

ROW, NARROWEST, WIDEST = 19, 20, 40
"""px of a matrix's rows, and of its narrowest and widest columns."""

Cell = tuple[str, str]
"""SVG about the middle of a column by `ROW` px, and what it shows in words where that is worth it."""


def slide(result: LotResult, key: str) -> Panel:
    """Tiles of each class: how many terms each scene requires of it, and what it says of each term."""
    told = [_over_scenes(one) for one in result.classes]
    names, scene = result.study.library.names, " in some scene" if result.study.missions else ""
    least = 1 if scene else 0
    count = sum(any(one[name][0] == NEEDED and one[name][1] >= least for one in told) for name in names)
    said = "; ".join(
        f"{class_name(one.sensor_class)}: {_alt(terms, scenes=bool(scene))}"
        for one, terms in zip(result.classes, told, strict=True)
    )
    width, high = SLIDE[0], min(TALL, ROOM / len(told))
    height = math.ceil(TILES + high * len(told) + KEY)
    return draw(
        lambda axes: _tiles(axes, result),
        title=f"{count} of {len(names)} terms are needed by some class{scene}",
        alt=said,
        key=key,
        **NO_MARGINS,
        width=width,
        height=height,
    )


def _over_scenes(found: ClassFound) -> dict[str, tuple[str, int]]:
    """What a class says of each term over its scenes, and how many of these require it.

    Without scenes what it says of itself; and of a term that no scene requires, whether its tests show it.
    """
    if not found.missions:
        return {term.name: (of_class(term), 0) for term in found.terms}
    told = [dict(answers_in(found, scene)) for scene in found.missions]
    said: dict[str, tuple[str, int]] = {}
    for name in told[0]:
        answers = [answer[name] for answer in told]
        first = next(one for one in (NEEDED, WOULD_MATTER, UNTOLD, NOT_NEEDED) if one in answers)
        shown = first == NOT_NEEDED and name in terms_of(found, NEEDED)
        said[name] = NEEDED if shown else first, answers.count(NEEDED)
    return said


def _alt(told: Mapping[str, tuple[str, int]], *, scenes: bool) -> str:
    """Terms by what is said of them, in words."""
    by: dict[str, list[str]] = {}
    for name, (answer, times) in told.items():
        by.setdefault("shown" if scenes and answer == NEEDED and not times else answer, []).append(name)
    return ", ".join(f"{answer} {' '.join(names)}" for answer, names in by.items())


def _tiles(axes: Axes, result: LotResult) -> None:
    """Draw rows of classes, with a column for each scene, then one for each term; px from the top left."""
    width, high = SLIDE[0], min(TALL, ROOM / len(result.classes))
    under = TILES + high * len(result.classes)
    axes.set(xlim=(0, width), ylim=(under + KEY, 0))
    axes.axis("off")
    scenes, terms = [one.name for one in result.study.missions], result.study.library.names
    left = 26 + max(7.6 * len(class_name(one.sensor_class)) for one in result.classes)
    room = width - 14 - left - (24 if scenes else 0)
    wide = min(64.0, (room - 20.0 * len(terms)) / max(len(scenes), 1))
    first = left + wide * len(scenes) + (24 if scenes else 0)
    narrow = min(34.0, (width - 14 - first) / len(terms))
    if scenes:
        axes.text(left, 12, "by scene", va="top", size=12, color=SOFT)
    axes.text(first, 12, "by term", va="top", size=12, color=SOFT)
    heads = [(left + wide * (k + 0.5), scene_name(name)) for k, name in enumerate(scenes)]
    heads += [(first + narrow * (k + 0.5), name) for k, name in enumerate(terms)]
    for x, name in heads:
        axes.text(x, TILES - 6, name, rotation=90, ha="center", va="bottom", size=12)
    for row, one in enumerate(result.classes):
        y = TILES + high * row
        axes.text(left - 10, y + high / 2, class_name(one.sensor_class), ha="right", va="center", size=13)
        for k, scene in enumerate(one.missions):
            _count_tile(axes, (left + wide * k, y, wide, high), one, scene)
        for k, (answer, times) in enumerate(_over_scenes(one).values()):
            _term_tile(axes, (first + narrow * k, y, narrow, high), answer, times, len(scenes))
    _key(axes, left, under, len(scenes))


def _count_tile(axes: Axes, box: Box, found: ClassFound, scene: MissionFound) -> None:
    """Number of terms needed, the darker the more; and how many more would matter, which no test shows."""
    count, more = (len(terms_in(found, scene, answer)) for answer in (NEEDED, WOULD_MATTER))
    share = count / len(scene.terms)
    colour = SHADES[min(math.ceil(share * 2.0 * (len(SHADES) - 1)), len(SHADES) - 1)]
    ink = "white" if colour == SHADES[-1] else INK
    narrow = box[2] < NARROW
    told = f"{count}{chr(10) if narrow else ' '}+{more}?" if more else f"{count}"
    tile(axes, box, told, ink=ink, size=9 if narrow else 14, facecolor=colour)


def _term_tile(axes: Axes, box: Box, answer: str, times: int, scenes: int) -> None:
    """Dark where every scene requires the term, paler with their number where some do or none does."""
    if answer == NEEDED and times == scenes:
        tile(axes, box, facecolor=ACCENT)
    elif answer == NEEDED:
        tile(axes, box, f"{times}", facecolor=SHADES[2 if times else 1])
    elif answer == WOULD_MATTER:
        tile(axes, box, facecolor="white", edgecolor=INK, hatch="////", linewidth=0.6)
    elif answer == UNTOLD:
        tile(axes, box, "?", facecolor="white", edgecolor=GREY, linewidth=0.6)
    else:
        tile(axes, box, facecolor=SHADES[0])


def _key(axes: Axes, left: float, under: float, scenes: int) -> None:
    """What the tiles of a term mean."""
    told = [(NEEDED, scenes, "needed in every scene" if scenes else "needed")]
    told += [(NEEDED, 1, "needed in so many scenes")] if scenes > 1 else []
    told += [(NEEDED, 0, "shown, needed in no scene"), (NOT_NEEDED, 0, "not needed")] if scenes else []
    told += [(WOULD_MATTER, 0, "cannot tell, would matter")] if scenes else [(NOT_NEEDED, 0, "not needed")]
    for k, (answer, times, words) in enumerate([*told, (UNTOLD, 0, "cannot tell")]):
        x, y = left + 225.0 * (k % 4), under + 12.0 + 24.0 * (k // 4)
        _term_tile(axes, (x, y, 22, 20), answer, times, scenes)
        axes.text(x + 28, y + 10, words, va="center", size=12)
    if scenes:
        x, y = left + 225.0 * 3, under + 36.0
        tile(axes, (x, y, 46, 20), "n +m?", facecolor=SHADES[2])
        axes.text(x + 52, y + 10, "n needed, m would matter", va="center", size=12)


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
    """SVG of a matrix; headings stand upright."""
    wide, head = _column(len(columns)), 12 + LETTER * max(map(len, columns))
    width, height = max(LABEL + wide * len(columns), WIDTH), math.ceil(head + ROW * len(rows) + 6)
    middle = [f"{LABEL + wide * (c + 0.5):.4g}" for c in range(len(columns))]
    parts = [
        f'<text transform="translate({float(x) + 4.0:.1f} {head - 6.0:.1f}) rotate(-90)">'
        f"{escape(name)}</text>"
        for x, name in zip(middle, columns, strict=True)
    ]
    for r, (name, row) in enumerate(zip(rows, cells, strict=True)):
        y = head + ROW * (r + 0.5)
        parts.append(f'<text x="{LABEL - 6}" y="{y + 4:.1f}" text-anchor="end">{escape(name)}</text>')
        parts.append(f'<g transform="translate(0 {y:.1f})">')
        parts += [
            f'<g transform="translate({x})">{_titled(*cell)}</g>' for x, cell in zip(middle, row, strict=True)
        ]
        parts.append("</g>")
    size = f'viewBox="0 0 {width} {height}" width="{width}" height="{height}"'
    return f'<svg id="{key}" {size} role="img" aria-label="{escape(alt)}">{"".join(parts)}</svg>'


def _titled(drawing: str, title: str) -> str:
    return f"<title>{escape(title)}</title>{drawing}" if title else drawing
