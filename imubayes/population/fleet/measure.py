"""The whole study of a fleet: every unit, in parts that are kept as they are done, and what all say."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from imubayes.errors import InputError
from imubayes.population.fleet.dataset import Marks
from imubayes.population.fleet.engines import Engine
from imubayes.population.fleet.keeping import fingerprint, keep, kept_records, leave, make_room, publish
from imubayes.population.fleet.plan import FleetStudy, Part, parts_of
from imubayes.population.fleet.population import FleetAnswer, answer
from imubayes.population.fleet.reduction import Tally, reduced, tally
from imubayes.population.fleet.units import Broken, PartFound, Record, part_found
from imubayes.population.processes import Lost, Progress, pace
from imubayes.sensors.lots import Lot, draw_lot

ENDED = (
    "its analysis ended the process that did it, each time: is its file too large for the memory of a worker?"
)


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
    study : as `config.read` gives it.
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

    def leaves() -> Iterator[tuple[int, Tally]]:
        done = 0
        for new in _missing(replace(study, units=()), parts, kept, engine):
            whole, count = _with_kept(new, parts[new.index], kept), len(new.records) + len(new.broken)
            finished[new.index] = keep(
                folder, whole, study.spec.library.names, prints, changed=bool(new.records)
            )
            done += count
            if count:
                tell(done)
            yield new.index, tally(whole, p)

    try:
        whole = reduced(leaves(), len(parts))
        _check_any(whole, study)
    finally:
        leave(folder)
    publish(folder, finished)
    found = answer(whole, study, lot)
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
