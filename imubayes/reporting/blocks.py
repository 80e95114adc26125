"""A page as a list of blocks, which a browser and a terminal show alike.

A page is written so::

    terms = Table("Terms of ACC-1", ("term", "value"), [("b0", "41 µg"), ("b2", "12 µg/g²")])
    fit = Figure([residual_panel(result, "r")], note="Dots: blocks of samples.")
    end = repeat(f"imubayes run {study.path}", study.text, f"Seed {study.seed}.")
    page = Page(study.title, "Which terms are needed?", first=[answer(["b0 is needed.", "b2 is not."])],
                blocks=[Section("The terms", [terms], "terms"), Section("The fit", [fit], "fit"), end])

`page_html` makes a file of it that opens offline; a console of rich prints it, or a section, as it is. A text
is escaped unless it is `Markup`, which `strong`, `link` and `Markup(...).format(...)` make.
"""

from __future__ import annotations

import json
import platform
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import date
from functools import cache, partial
from importlib.metadata import version
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from markupsafe import Markup
from rich.console import Console, ConsoleOptions, RenderableType
from rich.padding import Padding
from rich.table import Table as Grid
from rich.text import Text as Line

import imubayes
from imubayes.campaign import file_name
from imubayes.reporting.rounding import NARROW
from imubayes.reporting.rows import MARKS

if TYPE_CHECKING:
    from jinja2 import Environment

    from imubayes.reporting.canvas import Drawing


@dataclass(frozen=True, slots=True)
class Both:
    """A text on a page, and as a terminal has it, in a style there; None where that leaves out its column."""

    page: str
    terminal: str | None
    style: str = ""


Text: TypeAlias = str | Both
Block: TypeAlias = "Prose | Table | Figure | Section | Page"


@dataclass(frozen=True, slots=True)
class Prose:
    """A paragraph, or several, which are plain without a style.

    That is "answer", "answer misfit", "note", "list" or "pre" (as it stands).
    """

    texts: Text | Sequence[Text]
    style: str = ""

    @property
    def paragraphs(self) -> tuple[Text, ...]:
        """One by one; empty ones are left out."""
        texts = (self.texts,) if isinstance(self.texts, str | Both) else self.texts
        return tuple(text for text in texts if text)


@dataclass(frozen=True, slots=True)
class Row:
    """A row of which there is more to say than its cells: if anything leads there, and how a terminal has it.

    It has a cell for each heading, where an empty first one belongs to the row above; or the name of a group.
    In a terminal it stands out if it is strong, and is shown if it is brief.
    """

    cells: tuple[Text, ...]
    anchor: str = ""
    strong: bool = False
    brief: bool = True


@dataclass(frozen=True, slots=True)
class Table:
    """Rows under headings; without any, each row is a name and its text.

    Attributes
    ----------
    label : for those who cannot see it.
    columns : a letter each, "t" text on one line, "f" that may fold in a terminal, "w" words that wrap, "n"
        numbers, "m" marks below a heading that stands upright; the last one is that of all columns that
        follow. What is long may fold on a page that is narrow.
    beside : whether a reader may want two of its columns beside each other.
    brief : whether a terminal shows it.
    """

    label: str
    head: Sequence[Text]
    rows: Sequence[Row | tuple[Text, ...]]
    columns: str = "tn"
    note: Text = ""
    beside: bool = False
    brief: bool = True

    @property
    def lines(self) -> tuple[Row, ...]:
        """Rows, all of one type."""
        return tuple(row if isinstance(row, Row) else Row(row) for row in self.rows)

    def column(self, k: int) -> str:
        """Letter of a column, from 0."""
        return self.columns[min(k, len(self.columns) - 1)]


@dataclass(frozen=True, slots=True)
class Figure:
    """Panels beside each other, and how to read them; a terminal has none.

    `wide` is the label of panels that may be wider than a telephone, and scroll; empty where they are not.
    """

    panels: Sequence[Drawing]
    note: Text = ""
    wide: str = ""

    def __reduce__(self) -> tuple[Any, ...]:
        """What is sent to another process is for its terminal."""
        return Figure, ((), self.note, self.wide)


