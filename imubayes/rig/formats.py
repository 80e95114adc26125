"""Files that hold runs: one function and one line of `FORMATS` for each format.

A reader gives the file's columns as they are, as one table or in consecutive ones of bounded size; what they
mean is said elsewhere. Nothing here executes what a file contains: pickled objects are refused.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from imubayes.errors import DataError
from imubayes.rig.texts import STAMP, Wanted, line_of, said, text_rows, text_tables

if TYPE_CHECKING:
    import pyarrow as pa

Array = NDArray[np.generic]

_INDEXED = re.compile(r"(.+)\[:,\s*(\d+(?:\s*,\s*\d+)*)\]$")
_BRACKETED = re.compile(r"^(.*?)\s*(?:\[([^\]:]*)\]|\(([^)]*)\))\s*$")


def bare(name: str) -> str:
    """Name of a column without its unit.

    Examples
    --------
    >>> bare("f_i [g]"), bare("raw[:,0]")
    ('f_i', 'raw[:,0]')
    """
    match = _BRACKETED.match(name)
    return (match[1] if match else name).strip()


def bracketed(name: str) -> str | None:
    """Read the unit in a column's name, in brackets or parentheses; None without one.

    Examples
    --------
    >>> bracketed("f_i [g]"), bracketed("Time (s)"), bracketed("f_i")
    ('g', 's', None)
    """
    match = _BRACKETED.match(name)
    return (match[2] or match[3] or "").strip() or None if match else None


@dataclass(frozen=True, slots=True, eq=False)
class FileTable:
    """Columns of a file.

    Attributes
    ----------
    file : as the study gives it, for messages.
    columns : names as in the file, unit included; numbers counted from 0 where the file has none.
    arrays : one for each name, (n,) or with more axes, in the file's own type; text is an array of str.
    ordered : whether columns can be addressed by number.
    text : the path of a text file, to name lines; None for a binary file.
    first : row of the file, counted from 0, that the arrays begin with.
    """

    file: str
    columns: tuple[str, ...]
    arrays: tuple[Array, ...]
    ordered: bool
    text: Path | None = None
    first: int = 0

    def rows(self, which: slice) -> FileTable:
        """Consecutive ones of its rows."""
        first = self.first + (which.start or 0)
        return replace(self, arrays=tuple(values[which] for values in self.arrays), first=first)

    def place(self, row: int) -> str:
        """Name the place of a row (of the arrays, counted from 0) as a person finds it."""
        if self.text is None:
            return f"row {self.first + row} counted from 0"
        return f"line {line_of(self.text, self.first + row)}"

    def locate(self, wanted: str | int, channel: str) -> tuple[str, Array]:
        """Find a column by name, by name without unit, by number, or by index into a matrix.

        Wanted is ``f_i [g]``, ``f_i``, ``3`` or ``raw[:,0,3]``, for a channel, which messages name. Told are
        the name in the file and numbers (n,); of a clock ``t`` with time stamps the time in ns since 1970 or
        midnight, ``timedelta64[ns]``. It is a `DataError` if the column is not there, is there twice, or does
        not hold numbers.
        """
        index, rest = self._index(wanted, channel)
        name = self.columns[index] if not rest else str(wanted)
        values = self.arrays[index]
        if rest:
            if len(rest) + 1 != values.ndim or any(
                k >= n for k, n in zip(rest, values.shape[1:], strict=False)
            ):
                shape = " x ".join(str(n) for n in values.shape)
                raise DataError(
                    f"{self.file}: there is no column '{name}': the array is {shape}, numbered from 0"
                )
            values = values[(slice(None), *rest)]
        kind = values.dtype.kind if channel == "t" and values.ndim == 1 and len(values) else ""
        if kind == "M" or (kind == "O" and STAMP.match(str(values[0]))):
            stamps = self._each(name, values, _instant, "M8[ns]", _STAMP_WANTED)
            return name, stamps - np.datetime64(0, "ns")
        return name, self._numeric(name, values)

    def _index(self, wanted: str | int, channel: str) -> tuple[int, tuple[int, ...]]:
        if isinstance(wanted, int):
            if not self.ordered:
                raise DataError(
                    f"{self.file}: column {wanted} for channel {channel} is given by number, "
                    f"but arrays of this format have no order: expected a name out of {self.names()}"
                )
            if not 0 <= wanted < len(self.columns):
                raise DataError(
                    f"{self.file}: there is no column {wanted} for channel {channel}: "
                    f"the file has {len(self.columns)} columns, numbered from 0"
                )
            return wanted, ()
        hits = [i for i, name in enumerate(self.columns) if name == wanted]
        hits = hits or [i for i, name in enumerate(self.columns) if bare(name) == wanted]
        if len(hits) > 1:
            both = " and ".join(f"'{self.columns[i]}'" for i in hits)
            raise DataError(
                f"{self.file}: two columns for channel {channel}, {both}: say in the study which one it is"
            )
        if hits:
            return hits[0], ()
        match = _INDEXED.match(wanted)
        if match and match[1] in self.columns:
            return self.columns.index(match[1]), tuple(int(part) for part in match[2].split(","))
        raise DataError(
            f"{self.file}: there is no column '{wanted}' for channel {channel}: "
            f"the file has {self.names()}; rename it, or say in the study which column it is"
        )

    def names(self) -> str:
        """List the columns, of a matrix with its shape."""
        shown = [
            f"{name}[:,{','.join(f'0..{n - 1}' for n in array.shape[1:])}]" if array.ndim > 1 else name
            for name, array in zip(self.columns, self.arrays, strict=True)
        ]
        return ", ".join(shown[:24]) + (", ..." if len(shown) > 24 else "")

    def _numeric(self, name: str, values: Array) -> Array:
        if values.ndim != 1:
            shape = ",".join(["0"] * (values.ndim - 1))
            raise DataError(
                f"{self.file}: '{name}' has {values.ndim} axes: "
                f"expected one column of it, such as '{name}[:,{shape}]'"
            )
        if values.dtype.kind == "b":
            raise DataError(f"{self.file}: column '{name}' holds true and false where numbers were expected")
        if values.dtype.kind in "iuf":
            return values
        texts = values.astype(str) if values.dtype.kind == "M" else values
        return self._each(name, texts.tolist(), float, "f8", _NUMBER_WANTED)

    def _each(
        self, name: str, values: Array | list[Any], read: Callable[[Any], Any], dtype: str, wanted: str
    ) -> NDArray[Any]:
        """Read each entry of a column by itself: all of them, or the place of the first that is none."""
        found = np.empty(len(values), dtype)
        for row, value in enumerate(values):
            try:
                found[row] = read(value)
            except (TypeError, ValueError):
                raise DataError(
                    f"{self.file}, {self.place(row)}: column '{name}' holds {str(value)[:40]!r} where"
                    f" a {wanted}"
                ) from None
        return found


_STAMP_WANTED = "time stamp was expected, such as 2026-01-31T12:00:00.125: correct the entry"
_NUMBER_WANTED = "number was expected: correct the entry, or name another column in the study"


def _instant(value: object) -> np.datetime64:
    """Date, time of day, or both; a `ValueError` if it is none."""
    text = f"{value}"
    moment = np.datetime64(f"1970-01-01T{text}" if text[2:3] == ":" else text, "ns")
    if np.isnat(moment):
        raise ValueError(text)
    return moment


ROWS = 32_768
"""Rows of a table: with thirty columns they take 8 MB."""

BUFFER = 1 << 20
"""Bytes that Parquet reads of a column at a time: a row group may be larger than memory."""


def rows_in(path: Path) -> int:
    """About how many rows a file has; 0 for a format that is read as a whole, or a damaged file."""
    form = FORMATS.get(path.suffix.lower())
    try:
        return form.rows(path) if form else 0
    except Exception:  # noqa: BLE001  parsers raise almost anything: the reader of whole files says what is wrong
        return 0


def tables_of(path: Path, shown: str, wanted: Wanted | None) -> Iterator[FileTable]:
    """Read what is wanted of a file as consecutive tables; `shown` is for messages.

    Without a word of what is wanted the whole file is one table. It is a `DataError` while the tables come,
    where the file cannot be read any further.
    """
    return FORMATS[path.suffix.lower()].tables(path, shown, wanted)


def read_table(path: Path, shown: str = "") -> FileTable:
    """Read the columns of a file, of a format that its suffix says; `shown` is its name for messages.

    It is a `DataError` if the suffix is not known, or the file is empty, is not of its format, or has no
    rows.
    """
    shown, suffix = shown or str(path), path.suffix.lower()
    if suffix not in FORMATS:
        known = f"expected one of {', '.join(FORMATS)}"
        if suffix in SPREADSHEETS:
            raise DataError(f"{shown}: is a spreadsheet: save its sheet as CSV, and name that file ({known})")
        raise DataError(f"{shown}: format '{path.suffix}' is not known: {known}")
    try:
        if path.stat().st_size == 0:
            raise DataError(f"{shown}: the file is empty: expected a run with named columns")
        return next(tables_of(path, shown, None))
    except OSError as error:
        raise DataError(
            f"{shown}: cannot be read ({error.strerror or said(error)}): check the file"
        ) from None


def _from_arrow(tables: Iterator[pa.Table], shown: str, text: Path | None = None) -> Iterator[FileTable]:
    """Columns of Arrow tables; what is missing becomes NaN among numbers, NaT among time stamps."""
    import pyarrow as pa

    plain = (pa.types.is_integer, pa.types.is_floating, pa.types.is_timestamp, pa.types.is_date)
    first = 0
    for table in tables:
        if not table.num_rows:
            raise DataError(f"{shown}: has a header but no rows: expected at least 2 samples")
        arrays = tuple(
            column.to_numpy()
            if any(known(column.type) for known in plain)
            else np.array(column.to_pylist(), dtype=object)
            for column in table.columns
        )
        names = tuple(str(name).strip() for name in table.column_names)
        yield FileTable(shown, names, arrays, ordered=True, text=text, first=first)
        first += table.num_rows


_MATLAB_BINARY = b"MATLAB"
_HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_MATLAB_73_OFFSET = 512
"""A version 7.3 file is HDF5 behind a block of 512 bytes."""


def _text(path: Path, shown: str, wanted: Wanted | None) -> Iterator[FileTable]:
    return _from_arrow(text_tables(path, shown, wanted), shown, path)


def _parquet(path: Path, shown: str, wanted: Wanted | None) -> Iterator[FileTable]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    with (
        _reading(shown, "a Parquet file"),
        pq.ParquetFile(path, buffer_size=BUFFER, pre_buffer=False) as file,
    ):
        if wanted is None:
            tables = iter([file.read()])
        else:
            names = [name for name in file.schema_arrow.names if name in wanted]
            tables = (pa.Table.from_batches([one]) for one in file.iter_batches(ROWS, columns=names))
        yield from _from_arrow(tables, shown)


def _parquet_rows(path: Path) -> int:
    import pyarrow.parquet as pq

    return pq.read_metadata(path).num_rows


def _hdf5(path: Path, shown: str, wanted: Wanted | None) -> Iterator[FileTable]:
    """Datasets of an HDF5 file: at the root, in one group (by their own names), or by path.

    A unit comes from brackets in the name, or from the attribute ``unit`` or ``units``.
    """
    import h5py

    with _reading(shown, "an HDF5 file"), h5py.File(path, "r") as file:
        found = _named(_datasets_of(file))
        if wanted is None:
            yield _of_arrays(shown, {name: _sliced(node) for name, node in found.items()})
            return
        nodes = {name: node for name, node in found.items() if name in wanted}
        for first in range(0, max(max(node.shape) for node in nodes.values()), ROWS):
            arrays = {name: _sliced(node, first, first + ROWS) for name, node in nodes.items()}
            yield replace(_of_arrays(shown, arrays), first=first)


def _hdf5_rows(path: Path) -> int:
    import h5py

    with h5py.File(path, "r") as file:
        return max((max(node.shape) for node in _datasets_of(file).values()), default=0)


def _of_arrays(shown: str, arrays: Mapping[str, Array]) -> FileTable:
    """Table of arrays by name, which have no order."""
    if not arrays:
        raise DataError(f"{shown}: holds no array of numbers: expected one for each column, or a matrix")
    return FileTable(shown, tuple(arrays), tuple(arrays.values()), ordered=False)


def _matlab(path: Path, shown: str, _: Wanted | None) -> Iterator[FileTable]:
    """Variables of a MATLAB file; fields of structures as ``log.t``. Text is read as columns."""
    with path.open("rb") as stream:
        head = stream.read(_MATLAB_73_OFFSET + len(_HDF5_SIGNATURE))
    if head[_MATLAB_73_OFFSET:] == _HDF5_SIGNATURE:
        import h5py

        with _reading(shown, "an HDF5 file"), h5py.File(path, "r") as file:
            arrays = {name: _sliced(node[...].T) for name, node in _named(_datasets_of(file)).items()}
    elif head.startswith(_MATLAB_BINARY):
        import scipy.io

        with _reading(shown, "a MATLAB file"):
            content = scipy.io.loadmat(path, simplify_cells=True)
        arrays = dict(
            _flat("", {name: value for name, value in content.items() if not name.startswith("__")})
        )
    else:
        yield from _text(path, shown, None)
        return
    yield _of_arrays(shown, arrays)


def _numpy(path: Path, shown: str, _: Wanted | None) -> Iterator[FileTable]:
    """Arrays of a NumPy archive, or that of a ``.npy`` file by the file's name; pickles are never loaded."""
    import zipfile

    if path.suffix.lower() == ".npy":
        with _reading(shown, "a NumPy array"):
            arrays = {path.stem: np.load(path, allow_pickle=False)}
    elif not zipfile.is_zipfile(path):
        raise DataError(
            f"{shown}: is not a NumPy archive: expected a file written by numpy.savez with plain arrays"
        )
    else:
        with (
            _reading(shown, "a NumPy archive"),
            path.open("rb") as stream,
            np.load(stream, allow_pickle=False) as archive,
        ):
            arrays = {name: _plain(archive, name, shown) for name in archive.files}
    yield _of_arrays(shown, dict(_flat("", arrays)))


