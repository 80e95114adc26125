"""A fleet as its study says: one campaign, its units, and the parts that they are worked off in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from imubayes.campaign import SensorSpec
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

    def single(self, k: int) -> Part:
        """Give the k-th unit as a part of its own."""
        return Part(
            self.index, self.units[k : k + 1], None if self.lot is None else lot_slice(self.lot, k, 1)
        )


def parts_of(study: FleetStudy, lot: Lot | None) -> tuple[Part, ...]:
    """Divide a fleet into parts by the numbers of its units, whoever works them off.

    Parameters
    ----------
    study : of the fleet.
    lot : all its units where they are simulated, else None.
    """
    return tuple(
        Part(
            index,
            study.units[first : first + study.part],
            None if lot is None else lot_slice(lot, first, study.part),
        )
        for index, first in enumerate(range(0, len(study.units), study.part))
    )


def lot_slice(lot: Lot, first: int, count: int) -> Lot:
    """Units of a lot that follow each other."""
    return replace(lot, theta=lot.theta[first : first + count], noise=tuple(lot.noise[first : first + count]))


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
