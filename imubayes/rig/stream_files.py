"""Files as consecutive tables of a bounded number of rows: Parquet, delimited text, HDF5."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from imubayes.errors import DataError
from imubayes.rig.formats import Table, datasets_of, from_arrow, lies_down, named
from imubayes.rig.texts import Delimited, delimited, lines_of, parse_error, said

if TYPE_CHECKING:
    import pyarrow as pa

ROWS = 32_768
"""Rows of a table: with thirty columns they take 8 MB."""

BUFFER = 1 << 20
"""Bytes that Parquet reads of a column at a time: a row group may be larger than memory."""

TEXT_BLOCK = 1 << 20
"""Bytes of text at a time, of which the reader holds some thirty: 10,000 lines are usual."""

SAMPLED = 1 << 16
"""Bytes of a text from which its rows are estimated."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """What is read of a file.

    Attributes
    ----------
    columns : names as in the file, without blanks around them; empty for all.
    clock : those that make up the time, whose whole numbers stay whole, so that no step of a large one is
        rounded.
    """

    columns: Collection[str] = ()
    clock: Collection[str] = ()

    def __contains__(self, name: str) -> bool:
        return not self.columns or name.strip() in self.columns


def rows_in(path: Path) -> int:
    """About how many rows a file has; 0 for a format that is read as a whole, or a damaged file."""
    form = _FORMATS.get(path.suffix.lower())
    try:
        return form.rows(path) if form else 0
    except Exception:  # noqa: BLE001  parsers raise almost anything: the reader of whole files says what is wrong
        return 0


def tables_of(path: Path, shown: str, wanted: Wanted) -> Iterator[Table]:
    """Read what is wanted of a file that `rows_in` counts as consecutive tables; `shown` is for messages.

    Raises
    ------
    DataError : while the tables come, where the file cannot be read any further.
    """
    return _FORMATS[path.suffix.lower()].tables(path, shown, wanted)


def _parquet_rows(path: Path) -> int:
    import pyarrow.parquet as pq

    return pq.read_metadata(path).num_rows


def _parquet(path: Path, shown: str, wanted: Wanted) -> Iterator[Table]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(path, buffer_size=BUFFER, pre_buffer=False) as file:
            names = [name for name in file.schema_arrow.names if name in wanted]
            yield from _counted(file.iter_batches(ROWS, columns=names), shown)
    except (pa.ArrowException, OSError) as error:
        raise DataError(f"{shown}: is not a Parquet file that can be read: {said(error)}") from None


def _counted(batches: Any, shown: str, text: Path | None = None, *, header: bool = True) -> Iterator[Table]:
    """Tables of Arrow's batches, each with the number of its first row."""
    import pyarrow as pa

    first = 0
    for batch in batches:
        if batch.num_rows:
            yield from_arrow(pa.Table.from_batches([batch]), shown, text, header=header, first=first)
            first += batch.num_rows


def _text_rows(path: Path) -> int:
    if delimited(path, "").separator == " ":
        return 0
    with path.open("rb") as stream:
        head = stream.read(SAMPLED)
    return round(path.stat().st_size * head.count(b"\n") / max(len(head), 1))


def _text(path: Path, shown: str, wanted: Wanted) -> Iterator[Table]:
    import pyarrow as pa

    layout = delimited(path, shown)
    first = 0
    try:
        for table in _counted(_batches(path, layout, wanted), shown, path, header=not layout.names):
            first = table.first + len(table.arrays[0])
            yield table
    except pa.ArrowInvalid as error:
        raise _strange(path, shown, layout, wanted, first) or parse_error(
            path, shown, layout, error
        ) from None


def _batches(path: Path, layout: Delimited, wanted: Wanted) -> Iterator[pa.RecordBatch]:
    """Batches of a delimited text; every column but the clock as floating point, whatever it begins with."""
    import pyarrow as pa
    from pyarrow import csv

    def opened(names: list[str], types: dict[str, pa.DataType]) -> csv.CSVStreamingReader:
        return csv.open_csv(
            path,
            read_options=layout.read_options(block_size=TEXT_BLOCK),
            parse_options=csv.ParseOptions(delimiter=layout.separator),
            convert_options=csv.ConvertOptions(
                decimal_point=layout.decimal, null_values=[""], include_columns=names, column_types=types
            ),
        )

    with opened([], {}) as peek:
        schema = peek.schema
    names = [name for name in schema.names if name in wanted]
    types = {
        name: pa.float64()
        for name in names
        if wanted.columns
        and not (name.strip() in wanted.clock and not pa.types.is_floating(schema.field(name).type))
    }
    with opened(names, types) as reader:
        yield from reader


def _strange(path: Path, shown: str, layout: Delimited, wanted: Wanted, first: int) -> DataError | None:
    """Name the first entry from row `first` on that is no number; None if all are."""
    lines = lines_of(path)
    header = layout.names or next(lines)[1].split(layout.separator)
    for row, (number, line) in enumerate(lines):
        fields = line.split(layout.separator) if row >= first else []
        for k, field in enumerate(fields):
            name = header[min(k, len(header) - 1)].strip().strip('"')
            asked = name in wanted and name not in wanted.clock
            if asked and not _is_number(field.replace(layout.decimal, ".")):
                return DataError(
                    f"{shown}, line {number}: column '{name}' holds {field.strip()[:40]!r} "
                    "where a number was expected: correct the entry, or name another column in the study"
                )
    return None


def _is_number(field: str) -> bool:
    """Tell whether a field is a number, or missing: what is missing is found with the values."""
    try:
        float(field or "nan")
    except ValueError:
        return False
    return True


def _hdf5_rows(path: Path) -> int:
    import h5py

    with h5py.File(path, "r") as file:
        return max((max(node.shape) for node in datasets_of(file).values()), default=0)


def _hdf5(path: Path, shown: str, wanted: Wanted) -> Iterator[Table]:
    import h5py

    try:
        with h5py.File(path, "r") as file:
            nodes = {name: node for name, node in named(datasets_of(file)).items() if name in wanted}
            n = max(max(node.shape) for node in nodes.values())
            for first in range(0, n, ROWS):
                arrays = tuple(_slice(node, first, first + ROWS) for node in nodes.values())
                yield Table(shown, tuple(nodes), arrays, ordered=False, first=first)
    except OSError as error:
        raise DataError(f"{shown}: is not an HDF5 file that can be read: {said(error)}") from None


def _slice(node: Any, start: int, stop: int) -> NDArray[np.generic]:
    """Rows of a dataset; a single row or column counts as a vector."""
    if len(node.shape) == 2 and node.shape[0] == 1:
        return node[0, start:stop]
    if lies_down(node.shape):
        return node[:, start:stop].T
    values = node[start:stop]
    return values.reshape(-1) if values.ndim == 2 and node.shape[1] == 1 else values


class _Form(NamedTuple):
    """How a format tells its rows, and gives them."""

    rows: Callable[[Path], int]
    tables: Callable[[Path, str, Wanted], Iterator[Table]]


_FORMATS = {
    ".parquet": _Form(_parquet_rows, _parquet),
    ".csv": _Form(_text_rows, _text),
    ".tsv": _Form(_text_rows, _text),
    ".h5": _Form(_hdf5_rows, _hdf5),
    ".hdf5": _Form(_hdf5_rows, _hdf5),
}
"""Suffix -> how it is read in parts."""
