"""The kinds of study: how each is run, shown, written and traded (`imubayes.study.schema` reads it).

What a kind needs is imported when it is asked for.
"""

from __future__ import annotations

import gc
import importlib
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from imubayes.cli.console import Waiting, complete, fail, usable
from imubayes.errors import InputError
from imubayes.ladder import CHAINED
from imubayes.work import Begin, beside, here

if TYPE_CHECKING:
    from imubayes.reporting.blocks import Page
    from imubayes.study.method import Loaded

Written = tuple[Path, ...]
Done = tuple[object, Callable[[Path], Written]]
"""What a console shows, and a function that gives the files of the report, in a folder by then."""

CHAINS = "chains"
"""Folder of the chains' checkpoints, in that of the results."""


class RunOptions(NamedTuple):
    """Options of ``imubayes run``; `computing` has those that choose how a posterior is computed."""

    folder: Path
    computing: Mapping[str, Any] = {}
    resume: bool = False
    scheduler: str | None = None


def duration(text: str, option: str) -> float:
    """Seconds of a quantity in time that an option has."""
    from imubayes.units import quantity

    try:
        seconds = quantity(text, like="s")
    except InputError as error:
        raise InputError(f"{option}: {error}") from None
    if not seconds > 0.0:
        raise InputError(f"{option} '{text}': expected more than zero, such as '10 min'")
    return seconds


def run(path: Path, asked: RunOptions, told: Waiting) -> Done:
    """Run a study of any kind; garbage is looked for when what stays has been loaded and compiled."""
    gc.disable()
    try:
        from imubayes.study.schema import read

        study: Any
        kind, study = read(path)
        if asked.scheduler is not None and kind != "fleet":
            raise InputError("--scheduler shares out the units of a [fleet], which this study has none of")
        if kind != "sensor" or study.sampling.climbs:
            _tidy()
        return KINDS[kind](study, asked, told)
    finally:
        gc.enable()


def trade(
    path: Path, rungs: Sequence[str], only: Sequence[str], told: Waiting, *, repeats: int, limit: float
) -> Done:
    """Measure the rungs of the ladder on a study of sensors, or of simulated lots, in `limit` s.

    Without rungs all are meant, and with `only` these sensors or classes alone.
    """
    from imubayes.ladder.trade import measure
    from imubayes.ladder.trade.components import NAMES, of_lots, of_study, rungs_of
    from imubayes.reporting.trade_page import trade_json, trade_page
    from imubayes.study.schema import read

    asked = rungs_of(rungs) if rungs else NAMES
    study: Any
    kind, study = read(path)
    if kind == "fleet":
        raise InputError(f"{path}: [{kind}] has no methods to trade: expected [[sensor]] or [lots]")
    subject = of_lots(study, only, repeats) if kind == "lots" else of_study(study, only)
    traded = measure(replace(subject, rungs=asked, repeats=repeats, limit=limit), progress=told)
    return _done(trade_page(traded), trade_json(traded))


def plan(path: Path, out: Path | None, told: Waiting) -> tuple[Done, Path]:
    """Plan the test of a sensor, or find the hours that those of classes take; and give the folder for it."""
    from imubayes.population.lots import LotStudy
    from imubayes.study.schema import read_plan

    study = read_plan(path)
    if isinstance(study, LotStudy):
        from imubayes.planning.hours import hours
        from imubayes.reporting.hours_page import hours_json, hours_page

        folder = usable(out or Path("reports") / f"{path.stem}-plan")  # 'run' writes into that of the study
        by_class = hours(study, progress=told)
        return _done(hours_page(by_class), hours_json(by_class)), folder
    from imubayes.planning.proposal import propose
    from imubayes.reporting.plan_page import plan_json, plan_page
    from imubayes.study.schema import write_planned

    folder = usable(out or Path("reports") / path.stem)
    proposal = propose(study, progress=told)
    return _done(plan_page(proposal), plan_json(proposal), partial(write_planned, proposal)), folder


def compared(results: Sequence[Path]) -> Done:
    """Set results side by side."""
    from imubayes.reporting.comparison import side_by_side
    from imubayes.reporting.result.file import json_text

    page, values = side_by_side(results)
    return _done(page, json_text(values))


def _done(page: Page, values: str, *more: Callable[[Path], Path]) -> Done:
    """Lines of a page, and what writes it with its values, and more files, so that they come together."""
    from imubayes.reporting.blocks import write_page

    def write(folder: Path) -> Written:
        with complete(folder) as part:
            return *write_page(page, values, part), *(writer(part) for writer in more)

    return page, write


def _sensors(study: Any, asked: RunOptions, told: Waiting) -> Done:
    from imubayes.rig.recordings import files_of
    from imubayes.study.method import run as characterise

    study = replace(study, sampling=_sampling(study.sampling, asked))
    for run in (run for sensor in study.sensors for run in sensor.runs):
        files_of(run)  # one that is not there is told of before what draws and tests is loaded
    with nullcontext((here, None)) if study.sampling.climbs else _beside(study.compare) as (begin, loaded):
        tell = {"progress": told, "quicker": told.quicker, "warn": told.warn, "first": told.first}
        result = characterise(study, **tell, begin=begin, loaded=loaded)
        with complete(asked.folder) as part:
            reported = begin(_reported, summed(result), part)
            from imubayes.reporting.posterior import write_posterior

            draws = write_posterior(result, part)
            del result  # most of what is held goes before the page comes
            page, files = reported()
    return page, lambda _: (*files, draws)


