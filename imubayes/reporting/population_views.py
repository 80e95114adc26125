"""What the report shows of units of a class: findings, a table, a figure."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup

from imubayes.reporting.blocks import Block, Figure, Prose, Section, Table, joined, quiet, verdict
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
from imubayes.reporting.population_words import (
    LIKE,
    changes,
    class_answer,
    class_sentences,
    parts,
    short_title,
    shown,
    spread_text,
    whole,
)
from imubayes.reporting.rounding import measured, per_unit, percent, percents, pretty, signed
from imubayes.units import counted

if TYPE_CHECKING:
    from imubayes.population.classes import ClassInCommon, TermInClass

ROW, TALLEST = 9.0, 420.0
"""px of a unit, and of all of them at most."""

GAP = 1.5
"""Rows between components."""

BAR = 0.42
"""Half height of a session's bar, in rows."""

MOST_PANELS = 8
"""Terms that are drawn."""


NOTE = (
    "Intervals hold 90 %. The spreads are sds, each apart from the others: from unit to unit, between"
    " sessions of a unit, and the error bar of one session, with what the test books to a term in place"
    " of another. A unit needs a term where its sessions say so and none says the opposite; the interval"
    " of the share reaches as far as the units that cannot tell may be either. The class needs what more"
    " than half of its units need, if one model for all of them has it with 0.95 or more."
)

REPEATED = (
    " Common is the share of the variance between sessions that all units have together; that is seen as"
    " often as there are sessions, so that the interval is wider than if units moved independently."
)

ONCE = " With one session of each unit, what a turn-on changes is in the sd from unit to unit."


def class_title(found: ClassInCommon) -> str:
    """Class and kind."""
    return f"{found.class_id}, {found.kind}s"


def class_words(found: ClassInCommon) -> str:
    """Answer for the top of the page."""
    return _signs(class_answer(found))


def class_section(found: ClassInCommon, k: int) -> Section:
    """What the units of the k-th class have in common."""
    terms = shown(found)
    blocks: list[Block] = [Prose([_signs(text) for text in class_sentences(found)], "list")]
    if terms:
        drawn = [term for term in whole(found) if term in terms][:MOST_PANELS]
        panels = [units_panel(first, parts(terms, first), f"u{k}x{n}") for n, first in enumerate(drawn)]
        further = " in a further session" if is_repeated(found) else ""
        note = (
            "A row is a unit: the dot is its mean, each bar a session. The grey line is the population's"
            f" mean; the band holds a further unit{further} with 90 %."
        )
        blocks += [_table(found, terms), Figure(panels, note)]
    title, sub = "What units of this class have in common", class_title(found)
    return Section(title, blocks, f"class-{k + 1}", sub, listed=f"Units of {sub}")


def is_repeated(found: ClassInCommon) -> bool:
    """Whether units were tested in several sessions."""
    return sum(bool(name) for name in found.sessions) > 1


def _table(found: ClassInCommon, terms: tuple[TermInClass, ...]) -> Table:
    repeated, left = is_repeated(found), len(found.terms) - len(terms)
    more = f" {left} more parameters are in result.json." if left else ""
    between = ("between sessions", "common") if repeated else ()
    return Table(
        f"Population of {class_title(found)}",
        ("term", "the class", "needed in", "mean ± sd", "unit to unit", *between, "error bar", "unit"),
        [_row(term, found, repeated=repeated) for term in terms],
        "ttnnnnnnt" if repeated else "ttnnnnt",
        f"{NOTE}{REPEATED if repeated else ONCE}{more}",
    )


def _row(term: TermInClass, found: ClassInCommon, *, repeated: bool) -> tuple[str, ...]:
    printed, spreads, need = term.printed, term.spreads, term.need
    unit = per_unit(printed, term.unit)
    together = not term.component and len(found.components) > 1 and len(term.units) > len(found.units)
    answers = {part.need.verdict for part in found.terms if part.term == term.term and part is not term}
    needing = f"{need.answers.get('needed', 0)} of {sum(need.answers.values())}"
    share = quiet(f"({100.0 * need.share.low:.0f} to {percent(need.share.high)})")
    mean = None if together else measured(spreads.mean.value / unit, spreads.mean_sd / unit, printed)
    between = (
        _signs(spread_text(term, "turn_on").removesuffix(f" {printed}")),
        percents(spreads.common_share) if changes(term) else "",
    )
    error = measured(math.hypot(spreads.noise, spreads.alias) / unit, 0.0, printed)
    return (
        Markup("{}{}").format(term.name, quiet(", all") if together else ""),
        "by axis"
        if together and len(answers) > 1
        else verdict(need.verdict, reason=need.reason, like=LIKE.get(need.verdict, "")).page,
        joined(needing, share),
        signed(mean),
        _signs(spread_text(term, "unit").removesuffix(f" {printed}")),
        *(between if repeated else ()),
        quiet(signed(error)),
        pretty(printed),
    )


def _signs(text: str) -> str:
    """ASCII with the real signs, for the page; a hyphen within a word stays."""
    return re.sub(r"(?<![\w-])-(?=\d)", "−", pretty(text).replace("+-", "±"))


def units_panel(first: TermInClass, parts: tuple[TermInClass, ...], key: str) -> Panel:
    """One term: a lane for each component, in it a row for each unit.

    Parameters
    ----------
    first : the term for all components together, or the only one.
    parts : by component.
    """
    unit = per_unit(first.printed, first.unit)
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
    axes.set(ylim=(rows - 0.4, -0.6), xlabel=f"{parts[0].term}, {pretty(parts[0].printed)}")
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
