"""A fleet as its study says: one campaign, its units, and the parts that they are worked off in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from imubayes.campaign.study import SensorSpec
from imubayes.sensors.lots import Lot
from imubayes.sensors.sensor_class import SensorClass


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
