"""Figures of lots: a slide, tiles of classes by scene and by term; matrices of terms by class in a scene."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from imubayes.population.needs import NEEDED, NOT_NEEDED, UNTOLD, WOULD_MATTER
from imubayes.reporting import canvas
from imubayes.reporting.lots_words import class_name, of_budget, over_scenes, scene_name
from imubayes.reporting.rounding import percent
from imubayes.scenes.relevance import MATTERS
from imubayes.selection.verdicts import by_verdict
from imubayes.units import counted

if TYPE_CHECKING:
    from imubayes.population.lots import LotResult
    from imubayes.population.needs import ClassFound, MissionFound, MissionTerm

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


def slide(result: LotResult, key: str) -> canvas.Drawing:
    """Tiles of each class: how many terms each scene requires of it, and what it says of each term."""
    told = [_over_scenes(grade) for grade in result.classes]
    names, scene = result.study.library.names, " in some scene" if result.study.missions else ""
    least = 1 if scene else 0
    count = sum(any(terms[name][0] == NEEDED and terms[name][1] >= least for terms in told) for name in names)

    def words(terms: Mapping[str, tuple[str, int]]) -> Iterator[tuple[str, str]]:
        for name, (answer, times) in terms.items():
            yield name, "shown" if scene and answer == NEEDED and not times else answer

    said = "; ".join(
        f"{class_name(grade.sensor_class)}: {by_verdict(words(terms))}"
        for grade, terms in zip(result.classes, told, strict=True)
    )
    owner = "some class" if len(told) > 1 else class_name(result.classes[0].sensor_class)
    high = min(TALL, ROOM / len(told))
    return canvas.draw(
        lambda axes: _tiles(axes, result),
        title=f"{count} of {len(names)} terms are needed by {owner}{scene}",
        alt=said,
        key=key,
        room=canvas.Room(canvas.SLIDE[0], math.ceil(TILES + high * len(told) + KEY), 0, 0, 0, 0),
    )


def _over_scenes(grade: ClassFound) -> dict[str, tuple[str, int]]:
    """What a class says of each term over its scenes, and how many of these require it.

    Without scenes what it says of itself; and of a term that no scene requires, whether its tests show it.
    """
    said, shown = dict[str, tuple[str, int]](), grade.answered(NEEDED)
    for name, answers in over_scenes(grade).items():
        first = next(answer for answer in (NEEDED, WOULD_MATTER, UNTOLD, NOT_NEEDED) if answer in answers)
        answer = NEEDED if first == NOT_NEEDED and name in shown else first
        said[name] = answer, answers.count(NEEDED) if grade.missions else 0
    return said


def _tiles(axes: canvas.Axes, result: LotResult) -> None:
    """Draw rows of classes, with a column for each scene, then one for each term; px from the top left."""
    width, high = canvas.SLIDE[0], min(TALL, ROOM / len(result.classes))
    under = TILES + high * len(result.classes)
    axes.set(xlim=(0, width), ylim=(under + KEY, 0))
    axes.axis("off")
    scenes, terms = [mission.name for mission in result.study.missions], result.study.library.names
    left = 26 + max(7.6 * len(class_name(grade.sensor_class)) for grade in result.classes)
    room = width - 14 - left - (24 if scenes else 0)
    wide = min(64.0, (room - 20.0 * len(terms)) / max(len(scenes), 1))
    first = left + wide * len(scenes) + (24 if scenes else 0)
    narrow = min(34.0, (width - 14 - first) / len(terms))
    if scenes:
        axes.text(left, 12, "by scene", va="top", size=12, color=canvas.SOFT)
    axes.text(first, 12, "by term", va="top", size=12, color=canvas.SOFT)
    heads = [(left + wide * (k + 0.5), scene_name(name)) for k, name in enumerate(scenes)]
    heads += [(first + narrow * (k + 0.5), name) for k, name in enumerate(terms)]
    for x, name in heads:
        axes.text(x, TILES - 6, name, rotation=90, ha="center", va="bottom", size=12)
    for row, grade in enumerate(result.classes):
        y = TILES + high * row
        axes.text(left - 10, y + high / 2, class_name(grade.sensor_class), ha="right", va="center", size=13)
        for k, scene in enumerate(grade.missions):
            _count_tile(axes, (left + wide * k, y, wide, high), scene)
        for k, (answer, times) in enumerate(_over_scenes(grade).values()):
            _term_tile(axes, (first + narrow * k, y, narrow, high), answer, times, len(scenes))
    _key(axes, left, under, len(scenes))


def _count_tile(axes: canvas.Axes, box: canvas.Box, scene: MissionFound) -> None:
    """Number of terms needed, the darker the more; and how many more would matter, which no test shows."""
    count, more = (len(scene.answered(answer)) for answer in (NEEDED, WOULD_MATTER))
    share = count / len(scene.terms)
    colour = canvas.SHADES[min(math.ceil(share * 2.0 * (len(canvas.SHADES) - 1)), len(canvas.SHADES) - 1)]
    ink = "white" if colour == canvas.SHADES[-1] else canvas.INK
    narrow = box[2] < NARROW
    told = f"{count}{chr(10) if narrow else ' '}+{more}?" if more else f"{count}"
    canvas.tile(axes, box, told, ink=ink, size=9 if narrow else 14, facecolor=colour)


def _term_tile(axes: canvas.Axes, box: canvas.Box, answer: str, times: int, scenes: int) -> None:
    """Dark where every scene requires the term, paler with their number where some do or none does."""
    if answer == NEEDED and times == scenes:
        canvas.tile(axes, box, facecolor=canvas.ACCENT)
    elif answer == NEEDED:
        canvas.tile(axes, box, f"{times}", facecolor=canvas.SHADES[2 if times else 1])
    elif answer == WOULD_MATTER:
        canvas.tile(axes, box, facecolor="white", edgecolor=canvas.INK, hatch="////", linewidth=0.6)
    elif answer == UNTOLD:
        canvas.tile(axes, box, "?", facecolor="white", edgecolor=canvas.GREY, linewidth=0.6)
    else:
        canvas.tile(axes, box, facecolor=canvas.SHADES[0])


def _key(axes: canvas.Axes, left: float, under: float, scenes: int) -> None:
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
        canvas.tile(axes, (x, y, 46, 20), "n +m?", facecolor=canvas.SHADES[2])
        axes.text(x + 52, y + 10, "n needed, m would matter", va="center", size=12)


def scene_matrix(result: LotResult, k: int, key: str) -> canvas.Drawing:
    """Share of the budget of the k-th scene that each term takes in each class.

    A square's side is a logarithm of the share, with a frame where the term is needed. What the tests cannot
    tell is a question mark, or hatched where it would matter by the catalogue. Terms that take nothing
    anywhere are left out.
    """
    scenes = [grade.missions[k] for grade in result.classes]
    columns, terms = [class_name(grade.sensor_class) for grade in result.classes], scenes[0].terms
    rows = [
        j
        for j in range(len(terms))
        if any(max(scene.terms[j].share.value, scene.terms[j].required) >= LEAST for scene in scenes)
    ]
    wide = max(NARROWEST, min(WIDEST, (canvas.WIDTH - LABEL) // len(columns)))
    head, left = 12 + LETTER * max(map(len, columns)), [LABEL + wide * c for c in range(len(columns))]
    room = canvas.Room(
        max(LABEL + wide * len(columns), canvas.WIDTH), math.ceil(head + ROW * len(rows) + 6), 0, 0, 0, 0
    )
    cells = [
        ((left[c], head + ROW * r, wide, ROW), scene.terms[j], (scene, name))
        for r, j in enumerate(rows)
        for c, (scene, name) in enumerate(zip(scenes, columns, strict=True))
    ]

    def paint(axes: canvas.Axes) -> None:
        axes.set(xlim=(0, room.width), ylim=(room.height, 0))
        axes.axis("off")
        for x, name in zip(left, columns, strict=True):
            axes.text(x + wide / 2, head - 6, name, rotation=90, ha="center", va="bottom")
        for r, j in enumerate(rows):
            axes.text(LABEL - 6, head + ROW * (r + 0.5), terms[j].name, ha="right", va="center")
        _squares(axes, [cell[:2] for cell in cells], min(wide, ROW) - 4.0)

    needs = [bool(scene.answered(NEEDED)) for scene in scenes]
    classes = f"{counted(len(scenes), 'class')} need{'s' if sum(needs) == 1 else ''}"
    alt = "; ".join(
        f"{name}: " + ", ".join(" ".join(scene.answered(told)) or "none" for told in (NEEDED, WOULD_MATTER))
        for name, scene in zip(columns, scenes, strict=True)
    )
    return canvas.draw(
        paint,
        title=f"{sum(needs)} of {classes} a model in the scene {scene_name(scenes[0].name)}",
        alt=f"Terms needed, and by the catalogue alone: {alt}",
        key=key,
        said=[(box, said) for box, term, where in cells if (said := _share_words(term, *where))],
        room=room,
    )


def _share_words(term: MissionTerm, scene: MissionFound, column: str) -> str:
    """Answer, share and need in words, where they are worth it."""
    share = term.share.value
    if term.required == 0.0 and (share < LEAST or term.answer == UNTOLD):
        return ""
    modelled = f"in the smallest model of {percent(term.required)}"
    return f"{term.name}, {column}: {term.answer}, {of_budget(share, scene)}, {modelled}"


def _squares(axes: canvas.Axes, cells: Sequence[tuple[canvas.Box, MissionTerm]], largest: float) -> None:
    """Draw the squares of a matrix, those of a colour as one path: a report has thousands."""
    drawn: dict[str, list[canvas.Box]] = {}
    for (x, y, w, h), term in cells:
        share, answer = term.share.value, term.answer
        side = max(2.0, largest * min(math.log10(max(share, LEAST) / LEAST) / 2.0, 1.0))
        colour = canvas.WARNING if share >= 1.0 else canvas.ACCENT if share >= MATTERS else canvas.GREY
        sides = [(colour, side), *([("frame", largest + 3.0)] if answer == NEEDED else [])]
        if answer == UNTOLD:
            axes.text(x + w / 2, y + h / 2, "?", ha="center", va="center", color=canvas.SOFT)
        elif answer == WOULD_MATTER:
            sides = [("hatch", max(side, 0.5 * largest))]
        for style, a in sides if answer != UNTOLD else ():
            box = (x + (w - a) / 2, x + (w + a) / 2, y + (h - a) / 2, y + (h + a) / 2)
            drawn.setdefault(style, []).append(box)
    edge = {"edgecolor": canvas.GREY, "linewidth": 0.9}
    styles = {"frame": edge, "hatch": {**edge, "hatch": "/////"}}
    for colour, boxes in drawn.items():
        canvas.areas(axes, boxes, "none" if colour in styles else colour, **styles.get(colour, {}))
