"""The whole study of a fleet: every unit, in parts that are kept as they are done, and what all say."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from imubayes.errors import InputError
from imubayes.fleet.dataset import clear, fingerprint, read_part, write_part
from imubayes.fleet.engines import Engine
from imubayes.fleet.plan import FleetStudy, Part, parts_of
from imubayes.fleet.population import FleetAnswer, answer
from imubayes.fleet.reduction import Tally, reduced, tally
from imubayes.fleet.units import Broken, PartFound, part_found
from imubayes.processes import Lost, Progress, pace
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
    study : as `config.read_fleet` gives it.
    folder : of the results; its dataset ``units`` gets a file for each part as soon as it is done.
    engine : who does the work.
    resume : take the parts that are in the dataset already, if they were made from the same study and files.
    progress : is told how many units are done.

    Raises
    ------
    InputError : if no unit could be read.
    """
    start = time.perf_counter()
    lot = lot_of(study)
    parts = parts_of(study, lot)
    marks = [fingerprint(study, part) for part in parts]
    kept = _kept(folder, parts, marks) if resume else {}
    clear(folder, list(kept))
    slim, todo = replace(study, units=()), [part for part in parts if part.index not in kept]
    resumed = sum(len(parts[index].units) for index in kept)
    tell = pace(len(study.units) - resumed, "units", progress)

    def leaves() -> Iterator[tuple[int, Tally]]:
        done, p, names = 0, len(study.spec.library.terms), study.spec.library.names
        yield from ((index, tally(found, p)) for index, found in kept.items())
        for found in _ran(slim, todo, engine):
            write_part(folder, found, names, marks[found.index])
            done += len(found.records) + len(found.broken)
            tell(done)
            yield found.index, tally(found, p)

    whole = reduced(leaves(), len(parts))
    _check_any(whole, study)
    return FleetResult(study, answer(whole, study, lot), engine.name, resumed, time.perf_counter() - start)


def lot_of(study: FleetStudy) -> Lot | None:
    """Draw the units of a simulated fleet; None where they are recorded."""
    if not study.simulated:
        return None
    rng = np.random.default_rng([study.seed, 0])
    return draw_lot(study.sensor_class, study.spec.library, len(study.units), rng)


def _kept(folder: Path, parts: Sequence[Part], marks: Sequence[str]) -> dict[int, PartFound]:
    """Parts that are finished already."""
    found = {part.index: read_part(folder, part, mark) for part, mark in zip(parts, marks, strict=True)}
    return {index: one for index, one in found.items() if one is not None}


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
    jobs = [(study, part.single(k)) for k in range(len(part.units))]
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
