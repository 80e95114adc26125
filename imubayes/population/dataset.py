"""The records of a fleet as a Parquet dataset: a row for each unit and term, a file for each part.

A file appears under its name when it is complete, and carries a mark for each of its units: the fingerprint
of what the unit's records were made from (`keeping`).
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from imubayes.population.records import Record
from imubayes.rig.recordings import write_whole

if TYPE_CHECKING:
    import pyarrow as pa

NOTE = b"imubayes"
"""Key of the marks of a file's units, in the schema's metadata."""

SCALARS = ("mean", "sd", "full_mean", "full_sd", "inclusion", "truth")
"""Columns with one number for each unit and term."""

Marks = tuple[tuple[int, str], ...]
"""Number and fingerprint of each unit of a file."""


def write_part(file: Path, records: Sequence[Record], names: Sequence[str], marks: Marks) -> None:
    """Write the file of a part.

    Parameters
    ----------
    file : whose folder is there.
    records : of the part.
    names : of the library's terms.
    marks : of the records.
    """
    from pyarrow import parquet

    table = _table(records, names).replace_schema_metadata({NOTE: json.dumps({"units": marks})})

    def write(stream: BinaryIO) -> None:
        parquet.write_table(table, stream)

    write_whole(file, write)


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
    """Read the records of a file; none where it is damaged."""
    import pyarrow as pa
    from pyarrow import parquet

    try:
        return tuple(records_of(parquet.read_table(file)))
    except (OSError, ValueError, pa.ArrowException):
        return ()


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
