"""A page as its reader sees it: elements, sentences, labels of figures, numbers; lines of a terminal."""

import contextlib
import io
import json
import os
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from html.parser import HTMLParser
from typing import Any
from unittest import mock
from xml.etree.ElementTree import Element

from rich.console import RenderableType

from imubayes.cli.console import show
from imubayes.reporting.blocks import page_html
from imubayes.reporting.document import report_page
from imubayes.study import StudyResult

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


def walked(root: Element) -> Iterator[tuple[str, Element]]:
    """Every element of a page with the anchor that it stands under: of the heading, or section, before it."""
    anchor = ""
    todo = [root]
    while todo:
        node = todo.pop()
        if node.tag in ("style", "script", "pre"):
            continue
        above = node.tag == "section" and anchor  # a part's first screen stands under its title
        if node.get("id") and node.tag in ("h1", "h2", "h3", "h4", "section") and not above:
            anchor = node.get("id", "")
        if node.tag == "nav":
            anchor = "nav"
        yield anchor, node
        todo.extend(reversed(node))


def sentences(root: Element) -> list[Block]:
    """Text of a page by block, without what only repeats the study's settings."""
    return [
        Block(anchor, words_of(node))
        for anchor, node in walked(root)
        if node.tag in BLOCKS and node.get("class") != "sub"
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


def whole(page: Page) -> Page:
    """A page whose elements are closed in their order, and whose links lead to one place each."""
    assert page.wrong == []
    ids, links = page.all("id"), {link[1:] for link in page.all("href") if link.startswith("#")}
    assert len(ids) == len(set(ids))
    assert links <= set(ids), links - set(ids)
    return page


LINES = frozenset({"p", "li", "dt", "dd", "caption", "figcaption", "summary", "pre", "title"})
"""Elements whose words stand in a line of their own."""


def said(html: str) -> str:
    """Words of a page: a line for each heading, paragraph, row of a table and label of a figure."""
    return "".join(f"{line}\n" for line in _lines(tree(html)) if line)


def _lines(node: Element) -> Iterator[str]:
    if node.tag in ("style", "script") or node.get("aria-hidden"):
        return
    if re.fullmatch("h[1-6]", node.tag):
        yield f"\n{'#' * int(node.tag[1])} {words_of(node)}"
    elif node.tag in LINES:
        yield words_of(node)
    elif node.tag == "tr":
        yield " | ".join(words_of(cell) for cell in node)
    elif node.tag == "svg":
        labels = [text for text in map(words_of, node.iter("text")) if not NUMBER.fullmatch(text)]
        yield f"figure: {plain(node.get('aria-label', ''))} [{'; '.join(labels)}]"
    else:
        for child in node:
            yield from _lines(child)


def numbers(value: Any, indent: str = "\n") -> str:
    """JSON with a line for each table that holds no other, and numbers to four digits."""
    if isinstance(value, float):
        return f"{value:.4g}" if abs(value) > 1e-18 else "0"  # rounding's own digits are no promise
    if not isinstance(value, dict | list):
        return json.dumps(value, ensure_ascii=False)
    entries = list(value.values() if isinstance(value, dict) else value)
    keys = [f"{json.dumps(key)}: " for key in value] if isinstance(value, dict) else [""] * len(value)
    flat = not any(isinstance(one, dict | list) for one in entries)
    start, between, end = ("", ", ", "") if flat else (f"{indent} ", f",{indent} ", indent)
    parts = [key + numbers(one, f"{indent} ") for key, one in zip(keys, entries, strict=True)]
    first, last = "{}" if isinstance(value, dict) else "[]"
    return f"{first}{start}{between.join(parts)}{end}{last}"


def report_html(result: StudyResult) -> str:
    """Text of the report of a study of sensors."""
    return page_html(report_page(result))


def printed(shown: RenderableType, encoding: str = "utf-8") -> str:
    """Lines of a terminal of 80 columns without colour."""
    stream = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    with mock.patch.dict(os.environ, {"COLUMNS": "80"}), contextlib.redirect_stdout(stream):
        show(shown)
    stream.flush()
    return stream.buffer.getvalue().decode(encoding)


def told_of(cases: Iterable[tuple[str, Any]]) -> str:
    """What is said in each case, by its name: texts and rows of tables with a line each."""

    def lines(text: Any) -> str:
        if isinstance(text, str):
            return text
        return "\n".join(one if isinstance(one, str) else " | ".join(map(lines, one)) for one in text)

    told = "\n".join(f"[{case}]\n{lines(text)}\n" for case, text in cases)
    return told.replace("\xa0", " ").replace("\u202f", " ")
