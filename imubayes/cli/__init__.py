"""The command line: run, check, init, simulate, plan, trade, compare, index, export, catalogue, schema.

Exit code 0: done. 2: the input is wrong, and a sentence on stderr says where. 1: our fault. What a command
needs is imported when it runs, so that ``--help`` answers at once.
"""

from __future__ import annotations

import atexit
import gc
import json
import os
import re
import sys
from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from imubayes.cli.console import complete, fail, show, usable, waiting, written
from imubayes.errors import ConvergenceError, InputError, TermError, hint
from imubayes.ladder import METHODS
from imubayes.work import ONE_THREAD

if TYPE_CHECKING:
    from imubayes.cli.kinds import Done

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="Which terms of the generalized IMU model does this sensor need, and how sure is that?",
)


YOUNG = 50_000
"""Objects after which those are looked through for garbage: about as many as a large library makes."""


def example(*commands: str) -> str:
    """What stands below a command's help: commands that work as they stand, in the project's folder."""
    return "\n".join(["\b", "Example:", *(f"  imubayes {command}" for command in commands)])


Method = StrEnum("Method", METHODS)
Document = StrEnum("Document", ["study", "result"])
BiasAt = StrEnum("BiasAt", ["start", "mean", "end"])
ExportFormat = StrEnum("ExportFormat", ["kalibr", "px4", "c", "python", "matlab", "json", "filter"])


def option(help: str, usual: str | bool = False) -> Any:
    """Describe an option; `usual` says in words what it is where it is not given."""
    return typer.Option(help=help, show_default=usual)


StudyFile = Annotated[Path, typer.Argument(metavar="STUDY.toml", help="The study.", show_default=False)]
Folder = Annotated[Path, option("Folder of the files.")]


def main() -> None:
    """Run the command line; the console script's entry point."""
    # many small matrices: threads of the linear algebra only wait for each other
    for name in ONE_THREAD:
        os.environ.setdefault(name, "1")
    # what is loaded stays: looked for garbage less often, and not at all where it ends with the process
    gc.set_threshold(YOUNG)
    atexit.register(gc.freeze)
    try:
        _legible(sys.argv[1:])
        app()
    except InputError as error:
        fail(str(error), 2)
    except ConvergenceError as error:
        fail(f"{error}; this is a fault of imubayes, please report it with the study", 1)


def _legible(arguments: Sequence[str]) -> None:
    """Refuse what no file that is written could name: bytes that are no text stand as lone surrogates."""
    for argument in arguments:
        if re.search("[\ud800-\udfff]", argument):
            raise InputError(
                f"{argument!a}: is no text in UTF-8: rename the file or its folder, or, where names look"
                " right elsewhere, set LC_ALL=C.UTF-8"
            )


@app.callback(invoke_without_command=True)
def _options(
    version: Annotated[bool, typer.Option("--version", help="Print the version.", is_eager=True)] = False,
) -> None:
    if version:
        from imubayes import __version__

        typer.echo(f"imubayes {__version__}")
        raise typer.Exit


@app.command(
    "run",
    epilog=example(
        "run studies/quickstart.toml", 'run studies/imu_tactical.toml --budget "5 s" --out reports/quick'
    ),
)
def _run(
    study: StudyFile,
    out: Annotated[Path | None, option("Folder of the results.", "reports/<study>")] = None,
    method: Annotated[Method | None, option("How the posterior is computed.", "the study's")] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue what is in the folder.")] = False,
    time_limit: Annotated[str | None, option('Of the chains of a sensor, "5 min".', "the study's")] = None,
    ess: Annotated[float | None, option("Effective sample size to reach.", "the study's")] = None,
    budget: Annotated[
        str | None, option('Compute time of a sensor, "5 s": the best method that fits in.')
    ] = None,
    accuracy: Annotated[float | None, option("In posterior sd: the cheapest method that reaches it.")] = None,
    scheduler: Annotated[str | None, option("Address of a dask scheduler, for a fleet.", "local")] = None,
) -> None:
    """Decide which terms each sensor needs; write the report."""
    from imubayes.cli import kinds

    folder = usable(out or Path("reports") / study.stem)
    options = {"method": method and str(method), "ess": ess, "time_limit": time_limit}
    options |= {"budget": budget, "accuracy": accuracy}
    computing = {name: value for name, value in options.items() if value is not None}
    asked = kinds.RunOptions(folder, computing, resume, scheduler)
    with waiting() as told:
        done = kinds.run(study, asked, told)
    _report(done, folder)


