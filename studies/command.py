"""The command line of a study about the tool: ``python -m studies.NAME [--small] [--seed N] [--out DIR]``."""

from __future__ import annotations

from argparse import ArgumentParser
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from imubayes.cli.console import complete, fail, show, usable, waiting, written
from imubayes.errors import InputError


def main(
    study: Any,
    small: Any,
    measure: Callable[..., Any],
    shown: Callable[[Any], object],
    write: Callable[[Any, Path], tuple[Path, ...]],
) -> None:
    """Measure what a study asks for, write its report, and show it.

    Parameters
    ----------
    study : its settings, of which `command` ends with its name, and `seed` can be another.
    small : the settings that only show whether it runs.
    measure : makes a result of the settings, and tells `progress` what goes on.
    shown : lines of a result for a terminal.
    write : writes the report on a result into a folder, and gives its files.
    """
    parser = ArgumentParser(prog=study.command)
    usual = Path("reports") / study.command.rpartition(".")[2]
    parser.add_argument("--out", type=Path, default=usual, help=f"folder of the report; {usual} by default")
    parser.add_argument("--small", action="store_true", help="small sizes, which only show whether it runs")
    parser.add_argument("--seed", type=int, default=study.seed, help=f"{study.seed} by default")
    given = parser.parse_args()
    other = f" --seed {given.seed}" if given.seed != study.seed else ""
    command = f"{study.command}{' --small' if given.small else ''}{other}"
    asked = replace(small if given.small else study, seed=given.seed, command=command)
    try:
        folder = usable(given.out)
        with waiting() as told:
            found = measure(asked, progress=told)
        with complete(folder) as part:
            files = write(found, part)
    except InputError as error:
        fail(str(error), 2)
    show(shown(found))
    written(folder, files)


def settings(study: Any) -> dict[str, Any]:
    """Settings of a study but for its command, which says the same."""
    return {name: value for name, value in asdict(study).items() if name != "command"}


def settings_text(study: Any) -> str:
    """Settings of a study, a line each."""
    return "\n".join(f"{name} = {value!r}" for name, value in settings(study).items())