@dataclass(frozen=True, slots=True)
class Section:
    """Blocks under a title, down to three deep.

    Attributes
    ----------
    anchor : if anything leads there.
    sub : of the title, in a few words.
    listed : name in the page's contents. Sections of a page have their titles there without.
    brief : whether a terminal shows it.
    folded : whether a page shows its title alone until somebody asks; print has all of it.
    """

    title: str
    blocks: Sequence[Block]
    anchor: str = ""
    sub: str = ""
    listed: str = ""
    brief: bool = False
    folded: bool = False

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        yield from _lines((self,), options, 0)


GOOD = "fit OK"
"""Status of a model that the data don't reject."""


@dataclass(frozen=True, slots=True)
class Page:
    """A page. A section may hold pages: each is a file of its own, and in one text starts a sheet in print.

    Attributes
    ----------
    title, question : of the study, and what it asks.
    first : what stands before the contents: the answer, and a picture, whose first panel goes into a slide.
    counts, data, fit : status: how many answers of each kind, whether data are simulated or recorded, and
        whether the model fits; empty where that is not asked.
    anchor : of a page in a section, so that others lead there.
    """

    title: str
    question: str
    first: Sequence[Block]
    blocks: Sequence[Block]
    counts: str = ""
    data: str = ""
    fit: str = ""
    anchor: str = ""

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        """In a terminal: answer and status, and the sections that are brief, without their figures."""
        yield from _lines((*self.first, Prose(self.status), *self.blocks), options, 0)

    @property
    def status(self) -> str:
        """Line below the answer; what is wrong comes first."""
        wrong = self.fit if self.fit != GOOD else ""
        return " · ".join(filter(None, (wrong, self.counts, "" if wrong else self.fit, self.data)))

    @property
    def answer(self) -> str:
        """Words of the answer, without links."""
        said = next(
            (text for block in self.first if isinstance(block, Prose) for text in block.paragraphs), ""
        )
        page = said.page if isinstance(said, Both) else said
        return Markup(re.sub(r"<a .*?</a>", "", page)).striptags() if isinstance(page, Markup) else page

    @property
    def picture(self) -> Drawing | None:
        """What goes into a slide."""
        return next(
            (panel for block in self.first if isinstance(block, Figure) for panel in block.panels), None
        )


def strong(text: str) -> Markup:
    """Text that stands out."""
    return Markup("<strong>{}</strong>").format(text)


def link(text: str, anchor: str) -> Markup:
    """Text that leads to an anchor of the page."""
    return Markup('<a href="#{}">{}</a>').format(anchor, text)


def quiet(text: str) -> Markup:
    """Text that stands back."""
    return Markup('<span class="quiet">{}</span>').format(text)


def shape(word: str) -> Markup:
    """Shape of a verdict, for a matrix of them; nothing where there is none."""
    span = Markup('<span class="v {}" role="img" aria-label="{}" title="{}">{}</span>')
    return span.format(word.replace(" ", "-"), word, word, MARKS.get(word, ("·",))[0]) if word else Markup()


LEGEND = ", ".join(f"{mark[0]} {word}" for word, mark in MARKS.items())
"""Shapes and their verdicts, for the note of a matrix."""


def bar(
    inclusion: float, low: float | None = None, high: float | None = None, *, seen: bool = True
) -> Markup:
    """Inclusion as a bar and a number, with a whisker over its range; hollow where it is the prior's."""
    if not seen:
        track = (
            '<svg class="bar" aria-hidden="true"><rect class="hollow" y="4" width="100" height="6"/></svg>'
        )
        return Markup(f'{track} <span class="quiet prior">prior</span>')
    ends = [100.0 * (inclusion if end is None else end) for end in (low, high)]
    drawn = Markup(
        '<svg class="bar" aria-hidden="true"><rect class="back" y="4" width="100" height="6"/>'
        '<rect class="fill" y="4" width="{0:.1f}" height="6"/>'
        '<path d="M{1:.1f} 7H{2:.1f}M{1:.1f} 2V12M{2:.1f} 2V12"/></svg> {3:.3f}'
    )
    return drawn.format(100.0 * inclusion, *ends, inclusion)


def swatch(colour: str) -> Markup:
    """Patch of a figure's colour, for a note that says what it means."""
    return Markup('<i style="background:{}"></i>').format(colour)


def joined(*texts: str) -> Markup:
    """Texts with a space between; those that are no `Markup` are escaped."""
    return Markup(" ").join(text for text in texts if text)


