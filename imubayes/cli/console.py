"""What a command says on the console, and how its files come to be there together."""

from __future__ import annotations

import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from io import TextIOWrapper
from pathlib import Path
from threading import Event, Thread
from time import perf_counter
from typing import NoReturn

import typer

from imubayes.errors import InputError

MINUTE, OFTEN, BLINK = 60.0, 10.0, 1.0
"""s after which it is said what would take less time; between two lines of a file; and between two looks of a
terminal's line, which says what goes on and how long it takes."""

BAR = 20
"""Characters of the bar."""

BEGUN = 0.01
"""Share that must be done to say how long the rest takes."""

CLEAR = "\r\x1b[2K"
"""What clears a line of a terminal."""


def fail(message: str, code: int) -> NoReturn:
    """Say what went wrong, in one sentence, and end with an exit code."""
    clear_progress()
    typer.echo(f"imubayes: {' '.join(message.split())}", err=True)
    sys.exit(code)


@dataclass(slots=True)
class Waiting:
    """What somebody who waits is told: what goes on, what share of it is done, what would take less time.

    The reminder says it again, from when something is told: until then this process has no second thread.
    """

    doing: str = "starting"
    share: float | None = None
    instead: str = ""
    reminder: Thread | None = None
    start: float = field(default_factory=perf_counter)
    since: float = field(default_factory=perf_counter)
    """s; when the work was begun whose share is told."""

    def __call__(self, doing: str, share: float | None = None, /) -> None:
        """Say what goes on: on one line of stderr if it is a terminal."""
        if share is None or self.share is None or share < self.share:
            self.since = perf_counter()
        self.doing, self.share = doing, share
        if self.reminder and not self.reminder.ident:
            self.reminder.start()
        if sys.stderr.isatty():
            self.draw()

    def draw(self) -> None:
        """Draw the line of a terminal anew."""
        width = shutil.get_terminal_size().columns - 1
        typer.echo(f"{CLEAR}{self.line()[:width]}", nl=False, err=True)

    def line(self) -> str:
        """How long it takes, how far it is, about what is left, and what goes on."""
        from imubayes.reporting.rounding import duration

        now = perf_counter()
        elapsed, parts = duration(now - self.start, 2), [self.doing]
        if self.share and self.share > BEGUN:
            left = (now - self.since) * (1.0 / self.share - 1.0)
            bar = "#" * round(BAR * min(self.share, 1.0))
            rest = f"about {duration(left, 2)}" if left >= 1.0 else "less than 1 s"
            parts = [f"[{bar:-<{BAR}}] {self.share:.0%}, {rest} left", *parts]
        return f"after {elapsed}: {'; '.join(parts)}"

    def warn(self, text: str) -> None:
        """Say what does not wait, on a line of its own, such as what is wrong with the data."""
        clear_progress()
        typer.echo(f"imubayes: {text}", err=True)

    @property
    def first(self) -> Callable[[str], None] | None:
        """Who is told of verdicts that are provisional: a terminal, before chains end."""
        return self.warn if sys.stderr.isatty() else None

    def quicker(self, text: str) -> None:
        """Keep what would take less time: it is said once, when it is long."""
        self.instead = text


@contextmanager
def waiting(often: float = OFTEN) -> Iterator[Waiting]:
    """Tell what goes on: a terminal each second on one line, a file every ten seconds on a line each."""
    told, over = Waiting(), Event()
    told.reminder = Thread(target=_remind, args=(told, over, often), daemon=True)
    try:
        yield told
    finally:
        over.set()
        if told.reminder.ident:
            told.reminder.join()
        clear_progress()


def _remind(told: Waiting, over: Event, often: float) -> None:
    terminal = sys.stderr.isatty()
    while not over.wait(BLINK if terminal else often):
        if terminal:
            told.draw()
        else:
            typer.echo(f"imubayes: {told.line()}", err=True)
        if told.instead and not (terminal and perf_counter() - told.start < MINUTE):
            told.warn(told.instead)
            told.instead = ""


def clear_progress() -> None:
    """Clear the line that `Waiting` writes."""
    if sys.stderr.isatty():
        typer.echo(CLEAR, nl=False, err=True)


def show(renderable: object) -> None:
    """Print what rich can render, or lines; a sign that the terminal lacks is a question mark."""
    from rich.console import Console
    from rich.text import Text

    from imubayes.reporting.blocks import printable

    clear_progress()
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")
    if isinstance(renderable, str):
        renderable = Text("\n".join(map(printable, renderable.splitlines())))
    Console(highlight=False).print(renderable)


def written(folder: Path, files: tuple[Path, ...]) -> None:
    """Say which files were written."""
    names = [file.name for file in files]
    typer.echo(f"written: {', '.join([str(folder / names[0]), *names[1:]])}")


def usable(folder: Path) -> Path:
    """Give a folder to write to, unless a file has its name."""
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file: expected a folder for --out, or a name that is free")
    return folder


def _pages(report: Path) -> set[str]:
    """Names of the pages beside a report that it leads to, where it is there."""
    text = report.read_text(encoding="utf-8", errors="replace") if report.is_file() else ""
    return {*re.findall(r'href="(\d+-[^"/#]+\.html)["#]', text)}


@contextmanager
def complete(folder: Path) -> Iterator[Path]:
    """Give a folder to write to, whose files move to `folder` together when the block succeeds.

    The pages of a report that was there go with it, where the new one has none of their name.
    """
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{folder.name}-", dir=folder.parent) as name:
            yield (part := Path(name))
            folder.mkdir(exist_ok=True)
            files = [*part.iterdir()]
            earlier = _pages(folder / "report.html") if part / "report.html" in files else set[str]()
            for file in files:
                file.replace(folder / file.name)
            for name in earlier - {file.name for file in files}:
                (folder / name).unlink(missing_ok=True)
    except OSError as error:
        why = error.strerror or error
        raise InputError(f"{folder}: cannot be written ({why}): choose another --out") from None
