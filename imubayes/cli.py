"""The command line: ``imubayes run | check | simulate | catalogue | compare``.

Exit code 0: done. 2: the input is wrong, and a sentence on stderr says where. 1: our fault. What a command
needs is imported when it runs, so that ``--help`` answers at once.
"""

from __future__ import annotations

import math
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from difflib import get_close_matches
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from imubayes.errors import ConvergenceError, InputError, TermError

if TYPE_CHECKING:
    from imubayes.campaign import Sampling
    from imubayes.lots.plan import LotStudy
    from imubayes.quality.trials import QualityStudy
    from imubayes.sensors.catalogue import SensorClass

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="Which terms of the generalized IMU model does this sensor need, and how sure is that?",
)


class Method(StrEnum):
    """How the posterior is computed."""

    auto = "auto"
    exact = "exact"
    collapsed = "collapsed"
    full = "full"


CHAINS = "chains"
"""Folder of the chains' checkpoints, in that of the results."""

StudyFile = Annotated[Path, typer.Argument(metavar="STUDY.toml", help="The study.", show_default=False)]


def main() -> None:
    """Run the command line; the console script's entry point."""
    try:
        app()
    except InputError as error:
        _fail(str(error), 2)
    except ConvergenceError as error:
        _fail(f"{error}; this is a fault of imubayes, please report it with the study", 1)


@app.callback(invoke_without_command=True)
def _options(
    version: Annotated[bool, typer.Option("--version", help="Print the version.", is_eager=True)] = False,
) -> None:
    if version:
        from imubayes import __version__

        typer.echo(f"imubayes {__version__}")
        raise typer.Exit


