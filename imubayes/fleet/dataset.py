"""The records of a fleet as a Parquet dataset: a row for each unit and term, a file for each part.

A file appears under its name when it is complete, and carries the fingerprint of what it was made from and
the part's broken units: a study that is resumed takes the files whose fingerprint is that of its own parts.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from imubayes.errors import InputError
from imubayes.fleet.plan import FleetStudy, Part
from imubayes.fleet.units import Broken, PartFound, Record, run_file
from imubayes.rig.record import write_whole

if TYPE_CHECKING:
    import pyarrow as pa

UNITS = "units"
"""Folder of the dataset, in that of the results."""

NOTE = b"imubayes"
"""Key of a file's fingerprint and broken units, in the schema's metadata."""

SCALARS = ("mean", "sd", "full_mean", "full_sd", "inclusion", "truth")
"""Columns with one number for each unit and term."""


def part_file(folder: Path, index: int) -> Path:
    """Path of the file of a part."""
    return folder / UNITS / f"part-{index:05}.parquet"


def fingerprint(study: FleetStudy, part: Part) -> str:
    """Fingerprint of what the records of a part are made from.

    The study's text (its seed is there) and class, the version of imubayes, and each unit's name; of recorded
    units also size and time of their files, so that a file which is mended, or comes to be there, is read.
    """
    from imubayes import __version__

    made_from = [__version__, study.text, repr(study.sensor_class)]
    for unit in part.units:
        made_from.append(unit.name)
        if unit.place is not None:
            made_from += [_state(run_file(run, unit)) for run in study.spec.runs]
    return hashlib.sha256("\n".join(made_from).encode()).hexdigest()


def _state(file: Path) -> str:
    try:
        found = file.stat()
    except OSError:
        return "missing"
    return f"{found.st_size} {found.st_mtime_ns}"


def write_part(folder: Path, found: PartFound, names: Sequence[str], mark: str) -> None:
    """Write the file of a part.

    Parameters
    ----------
    folder : of the results, whose dataset is there (`clear`).
    found : of the part.
    names : of the library's terms.
    mark : fingerprint of the part.
    """
    from pyarrow import parquet

    path = part_file(folder, found.index)
    note = {"fingerprint": mark, "broken": [asdict(one) for one in found.broken]}
    table = _table(found.records, names).replace_schema_metadata({NOTE: json.dumps(note)})

    def write(stream: BinaryIO) -> None:
        parquet.write_table(table, stream)

    write_whole(path, write)


def _table(records: Sequence[Record], names: Sequence[str]) -> pa.Table:
    """Rows of some units; ``factor`` holds row j of R from its diagonal on, ``rho`` its last element."""
    import pyarrow as pa

    def column(values: list[Any], sort: pa.DataType) -> pa.Array:
        return pa.array(values, type=sort, from_pandas=True)

    def by_unit(value: Any) -> list[Any]:
        return [value(record) for record in records for _ in names]

    number, text = pa.float64(), pa.string()
    columns = {
        "unit": column(by_unit(lambda one: one.name), text),
        "number": column(by_unit(lambda one: one.number), pa.int64()),
        "term": column([name for _ in records for name in names], text),
        **{
            key: column([x for one in records for x in getattr(one, key).tolist()], number) for key in SCALARS
        },
        "verdict": column([verdict for one in records for verdict in one.verdicts], text),
        **{key: column(by_unit(partial(_noise, k)), number) for k, key in enumerate("NBK")},
        "samples": column(by_unit(lambda one: one.samples), pa.int64()),
        "factor": column(
            [one.R[j, j:].tolist() for one in records for j in range(len(names))], pa.list_(number)
        ),
        "rho": column(by_unit(lambda one: float(one.R[-1, -1])), number),
    }
    return pa.table(columns)


def _noise(k: int, record: Record) -> float:
    return record.noise[k]


def read_part(folder: Path, part: Part, mark: str) -> PartFound | None:
    """Read the records of a part that is finished; None where it is not, or was made from something else.

    Parameters
    ----------
    folder : of the results.
    part : of the fleet.
    mark : fingerprint that the file must have.
    """
    import pyarrow as pa
    from pyarrow import parquet

    path = part_file(folder, part.index)
    try:
        table = parquet.read_table(path)
        note = json.loads((table.schema.metadata or {})[NOTE])
    except (OSError, KeyError, ValueError, pa.ArrowException):
        return None
    if note["fingerprint"] != mark:
        return None
    broken = tuple(Broken(**one) for one in note["broken"])
    return PartFound(part.index, tuple(records_of(table)), broken)


def records_of(table: pa.Table) -> Iterator[Record]:
    """Take a table of the dataset apart into the records that it was made of, to the last bit."""
    columns = {name: table.column(name).to_pylist() for name in table.column_names}
    numbers = columns["number"]
    starts = [k for k, number in enumerate(numbers) if k == 0 or number != numbers[k - 1]]
    for start, stop in zip(starts, [*starts[1:], len(numbers)], strict=True):
        yield _record({name: values[start:stop] for name, values in columns.items()})


def _record(rows: dict[str, list[Any]]) -> Record:
    values = {key: np.array(rows[key], dtype=np.float64) for key in SCALARS}
    return Record(
        number=rows["number"][0],
        name=rows["unit"][0],
        verdicts=tuple(rows["verdict"]),
        noise=(rows["N"][0], rows["B"][0], rows["K"][0]),
        samples=rows["samples"][0],
        R=_upper(rows["factor"], rows["rho"][0]),
        **values,
    )


def _upper(rows: Sequence[Sequence[float]], rho: float) -> np.ndarray:
    R = np.zeros((len(rows) + 1, len(rows) + 1))
    for j, row in enumerate(rows):
        R[j, j:] = row
    R[-1, -1] = rho
    return R


def clear(folder: Path, keep: Sequence[int]) -> None:
    """Make room for the dataset: remove the files of earlier studies, but for some parts.

    Raises
    ------
    InputError : if the folder cannot be written.
    """
    try:
        (folder / UNITS).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror}): choose another --out") from None
    kept = {part_file(folder, index) for index in keep}
    for file in sorted((folder / UNITS).glob("*.parquet")):
        if file not in kept:
            file.unlink()
