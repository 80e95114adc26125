"""A report read as its reader sees it: sentences, labels of figures, tables, and the numbers in them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from html.parser import HTMLParser
from xml.etree.ElementTree import Element

NUMBER = re.compile(r"(?<![\w.^])[-−]?\d+(?:,\d{3})*(?:\.\d+)?(?:e[-+−]?\d+)?(?![\w^])")
"""A number that stands by itself: not that of a name such as b0 or c_ij2."""

SIZE_OF = {"%": 1e-2, "ns": 1e-9, "µs": 1e-6, "ms": 1e-3, "min": 60.0, "h": 3600.0}

UNIT = re.compile(r"\s*(%|times|ns|µs|ms|s|min|h)?(?!\w)")

VOID = frozenset({"meta", "link", "br", "img", "input", "hr", "col", "wbr"})

Attributes = list[tuple[str, str | None]]

BLOCKS = frozenset({"p", "li", "h1", "h2", "h3", "h4", "figcaption"})
"""Elements that hold a sentence or more of a report."""


@dataclass(frozen=True)
class Block:
    """Text that stands together, and the anchor of the heading that it stands under."""

    anchor: str
    text: str


@dataclass(frozen=True)
class Grid:
    """A table: the anchor that it stands under, its headings, and its rows."""

    anchor: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass
class Page(HTMLParser):
    """Elements of a page as a tree, and what is wrong with how they are closed."""

    html: str
    root: Element = field(default_factory=lambda: Element("root"))
    wrong: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__()
        self.open = [self.root]
        self.feed(self.html)
        self.close()
        self.wrong += [f"<{node.tag}> is not closed" for node in self.open[1:]]

    def handle_starttag(self, tag: str, attrs: Attributes) -> None:
        self.handle_startendtag(tag, attrs)
        if tag not in VOID:
            self.open.append(self.open[-1][-1])

    def handle_startendtag(self, tag: str, attrs: Attributes) -> None:
        self.open[-1].append(Element(tag, {name: value or "" for name, value in attrs}))

    def handle_endtag(self, tag: str) -> None:
        if self.open[-1].tag != tag:
            self.wrong.append(f"</{tag}> at {self.getpos()}")
        if tag in [node.tag for node in self.open[1:]]:
            while self.open.pop().tag != tag:
                pass

    def handle_data(self, data: str) -> None:
        last = self.open[-1]
        if len(last):
            last[-1].tail = (last[-1].tail or "") + data
        else:
            last.text = (last.text or "") + data

    def tagged(self, *tags: str) -> list[dict[str, str]]:
        """Attributes of the elements with one of these tags, in order."""
        return [node.attrib for node in self.root.iter() if node.tag in tags]

    def all(self, name: str) -> list[str]:
        """Values of an attribute, wherever it stands."""
        return [node.attrib[name] for node in self.root.iter() if name in node.attrib]


def tree(html: str) -> Element:
    """Elements of a page."""
    return Page(html).root


def words_of(node: Element) -> str:
    """Text in an element with single blanks."""
    return plain("".join(node.itertext()))


def plain(text: str) -> str:
    """Text with single blanks."""
    return " ".join(text.replace("\xa0", " ").split())


def walked(root: Element, skip: Sequence[str] = ("style", "script", "pre")) -> Iterator[tuple[str, Element]]:
    """Every element of a page with the anchor that it stands under: of the heading, or section, before it."""
    anchor = ""
    todo = [root]
    while todo:
        node = todo.pop()
        if node.tag in skip:
            continue
        above = node.tag == "section" and anchor  # a part's first screen stands under its title
        if node.get("id") and node.tag in ("h1", "h2", "h3", "h4", "section") and not above:
            anchor = node.get("id", "")
        if node.tag == "nav":
            anchor = "nav"
        yield anchor, node
        todo.extend(reversed(node))


def sentences(root: Element, *, apart: Sequence[str] = ("sub",)) -> list[Block]:
    """Text of a page by block; what only repeats the study's settings (of a class in `apart`) is left out."""
    return [
        Block(anchor, words_of(node))
        for anchor, node in walked(root)
        if node.tag in BLOCKS and node.get("class") not in apart
    ]


def drawn(root: Element) -> list[Block]:
    """What a page's figures say to those who cannot see them, and to those who point at a mark."""
    found = []
    for anchor, node in walked(root):
        said = node.get("aria-label", "") if node.tag == "svg" else ""
        if node.tag == "title":
            said = "".join(node.itertext())
        if said:
            found.append(Block(anchor, plain(said)))
    return found


def grids(root: Element) -> list[Grid]:
    """Tables of a page."""
    found = []
    for anchor, node in walked(root):
        if node.tag == "table":
            lines = [[words_of(cell) for cell in row] for row in node.iter("tr")]
            found.append(Grid(anchor, tuple(lines[0]), tuple(map(tuple, lines[1:]))))
    return found


def written(text: str, usual: str = "") -> Iterator[tuple[float, float]]:
    """Numbers of a text in the size of their units, each with half of its last digit.

    Zeros at the end of a whole number may be rounded; a power of ten may be in common with a value before. A
    number without a unit is in the usual one.
    """
    text = re.sub(r"\((\S+) (\+-|±) (\S+)\)(e[-−]?\d+)", r"\1\4 \2 \3\4", text)
    for found in NUMBER.finditer(text):
        unit = UNIT.match(text, found.end())
        body, _, power = found[0].replace(",", "").replace("−", "-").partition("e")
        size = float(f"1e{power or 0}") * SIZE_OF.get(unit[1] if unit and unit[1] else usual, 1.0)
        digits = body.lstrip("-")
        zeros = len(digits) - len(digits.rstrip("0"))
        last = -len(digits.partition(".")[2]) if "." in digits else min(zeros, len(digits) - 1)
        yield float(body) * size, 0.5 * 10.0**last * size
