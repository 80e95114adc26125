"""Text files that hold columns of numbers."""

from __future__ import annotations

import re
from codecs import getincrementaldecoder
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from imubayes.errors import DataError

if TYPE_CHECKING:
    import pyarrow as pa

Array = NDArray[np.generic]

SEPARATORS = ",;\t"
_COMMENT = ("#", "%")
_SNIFFED = 4096
"""Bytes that tell text from binary."""
_NUMBER = re.compile(r"\s*[-+]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][-+]?\d+)?\s*$")


@dataclass(frozen=True, slots=True, eq=False)
class Text:
    """Columns that have an order.

    Attributes
    ----------
    columns : names as in the file; ``0``, ``1``, ... where the file has no header.
    arrays : (n,) for each column; numbers, or objects where some entry is not a number.
    lines : whether a row is a line of a text file.
    header : whether the first line names the columns.
    """

    columns: tuple[str, ...]
    arrays: tuple[Array, ...]
    lines: bool = True
    header: bool = True


def line_of(path: Path, row: int, *, header: bool) -> int:
    """Line (counted from 1) of a row of numbers (counted from 0); empty lines and comments do not count."""
    wanted = row + (1 if header else 0)
    for count, (number, _) in enumerate(lines_of(path)):
        if count == wanted:
            return number
    return wanted + 1


def read_delimited(path: Path, shown: str) -> Text:
    """Read a text whose columns are separated by comma, semicolon or tab.

    The first line names the columns, unless it holds numbers only. With semicolons a decimal comma is
    read as such.

    Raises
    ------
    DataError : if it is not text, or a line has more or fewer fields than the first.
    """
    import pyarrow as pa
    from pyarrow import csv

    found = delimited(path, shown)
    try:
        table = csv.read_csv(
            path,
            read_options=csv.ReadOptions(autogenerate_column_names=found.headless, skip_rows=found.skipped),
            parse_options=csv.ParseOptions(delimiter=found.separator),
            convert_options=csv.ConvertOptions(decimal_point=found.decimal, null_values=[""]),
        )
    except pa.ArrowInvalid as error:
        raise parse_error(path, shown, found.separator, error) from None
    read = from_arrow(table, shown, lines=True)
    return _numbered(read.arrays) if found.headless else read


@dataclass(frozen=True, slots=True)
class Delimited:
    """How a text separates its columns.

    Attributes
    ----------
    separator, decimal : characters.
    skipped : lines before the first that counts.
    headless : whether that line holds numbers already.
    """

    separator: str
    decimal: str
    skipped: int
    headless: bool


def delimited(path: Path, shown: str) -> Delimited:
    """Tell from its first lines how a text separates its columns.

    Raises
    ------
    DataError : if it is not text.
    """
    skipped, first, second = _first_two(path, shown)
    separator = max(SEPARATORS, key=first.count)
    headless = all(_NUMBER.match(field) for field in first.split(separator))
    comma = separator == ";" and "," in second and "." not in second
    return Delimited(separator, "," if comma else ".", skipped, headless)


def read_spaced(path: Path, shown: str) -> Text:
    """Read a text whose columns are separated by blanks; a text with separators is read as such.

    The first line names the columns (without blanks in a name), unless it holds numbers only; lines
    that start with ``#`` or ``%`` are comments.

    Raises
    ------
    DataError : if it is not text, an entry is not a number, or a line has another number of entries.
    """
    _, first, _ = _first_two(path, shown)
    if any(separator in first for separator in SEPARATORS):
        return read_delimited(path, shown)
    names = re.sub(r"\s+(?=[\[(])", "", first).split()
    headless = all(_NUMBER.match(field) for field in names)
    width = len(names)
    rows = _spaced_rows(path, shown, width, skip=not headless)
    values = np.fromiter((x for row in rows for x in row), dtype=np.float64).reshape(-1, width)
    _require_rows(len(values), shown)
    arrays = tuple(np.ascontiguousarray(values.T))
    return _numbered(arrays) if headless else Text(tuple(names), arrays)


def from_arrow(table: pa.Table, shown: str, *, lines: bool) -> Text:
    """Columns of an Arrow table; what is missing in a column of numbers becomes NaN."""
    import pyarrow as pa

    _require_rows(table.num_rows, shown)
    arrays = []
    for column in table.columns:
        numeric = pa.types.is_integer(column.type) or pa.types.is_floating(column.type)
        arrays.append(column.to_numpy() if numeric else np.array(column.to_pylist(), dtype=object))
    return Text(tuple(str(name).strip() for name in table.column_names), tuple(arrays), lines)


def _numbered(arrays: tuple[Array, ...]) -> Text:
    return Text(tuple(str(k) for k in range(len(arrays))), arrays, header=False)


def _require_rows(n: int, shown: str) -> None:
    if n == 0:
        raise DataError(f"{shown}: has a header but no rows: expected at least 2 samples")


def lines_of(path: Path) -> Iterator[tuple[int, str]]:
    """Lines with their number, without empty ones and comments."""
    with path.open(encoding="utf-8-sig", errors="replace") as stream:
        for number, line in enumerate(stream, start=1):
            if line.strip() and not line.lstrip().startswith(_COMMENT):
                yield number, line.rstrip("\r\n")


def _first_two(path: Path, shown: str) -> tuple[int, str, str]:
    """Count the lines before the first that counts; that line and the next. Only text passes."""
    with path.open("rb") as stream:
        head = stream.read(_SNIFFED)
    if b"\0" in head or not _is_text(head):
        raise DataError(f"{shown}: is not a text in UTF-8: expected columns of numbers under a header")
    lines = lines_of(path)
    number, first = next(lines, (1, ""))
    _, second = next(lines, (0, ""))
    if not first:
        raise DataError(f"{shown}: has no rows: expected a header and at least 2 samples")
    return number - 1, first, second


def _is_text(head: bytes) -> bool:
    try:
        getincrementaldecoder("utf-8")().decode(head)
    except UnicodeDecodeError:
        return False
    return True


def _spaced_rows(path: Path, shown: str, width: int, *, skip: bool) -> Iterator[list[float]]:
    lines = lines_of(path)
    if skip:
        next(lines)
    for number, line in lines:
        fields = line.split()
        if len(fields) != width:
            raise _ragged(shown, number, width, len(fields))
        try:
            yield [float(field) for field in fields]
        except ValueError:
            bad = next(k for k, field in enumerate(fields) if not _NUMBER.match(field))
            raise DataError(
                f"{shown}, line {number}: column {bad} holds {fields[bad][:40]!r} where a number "
                "was expected: correct the entry"
            ) from None


def parse_error(path: Path, shown: str, separator: str, error: Exception) -> DataError:
    """Name the line that the parser stumbled on."""
    width = None
    for number, line in lines_of(path):
        fields = line.count(separator) + 1
        width = width or fields
        if fields != width:
            return _ragged(shown, number, width, fields)
    return DataError(f"{shown}: is not a CSV file that can be read: {said(error)}")


def _ragged(shown: str, number: int, expected: int, came: int) -> DataError:
    return DataError(
        f"{shown}, line {number}: has {came} fields where the first line has {expected}: "
        "complete the line or leave it out"
    )


def said(error: Exception) -> str:
    """Shorten what a library says to its first sentence, for a message."""
    return re.split(r"\n|\. ", str(error).strip())[0][:200]
