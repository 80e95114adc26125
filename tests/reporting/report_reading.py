"""A report read as its reader sees it, and every number in it held against the result.

A `Reading` is a phrase that reports use, and what its numbers and names must be by ``result.json``. A number
that no reading explains is a problem, as is one that its reading contradicts: a sentence that is added to a
report asks for its reading.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from html.parser import HTMLParser
from typing import Any
from xml.etree.ElementTree import Element

NUMBER = re.compile(r"(?<![\w.^])[-−]?\d+(?:,\d{3})*(?:\.\d+)?(?:e[-+−]?\d+)?(?![\w^])")
"""A number that stands by itself: not that of a name such as b0 or c_ij2."""

SIZE_OF = {"%": 1e-2, "ns": 1e-9, "µs": 1e-6, "ms": 1e-3, "min": 60.0, "h": 3600.0}

UNIT = re.compile(r"\s*(%|times|ns|µs|ms|s|min|h)?(?!\w)")

VOID = frozenset({"meta", "link", "br", "img", "input", "hr", "col", "wbr"})

BLOCKS = frozenset({"p", "li", "h1", "h2", "h3", "h4", "figcaption"})
"""Elements that hold a sentence or more of a report."""

Meant = float | int | Sequence[str] | None
"""What a group of a phrase must say: a number, names, or nothing that the result knows of."""

Of = Callable[[Any, re.Match[str], str], Any]
Told = Callable[[Any, re.Match[str]], Iterable[Meant]]


@dataclass(frozen=True)
class Reading:
    """A phrase, and what its groups must be: of the result, the match, and the anchor of its heading."""

    phrase: str
    meant: Callable[[Any, re.Match[str], str], Iterable[Meant]]


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


class _Tree(HTMLParser):
    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.root = Element("root")
        self.open = [self.root]

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        node = Element(tag, {name: value or "" for name, value in attrs})
        self.open[-1].append(node)
        if tag not in VOID:
            self.open.append(node)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.open[-1].append(Element(tag, {name: value or "" for name, value in attrs}))

    def handle_endtag(self, tag: str) -> None:
        if tag in [node.tag for node in self.open[1:]]:
            while self.open.pop().tag != tag:
                pass

    def handle_data(self, data: str) -> None:
        last = self.open[-1]
        if len(last):
            last[-1].tail = (last[-1].tail or "") + data
        else:
            last.text = (last.text or "") + data


def tree(html: str) -> Element:
    """Elements of a page."""
    parser = _Tree()
    parser.feed(html)
    return parser.root


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
        Block(anchor, plain("".join(node.itertext())))
        for anchor, node in walked(root)
        if node.tag in BLOCKS and node.get("class") not in apart
    ]


def drawn(root: Element) -> list[Block]:
    """Text of a page's figures: labels, titles, and what stands for those who cannot see them; no ticks."""
    found = []
    for anchor, node in walked(root):
        said = node.get("aria-label", "") if node.tag == "svg" else ""
        if node.tag in ("text", "title"):
            said = "".join(node.itertext())
        if said and not NUMBER.fullmatch(plain(said)):
            found.append(Block(anchor, plain(said)))
    return found


def grids(root: Element) -> list[Grid]:
    """Tables of a page."""
    found = []
    for anchor, node in walked(root):
        if node.tag == "table":
            lines = [[plain("".join(cell.itertext())) for cell in row] for row in node.iter("tr")]
            found.append(Grid(anchor, tuple(lines[0]), tuple(map(tuple, lines[1:]))))
    return found


def written(text: str, usual: str = "") -> Iterator[tuple[float, float]]:
    """Numbers of a text in the size of their units, each with half of its last digit.

    Zeros at the end of a whole number may be rounded; a power of ten may be in common with a value before. A
    number without a unit is in the usual one.
    """
    text = re.sub(r"\((\S+) \+- (\S+)\)(e-?\d+)", r"\1\3 +- \2\3", text)
    for found in NUMBER.finditer(text):
        unit = UNIT.match(text, found.end())
        body, _, power = found[0].replace(",", "").replace("−", "-").partition("e")
        size = float(f"1e{power or 0}") * SIZE_OF.get(unit[1] if unit and unit[1] else usual, 1.0)
        digits = body.lstrip("-")
        zeros = len(digits) - len(digits.rstrip("0"))
        last = -len(digits.partition(".")[2]) if "." in digits else min(zeros, len(digits) - 1)
        yield float(body) * size, 0.5 * 10.0**last * size