def answer(sentences: Sequence[str], *, doubtful: bool = False) -> Prose:
    """Answer of a page, its first sentence to stand out; marked where it is doubtful."""
    said = joined(strong(sentences[0]), *sentences[1:])
    return Prose(said, "answer misfit" if doubtful else "answer")


MOST_WORDS = 60
"""Words of an answer."""


def parted(sentences: Iterable[str], last: str = "") -> tuple[list[str], list[str]]:
    """Sentences that an answer has room for, the first one in any case, beside its `last`; and the others.

    >>> parted(["Yes.", "a " * 59 + "a."])[0]
    ['Yes.']
    """
    said = list(sentences)
    lengths = [len(" ".join((*said[: k + 1], last)).split()) for k in range(len(said))]
    room = max(sum(length <= MOST_WORDS for length in lengths), 0 if last else 1)
    return said[:room], said[room:]


def verdict(word: str, *, reason: str = "", like: str = "") -> Both:
    """Verdict with its shape and colour, or those of another one that it is like."""
    mark, style = MARKS.get(like or word, ("·",))[0], (like or word).replace(" ", "-")
    span = Markup('<span class="v {}" title="{}"><span aria-hidden="true">{}</span> {}</span>')
    shown = span.format(style, reason or word, mark, word)
    return Both(shown, f"{mark} {word}", MARKS.get(like or word, ("", ""))[1]) if word else Both("", "")


def repeat(command: str, study: str, *said: str, made_with: Mapping[str, str] | None = None) -> Section:
    """Last section of every page: its command, what else is said, and the text of its study file, if any.

    The first paragraph ends with the versions that it was made with: those of now if not given.
    """
    numbers = ", ".join(f"{name} {number}" for name, number in (made_with or versions()).items())
    first, *rest = said or ("",)
    file = (Section("The study file", (Prose(study, "pre"),), folded=True),) if study else ()
    told = Prose((joined(first, f"{numbers}."), *rest))
    return Section("How to repeat this", (Prose(command, "pre"), told, *file), "repeat")


CLASSES = {"t": "once", "f": "once", "w": "wrap", "n": "n", "m": "m"}
"""Class of a cell by the letter of its column (`Table.columns`)."""

MANY = 10
"""Columns of a table whose cells are narrow."""


def _style(text: Text, letter: str, columns: int) -> str:
    """Classes of a cell: what is long, less so among many columns, may fold where the page is narrow."""
    words = text.page if isinstance(text, Both) else text
    plain = words.striptags() if isinstance(words, Markup) else words
    return f"{CLASSES[letter]} fold" if len(plain) > (16 if columns < MANY else 8) else CLASSES[letter]


def page_html(page: Page, *, home: str = "", made: str = "", summary: str = "") -> str:
    """Text of the page; names that come from files are escaped.

    `home` is the index of its folder, `made` the date, `summary` the title of the study whose part it is.
    """
    template = environment().get_template("page.html.j2")
    return template.render(page=page, home=home, made=made, summary=summary)


def page_files(page: Page, *, home: str = "", made: str = "") -> dict[str, str]:
    """Texts of ``report.html`` and of the pages in its sections, by file; links lead into others' files."""
    summary, parts = apart(page)
    texts = {"report.html": page_html(summary, home=home, made=made)}
    places = dict[str, str]()
    for k, part in enumerate(parts, 1):
        name = f"{k}-{file_name(part.title)}.html"
        texts[name] = page_html(part, home=home, made=made, summary=page.title)
        places[part.anchor] = name
    anchors = {name: set(_ANCHOR.findall(text)) for name, text in texts.items()}
    places = {anchor: f"{name}#{anchor}" for name, own in anchors.items() for anchor in own} | places

    def placed(own: set[str], match: re.Match[str]) -> str:
        return match[0] if match[1] in own else f'href="{places.get(match[1], f"#{match[1]}")}"'

    return {name: _LINK.sub(partial(placed, anchors[name]), text) for name, text in texts.items()}


_ANCHOR, _LINK = re.compile(r'\bid="([^"]+)"'), re.compile(r'href="#([^"]+)"')


