"""The command line: ``imubayes run | check | simulate | trade | catalogue | compare``.

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
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from imubayes.errors import ConvergenceError, InputError, TermError

if TYPE_CHECKING:
    from imubayes.campaign import Sampling
    from imubayes.fleet.plan import FleetStudy
    from imubayes.other_studies import Done
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
    resume: Annotated[bool, typer.Option("--resume", help="Continue what is in the folder.")] = False,
    time_limit: Annotated[
        str | None, typer.Option(help='Of the chains of a sensor, "5 min".', show_default="the study's")
    ] = None,
    ess: Annotated[
        float | None, typer.Option(help="Effective sample size to reach.", show_default="the study's")
    ] = None,
    budget: Annotated[
        str | None,
        typer.Option(
            help='Compute time of a sensor, "5 s": the best method that fits in.', show_default=False
        ),
    ] = None,
    accuracy: Annotated[
        float | None,
        typer.Option(help="In posterior sd: the cheapest method that reaches it.", show_default=False),
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="Address of a dask scheduler, for a fleet.", show_default="local")
    ] = None,
) -> None:
    """Decide which terms each sensor needs; write the report."""
    from imubayes.config import read_extremes, read_fleet, read_lots, read_quality, read_speed, read_study
    from imubayes.other_studies import measured
    from imubayes.reporting.document import write_results
    from imubayes.reporting.tables import terminal_summary
    from imubayes.study import run

    folder = _usable(out or Path("reports") / study.stem)
    if fleet := read_fleet(study):
        if any(option is not None for option in (method, time_limit, ess, budget, accuracy)):
            raise InputError(
                "--method, --time-limit, --ess, --budget and --accuracy choose how a sensor's posterior is"
                " computed, and a fleet's is exact: leave them out"
            )
        _run_fleet(fleet, folder, scheduler or "local", resume=resume)
        return
    if scheduler is not None:
        raise InputError("--scheduler shares out the units of a [fleet], which this study has none of")
    if other := read_lots(study) or read_quality(study) or read_extremes(study) or read_speed(study):
        if resume or any(option is not None for option in (method, time_limit, ess, budget, accuracy)):
            raise InputError(
                "--method, --resume, --time-limit, --ess, --budget and --accuracy choose how a sensor's"
                " posterior is computed, which this study leaves no choice of: leave them out"
            )
        _report(measured(other, _progress()), folder)
        return
    read = read_study(study)
    sampling = _overruled(read.sampling, method, ess, time_limit)
    sampling = _climbing(sampling, budget, accuracy, method=method, resume=resume)
    if resume:
        _check_resumable(sampling.method, folder / CHAINS)
    sampling = replace(sampling, checkpoints=folder / CHAINS, resume=resume)
    result = run(replace(read, sampling=sampling), progress=_progress())
    files = write_results(result, folder)
    _show(terminal_summary(result))
    _written(folder, files)


def _report(done: Done, folder: Path) -> None:
    """Write what a study came to, and show it."""
    shown, write = done
    with _complete(folder) as part:
        files = write(part)
    _show(shown)
    _written(folder, files)


def _run_fleet(study: FleetStudy, folder: Path, scheduler: str, *, resume: bool) -> None:
    """Run a study of a fleet; its dataset grows in the folder as units are done."""
    from imubayes.fleet.engines import engine
    from imubayes.fleet.measure import measure
    from imubayes.reporting.fleet_page import terminal_fleet, write_fleet

    with engine(scheduler, study.processes) as workers:
        result = measure(study, folder, workers, resume=resume, progress=_progress())
    with _complete(folder) as part:
        files = write_fleet(result, part)
    _show(terminal_fleet(result))
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


@app.command("trade")
def _trade(
    study: StudyFile,
    out: Annotated[
        Path | None, typer.Option(help="Folder of the report.", show_default="reports/<study>-trade")
    ] = None,
    repeats: Annotated[int, typer.Option(help="Simulated sensors whose truth is known.")] = 20,
    rungs: Annotated[
        str | None, typer.Option(help="Methods, separated by commas.", show_default="all")
    ] = None,
    limit: Annotated[str, typer.Option(help="Of the time, about.")] = "5 min",
    only: Annotated[
        str | None, typer.Option(help="Sensors or classes, separated by commas.", show_default="all")
    ] = None,
) -> None:
    """Measure what each method costs on a study, and what it gets wrong."""
    from imubayes.other_studies import traded

    folder = _usable(out or Path("reports") / f"{study.stem}-trade")
    asked = [] if rungs is None else rungs.split(",")
    names = [] if only is None else [name.strip() for name in only.split(",")]
    done = traded(
        study, asked, names, repeats=repeats, limit=_duration(limit, "--limit"), progress=_progress()
    )
    _report(done, folder)


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


def _climbing(
    usual: Sampling, budget: str | None, accuracy: float | None, *, method: Method | None, resume: bool
) -> Sampling:
    """Sampling with the budget or the accuracy that the command line asks for."""
    if budget is None and accuracy is None:
        return usual
    if method is not None or resume or (budget is not None and accuracy is not None):
        raise InputError(
            "--budget and --accuracy choose the method: give one of them, without --method and --resume"
        )
    if accuracy is not None and not 0.0 < accuracy < math.inf:
        raise InputError(f"--accuracy {accuracy:g}: expected posterior standard deviations, such as 0.1")
    return replace(usual, budget=None if budget is None else _duration(budget, "--budget"), accuracy=accuracy)


def _duration(text: str, option: str = "--time-limit") -> float:
    """Seconds of a quantity in time."""
    from imubayes.units import quantity

    try:
        seconds = quantity(text, like="s")
    except InputError as error:
        raise InputError(f"{option}: {error}") from None
    if not seconds > 0.0:
        raise InputError(f"{option} '{text}': expected more than zero, such as '10 min'")
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
