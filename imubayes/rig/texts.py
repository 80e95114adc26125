"""Text files that hold columns of numbers."""

from __future__ import annotations

import re
from codecs import BOM_UTF16_BE, BOM_UTF16_LE, getincrementaldecoder
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from imubayes.errors import DataError

if TYPE_CHECKING:
    import pyarrow as pa

SEPARATORS = ",;\t"
_COMMENT = ("#", "%")
_SNIFFED = 4096
"""Bytes that tell text from binary."""
TEXT_BLOCK = 1 << 20
"""Bytes of text at a time, of which the reader holds some thirty: 10,000 lines are usual."""
_SAMPLED = 1 << 16
"""Bytes of a text from which its rows are estimated."""
_NAME = re.compile(r"[^\s\[(]+(?:\s*[\[(][^\])]*[\])])?")
STAMP = re.compile(r"\s*\"?(?:\d{4}-\d\d-\d\d(?:[T ].*)?|\d\d:\d\d:\d\d.*)$")
"""Date, time of day, or both."""
_NUMBER = re.compile(r"\s*[-+]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][-+]?\d+)?\s*$")


def line_of(path: Path, row: int) -> int:
    """Line (counted from 1) of a row of numbers (counted from 0); empty lines and comments do not count."""
    wanted = row if delimited(path, "").names else row + 1
    for count, (number, _) in enumerate(lines_of(path)):
        if count == wanted:
            return number
    return wanted + 1


@dataclass(frozen=True, slots=True)
class Wanted:
    """What is read of a file: columns by their names in it without blanks around; all if there are none.

    Whole numbers of those that make up the clock stay whole, so that no step of a large one is rounded.
    """

    columns: Collection[str] = ()
    clock: Collection[str] = ()

    def __contains__(self, name: str) -> bool:
        return not self.columns or name.strip() in self.columns


@dataclass(frozen=True, slots=True)
class Delimited:
    """How a text separates its columns; a blank stands for any number of them.

    So many lines are `skipped` before the first that counts. Where that holds numbers already `names` are
    those of the comment above it, or 0, 1, ...; none where it is the header.
    """

    separator: str
    decimal: str
    skipped: int
    names: tuple[str, ...]
    encoding: str

    def options(self, convert: dict[str, Any] | None = None, **reading: Any) -> dict[str, Any]:
        """Say to Arrow where the columns begin, what they are called, and what separates them."""
        from pyarrow import csv

        where = {"skip_rows": self.skipped, "encoding": self.encoding} | reading
        return {
            "read_options": csv.ReadOptions(column_names=list(self.names), **where),
            "parse_options": csv.ParseOptions(delimiter=self.separator),
            "convert_options": csv.ConvertOptions(
                decimal_point=self.decimal, null_values=[""], **(convert or {})
            ),
        }


def delimited(path: Path, shown: str) -> Delimited:
    """Tell from its first lines how a text separates its columns; a `DataError` if it is none."""
    codec = _codec(path)
    with path.open("rb") as stream:
        head = stream.read(_SNIFFED)
    try:
        getincrementaldecoder(codec)().decode(head)
        told = codec == "utf-16" or b"\0" not in head
    except UnicodeDecodeError:
        told = False
    if not told:
        raise DataError(f"{shown}: is not a text in UTF-8: expected columns of numbers under a header")
    encoding = "utf-8" if codec == "utf-8-sig" else codec
    lines = lines_of(path)
    number, first = next(lines, (1, ""))
    _, second = next(lines, (0, ""))
    if not first:
        raise DataError(f"{shown}: has no rows: expected a header and at least 2 samples")
    separator = max(SEPARATORS, key=first.count)
    if separator not in first and len(second.split()) == len(_names(first, " ")) > 1:
        separator = " "
    comma = separator == ";" and "," in second and "." not in second
    fields = _names(first, separator)
    headless = all(_NUMBER.match(field) or STAMP.match(field) for field in fields)
    names = _names_above(path, number, separator, len(fields)) if headless else ()
    return Delimited(separator, "," if comma else ".", number - 1, names, encoding)


def _names(line: str, separator: str) -> list[str]:
    """Names of a header; a unit in brackets belongs to the name before it."""
    return _NAME.findall(line) if separator == " " else [name.strip() for name in line.split(separator)]


def _names_above(path: Path, number: int, separator: str, width: int) -> tuple[str, ...]:
    """Names of columns in the comment right above line `number`; 0, 1, ... if there are none."""
    above = ""
    with path.open(encoding=_codec(path), errors="replace") as stream:
        for _, line in zip(range(number - 1), stream, strict=False):
            above = line.strip() or above
    names = _names(above.lstrip("".join(_COMMENT) + " "), separator)
    if len(names) == width and not any(_NUMBER.match(name) or not name for name in names):
        return tuple(names)
    return tuple(str(k) for k in range(width))