def agrees(said: str, meant: Meant) -> bool:
    """Whether a group says what is meant: the number within its rounding, or the names."""
    if meant is None:
        return True
    if isinstance(meant, int | float):
        (value, half), *_ = written(said)
        if said.startswith(("below ", "<")):
            return 0.0 <= meant <= value
        if said.startswith("above "):
            return meant >= value
        exact = isinstance(meant, int)
        return value == meant if exact else abs(value - meant) <= 1.02 * half + 1e-9 * abs(meant)
    return names(said) == sorted(meant)


def names(text: str) -> list[str]:
    """Names of a list in a sentence, or with blanks between them, in order; none of 'none'."""
    listed = re.split(r", | and ", text) if "," in text or " and " in text else text.split()
    return sorted(name for name in listed if name not in ("none", "no term"))


def problems(blocks: Iterable[Block], readings: Sequence[Reading], result: Any) -> list[str]:
    """Numbers that nothing in the result explains, and what contradicts it; empty where all is well."""
    return [problem for block in blocks for problem in wrong_in(block, readings, result)]


def wrong_in(block: Block, readings: Sequence[Reading], result: Any) -> Iterator[str]:
    explained: list[tuple[int, int]] = []
    for reading in readings:
        for match in re.finditer(reading.phrase, block.text):
            try:
                wanted = list(reading.meant(result, match, block.anchor))
            except (LookupError, StopIteration, ValueError):
                yield f"#{block.anchor}: the result has nothing of '{match[0]}'"
                continue
            for k, meant in enumerate(wanted, start=1):
                if match[k] is None:
                    continue
                explained.append(match.span(k))
                if not agrees(match[k], meant):
                    yield f"#{block.anchor}: '{match[k]}' in '{match[0]}' is {meant} in the result"
    for number in NUMBER.finditer(block.text):
        if not any(a <= number.start() and number.end() <= b for a, b in explained):
            around = block.text[max(0, number.start() - 60) : number.end() + 40]
            yield f"#{block.anchor}: nothing explains '{number[0]}' in '...{around}...'"


def fixed(*phrases: str) -> tuple[Reading, ...]:
    """Phrases whose numbers are part of their words, such as '90 % of the units'."""
    return readings({phrase: lambda _, match: [None] * len(match.groups()) for phrase in phrases})


def readings(table: Mapping[str, Told], of: Of = lambda result, match, anchor: result) -> tuple[Reading, ...]:
    """Readings of a table: what the groups of each phrase must be, by what the phrase is of."""

    def meant(told: Told, result: Any, match: re.Match[str], anchor: str) -> Iterable[Meant]:
        return told(of(result, match, anchor), match)

    return tuple(Reading(phrase, partial(meant, told)) for phrase, told in table.items())


def named(entries: Iterable[Any], name: str, key: str = "name") -> Any:
    """Entry of a result by its name."""
    return next(one for one in entries if one[key] == name)


def value(said: str) -> float:
    """A number as it is written, without its unit."""
    return float(NUMBER.findall(said)[0].replace(",", "").replace("−", "-"))


def nearest(said: str, values: Iterable[float]) -> float:
    """Of several values that a phrase may be of, the nearest."""
    return min(values, key=lambda one: abs(one - value(said)), default=math.nan)


def quantile(low: float, high: float, count: int, n: int) -> tuple[float, float]:
    """Jeffreys interval of a share, open to the end that was met."""
    from scipy.stats import beta

    law = beta(count + 0.5, n - count + 0.5)
    return (law.ppf(low) if count else 0.0), (law.ppf(high) if count < n else 1.0)


def number(value: float | None) -> float:
    """Value of a result, where null is not a number."""
    return math.nan if value is None else float(value)
