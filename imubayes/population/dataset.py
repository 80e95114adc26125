"""The records of a fleet as a Parquet dataset: a row for each unit and term, a file for each part.

What is finished is kept: files of parts grow beside the dataset, and take its place when all is done. A file
appears under its name when it is complete, and carries a mark for each of its units: a fingerprint of what
the unit's record is made from, not its place in the fleet. A study that is resumed takes every record whose
fingerprint is that of one of its units, from whatever file holds it.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from imubayes.errors import InputError
from imubayes.population import FleetStudy, Record, Unit, run_file
from imubayes.rig.recordings import write_whole

if TYPE_CHECKING:
    import pyarrow as pa

UNITS = "units"
"""Folder of the dataset, in that of the results."""

GROWING = "units.part"
"""Folder of the parts that are finished while others are not."""

NOTE = b"imubayes"
"""Key of the marks of a file's units, in the schema's metadata."""

SCALARS = ("mean", "sd", "full_mean", "full_sd", "inclusion", "truth")
"""Columns with one number for each unit and term."""

Marks = tuple[tuple[int, str], ...]
"""Number and fingerprint of each unit of a file."""


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
        state = file.stat()
    except OSError:
        return "missing"
    return f"{state.st_size} {state.st_mtime_ns}"


def make_room(folder: Path, study: FleetStudy) -> None:
    """Make the folder of the growing parts in that of the results; nothing that is there is touched.

    It is an `InputError` if a unit of the study, or a Parquet file that no study of a fleet wrote, is where
    the results would be; if the folder cannot be written.
    """
    for here in (folder / UNITS, folder / GROWING):
        target = here.resolve()
        for unit in study.units:
            if unit.place and (unit.place.parent.resolve() / unit.place.name).is_relative_to(target):
                raise InputError(
                    f"{unit.place}: is a unit of this study, and {here} is where the results would be:"
                    " choose another --out"
                )
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


def _own(file: Path) -> bool:
    """Whether a study of a fleet wrote a file."""
    return re.fullmatch(r"part-\d{5,}\.parquet", file.name) is not None and marks_of(file) is not None


def _own_files(folder: Path) -> Iterator[Path]:
    for name in (GROWING, UNITS):
        yield from (file for file in sorted((folder / name).glob("part-*.parquet")) if _own(file))


def kept_records(folder: Path, prints: Sequence[str]) -> dict[int, Record]:
    """Records that are finished already, by the number that their unit, of this fingerprint, has now."""
    wanted = {mark: number for number, mark in enumerate(prints)}
    records = dict[int, Record]()
    for file in _own_files(folder):
        prints_there = [mark for _, mark in marks_of(file) or ()]
        if wanted.keys() & prints_there:
            # a damaged file gives no record
            for record, mark in zip(read_part(file), prints_there, strict=False):
                if mark in wanted:
                    records[wanted[mark]] = replace(record, number=wanted[mark])
    return records


def keep(
    folder: Path,
    index: int,
    records: Sequence[Record],
    names: Sequence[str],
    prints: Sequence[str],
    *,
    changed: bool,
) -> Marks:
    """Write the file of the part of this index, where it has records; give its marks.

    `prints` are the fingerprints of the fleet's units. Unless a record is new (`changed`), a file that has
    them already stays.
    """
    marks = tuple((record.number, prints[record.number]) for record in records)
    grown = part_file(folder, index, GROWING)
    there = () if changed else (marks_of(grown), marks_of(part_file(folder, index)))
    if marks and marks not in there:
        write_part(grown, records, names, marks)
    return marks


def publish(folder: Path, finished: Mapping[int, Marks]) -> None:
    """Put the files of all parts, with the marks that `keep` gave, in the place of the earlier dataset."""
    (folder / UNITS).mkdir(exist_ok=True)
    dataset = {part_file(folder, index): marks for index, marks in finished.items() if marks}
    for file, marks in dataset.items():
        grown = folder / GROWING / file.name
        if marks_of(grown) == marks:
            grown.replace(file)
    # a process that was killed as it wrote leaves an unfinished file under a hidden name
    torn = (folder / GROWING).glob(".part-*.parquet.part")
    for file in [*torn, *(path for path in _own_files(folder) if path not in dataset)]:
        file.unlink()
    leave(folder)


def leave(folder: Path) -> None:
    """Remove the folder of the growing parts if nothing is in it."""
    with suppress(OSError):
        (folder / GROWING).rmdir()


def write_part(file: Path, records: Sequence[Record], names: Sequence[str], marks: Marks) -> None:
    """Write the records of a part, of terms of these names, with their marks."""
    from pyarrow import parquet

    table = _table(records, names).replace_schema_metadata({NOTE: json.dumps({"units": marks})})
    write_whole(file, lambda stream: parquet.write_table(table, stream))


def _table(records: Sequence[Record], names: Sequence[str]) -> pa.Table:
    """Rows of some units; ``factor`` holds row j of R from its diagonal on, ``rho`` its last element."""
    import pyarrow as pa

    number, text, count = pa.float64(), pa.string(), pa.int64()

    def by_term(values: list[Any], sort: pa.DataType) -> pa.Array:
        return pa.array(values, type=sort, from_pandas=True)

    def by_unit(values: list[Any], sort: pa.DataType) -> pa.Array:
        return by_term([value for value in values for _ in names], sort)

    columns = {
        "unit": by_unit([record.name for record in records], text),
        "number": by_unit([record.number for record in records], count),
        "term": by_term([name for _ in records for name in names], text),
        **{
            key: by_term([x for record in records for x in getattr(record, key).tolist()], number)
            for key in SCALARS
        },
        "verdict": by_term([verdict for record in records for verdict in record.verdicts], text),
        **{key: by_unit([record.noise[k] for record in records], number) for k, key in enumerate("NBK")},
        "samples": by_unit([record.samples for record in records], count),
        "factor": by_term(
            [record.R[j, j:].tolist() for record in records for j in range(len(names))], pa.list_(number)
        ),
        "rho": by_unit([float(record.R[-1, -1]) for record in records], number),
        "scale": by_unit([record.scale for record in records], number),
    }
    return pa.table(columns)


def marks_of(file: Path) -> Marks | None:
    """Marks of a file's units; None where it is not there, is damaged, or is none of `write_part`."""
    import pyarrow as pa
    from pyarrow import parquet

    try:
        note = json.loads((parquet.read_schema(file).metadata or {})[NOTE])
        return tuple((number, mark) for number, mark in note.get("units", ()))
    except (OSError, KeyError, ValueError, pa.ArrowException):
        return None