@app.command("run")
def _run(
    study: StudyFile,
    out: Annotated[
        Path | None, typer.Option(help="Folder of the results.", show_default="reports/<study>")
    ] = None,
    method: Annotated[
        Method | None, typer.Option(help="How the posterior is computed.", show_default="the study's")
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue the chains in the folder.")] = False,
    time_limit: Annotated[
        str | None, typer.Option(help='Of the chains of a sensor, "5 min".', show_default="the study's")
    ] = None,
    ess: Annotated[
        float | None, typer.Option(help="Effective sample size to reach.", show_default="the study's")
    ] = None,
) -> None:
    """Decide which terms each sensor needs; write the report."""
    from imubayes.config import read_lots, read_quality, read_study
    from imubayes.reporting.document import write_results
    from imubayes.reporting.tables import terminal_summary
    from imubayes.study import run

    folder = _usable(out or Path("reports") / study.stem)
    if other := read_lots(study) or read_quality(study):
        if resume or any(option is not None for option in (method, time_limit, ess)):
            raise InputError(
                "--method, --resume, --time-limit and --ess are of chains, which this study has none of"
            )
        _measure(other, folder)
        return
    read = read_study(study)
    sampling = _overruled(read.sampling, method, ess, time_limit)
    if resume:
        _check_resumable(sampling.method, folder / CHAINS)
    sampling = replace(sampling, checkpoints=folder / CHAINS, resume=resume)
    result = run(replace(read, sampling=sampling), progress=_progress())
    files = write_results(result, folder)
    _show(terminal_summary(result))
    _written(folder, files)


def _measure(study: LotStudy | QualityStudy, folder: Path) -> None:
    """Run a study of simulated lots, or of how good the decision is; write the report."""
    from imubayes.lots import measure as lots
    from imubayes.lots.plan import LotStudy
    from imubayes.quality import measure as quality
    from imubayes.reporting.lots_page import terminal_lots, write_lots
    from imubayes.reporting.quality_page import terminal_quality, write_quality

    if isinstance(study, LotStudy):
        lot = lots.measure(study, progress=_progress())
        shown, write = terminal_lots(lot), partial(write_lots, lot)
    else:
        found = quality.measure(study, progress=_progress())
        shown, write = terminal_quality(found), partial(write_quality, found)
    with _complete(folder) as part:
        files = write(part)
    _show(shown)
    _written(folder, files)


@app.command("check")
def _check(study: StudyFile) -> None:
    """Say what the runs can tell, before a fit."""
    from imubayes.config import read_study
    from imubayes.reporting.tables import terminal_check
    from imubayes.study import check

    for sensor in check(read_study(study)):
        _show(terminal_check(sensor.id, sensor.observability, sensor.library, sensor.extras))


@app.command("simulate")
def _simulate(
    study: StudyFile,
    out: Annotated[Path, typer.Option(help="Folder of the files.", show_default=False)],
) -> None:
    """Write simulated runs, and a study of them, as files."""
    from imubayes.config import read_study, record_study

    folder = _usable(out)
    with _complete(folder) as part:
        files = record_study(read_study(study), part)
    _written(folder, files)


@app.command("catalogue")
def _catalogue(
    name: Annotated[
        str | None, typer.Argument(metavar="CLASS", help="A class id.", show_default=False)
    ] = None,
    kind: Annotated[str | None, typer.Option(help="accelerometer or gyroscope.", show_default=False)] = None,
    own: Annotated[Path | None, typer.Option(help="TOML file of own classes.", show_default=False)] = None,
) -> None:
    """List the technologies and grades, or one's figures and priors."""
    from imubayes.reporting.catalogue_tables import bench_list, class_list, class_page
    from imubayes.sensors.catalogue import classes
    from imubayes.sensors.catalogue_file import read_catalogue

    known = classes(kind, catalogue=() if own is None else read_catalogue(own))
    if name is None:
        _show(class_list(known))
    if name is None and kind is None:
        _show(bench_list())
    for entry in [] if name is None else _named(name, known):
        _show(class_page(entry))


@app.command("compare")
def _compare(
    results: Annotated[
        list[Path], typer.Argument(metavar="RESULT...", help="Files result.json, or their folders.")
    ],
    out: Annotated[
        Path | None, typer.Option(help="Folder of the comparison's report.", show_default=False)
    ] = None,
) -> None:
    """Set results side by side; say what differs beyond uncertainty."""
    from imubayes.reporting.comparison.kinds import side_by_side, write_comparison
    from imubayes.reporting.comparison.view import terminal_page

    folder = None if out is None else _usable(out)
    found = side_by_side(results)
    files: tuple[Path, ...] = ()
    if folder is not None:
        with _complete(folder) as part:
            files = write_comparison(found, part)
    _show(terminal_page(found.page))
    if folder is not None:
        _written(folder, files)


def _named(name: str, known: Sequence[SensorClass]) -> list[SensorClass]:
    found = [entry for entry in known if entry.id == name]
    if not found:
        ids = dict.fromkeys(entry.id for entry in known)
        near = get_close_matches(name, ids, n=1)
        hint = f"did you mean '{near[0]}'?" if near else f"expected one of {', '.join(ids)}"
        raise TermError(f"class '{name}' is not in the catalogue: {hint}")
    return found


def _overruled(usual: Sampling, method: Method | None, ess: float | None, time_limit: str | None) -> Sampling:
    """Sampling of the study, with what the command line says in place of it."""
    if ess is not None and not 0.0 < ess < math.inf:
        raise InputError(f"--ess {ess:g}: expected a number of effective samples above zero, such as 1000")
    return replace(
        usual,
        method=usual.method if method is None else method.value,
        ess=usual.ess if ess is None else ess,
        time_limit=usual.time_limit if time_limit is None else _duration(time_limit),
    )


def _duration(text: str) -> float:
    """Seconds of a quantity in time."""
    from imubayes.units import quantity

    try:
        seconds = quantity(text, like="s")
    except InputError as error:
        raise InputError(f"--time-limit: {error}") from None
    if not seconds > 0.0:
        raise InputError(f"--time-limit '{text}': expected more than zero, such as '10 min'")
    return seconds


def _check_resumable(method: str, chains: Path) -> None:
    if method == "exact":
        raise InputError("--resume continues chains, and the method 'exact' has none: run without --resume")
    if not any(chains.glob("*.h5")):
        raise InputError(
            f"{chains / '*.h5'}: there is no checkpoint to resume from: run without --resume, "
            "or name by --out the folder of the run that was interrupted"
        )


def _fail(message: str, code: int) -> None:
    _clear_progress()
    typer.echo(f"imubayes: {' '.join(message.split())}", err=True)
    sys.exit(code)


def _progress() -> Callable[[str], None]:
    """Say what goes on, on one line of stderr, if somebody watches."""
    if not sys.stderr.isatty():
        return lambda message: None
    width = shutil.get_terminal_size().columns - 1
    return lambda message: typer.echo(f"\r\x1b[2K{message[:width]}", nl=False, err=True)


def _clear_progress() -> None:
    if sys.stderr.isatty():
        typer.echo("\r\x1b[2K", nl=False, err=True)


def _show(renderable: object) -> None:
    from rich.console import Console

    _clear_progress()
    Console(highlight=False).print(renderable)


def _written(folder: Path, files: tuple[Path, ...]) -> None:
    names = [file.name for file in files]
    typer.echo(f"written: {', '.join([str(folder / names[0]), *names[1:]])}")


def _usable(folder: Path) -> Path:
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file: expected a folder for --out, or a name that is free")
    return folder


@contextmanager
def _complete(folder: Path) -> Iterator[Path]:
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