def _plain(archive: Any, name: str, shown: str) -> Array:
    try:
        return archive[name]
    except ValueError as error:
        if "pickle" not in str(error):
            raise
    raise DataError(
        f"{shown}: '{name}' holds a pickle, which could run code: expected plain arrays of numbers, "
        "save it without objects"
    )


@contextmanager
def _reading(shown: str, wanted: str) -> Iterator[None]:
    """Call the file damaged whatever its parser raises: on a damaged file they raise almost anything."""
    try:
        yield
    except (DataError, PermissionError):
        raise
    except Exception as error:  # noqa: BLE001
        raise DataError(f"{shown}: is not {wanted} that can be read: {said(error)}") from None


def _flat(prefix: str, content: Mapping[str, Any]) -> Iterator[tuple[str, Array]]:
    """Arrays of numbers with at least two entries, by dotted name."""
    for name, value in content.items():
        if isinstance(value, Mapping):
            yield from _flat(f"{prefix}{name}.", value)
        elif isinstance(value, np.ndarray) and value.dtype.kind in "iuf" and value.size > 1:
            yield f"{prefix}{name}", _sliced(value)


CHANNELS_AT_MOST, ROWS_A_CHANNEL = 16, 10
"""An array has channels as its rows where they are few, and it has far more columns."""