def read_part(file: Path) -> tuple[Record, ...]:
    """Read the records of a file as they were, to the last bit; none where it is damaged."""
    import pyarrow as pa
    from pyarrow import parquet

    try:
        table = parquet.read_table(file)
        columns = {name: table.column(name).to_pylist() for name in table.column_names}
        return tuple(_records_of(columns))
    except (OSError, KeyError, ValueError, pa.ArrowException):
        return ()


def _records_of(columns: Mapping[str, list[Any]]) -> Iterator[Record]:
    numbers = columns["number"]
    starts = [k for k, number in enumerate(numbers) if k == 0 or number != numbers[k - 1]]
    for start, stop in zip(starts, [*starts[1:], len(numbers)], strict=True):
        rows = {name: values[start:stop] for name, values in columns.items()}
        arrays: dict[str, Any] = {key: np.array(rows[key], dtype=np.float64) for key in SCALARS}
        R = np.zeros((len(rows["factor"]) + 1, len(rows["factor"]) + 1))
        for j, row in enumerate(rows["factor"]):
            R[j, j:] = row
        R[-1, -1] = rows["rho"][0]
        yield Record(
            number=rows["number"][0],
            name=rows["unit"][0],
            verdicts=tuple(rows["verdict"]),
            noise=(rows["N"][0], rows["B"][0], rows["K"][0]),
            samples=rows["samples"][0],
            R=R,
            scale=rows["scale"][0],
            **arrays,
        )
