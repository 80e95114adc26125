"""A comparison as a reader sees it: on a page, and in a terminal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Group, RenderableType
from rich.table import Table as Grid
from rich.text import Text

from imubayes.reporting.comparison.pulls import Pull, is_beyond
from imubayes.reporting.results import versions
from imubayes.reporting.rounding import minus, pretty
from imubayes.reporting.rows import MARKS
from imubayes.reporting.terminal import indented, printable

RIGHT = ("inclusion", "difference")
"""Columns of numbers."""

FOLDED = ("verdict", "mean", "spread", "class: mean, spread", "method")
"""Columns of a terminal that may take two lines."""

SHORT = {"result": "", "difference": "differs"}
"""Headings in a terminal, where they are others."""


@dataclass(frozen=True, slots=True)
class Line:
    """A line of a table.

    Attributes
    ----------
    cells : as text, one for each heading; the first is empty after the first line of its group.
    beyond : whether it differs beyond uncertainty.
    brief : whether a terminal shows it.
    narrow : cells in a terminal, where they are others.
    """

    cells: tuple[str, ...]
    beyond: bool = False
    brief: bool = True
    narrow: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Table:
    """A table, its title and headings; "verdict" and "difference" are set in their own ways.

    In a terminal it has the headings `narrow`, where they are others. `said` are sentences that go with it.
    """

    title: str
    head: tuple[str, ...]
    lines: tuple[Line, ...]
    narrow: tuple[str, ...] = ()
    said: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Section:
    """A part of the page: a component, a class, a scene.

    Attributes
    ----------
    anchor, title, told : of the section; what it is, in a few words.
    sentences : the finding.
    tables : its numbers.
    """

    anchor: str
    title: str
    told: str
    sentences: tuple[str, ...]
    tables: tuple[Table, ...]


@dataclass(frozen=True, slots=True)
class Labelled:
    """A result that is compared, under its label."""

    label: str
    study: str
    path: Path
    sha256: str
    version: str


@dataclass(frozen=True, slots=True)
class Page:
    """A whole comparison.

    Attributes
    ----------
    question : that it answers.
    answer : in words made from the numbers.
    files : the results.
    method : what counts as a difference.
    notes : what stands in one result only.
    sections : one by one.
    """

    question: str
    answer: tuple[str, ...]
    files: tuple[Labelled, ...]
    method: str
    notes: tuple[str, ...]
    sections: tuple[Section, ...]

    @property
    def command(self) -> str:
        """Command that repeats it."""
        return f"imubayes compare {' '.join(str(one.path) for one in self.files)}"


def page_html(page: Page) -> str:
    """Text of the page; names that come from files are escaped."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("imubayes", "reporting"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["pretty"] = lambda text: minus(pretty(text).replace("+-", "±"))
    return environment.get_template("comparison.html.j2").render(
        page=page,
        right=RIGHT,
        marks={verdict: mark[0] for verdict, mark in MARKS.items()},
        versions=versions(),
    )


def terminal_page(page: Page) -> Group:
    """Lines for a terminal: what differs, and the numbers side by side. It fits 80 columns."""
    parts: list[RenderableType] = [
        Text(printable(f"{one.label}  {one.path} ({one.study})")) for one in page.files
    ]
    parts += [Text(), Text(printable(" ".join(page.answer)), style="bold"), Text()]
    parts += [indented(text) for text in page.notes]
    for section in page.sections:
        shown = [table for table in section.tables if any(line.brief for line in table.lines)]
        if shown:
            parts.append(Text(printable(f"{section.title}  {section.told}".rstrip()), style="bold"))
            for k, table in enumerate(shown):
                parts += [*([indented(table.title, "dim")] if k else []), _grid(table)]
                parts += map(indented, table.said)
            parts += [*(indented(_unbroken(text)) for text in section.sentences), Text()]
    parts.append(indented(page.method, "dim"))
    return Group(*parts)


def _grid(table: Table) -> Grid:
    grid = Grid(box=None, pad_edge=False, padding=(0, 1, 0, 1), header_style="dim")
    for heading in table.narrow or table.head:
        justify = "right" if heading in RIGHT else "left"
        grid.add_column(SHORT.get(heading, heading), justify=justify, no_wrap=heading not in FOLDED)
    for line in table.lines:
        if line.brief:
            style = "bold" if line.beyond else ""
            cells = line.narrow or line.cells
            grid.add_row(*(Text(printable(_unbroken(cell)), style=style) for cell in cells))
    return grid


def _unbroken(text: str) -> str:
    """Put plain spaces for those of a page where no line ends."""
    return text.replace("\N{NO-BREAK SPACE}", " ")


def pull_text(pull: Pull | None, count: int, what: str = "") -> str:
    """Difference as text; between which two of more than two results."""
    if pull is None:
        return ""
    pair = f" {pull.pair[0]}-{pull.pair[1]}" if count > 2 else ""
    of = f"{what} " if what else ""
    return f"{'! ' if is_beyond(pull) else ''}{of}{pull.size:.1f} sd{pair}"


def headed(k: int, *texts: str) -> tuple[str, ...]:
    """Texts that only the first line of a group has."""
    return texts if k == 0 else ("",) * len(texts)


def counted(count: int, one: str, many: str) -> str:
    """Number with its noun and verb.

    Examples
    --------
    >>> counted(1, "value differs", "values differ"), counted(3, "value differs", "values differ")
    ('1 value differs', '3 values differ')
    """
    return f"{count} {one if count == 1 else many}"


def largest_first(pulls: Sequence[tuple[str, Pull | None]]) -> list[tuple[str, Pull]]:
    """Named differences beyond uncertainty, the largest first."""
    there = [(name, pull) for name, pull in pulls if pull is not None and pull.beyond]
    return sorted(there, key=lambda pair: -pair[1].size)
