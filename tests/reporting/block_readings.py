"""Blocks of a page as a test reads them: words of cells, tables and panels wherever they stand."""

from collections.abc import Iterable, Iterator

from markupsafe import Markup

from imubayes.reporting.blocks import Block, Both, Figure, Prose, Section, Table, Text


def words(text: Text) -> str:
    """Words of a text on a page."""
    said = text.page if isinstance(text, Both) else text
    return said.striptags() if isinstance(said, Markup) else said


def walk(blocks: Iterable[Block]) -> Iterator[Block]:
    """Every block, those of sections after them."""
    for block in blocks:
        yield block
        if isinstance(block, Section):
            yield from walk(block.blocks)


def rows(blocks: Iterable[Block]) -> list[tuple[str, ...]]:
    """Cells of all tables."""
    tables = [block for block in walk(blocks) if isinstance(block, Table)]
    return [tuple(map(words, row.cells)) for table in tables for row in table.lines]


def panels(blocks: Iterable[Block]) -> list:
    """Panels of all figures."""
    return [panel for block in walk(blocks) if isinstance(block, Figure) for panel in block.panels]


def said(blocks: Iterable[Block]) -> str:
    """Prose, and the notes of tables and figures."""
    found = []
    for block in walk(blocks):
        found += map(words, block.paragraphs) if isinstance(block, Prose) else []
        found += [words(block.note)] if isinstance(block, Table | Figure) else []
    return " ".join(found)
