"""The kinds of study: how each is run, shown, written and traded (`imubayes.study.schema` reads it).

What a kind needs is imported when it is asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from imubayes.cli.console import Waiting, complete, fail
from imubayes.cli.options import check_resumable, climbing, overruled
from imubayes.errors import InputError

Written = tuple[Path, ...]
Done = tuple[object, Callable[[Path], Written]]
"""What a console shows, and a function that writes the report into a folder and gives its files."""

CHAINS = "chains"
"""Folder of the chains' checkpoints, in that of the results."""


@dataclass(frozen=True, slots=True)
class Asked:
    """What the command line asks of a run beside the study: the options of ``imubayes run``."""

    folder: Path
    method: str | None = None
    resume: bool = False
    time_limit: str | None = None
    ess: float | None = None
    budget: str | None = None
    accuracy: float | None = None
    scheduler: str | None = None

    @property
    def computing(self) -> bool:
        """Whether an option chooses how a posterior is computed."""
        given = (self.method, self.time_limit, self.ess, self.budget, self.accuracy)
        return any(option is not None for option in given)


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of study.

    Attributes
    ----------
    run : characterises or measures what the study asks for.
    subjects : what `imubayes trade` measures, of the study, names and repeats; None where there is nothing.
    """

    run: Callable[[Any, Asked, Waiting], Done]
    subjects: Callable[[Any, Sequence[str], int], Any] | None = None


def run(path: Path, asked: Asked, told: Waiting) -> Done:
    """Run a study of any kind.

    Raises
    ------
    InputError : if the study cannot be read, or has no use for an option.
    """
    from imubayes.study.schema import read

    kind, study = read(path)
    if asked.scheduler is not None and kind != "fleet":
        raise InputError("--scheduler shares out the units of a [fleet], which this study has none of")
    return KINDS[kind].run(study, asked, told)


def trade(
    path: Path,
    rungs: Sequence[str],
    only: Sequence[str],
    told: Waiting,
    *,
    repeats: int,
    limit: float,
) -> Done:
    """Measure the rungs of the ladder on a study of sensors, or of simulated lots.

    Parameters
    ----------
    path : of the study.
    rungs : by name; none for all.
    only : sensors or classes; none for all.
    told : is told what goes on.
    repeats : simulated sensors.
    limit : s, of all.

    Raises
    ------
    InputError : if the study cannot be read, or has nothing of what was asked.
    """
    from imubayes.ladder.trade.subjects import NAMES, rungs_of, with_options
    from imubayes.ladder.trade.table import measure
    from imubayes.reporting.trade_page import terminal_trade, write_trade
    from imubayes.study.schema import read

    asked = rungs_of(rungs) if rungs else NAMES
    kind, study = read(path)
    if (subjects := KINDS[kind].subjects) is None:
        raise InputError(f"{path}: [{kind}] has no methods to trade: expected [[sensor]] or [lots]")
    subject = with_options(subjects(study, only, repeats), rungs=asked, repeats=repeats, limit=limit)
    found = measure(subject, progress=told)
    return terminal_trade(found), partial(_together, write_trade, found)


def _together(write: Callable[[Any, Path], Written], found: object, folder: Path) -> Written:
    """Write files that come to be there together."""
    with complete(folder) as part:
        return write(found, part)


def _sensors(study: Any, asked: Asked, told: Waiting) -> Done:
    from imubayes.reporting.document import write_results
    from imubayes.reporting.tables import terminal_summary
    from imubayes.study.method import run as characterise

    sampling = overruled(study.sampling, asked.method, asked.ess, asked.time_limit)
    sampling = climbing(sampling, asked.budget, asked.accuracy, method=asked.method, resume=asked.resume)
    chains = asked.folder / CHAINS
    if asked.resume:
        check_resumable(sampling.method, chains)
    sampling = replace(sampling, checkpoints=chains, resume=asked.resume)
    found = characterise(replace(study, sampling=sampling), progress=told, quicker=told.quicker)
    return terminal_summary(found), partial(write_results, found)


def _fleet(study: Any, asked: Asked, told: Waiting) -> Done:
    """Its dataset grows in the folder as units are done."""
    from imubayes.population.fleet import measure
    from imubayes.population.processes import engine
    from imubayes.reporting.fleet_page import terminal_fleet, write_fleet

    if asked.computing:
        raise InputError(
            "--method, --time-limit, --ess, --budget and --accuracy choose how a sensor's posterior is"
            " computed, and a fleet's is exact: leave them out"
        )
    try:
        with engine("local" if asked.scheduler is None else asked.scheduler, study.processes) as workers:
            found = measure(study, asked.folder, workers, resume=asked.resume, progress=told)
    except KeyboardInterrupt:
        fail("interrupted: the same command with --resume goes on, and keeps what is finished", 130)
    return terminal_fleet(found), partial(_together, write_fleet, found)


def _lots(study: Any, asked: Asked, told: Waiting) -> Done:
    from imubayes.population.lots import measure
    from imubayes.reporting.lots_page import terminal_lots, write_lots

    found = measure(_left_alone(study, asked), progress=told)
    return terminal_lots(found), partial(_together, write_lots, found)


def _left_alone(study: Any, asked: Asked) -> Any:
    """Study that leaves no choice of how a posterior is computed, where none was asked for."""
    if asked.resume or asked.computing:
        raise InputError(
            "--method, --resume, --time-limit, --ess, --budget and --accuracy choose how a sensor's"
            " posterior is computed, which this study leaves no choice of: leave them out"
        )
    return study


def _traded_sensors(study: Any, only: Sequence[str], repeats: int) -> Any:
    from imubayes.ladder.trade.subjects import of_study

    return of_study(study, only)


def _traded_lots(study: Any, only: Sequence[str], repeats: int) -> Any:
    from imubayes.ladder.trade.subjects import of_lots

    return of_lots(study, only, repeats)


KINDS: Mapping[str, Kind] = {
    "sensor": Kind(_sensors, _traded_sensors),
    "lots": Kind(_lots, _traded_lots),
    "fleet": Kind(_fleet),
}
"""Kinds of study by the table that makes them: the keys of `schema.reading.FORMS`, and sensors."""
