"""What is finished is kept: files of parts that grow beside the dataset, and take its place when all is done.

A unit is known by a fingerprint of what its record is made from, not by its place in the fleet: a study that
is resumed takes every record whose fingerprint is that of one of its units, from whatever file holds it.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from imubayes.errors import InputError
from imubayes.population.dataset import Marks, marks_of, read_part, write_part
from imubayes.population.parts import FleetStudy, PartFound, Unit, run_file
from imubayes.population.records import Record

UNITS = "units"
"""Folder of the dataset, in that of the results."""

GROWING = "units.part"
"""Folder of the parts that are finished while others are not."""


def part_file(folder: Path, index: int, within: str = UNITS) -> Path:
    """Path of the file of a part, in the folder of the results."""
    return folder / within / f"part-{index:05}.parquet"


def fingerprint(study: FleetStudy, unit: Unit) -> str:
    """Fingerprint of what the record of a unit is made from.

    The study's text (its seed is there) and class, the version of imubayes, and the unit's name; of a
    recorded unit also size and time of its files, so that a file that is changed is read again.
    """
    from imubayes import __version__

    made_from = [__version__, study.text, repr(study.sensor_class), unit.name]
    if unit.place is not None:
        made_from += [_state(run_file(run, unit)) for run in study.spec.runs]
    return hashlib.sha256("\n".join(made_from).encode()).hexdigest()


def _state(file: Path) -> str:
    try:
        found = file.stat()
    except OSError:
        return "missing"
    return f"{found.st_size} {found.st_mtime_ns}"


def make_room(folder: Path, study: FleetStudy) -> None:
    """Make the folder of the growing parts; nothing that is there is touched.

    Raises
    ------
    InputError : if a unit of the study, or a Parquet file that no study of a fleet wrote, is where the
        results would be; if the folder cannot be written.
    """
    for here in (folder / UNITS, folder / GROWING):
        _check_units(here, study)
        for file in sorted(here.glob("*.parquet")):
            if not _own(file):
                raise InputError(
                    f"{file}: is not whole, or was not written by a study of a fleet, and results would lie "
                    "beside it: move it away, or choose another --out"
                )
    try:
        (folder / GROWING).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror}): choose another --out") from None


def _check_units(here: Path, study: FleetStudy) -> None:
    target = here.resolve()
    for unit in study.units:
        if unit.place and (unit.place.parent.resolve() / unit.place.name).is_relative_to(target):
            raise InputError(
                f"{unit.place}: is a unit of this study, and {here} is where the results would be: choose "
                "another --out"
            )


def _own(file: Path) -> bool:
    """Whether a study of a fleet wrote a file."""
    return re.fullmatch(r"part-\d{5,}\.parquet", file.name) is not None and marks_of(file) is not None


def _own_files(folder: Path) -> Iterator[Path]:
    for name in (GROWING, UNITS):
        yield from (file for file in sorted((folder / name).glob("part-*.parquet")) if _own(file))


def kept_records(folder: Path, prints: Sequence[str]) -> dict[int, Record]:
    """Read the records that are finished already, by the number that their unit has now.

    Parameters
    ----------
    folder : of the results.
    prints : fingerprint of each unit of the fleet.
    """
    wanted = {one: number for number, one in enumerate(prints)}
    found = dict[int, Record]()
    for file in _own_files(folder):
        prints_there = [one for _, one in marks_of(file) or ()]
        if wanted.keys() & prints_there:
            # a damaged file gives no record
            for record, one in zip(read_part(file), prints_there, strict=False):
                if one in wanted:
                    found[wanted[one]] = replace(record, number=wanted[one])
    return found


def keep(
    folder: Path, found: PartFound, names: Sequence[str], prints: Sequence[str], *, changed: bool
) -> Marks:
    """Write the file of a part that is finished; give its marks.

    Parameters
    ----------
    folder : of the results.
    found : of the part; without a record there is no file.
    names : of the library's terms.
    prints : fingerprint of each unit of the fleet.
    changed : whether any of the records is new: else a file that has them already stays.
    """
    marks = tuple((record.number, prints[record.number]) for record in found.records)
    grown = part_file(folder, found.index, GROWING)
    there = () if changed else (marks_of(grown), marks_of(part_file(folder, found.index)))
    if marks and marks not in there:
        write_part(grown, found.records, names, marks)
    return marks


def publish(folder: Path, finished: Mapping[int, Marks]) -> None:
    """Put the files of all parts in the place of the dataset that was there.

    Parameters
    ----------
    folder : of the results.
    finished : marks of every part, as `keep` gives them.
    """
    (folder / UNITS).mkdir(exist_ok=True)
    dataset = {part_file(folder, index): marks for index, marks in finished.items() if marks}
    for file, marks in dataset.items():
        grown = folder / GROWING / file.name
        if marks_of(grown) == marks:
            grown.replace(file)
    # a process that was killed as it wrote leaves an unfinished file under a hidden name
    torn = (folder / GROWING).glob(".part-*.parquet.part")
    for file in [*torn, *(one for one in _own_files(folder) if one not in dataset)]:
        file.unlink()
    leave(folder)


def leave(folder: Path) -> None:
    """Remove the folder of the growing parts if nothing is in it."""
    with suppress(OSError):
        (folder / GROWING).rmdir()
