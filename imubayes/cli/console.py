"""What a command says on the console, and how its files come to be there together."""

from __future__ import annotations

import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import TextIOWrapper
from pathlib import Path
from threading import Event, Thread
from typing import NoReturn

import typer

from imubayes.errors import InputError

MINUTE, OFTEN = 60.0, 10.0
"""s after which a command that still computes says what: on a terminal, which sees each step, and after two,
four ... minutes; in a file, again and again."""


def fail(message: str, code: int) -> NoReturn:
    """Say what went wrong, in one sentence, and end with an exit code."""
    clear_progress()
    typer.echo(f"imubayes: {' '.join(message.split())}", err=True)
    sys.exit(code)


@dataclass(slots=True)
class Waiting:
    """What somebody who waits is told: what goes on, and what would take less time, if that is known."""

    doing: str = ""
    instead: str = ""

    def __call__(self, message: str) -> None:
        """Say what goes on: on one line of stderr if it is a terminal."""
        self.doing = message
        if sys.stderr.isatty():
            width = shutil.get_terminal_size().columns - 1
            typer.echo(f"\r\x1b[2K{message[:width]}", nl=False, err=True)

    def warn(self, text: str) -> None:
        """Say what is wrong with the data, on a line of its own."""
        clear_progress()
        typer.echo(f"imubayes: {text}", err=True)

    def quicker(self, text: str) -> None:
        """Keep what would take less time: it is said once, when it is long."""
        self.instead = text


@contextmanager
def waiting(often: float = OFTEN) -> Iterator[Waiting]:
    """Tell what goes on; of long work now and then on a line of its own, in a file every ten seconds."""
    told, over = Waiting(), Event()
    reminder = Thread(target=_remind, args=(told, over, often), daemon=True)
    reminder.start()
    try:
        yield told
    finally:
        over.set()
        reminder.join()


def _remind(told: Waiting, over: Event, often: float) -> None:
    from imubayes.reporting.rounding import duration

    elapsed = wait = MINUTE if sys.stderr.isatty() else often
    while not over.wait(wait):
        clear_progress()
        typer.echo(f"imubayes: after {duration(elapsed)}: {told.doing or 'starting'}", err=True)
        if told.instead:
            typer.echo(f"imubayes: {told.instead}", err=True)
            told.instead = ""
        wait = elapsed if sys.stderr.isatty() else often
        elapsed += wait


def clear_progress() -> None:
    """Clear the line that `Waiting` writes."""
    if sys.stderr.isatty():
        typer.echo("\r\x1b[2K", nl=False, err=True)


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


@contextmanager
def complete(folder: Path) -> Iterator[Path]:
    """Give a folder to write to, whose files move to `folder` together when the block succeeds."""
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{folder.name}-", dir=folder.parent) as name:
            yield (part := Path(name))
            folder.mkdir(exist_ok=True)
            for file in part.iterdir():
                file.replace(folder / file.name)
    except OSError as error:
        why = error.strerror or error
        raise InputError(f"{folder}: cannot be written ({why}): choose another --out") from None