def _sliced(node: Any, start: int = 0, stop: int | None = None) -> Array:
    """Rows of an array or dataset; a single row or column is a vector, channels x n are n x channels."""
    few = len(node.shape) == 2 and node.shape[0] <= CHANNELS_AT_MOST
    if few and node.shape[0] == 1:
        return node[0, start:stop]
    if few and node.shape[1] >= ROWS_A_CHANNEL * node.shape[0]:
        return node[:, start:stop].T
    values = node[start:stop]
    return values.reshape(-1) if values.ndim == 2 and node.shape[1] == 1 else values


def _datasets_of(file: Any) -> dict[str, Any]:
    """Datasets of numbers, of two entries at least, by their paths in an open HDF5 file, with their units."""
    import h5py

    found: dict[str, Any] = {}

    def visit(name: str, node: Any) -> None:
        if not isinstance(node, h5py.Dataset) or name.startswith("#") or node.dtype.kind not in "iuf":
            return
        if node.size is not None and node.size > 1:
            unit = node.attrs.get("unit", node.attrs.get("units"))
            found[
                name
                if unit is None or "[" in name
                else f"{name} [{unit.decode() if isinstance(unit, bytes) else unit}]"
            ] = node

    file.visititems(visit)
    return found


def _named(found: dict[str, Any]) -> dict[str, Any]:
    """Call datasets by their own names if all of them are in one group, else by path (``imu.f_i``)."""
    groups = {name.partition(" [")[0].rpartition("/")[0] for name in found}
    if len(groups) == 1:
        cut = len(groups.pop())
        return {name[cut:].lstrip("/"): values for name, values in found.items()}
    parted = {name.partition(" ["): values for name, values in found.items()}
    return {path.replace("/", ".") + start + unit: values for (path, start, unit), values in parted.items()}


class _Form(NamedTuple):
    """How a format gives its rows, and tells how many there are; 0 of one that is read as a whole."""

    tables: Callable[[Path, str, Wanted | None], Iterator[FileTable]]
    rows: Callable[[Path], int] = lambda _: 0


SPREADSHEETS = (".xlsx", ".xls", ".xlsm", ".ods")
"""Files of which a sheet is to be chosen, and cells may be formulas."""

FORMATS: dict[str, _Form] = {
    **dict.fromkeys((".csv", ".tsv", ".txt", ".dat", ".log"), _Form(_text, text_rows)),
    ".parquet": _Form(_parquet, _parquet_rows),
    **dict.fromkeys((".h5", ".hdf5"), _Form(_hdf5, _hdf5_rows)),
    ".mat": _Form(_matlab),
    **dict.fromkeys((".npz", ".npy"), _Form(_numpy)),
}
"""Suffix -> how it is read."""
