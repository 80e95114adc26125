"""A study of a fleet: every unit, in parts that are kept as they are done, and what all say together."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import NormalDist

import numpy as np

from imubayes.algebra.arrays import FloatArray, IntArray
from imubayes.errors import InputError
from imubayes.inference.intervals import Share
from imubayes.population.dataset import Marks
from imubayes.population.engines import Engine
from imubayes.population.keeping import fingerprint, keep, kept_records, leave, make_room, publish
from imubayes.population.parts import FleetStudy, Part, PartFound, part_found, parts_of
from imubayes.population.processes import Lost, Progress, pace
from imubayes.population.records import Broken, Record
from imubayes.population.tally import Tally, over_units, tally, together
from imubayes.population.terms import PopulationTerm, population
from imubayes.sensors.lots import Lot, draw_lot

ENDED = (
    "its analysis ended the process that did it, each time: is its file too large for the memory of a worker?"
)

ALARM = 0.01
"""Probability that any unit of a fleet of one population stands out in any term."""

WORST = 20
"""Units that are named, those farthest from the population first."""

NOISE = ("N", "B", "K")

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
class FleetAnswer:
    """What the units say together.

    Attributes
    ----------
    units : number of units that could be read.
    samples : rows that were used.
    terms : population of each term, SI; true values are NaN for recorded units.
    counts : (6, p) units with each verdict, in the order of `tally.VERDICTS`.
    order : number of needed terms of a unit, median and 90 % range.
    noise : N, B, K over the units, SI: median and 90 % range.
    worst : the units that are farthest from the population, farthest first.
    outliers : number of units that are farther than expected.
    limit : pull from which that is.
    broken : units that could not be read.
    """

    units: int
    samples: int
    terms: tuple[PopulationTerm, ...]
    counts: IntArray
    order: Share
    noise: tuple[Share, Share, Share]
    worst: tuple[Pull, ...]
    outliers: int
    limit: float
    broken: tuple[Broken, ...]


@dataclass(frozen=True, slots=True, eq=False)
class FleetResult:
    """Result of a study of a fleet.

    Attributes
    ----------
    study : that was run.
    answer : what the units say together.
    engine : who did the work, in words.
    resumed : units whose records were there already.
    seconds : that it took.
    """

    study: FleetStudy
    answer: FleetAnswer
    engine: str
    resumed: int
    seconds: float


def measure(
    study: FleetStudy,
    folder: Path,
    engine: Engine,
    *,
    resume: bool = False,
    progress: Progress = lambda message: None,
) -> FleetResult:
    """Test every unit of a fleet.

    Parameters
    ----------
    study : as `study.schema` reads it.
    folder : of the results; a part is kept there as soon as it is done, and all become its dataset ``units``
        when none is left.
    engine : who does the work.
    resume : take the records that are there already, if they were made from the same study and files; units
        that could not be read are tried again.
    progress : is told how many units are done.

    Raises
    ------
    InputError : if no unit could be read; if the folder cannot be written, or other files are in its way.
    """
    start = time.perf_counter()
    make_room(folder, study)
    lot, prints = lot_of(study), [fingerprint(study, unit) for unit in study.units]
    kept = kept_records(folder, prints) if resume else {}
    parts, p = parts_of(study, lot), len(study.spec.library.terms)
    finished = dict[int, Marks]()
    tell = pace(len(study.units) - len(kept), "units", progress)

    done, tallies = 0, dict[int, Tally]()
    try:
        for new in _missing(replace(study, units=()), parts, kept, engine):
            whole, count = _with_kept(new, parts[new.index], kept), len(new.records) + len(new.broken)
            finished[new.index] = keep(
                folder, whole, study.spec.library.names, prints, changed=bool(new.records)
            )
            tallies[new.index] = tally(whole.records, p, whole.broken)
            done += count
            if count:
                tell(done)
        units = together([tallies[k] for k in range(len(parts))])
        _check_any(units, study)
    finally:
        leave(folder)
    publish(folder, finished)
    found = answer(units, study, lot)
    return FleetResult(study, found, engine.name, len(kept), time.perf_counter() - start)


def lot_of(study: FleetStudy) -> Lot | None:
    """Draw the units of a simulated fleet; None where they are recorded."""
    if not study.simulated:
        return None
    rng = np.random.default_rng([study.seed, 0])
    return draw_lot(study.sensor_class, study.spec.library, len(study.units), rng)


def _missing(
    study: FleetStudy, parts: Sequence[Part], kept: Mapping[int, Record], engine: Engine
) -> Iterator[PartFound]:
    """Records that are not kept, part by part: those that lack none first, the others as they are done."""
    todo = list[Part]()
    for part in parts:
        places = [k for k, unit in enumerate(part.units) if unit.number not in kept]
        if places:
            todo.append(part.only(places))
        else:
            yield PartFound(part.index, (), ())
    yield from _ran(study, todo, engine)


def _with_kept(new: PartFound, part: Part, kept: Mapping[int, Record]) -> PartFound:
    """Records of a part, those that were kept among them, in the order of its units."""
    old = [kept[unit.number] for unit in part.units if unit.number in kept]
    records = sorted((*old, *new.records), key=lambda record: record.number)
    return replace(new, records=tuple(records))


def _ran(study: FleetStudy, parts: Sequence[Part], engine: Engine) -> Iterator[PartFound]:
    """Records of the parts as they are done; a part that ends its process is done unit by unit at the end."""
    lost = list[Part]()
    for k, found in engine.do(part_found, [(study, part) for part in parts]):
        if isinstance(found, Lost):
            lost.append(parts[k])
        else:
            yield found
    yield from (_one_by_one(study, part, engine) for part in lost)


def _one_by_one(study: FleetStudy, part: Part, engine: Engine) -> PartFound:
    jobs = [(study, part.only([k])) for k in range(len(part.units))]
    found = dict[int, PartFound]()
    for k, one in engine.do(part_found, jobs) if len(jobs) > 1 else [(0, Lost())]:
        unit = part.units[k]
        ended = PartFound(part.index, (), (Broken(unit.number, unit.name, ENDED),))
        found[k] = ended if isinstance(one, Lost) else one
    ordered = [found[k] for k in range(len(jobs))]
    return PartFound(
        part.index,
        tuple(record for one in ordered for record in one.records),
        tuple(broken for one in ordered for broken in one.broken),
    )


def _check_any(whole: Tally, study: FleetStudy) -> None:
    if not whole.names:
        first = whole.broken[0]
        raise InputError(f"none of {len(study.units)} units could be read; {first.name}: {first.error}")


def answer(whole: Tally, study: FleetStudy, lot: Lot | None) -> FleetAnswer:
    """Put the units of a fleet together.

    Parameters
    ----------
    whole : tally of all units.
    study : of the fleet.
    lot : that simulated units are of: the truth to set beside.
    """
    terms = population(whole, study.sensor_class, study.spec.library, lot)
    N, B, K = (over_units(whole.noise[:, k]) for k in range(3))
    pulls = _pulls(whole, terms)
    limit = NormalDist().inv_cdf(1.0 - 0.5 * ALARM / pulls.size)
    farthest = np.abs(pulls).max(axis=1)
    order = np.argsort(-farthest, kind="stable")[:WORST]
    return FleetAnswer(
        units=len(whole.names),
        samples=whole.samples,
        terms=terms,
        counts=whole.counts,
        order=over_units(whole.order),
        noise=(N, B, K),
        worst=tuple(_pull(whole, study.spec.library.names, pulls, int(k), limit) for k in order),
        outliers=int(np.sum(farthest > limit)),
        limit=limit,
        broken=whole.broken,
    )


def _pulls(whole: Tally, terms: Sequence[PopulationTerm]) -> FloatArray:
    """Pull (n, p + 1) of each unit in each term, and in its white noise."""
    mean = np.array([term.mean.value for term in terms])
    spreads = np.array([term.spread.value for term in terms])
    of_terms = (whole.estimate - mean) / np.sqrt(spreads**2 + whole.variance)
    log_noise = np.log(whole.noise[:, 0])
    away = log_noise - np.median(log_noise)
    scatter = MAD_TO_SD * float(np.median(np.abs(away))) or math.inf
    return np.column_stack((of_terms, away / scatter))


def _pull(whole: Tally, names: Sequence[str], pulls: FloatArray, k: int, limit: float) -> Pull:
    j = int(np.argmax(np.abs(pulls[k])))
    at_noise = j == len(names)
    return Pull(
        unit=whole.names[k],
        term=NOISE[0] if at_noise else names[j],
        value=float(whole.noise[k, 0] if at_noise else whole.estimate[k, j]),
        pull=float(pulls[k, j]),
        outlier=bool(abs(pulls[k, j]) > limit),
    )
