"""A fleet as its study says: one campaign, its units, and the parts that they are worked off in.

A unit gives the same record to the last digit wherever it is analysed: its random numbers come from the
study's seed and its own number (recorded: its name) alone, and linear algebra is left to one thread.
"""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from imubayes.campaign.preparation import runs_of
from imubayes.campaign.study import SensorSpec
from imubayes.errors import ImubayesError
from imubayes.population.records import Broken, Record, record_of, simulate_unit
from imubayes.rig.inputs import Run
from imubayes.rig.recordings import RunSpec
from imubayes.sensors.lots import Lot
from imubayes.sensors.sensor_class import SensorClass

_ONE_AT_A_TIME = threading.Lock()
"""Threads of a worker take turns: a limit on the threads of linear algebra holds for the whole process."""


@dataclass(frozen=True, slots=True)
class Unit:
    """One unit of a fleet.

    Attributes
    ----------
    number : in the fleet, from 0; the order of the names for recorded units.
    name : of its folder or file; the class and the number of a simulated one.
    place : folder of its files, or its only file; None for a simulated unit.
    """

    number: int
    name: str
    place: Path | None = None


@dataclass(frozen=True, slots=True, eq=False)
class FleetStudy:
    """A study of a fleet.

    Attributes
    ----------
    title, seed : of the study.
    spec : of every unit: class, library, campaign, errors of the bench.
    sensor_class : of every unit; it says how far units can differ.
    units : of the fleet.
    part : units that are worked off, and kept, together.
    processes : of this machine that share the work where no scheduler does.
    path, text : of the file.
    """

    title: str
    seed: int
    spec: SensorSpec
    sensor_class: SensorClass
    units: tuple[Unit, ...]
    part: int
    processes: int
    path: Path
    text: str

    @property
    def simulated(self) -> bool:
        """Whether the units are drawn at random."""
        return self.units[0].place is None


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """Units that one process works off, one after the other.

    Attributes
    ----------
    index : among the parts of the fleet.
    units : of the part.
    lot : simulated units of the part, in their order; None for recorded ones.
    """

    index: int
    units: tuple[Unit, ...]
    lot: Lot | None = None

    def only(self, places: Sequence[int]) -> Part:
        """Give the part with some of its units, by their places in it."""
        lot = None if self.lot is None else lot_of_some(self.lot, places)
        return replace(self, units=tuple(self.units[k] for k in places), lot=lot)


@dataclass(frozen=True, slots=True, eq=False)
class PartFound:
    """Records of a part's units, and the units that have none, each in the order of the units."""

    index: int
    records: tuple[Record, ...]
    broken: tuple[Broken, ...]


def parts_of(study: FleetStudy, lot: Lot | None) -> tuple[Part, ...]:
    """Divide a fleet into parts by the numbers of its units, whoever works them off.

    Parameters
    ----------
    study : of the fleet.
    lot : all its units where they are simulated, else None.
    """
    whole, n = Part(0, study.units, lot), len(study.units)
    return tuple(
        replace(whole.only(range(first, min(first + study.part, n))), index=index)
        for index, first in enumerate(range(0, n, study.part))
    )


def lot_of_some(lot: Lot, places: Sequence[int]) -> Lot:
    """Some units of a lot, by their places in it."""
    return replace(lot, theta=lot.theta[list(places)], noise=tuple(lot.noise[k] for k in places))


def simulated_units(class_id: str, count: int) -> tuple[Unit, ...]:
    """Units without files, by class and number.

    Examples
    --------
    >>> [unit.name for unit in simulated_units("mems_tactical", 10)][-1]
    'mems_tactical-10'
    """
    digits = len(str(count))
    return tuple(Unit(number, f"{class_id}-{number + 1:0{digits}}") for number in range(count))


def recorded_units(names: Sequence[str], places: Sequence[Path]) -> tuple[Unit, ...]:
    """Units of folders or files, in the order given."""
    return tuple(Unit(k, name, place) for k, (name, place) in enumerate(zip(names, places, strict=True)))


def part_found(study: FleetStudy, part: Part) -> PartFound:
    """Analyse the units of a part.

    Parameters
    ----------
    study : says the campaign; its list of units is not used.
    part : of the fleet.
    """
    from threadpoolctl import threadpool_limits

    with _ONE_AT_A_TIME, threadpool_limits(1):
        found = [_unit_found(study, part.only([k])) for k in range(len(part.units))]
    return PartFound(
        part.index,
        tuple(one for one in found if isinstance(one, Record)),
        tuple(one for one in found if isinstance(one, Broken)),
    )


def _unit_found(study: FleetStudy, alone: Part) -> Record | Broken:
    (unit,) = alone.units
    try:
        return unit_record(study, alone)
    except ImubayesError as error:
        return Broken(unit.number, unit.name, str(error))
    except Exception as error:  # noqa: BLE001  # our fault in one unit must not cost the other thousand
        fault = f"{type(error).__name__}: {error}"
        return Broken(unit.number, unit.name, f"{fault}; this is a fault of imubayes, please report it")


def unit_record(study: FleetStudy, alone: Part) -> Record:
    """Test and analyse one unit.

    Parameters
    ----------
    study : says the campaign.
    alone : part of this unit only.

    Raises
    ------
    InputError : if a file of the unit cannot be used.
    ConvergenceError : if the errors of the bench do not settle.
    """
    (unit,) = alone.units
    spec, seed = replace(study.spec, id=unit.name), (study.seed, *_stream(unit))
    if alone.lot is None:
        spec = replace(spec, runs=tuple(_recorded(run, unit) for run in spec.runs))
        runs = tuple(run for run in runs_of(spec, study.seed, 0) if isinstance(run, Run))
        truth = np.full(len(spec.library.terms), np.nan)
    else:
        spec, truth = replace(spec, truth=alone.lot.truth(0)), alone.lot.theta[0]
        runs = simulate_unit(spec, alone.lot, 0, np.random.default_rng([*seed, 0]))
    return record_of(unit.number, spec, runs, truth, [*seed, 1])


def _stream(unit: Unit) -> tuple[int, int]:
    """Random stream of a unit: a recorded one's hangs on its name, as others may be added before it."""
    if unit.place is None:
        return 1, unit.number
    return 2, int.from_bytes(hashlib.sha256(unit.name.encode()).digest()[:8])


def _recorded(run: RunSpec, unit: Unit) -> RunSpec:
    """Run of a unit: in its folder, or in its only file."""
    file = run_file(run, unit)
    return replace(run, file=file, shown=str(file))


def run_file(run: RunSpec, unit: Unit) -> Path:
    """Path of a run of a recorded unit.

    Examples
    --------
    >>> run_file(RunSpec("tumble", "tumble", shown="t.csv"), Unit(0, "A1", Path("data/A1"))).as_posix()
    'data/A1/t.csv'
    """
    place = unit.place or Path(unit.name)
    return place / run.shown if run.shown else place