def apart(page: Page) -> tuple[Page, list[Page]]:
    """Take the pages out of a page's sections, where links to them and what they first say are left."""
    parts = list[Page]()

    def left(blocks: Iterable[Block]) -> Iterator[Block]:
        for paged, several in groupby(blocks, lambda block: isinstance(block, Page)):
            if paged:
                parts.extend(pages := [block for block in several if isinstance(block, Page)])
                firsts = (f"{inner.answer.partition('. ')[0].rstrip('.')}." for inner in pages)
                links = (link(f"{inner.title}:", inner.anchor) for inner in pages)
                yield Prose([joined(*told) for told in zip(links, firsts, strict=True)], "list")
                continue
            for block in several:
                yield replace(block, blocks=list(left(block.blocks))) if isinstance(block, Section) else block

    return replace(page, blocks=list(left(page.blocks))), parts


def write_page(page: Page, values: str, folder: Path) -> tuple[Path, ...]:
    """Write ``report.html``, with ``result.json``, its picture as ``slide.svg`` and ``slide.png``."""
    report, result = folder / "report.html", folder / "result.json"
    home = f"../{INDEX}" if is_of_reports(folder.parent) else ""
    for name, text in page_files(page, home=home, made=date.today().isoformat()).items():
        (folder / name).write_text(text, encoding="utf-8")
    result.write_text(values, encoding="utf-8")
    if (panel := page.picture) is None:
        return report, result
    from imubayes.reporting.canvas import slides  # the library of figures: a page without any needs none

    record, pictures = json.loads(values), list[Path]()
    told = [page.title, f"seed {record['seed']}" if "seed" in record else ""]
    told += [record.get("provenance", {}).get("study_file", ""), page.data, f"imubayes {record['imubayes']}"]
    source = printable(" · ".join(filter(None, told)))
    for form, drawn in slides(panel, printable(page.answer), source).items():
        pictures.append(folder / f"slide.{form}")
        pictures[-1].write_bytes(drawn)
    return report, result, *pictures


INDEX = "index.html"
"""Name of the list of a folder's reports."""

MARK = '<meta name="generator" content="imubayes index">'
"""What tells such a list from another file of its name."""


def is_of_reports(folder: Path) -> bool:
    """Whether a folder is clearly one of reports: it is called so, or it has their index."""
    file = folder.resolve() / INDEX
    if file.is_file():
        return MARK in file.read_text(encoding="utf-8", errors="replace")[:2000]
    return folder.resolve().name == "reports"


