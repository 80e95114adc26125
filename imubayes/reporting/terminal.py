"""Blocks in a terminal of 80 columns."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from markupsafe import Markup
from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table as Grid
from rich.text import Text as Line

from imubayes.reporting.blocks import Both, Prose, Section, Table

if TYPE_CHECKING:
    from imubayes.reporting.blocks import Block, Page, Text

STYLES = {"answer": "bold", "note": "dim"}
"""Of prose, by its style."""


def terminal_page(page: Page) -> Group:
    """Lines of a whole page."""
    return terminal((*page.first, *page.blocks))


def terminal(blocks: Iterable[Block]) -> Group:
    """Lines for a terminal: words and tables, without figures and what is left to the page."""
    return Group(*_parts(blocks, 0))


def _parts(blocks: Iterable[Block], depth: int) -> Iterator[RenderableType]:
    for block in blocks:
        if isinstance(block, Section) and _is_shown(block):
            told = f"{block.title}  {block.sub}".rstrip()
            yield indented(told, "dim") if depth else Line(printable(told), style="bold")
            yield from _parts(block.blocks, depth + 1)
            yield from [] if depth else [Line()]
        elif isinstance(block, Prose):
            style = STYLES.get(block.style, "")
            for text in map(_words, block.paragraphs):
                yield indented(text, style) if depth else Line(printable(text), style=style)
            yield from [] if depth or not block.paragraphs else [Line()]
        elif isinstance(block, Table):
            yield _grid(block)


def _is_shown(section: Section) -> bool:
    """Whether a terminal shows a section: not where it has tables, and nothing brief in them."""
    tables = list(_tables(section))
    return section.brief and (not tables or any(row.brief for table in tables for row in table.lines))


def _tables(section: Section) -> Iterator[Table]:
    for block in section.blocks:
        if isinstance(block, Table):
            yield block
        elif isinstance(block, Section):
            yield from _tables(block)


def _grid(table: Table) -> Grid:
    grid = Grid(box=None, pad_edge=False, padding=(0, 1), header_style="dim", show_header=bool(table.head))
    head = table.head or [""] * max(len(row.cells) for row in table.lines)
    shown = [k for k, text in enumerate(head) if not (isinstance(text, Both) and text.terminal is None)]
    for k in shown:
        letter = table.column(k)
        justify = "right" if letter == "n" else "left"
        grid.add_column(_words(head[k]), justify=justify, no_wrap=letter in "tn")
    for row in table.lines:
        if row.brief:
            style = "bold" if row.strong else ""
            grid.add_row(*(Line(printable(_words(row.cells[k])), style=style) for k in shown))
    return grid


def _words(text: Text) -> str:
    """Text without markup, and with plain spaces for those where no line of a page ends."""
    said = (text.terminal or "") if isinstance(text, Both) else text
    plain = said.striptags() if isinstance(said, Markup) else said
    return plain.replace("\N{NO-BREAK SPACE}", " ")


def indented(text: str, style: str = "") -> Padding:
    """Paragraph that stands a little in, printable."""
    return Padding(Line(printable(text), style=style), (0, 0, 0, 1))


def printable(text: str) -> str:
    r"""Names come from files: what is not printable does not reach a terminal, every blank is plain.

    Examples
    --------
    >>> printable("ACC\x1b[2J-07")
    'ACC?[2J-07'
    """
    return "".join(sign if sign.isprintable() else " " if sign.isspace() else "?" for sign in text)
