"""A study of a fleet: every unit, in parts that are kept as they are done, and what all say together."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import NormalDist
from typing import Any

import numpy as np

from imubayes.algebra import FloatArray, IntArray
from imubayes.errors import InputError
from imubayes.inference import Share
from imubayes.population import Broken, FleetStudy, Record, Unit, part_found, parts_of
from imubayes.population.dataset import Marks, fingerprint, keep, kept_records, leave, make_room, publish
from imubayes.population.needs import NEEDED, VERDICTS, PopulationTerm
from imubayes.population.spreads import over_units, population
from imubayes.sensors.lots import Lot, draw_lot
from imubayes.work import Done, Engine, Lost, Progress, silent

ENDED = (
    "its analysis ended the process that did it, each time: is its file too large for the memory of a worker?"
)

ALARM = 0.01
"""Probability that any unit of a fleet of one population stands out in any term."""

WORST = 20
"""Units that are named, those farthest from the population first."""

MAD_TO_SD = 1.0 / NormalDist().inv_cdf(0.75)
"""Standard deviation of a normal over its median absolute deviation."""


@dataclass(frozen=True, slots=True)
class Pull:
    """How far a unit is from the others, in the term in which it is farthest.

    Attributes
    ----------
    unit : its name.
    term : of the library, or ``N``.
    value : that was found of it, SI.
    pull : distance from the population's mean over the sd that the population and the unit's error give;
        for ``N``, of its logarithm from the median, over the fleet's scatter.
    outlier : whether so far a unit is not expected anywhere in the fleet.
    """

    unit: str
    term: str
    value: float
    pull: float
    outlier: bool


@dataclass(frozen=True, slots=True, eq=False)
class FleetResult:
    """What the units of a fleet say together.

    Attributes
    ----------
    units, samples : number of units that could be read, and rows that were used.
    terms : population of each term, SI; true values are NaN for recorded units.
    counts : (6, p) units with each verdict, in the order of `needs.VERDICTS`.
    order : number of needed terms of a unit, median and 90 % range.
    noise : N, B, K over the units, SI: median and 90 % range.
    worst : the units that are farthest from the population, farthest first.
    farthest : their records, and of each (p + 1,) how far it is in each term and in N, in sd.
    outliers : number of units that are farther than expected.
    limit : pull from which that is.
    broken : units that could not be read.
    engine : who did it.
    resumed : number of units that were there already.
    """

    study: FleetStudy
    units: int
    samples: int
    terms: tuple[PopulationTerm, ...]
    counts: IntArray
    order: Share
    noise: tuple[Share, Share, Share]
    worst: tuple[Pull, ...]
    farthest: tuple[tuple[Record, FloatArray], ...]
    outliers: int
    limit: float
    broken: tuple[Broken, ...]
    engine: str = ""
    resumed: int = 0
    seconds: float = 0.0


def measure(
    study: FleetStudy, folder: Path, engine: Engine, *, resume: bool = False, progress: Progress = silent
) -> FleetResult:
    """Test every unit of a fleet; `progress` is told how many are done.

    A part is kept in the `folder` of the results as soon as it is done, and all become its dataset ``units``
    when none is left. `resume` takes the records that are there already, if they were made from the same
    study and files; units that could not be read are tried again. It is an `InputError` if no unit could be
    read; if the folder cannot be written, or other files are in its way.
    """
    start, (name, do) = time.perf_counter(), engine
    make_room(folder, study)
    lot, prints = lot_of(study), [fingerprint(study, unit) for unit in study.units]
    kept = kept_records(folder, prints) if resume else {}
    total = len(study.units) - len(kept)
    done, finished, every = 0, dict[int, Marks](), list[Record | Broken]()
    try:
        for part, new in _missing(replace(study, units=()), parts_of(study, lot), kept, do):
            old = [kept[unit.number] for unit in part if unit.number in kept]
            units = sorted((*old, *new), key=lambda unit: unit.number)
            records, names, index = _records(units), study.spec.library.names, part[0].number // study.part
            changed = bool(_records(new))
            finished[index] = keep(folder, index, records, names, prints, changed=changed)
            every += units
            done += len(new)
            if new:
                progress(f"{done} of {total} units", done / total)
        every.sort(key=lambda unit: unit.number)
        first = every[0]
        if isinstance(first, Broken) and not _records(every):
            raise InputError(f"none of {len(every)} units could be read; {first.name}: {first.error}")
    finally:
        leave(folder)
    publish(folder, finished)
    fleet = together(every, study, lot)
    return replace(fleet, engine=name, resumed=len(kept), seconds=time.perf_counter() - start)


def _records(units: Sequence[Record | Broken]) -> list[Record]:
    return [unit for unit in units if isinstance(unit, Record)]


def lot_of(study: FleetStudy) -> Lot | None:
    """Draw the units of a simulated fleet; None where they are recorded."""
    if not study.simulated:
        return None
    rng = np.random.default_rng([study.seed, 0])
    return draw_lot(study.sensor_class, study.spec.library, len(study.units), rng)


def _missing(
    study: FleetStudy, parts: Sequence[Sequence[Unit]], kept: Mapping[int, Record], do: Callable[..., Done]
) -> Iterator[tuple[Sequence[Unit], Sequence[Record | Broken]]]:
    """Each part with what is not kept of it: those that lack nothing first, the others as they are done.

    A part that ends its process is done unit by unit at the end.
    """
    lacking = [[unit for unit in part if unit.number not in kept] for part in parts]
    yield from ((part, ()) for part, units in zip(parts, lacking, strict=True) if not units)
    todo, lost = [k for k, units in enumerate(lacking) if units], list[int]()
    for job, records in do(part_found, [(study, lacking[k]) for k in todo]):
        if isinstance(records, Lost):
            lost.append(todo[job])
        else:
            yield parts[todo[job]], records
    for k in lost:
        jobs = [(study, [unit]) for unit in lacking[k]]
        alone: dict[int, Any] = dict(do(part_found, jobs)) if len(jobs) > 1 else {0: Lost()}
        yield (
            parts[k],
            [
                Broken(unit.number, unit.name, ENDED) if isinstance(alone[j], Lost) else alone[j][0]
                for j, unit in enumerate(lacking[k])
            ],
        )


def together(every: Sequence[Record | Broken], study: FleetStudy, lot: Lot | None) -> FleetResult:
    """Put the units of a fleet together, of a simulated one beside the truth of its lot."""
    units, names = _records(every), study.spec.library.names
    terms = population(
        [units], study.sensor_class, study.spec.library, [lot] if lot else (), study.spec.prior
    )
    N, B, K = (over_units([unit.noise[k] for unit in units]) for k in range(3))
    # pull (n, p + 1) of each unit in each term, and in its white noise
    mean = np.array([term.mean.value for term in terms])
    spreads = np.array([term.spread.value for term in terms])
    estimate, sd = (np.array([getattr(unit, name) for unit in units]) for name in ("full_mean", "full_sd"))
    log_noise = np.log([unit.noise[0] for unit in units])
    away = log_noise - np.median(log_noise)
    scatter = MAD_TO_SD * float(np.median(np.abs(away))) or math.inf
    pulls = np.column_stack(((estimate - mean) / np.sqrt(spreads**2 + sd**2), away / scatter))
    limit = NormalDist().inv_cdf(1.0 - 0.5 * ALARM / pulls.size)
    farthest = np.abs(pulls).max(axis=1)
    order = np.argsort(-farthest, kind="stable")[:WORST]
    verdicts = np.array([unit.verdicts for unit in units])
    return FleetResult(
        study=study,
        units=len(units),
        samples=sum(unit.samples for unit in units),
        terms=terms,
        counts=np.array([np.sum(verdicts == verdict, axis=0) for verdict in VERDICTS]),
        order=over_units([unit.verdicts.count(NEEDED) for unit in units]),
        noise=(N, B, K),
        worst=tuple(_pull(units[k], names, pulls[k], limit) for k in order.tolist()),
        farthest=tuple((units[k], pulls[k]) for k in order.tolist()),
        outliers=int(np.sum(farthest > limit)),
        limit=limit,
        broken=tuple(unit for unit in every if isinstance(unit, Broken)),
    )


def _pull(unit: Record, names: Sequence[str], pulls: FloatArray, limit: float) -> Pull:
    j = int(np.argmax(np.abs(pulls)))
    term, value = (names[j], float(unit.full_mean[j])) if j < len(names) else ("N", unit.noise[0])
    return Pull(unit.name, term, value, float(pulls[j]), bool(abs(pulls[j]) > limit))