@contextmanager
def _beside(compare: bool) -> Iterator[tuple[Begin, Loaded]]:
    """Process beside this one, and what waits until it has compiled what weighs models, which both need.

    The compiler is begun before, so that a fork has it.
    """
    import numpy as np

    from imubayes.selection import kernels, lanes, panel

    def loaded() -> Callable[[], object]:
        kernels.ready()  # the other process has compiled a part of it by now
        walked()
        _tidy()
        return partial(begin, _pages)

    kernels.ones(1)
    with beside() as begin:
        walked = begin(lanes.residuals, np.eye(2))  # of one model
        if compare:
            begin(panel.ready)
        kernels.powers_ready()  # the other process finds them compiled
        yield begin, loaded


def _tidy() -> None:
    """Look for garbage again, but not among what has been loaded and compiled."""
    if not gc.isenabled():
        gc.freeze()
        gc.enable()


def _pages() -> None:
    """Load what writes pages."""
    _tidy()
    importlib.import_module("imubayes.reporting.document")


def summed(result: Any) -> Any:
    """What is said of a study, without what is most of it: single models, draws, and dwells at draws."""
    import numpy as np

    from imubayes.selection.mixture import no_mixture
    from imubayes.selection.model_sets import Space

    none = np.empty(0)

    def light(sensor: Any) -> Any:
        models = sensor.selection.models
        few = {"parts": (), "given": {}, "weight": none, "components": no_mixture(models.candidates)}
        few["space"] = Space(models.space.p)
        chains = sensor.chains and replace(sensor.chains, log_likelihood=none, predicted=none)
        selection = replace(sensor.selection, models=replace(models, **few))
        draws = {"draws": np.empty((len(sensor.draws), 0)), "prior_draws": none}  # they are counted
        return replace(sensor, selection=selection, chains=chains, **draws)

    return replace(result, sensors=tuple(map(light, result.sensors)))


def _reported(result: Any, folder: Path) -> tuple[Page, Written]:
    """Write the report of a study of sensors; give its page, as a terminal shows it, and the files."""
    from imubayes.reporting.blocks import write_page
    from imubayes.reporting.document import report_page
    from imubayes.reporting.results import result_json

    page = report_page(result)
    return page, write_page(page, result_json(result), folder)


def _sampling(usual: Any, asked: RunOptions) -> Any:
    """Sampling of the study, with what the command line says in place of it; options must not contradict."""
    given, chains = dict(asked.computing), asked.folder / CHAINS
    for name, what in (
        ("ess", "a number of effective samples above zero, such as 1000"),
        ("accuracy", "posterior standard deviations, such as 0.1"),
    ):
        if not 0.0 < given.get(name, 1.0) < math.inf:
            raise InputError(f"--{name} {given[name]:g}: expected {what}")
    climbs = given.keys() & {"budget", "accuracy"}
    if climbs and ("method" in given or asked.resume or len(climbs) == 2):
        raise InputError(
            "--budget and --accuracy choose the method: give one of them, without --method and --resume"
        )
    for name in ("time_limit", "budget"):
        if name in given:
            given[name] = duration(given[name], f"--{name.replace('_', '-')}")
    sampling = replace(usual, **given)
    if asked.resume and sampling.method not in CHAINED:
        raise InputError(
            f"--resume continues chains, and the method '{sampling.method}' keeps none: run without --resume"
        )
    if asked.resume and not any(chains.glob("*.h5")):
        raise InputError(
            f"{chains / '*.h5'}: there is no checkpoint to resume from: run without --resume, "
            "or name by --out the folder of the run that was interrupted"
        )
    return replace(sampling, checkpoints=chains, resume=asked.resume)


def _fleet(study: Any, asked: RunOptions, told: Waiting) -> Done:
    """Its dataset grows in the folder as units are done."""
    from imubayes.population.fleet import measure
    from imubayes.reporting.fleet_page import fleet_json, fleet_page
    from imubayes.work import engine

    if asked.computing:
        raise InputError(
            "--method, --time-limit, --ess, --budget and --accuracy choose how a sensor's posterior is"
            " computed, and a fleet's is exact: leave them out"
        )
    try:
        with engine("local" if asked.scheduler is None else asked.scheduler, study.processes) as workers:
            fleet = measure(study, asked.folder, workers, resume=asked.resume, progress=told)
    except KeyboardInterrupt:
        fail("interrupted: the same command with --resume goes on, and keeps what is finished", 130)
    return _done(fleet_page(fleet), fleet_json(fleet))


def _lots(study: Any, asked: RunOptions, told: Waiting) -> Done:
    from imubayes.population.lots import measure
    from imubayes.reporting.lots_page import lots_json, lots_page

    if asked.resume or asked.computing:
        raise InputError(
            "--method, --resume, --time-limit, --ess, --budget and --accuracy choose how a sensor's"
            " posterior is computed, which this study leaves no choice of: leave them out"
        )
    lots = measure(study, progress=told)
    return _done(lots_page(lots), lots_json(lots))


KINDS: Mapping[str, Callable[[Any, RunOptions, Waiting], Done]] = {
    "sensor": _sensors,
    "lots": _lots,
    "fleet": _fleet,
}
"""What runs a kind of study, by the table that makes it: the keys of `schema.FORMS`, and sensors."""