def text_rows(path: Path) -> int:
    """About how many rows a text has; 0 of one that is read as a whole, for blanks separate its columns."""
    if delimited(path, "").separator == " ":
        return 0
    with path.open("rb") as stream:
        head = stream.read(_SAMPLED)
    return round(path.stat().st_size * head.count(b"\n") / max(len(head), 1))


def text_tables(path: Path, shown: str, wanted: Wanted | None) -> Iterator[pa.Table]:
    """Read what is wanted of a text a part at a time, or all at once where nothing is said of that.

    Columns are separated by comma, semicolon, tab or blanks. The first line names them, unless it holds
    numbers only; then a comment right above it may, or they are called ``0``, ... With semicolons a decimal
    comma is read as such. Lines that start with ``#`` or ``%`` are comments. It is a `DataError` if it is not
    text, or a line has more or fewer fields than the first.
    """
    import pyarrow as pa
    from pyarrow import csv

    text, done = delimited(path, shown), 0
    # an entry that is no number is found where it is taken as text
    for kind in (pa.float64(), pa.string()):
        try:
            if wanted is not None:
                for batch in _batches(path, text, wanted, kind, done):
                    yield pa.Table.from_batches([batch])
                    done += batch.num_rows
            elif text.separator == " ":
                yield csv.read_csv(_single_blanks(path), **text.options(skip_rows=0, encoding="utf-8"))
            else:
                yield csv.read_csv(path, **text.options())
            return
        except pa.ArrowInvalid as error:
            if wanted is None or pa.types.is_string(kind):
                raise _parse_error(path, shown, text, error) from None


def _batches(
    path: Path, layout: Delimited, wanted: Wanted, kind: pa.DataType, done: int
) -> Iterator[pa.RecordBatch]:
    """Batches of a delimited text behind the rows that are `done`, with columns of a kind.

    A clock of whole numbers is read as such.
    """
    import pyarrow as pa
    from pyarrow import csv

    with csv.open_csv(path, **layout.options(block_size=TEXT_BLOCK)) as peek:
        schema = peek.schema
    names = [name for name in schema.names if name in wanted]
    whole = {name for name in names if name.strip() in wanted.clock} if pa.types.is_floating(kind) else set()
    types = {
        name: kind
        for name in names
        if wanted.columns and (name not in whole or pa.types.is_floating(schema.field(name).type))
    }
    asked = {"include_columns": names, "column_types": types}
    with csv.open_csv(path, **layout.options(asked, block_size=TEXT_BLOCK)) as reader:
        for batch in reader:
            if done < batch.num_rows:
                yield batch.slice(done)
            done = max(done - batch.num_rows, 0)


def _single_blanks(path: Path) -> pa.BufferReader:
    """Make one blank stand between entries, so that one reader serves every text."""
    import pyarrow as pa

    lines = (line for _, line in lines_of(path))
    header = next(lines, "")
    first = " ".join(re.sub(r"\s+", "", name) for name in _NAME.findall(header))
    return pa.BufferReader("\n".join([first, *(" ".join(line.split()) for line in lines)]).encode())


def lines_of(path: Path) -> Iterator[tuple[int, str]]:
    """Lines with their number, without empty ones and comments."""
    with path.open(encoding=_codec(path), errors="replace") as stream:
        for number, line in enumerate(stream, start=1):
            if line.strip() and not line.lstrip().startswith(_COMMENT):
                yield number, line.rstrip("\r\n")


def _codec(path: Path) -> str:
    """Name of a text's encoding: its first bytes say that it is UTF-16, as spreadsheets write it."""
    with path.open("rb") as stream:
        return "utf-16" if stream.read(2) in (BOM_UTF16_LE, BOM_UTF16_BE) else "utf-8-sig"


def _parse_error(path: Path, shown: str, layout: Delimited, error: Exception) -> DataError:
    """Name the line that the parser stumbled on."""
    width, separator = None, None if layout.separator == " " else layout.separator
    for number, line in lines_of(path):
        fields = len(_names(line, " ") if width is None and separator is None else line.split(separator))
        width = width or fields
        if fields != width:
            return DataError(
                f"{shown}, line {number}: has {fields} fields where the first line has {width}: "
                "complete the line or leave it out"
            )
    return DataError(f"{shown}: is not a CSV file that can be read: {said(error)}")


def said(error: Exception) -> str:
    """Shorten what a library says to its first sentence, for a message."""
    return re.split(r"\n|\. ", str(error).strip())[0][:200]