def _report(done: Done, folder: Path) -> None:
    """Write what a study came to, and show it."""
    from imubayes.reporting.index import renew_index

    shown, write = done
    files = write(folder)
    renew_index(folder)
    show(shown)
    written(folder, files)


@app.command("check", epilog=example("check studies/quickstart.toml"))
def _check(study: StudyFile) -> None:
    """Say what the runs can tell, before a fit."""
    from imubayes.reporting.tables import terminal_check
    from imubayes.study.method import check

    with waiting() as told:
        sensors = check(study, progress=told)
    for sensor in sensors:
        show(terminal_check(sensor))


@app.command(
    "init", epilog=example("simulate studies/quickstart.toml --out recorded", "init recorded/tumble.csv")
)
def _init(
    recording: Annotated[Path, typer.Argument(metavar="RECORDING", help="A file of samples.")],
    out: Annotated[Path | None, option("The study.", "RECORDING with the suffix .toml")] = None,
    force: Annotated[bool, typer.Option("--force", help="Write over a file that is there.")] = False,
) -> None:
    """Begin a study of a recording: guess its columns, ask for the rest."""
    from imubayes.rig.recordings import write_whole
    from imubayes.study.draft import drafted

    file = out or recording.with_suffix(".toml")
    if file.exists() and (not force or file.samefile(recording)):
        raise InputError(f"{file}: is there already: choose another --out, or --force to write over a study")
    text = drafted(recording, file.parent)
    try:
        write_whole(file, lambda stream: stream.write(text.encode()))
    except OSError as error:
        raise InputError(f"{file}: cannot be written ({error.strerror}): choose another --out") from None
    typer.echo(text, nl=False)
    written(file.parent, (file,))


@app.command("simulate", epilog=example("simulate studies/quickstart.toml --out recorded"))
def _simulate(study: StudyFile, out: Folder) -> None:
    """Write simulated runs, and a study of them, as files."""
    from imubayes.study.schema import read_study, record_study

    folder = usable(out)
    with waiting() as told, complete(folder) as part:
        files = record_study(read_study(study), part, told)
    written(folder, files)


@app.command("trade", epilog=example('trade studies/quickstart.toml --limit "1 min"'))
def _trade(
    study: StudyFile,
    out: Annotated[Path | None, option("Folder of the report.", "reports/<study>-trade")] = None,
    repeats: Annotated[int, option("Simulated sensors whose truth is known.", True)] = 20,
    rungs: Annotated[str | None, option("Methods, separated by commas.", "all")] = None,
    limit: Annotated[str, option("Of the time, about.", True)] = "5 min",
    only: Annotated[str | None, option("Sensors or classes, separated by commas.", "all")] = None,
) -> None:
    """Measure what each method costs on a study, and what it gets wrong."""
    from imubayes.cli import kinds

    folder = usable(out or Path("reports") / f"{study.stem}-trade")
    asked = [] if rungs is None else rungs.split(",")
    names = [] if only is None else [name.strip() for name in only.split(",")]
    lasting = kinds.duration(limit, "--limit")
    with waiting() as told:
        done = kinds.trade(study, asked, names, told, repeats=repeats, limit=lasting)
    _report(done, folder)


