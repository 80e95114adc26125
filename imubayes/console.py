"""What a command says on the console, and how its files come to be there together."""

from __future__ import annotations

import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn

import typer

from imubayes.errors import InputError


def fail(message: str, code: int) -> NoReturn:
    """Say what went wrong, in one sentence, and end with an exit code."""
    clear_progress()
    typer.echo(f"imubayes: {' '.join(message.split())}", err=True)
    sys.exit(code)


def progress_line() -> Callable[[str], None]:
    """Say what goes on, on one line of stderr, if somebody watches."""
    if not sys.stderr.isatty():
        return lambda message: None
    width = shutil.get_terminal_size().columns - 1
    return lambda message: typer.echo(f"\r\x1b[2K{message[:width]}", nl=False, err=True)


def clear_progress() -> None:
    """Clear the line that `progress_line` writes."""
    if sys.stderr.isatty():
        typer.echo("\r\x1b[2K", nl=False, err=True)


def show(renderable: object) -> None:
    """Print what rich can render."""
    from rich.console import Console

    clear_progress()
    Console(highlight=False).print(renderable)


def written(folder: Path, files: tuple[Path, ...]) -> None:
    """Say which files were written."""
    names = [file.name for file in files]
    typer.echo(f"written: {', '.join([str(folder / names[0]), *names[1:]])}")


def usable(folder: Path) -> Path:
    """Give a folder to write to, unless a file has its name.

    Raises
    ------
    InputError : if one has.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file: expected a folder for --out, or a name that is free")
    return folder


@contextmanager
def complete(folder: Path) -> Iterator[Path]:
    """Give a folder to write to, whose files move to `folder` together when the block succeeds."""
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        part = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror}): choose another --out") from None
    try:
        yield part
        folder.mkdir(exist_ok=True)
        for file in part.iterdir():
            file.replace(folder / file.name)
    finally:
        shutil.rmtree(part, ignore_errors=True)
