"""The command line of a study about the tool, and what all their reports have in common."""

from __future__ import annotations

from argparse import ArgumentParser
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from shlex import quote
from typing import Any

from imubayes import __version__
from imubayes.cli.console import complete, fail, show, usable, waiting, written
from imubayes.errors import InputError
from imubayes.reporting.blocks import Page, versions, write_page
from imubayes.reporting.result.file import json_text


def main(
    study: Any,
    small: Any,
    measure: Callable[..., Any],
    page: Callable[[Any], Page],
    record: Callable[[Any], dict[str, Any]],
    options: Sequence[str] = (),
) -> None:
    """Measure what a study asks for, write ``report.html`` and ``result.json``, and show it.

    The settings of the study are those of its `command`, or the `small` ones, which only show whether it
    runs; another `seed` and other `options` can be given: numbers, or some of the texts of a tuple. `measure`
    makes a result of them, and tells `progress` what goes on; `page` and `record` are of that, for readers
    and for scripts.
    """
    asked, out = _asked(study, small, options)
    try:
        folder = usable(out)
        with waiting() as told:
            found = measure(asked, progress=told)
        shown = page(found)
        with complete(folder) as part:
            files = write_page(shown, json_text(record(found)), part)
    except InputError as error:
        fail(str(error), 2)
    show(shown)
    written(folder, files)


def _asked(study: Any, small: Any, options: Sequence[str]) -> tuple[Any, Path]:
    """Settings and folder, by the options of the command line."""
    parser = ArgumentParser(prog=study.command)
    usual = Path("reports") / study.command.rpartition(".")[2]
    parser.add_argument("--out", type=Path, default=usual, help=f"folder of the report; {usual} by default")
    parser.add_argument("--small", action="store_true", help="small sizes, which only show whether it runs")
    for name in ("seed", *options):
        value = getattr(study, name)
        many = isinstance(value, tuple)
        some: dict[str, Any] = {"nargs": "+", "choices": value} if many else {"type": int}
        said = "all" if many else value
        parser.add_argument(f"--{name}", help=f"{said} by default", **some)
    given = parser.parse_args()
    asked = {name: getattr(given, name) for name in ("seed", *options) if getattr(given, name) is not None}
    base = small if given.small else study
    other = {name: value for name, value in asked.items() if value != getattr(base, name)}
    words = [word for name, value in other.items() for word in (f"--{name}", *_texts(value))]
    command = " ".join([study.command, *(["--small"] if given.small else []), *map(quote, words)])
    other = {name: tuple(value) if isinstance(value, list) else value for name, value in other.items()}
    return replace(base, **other, command=command), given.out


def _texts(value: Any) -> list[str]:
    return value if isinstance(value, list) else [str(value)]


def recorded(found: Any, title: str, answer: Sequence[str], **values: Any) -> dict[str, Any]:
    """Values of ``result.json``: those of a study beside what all of them say."""
    settings = asdict(found.study)
    command = settings.pop("command")
    return {
        "imubayes": __version__,
        "study": title,
        "seed": found.study.seed,
        "answer": answer,
        **values,
        "seconds": found.seconds,
        "provenance": {"command": command, "settings": settings, "versions": versions()},
    }