@app.command("plan", epilog=example("plan studies/plan_tactical.toml"))
def _plan(
    study: StudyFile,
    out: Annotated[
        Path | None, option("Folder of the results.", "reports/<study>, of classes reports/<study>-plan")
    ] = None,
) -> None:
    """Find the best test within a time, or the hours of classes."""
    from imubayes.cli import kinds

    with waiting() as told:
        done, folder = kinds.plan(study, out, told)
    _report(done, folder)


@app.command("catalogue", epilog=example("catalogue", "catalogue fog_tactical"))
def _catalogue(
    name: Annotated[
        str | None, typer.Argument(metavar="CLASS", help="A class id.", show_default=False)
    ] = None,
    kind: Annotated[str | None, option("accelerometer or gyroscope.")] = None,
    own: Annotated[Path | None, option("TOML file of own classes.")] = None,
) -> None:
    """List the technologies and grades, or one's figures and priors."""
    from imubayes.reporting.tables import bench_list, class_list, class_page
    from imubayes.sensors.catalogue import classes
    from imubayes.sensors.catalogue_file import read_catalogue

    known = classes(kind, catalogue=() if own is None else read_catalogue(own))
    if name is None:
        show(class_list(known))
        if kind is None:
            show(bench_list())
        return
    if not (entries := [entry for entry in known if entry.id == name]):
        ids = dict.fromkeys(entry.id for entry in known)
        raise TermError(f"class '{name}' is not in the catalogue: {hint(name, ids)}")
    for entry in entries:
        show(class_page(entry))


@app.command("compare", epilog=example("compare reports/xsens_tumble reports/imu_tk_xsens"))
def _compare(
    results: Annotated[
        list[Path], typer.Argument(metavar="RESULT...", help="Files result.json, or their folders.")
    ],
    out: Annotated[Path | None, option("Folder of the comparison's report.")] = None,
) -> None:
    """Set results side by side; say what differs beyond uncertainty."""
    from imubayes.cli import kinds

    folder = None if out is None else usable(out)
    done = kinds.compared(results)
    if folder is None:
        show(done[0])
    else:
        _report(done, folder)


@app.command("index", epilog=example("index reports"))
def _index(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="Folder of reports, such as reports.", show_default=False)
    ],
) -> None:
    """List a folder's reports on a page, with their answers."""
    from imubayes.reporting.index import write_index

    typer.echo(f"written: {write_index(folder)}")


@app.command("export", epilog=example("export reports/imu_tactical --to kalibr --out kalibr"))
def _export(
    result: Annotated[Path, typer.Argument(metavar="RESULT.json", help="A result, or its folder.")],
    to: Annotated[ExportFormat, option("What it is for.")],
    out: Folder,
    model: Annotated[str, option("best, needed, full, basic, or a scene of the result.", True)] = "best",
    sensor: Annotated[str, option("Id, where the result has several.")] = "",
    bias_at: Annotated[
        BiasAt, option("start, mean or end of the record: whose bias, where it walks.", True)
    ] = BiasAt.mean,
    accept_misfit: Annotated[
        bool, typer.Option("--accept-misfit", help="Export a model that the data reject.")
    ] = False,
) -> None:
    """Write a compensation, a simulator's model or a filter's parameters."""
    from imubayes.reporting.export import exported

    folder = usable(out)
    asked = {"sensor": sensor, "model": model, "bias_at": str(bias_at), "accept_misfit": accept_misfit}
    texts = exported(result, str(to), **asked)
    with complete(folder) as part:
        for name, text in texts.items():
            (part / name).write_text(text, encoding="utf-8")
    written(folder, tuple(folder / name for name in texts))


@app.command("schema", epilog=example("schema study"))
def _schema(document: Annotated[Document, typer.Argument(help="What it is of.", show_default=False)]) -> None:
    """Print the JSON Schema of a study file or of result.json."""
    if document is Document.study:
        from imubayes.study.schema.document import study_schema as schema
    else:
        from imubayes.reporting.result.file import result_schema as schema
    typer.echo(json.dumps(schema(), indent=1, ensure_ascii=False))