@cache
def environment() -> Environment:
    """Templates of reports, and what they know of blocks."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    templates = Environment(
        loader=PackageLoader("imubayes", "reporting"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.tests["block"] = lambda block, kind: type(block).__name__ == kind
    templates.filters["html"] = _html
    templates.filters["style"] = _style
    templates.globals |= {"classes": CLASSES, "many": MANY}
    return templates


def _html(text: Text) -> str:
    """A text on a page, where no line ends between a number and its percent sign."""
    return (text.page if isinstance(text, Both) else text).replace(" %", f"{NARROW}%")


def header(study: Any, command: str) -> dict[str, Any]:
    """What every published result begins and ends with: its study, and what it takes to repeat that."""
    file = {"study_file": str(study.path), "study_text": study.text, "command": command}
    return {
        "imubayes": imubayes.__version__,
        "study": study.title,
        "seed": study.seed,
        "provenance": {**file, "versions": versions()},
    }


@cache
def versions() -> dict[str, str]:
    """Versions of imubayes, of Python and of what computes the numbers."""
    return {
        "imubayes": imubayes.__version__,
        "python": platform.python_version(),
        **{name: version(name) for name in ("numpy", "numba", "emcee")},
    }


STYLES = {"answer": "bold", "answer misfit": "bold red", "note": "dim"}
"""Of prose in a terminal, by its style."""

ASCII = str.maketrans(
    dict(zip("µ−–×●○◐▲△✓✗≠⁻⁰¹⁴⁵⁶⁷⁸⁹", "u--x*o~!?+x!-01456789", strict=True))
    | {"±": "+-", "√": "sqrt ", "°": "deg", "²": "^2", "³": "^3", "’": "'", "“": '"', "”": '"'}
)
"""What stands for a sign where a terminal has ASCII alone."""

WHOLE, GAP = "tnm", 2
"""Letters of columns that a terminal does not fold, and blanks between two columns where there is room."""


def _lines(blocks: Iterable[Block], options: ConsoleOptions, depth: int) -> Iterator[RenderableType]:
    def line(text: str, style: str) -> RenderableType:
        told = _line(text, style, options)
        return Padding(told, (0, 0, 0, 1)) if depth else told

    for block in blocks:
        if isinstance(block, Page):  # of one of many units
            yield from _lines(block.blocks, options, depth)
        elif isinstance(block, Section) and block.brief:
            yield line(f"{block.title}  {block.sub}".rstrip(), "dim" if depth else "bold")
            yield from _lines(block.blocks, options, depth + 1)
            yield from [] if depth else [Line()]
        elif isinstance(block, Prose):
            for text in filter(None, map(_words, block.paragraphs)):
                yield line(text, STYLES.get(block.style, ""))
            yield from [] if depth or not block.paragraphs else [Line()]
        elif isinstance(block, Table) and block.brief and block.rows:
            yield from _grids(block, options)


def _grids(table: Table, options: ConsoleOptions) -> Iterator[Grid]:
    """Grid of a table; of one that is wider than the terminal several, each with its first column."""
    head = table.head or [""] * max(len(row.cells) for row in table.lines)
    shown = [k for k, text in enumerate(head) if not (isinstance(text, Both) and text.terminal is None)]
    rows = [row for row in table.lines if row.brief and len(row.cells) == len(head)]
    columns = [
        (table.column(k), [_line(_words(head[k]), "dim", options), *(_cell(row, k, options) for row in rows)])
        for k in shown
    ]
    taken, room = columns[:1], options.max_width
    for column in columns[1:]:
        if len(taken) > 1 and sum(1 + _least(*cells) for cells in (*taken, column)) - 1 > room:
            yield _grid(taken, room, titled=bool(table.head))
            taken = columns[:1]
        taken.append(column)
    yield _grid(taken, room, titled=bool(table.head))


def _least(letter: str, cells: Sequence[Line]) -> int:
    """Letters of a column's longest word, or of its longest cell where it is no text that folds."""
    words = [part for cell in cells for part in cell.plain.split()]
    return max(map(len, [*words, *(cell.plain for cell in cells[1:] if letter in WHOLE)]), default=0)


def _grid(columns: Sequence[tuple[str, Sequence[Line]]], room: int, *, titled: bool) -> Grid:
    """Columns beside each other; those that fold share what room there is."""
    least = [_least(*column) for column in columns]
    more = [
        max(len(cell.plain) for cell in cells) - own for own, (_, cells) in zip(least, columns, strict=True)
    ]
    gap = GAP if sum(least) + GAP * (len(columns) - 1) <= room else 1
    grid = Grid(box=None, pad_edge=False, padding=(0, gap, 0, 0), show_header=titled)
    free = max(room - sum(least) - gap * (len(columns) - 1), 0)
    part = min(free / max(sum(more), 1), 1.0)
    for own, wish, (letter, cells) in zip(least, more, columns, strict=True):
        justify = "right" if letter == "n" else "left"
        grid.add_column(cells[0], justify=justify, width=own + int(part * wish), overflow="fold")
    for cells in zip(*(cells[1:] for _, cells in columns), strict=True):
        grid.add_row(*cells)
    return grid


def _cell(row: Row, k: int, options: ConsoleOptions) -> Line:
    text = row.cells[k]
    style = "bold" if row.strong else text.style if isinstance(text, Both) else ""
    return _line(_words(text), style, options)


def _words(text: Text) -> str:
    """Text without markup, and with plain spaces for those where no line of a page ends."""
    said = (text.terminal or "") if isinstance(text, Both) else text
    plain = said.striptags() if isinstance(said, Markup) else said
    return plain.replace("\N{NO-BREAK SPACE}", " ")


def _line(text: str, style: str, options: ConsoleOptions) -> Line:
    """Text that a terminal can print, in its signs."""
    return Line(printable(text.translate(ASCII) if options.ascii_only else text), style=style)


def printable(text: str) -> str:
    r"""Names come from files: what is not printable does not reach a terminal, every blank is plain.

    >>> printable("ACC\x1b[2J-07")
    'ACC?[2J-07'
    """
    return "".join(sign if sign.isprintable() else " " if sign.isspace() else "?" for sign in text)
