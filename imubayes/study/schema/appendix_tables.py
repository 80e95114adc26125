"""One ``[[appendix]]`` table, and the CSV file that it names, become an `Appendix`."""

from __future__ import annotations

import csv
from pathlib import Path

from pydantic.dataclasses import dataclass as shape

from imubayes.campaign.study import Appendix
from imubayes.study.schema.measured import STRICT, Text, key
from imubayes.study.schema.run_tables import located
from imubayes.study.schema.shapes import Place, shaped

LONGEST = 200
"""Rows of a table that a report can show; a longer one is data."""

_Line = tuple[int, tuple[str, ...]]
"""Number of a line in the file, and its fields."""


@shape(config=STRICT, frozen=True, kw_only=True)
class AppendixTable:
    """``[[appendix]]``."""

    title: Text = key("heading", "Effective samples a second")
    file: Text = key("CSV, UTF-8, commas: a line of headings and at most 200 rows", "speed.csv")
    note: str = key("what it shows, in words", "Two cores.", "")
    command: str = key("that made it", "pytest -m benchmark", "")


def appendix(raw: object, folder: Path, place: Place) -> Appendix:
    """Check one table from elsewhere and read its file.

    Parameters
    ----------
    raw : the table.
    folder : of the study's file.
    place : of the table, for errors.

    Raises
    ------
    StudyError : naming the key or the file's line.
    """
    table = shaped(AppendixTable, raw, place)
    here = place.at("file")
    lines = _lines(located(table.file, folder), table.file, here)
    if len(lines) < 2:
        raise here.error(f"{table.file}: expected a line of headings and at least one row")
    if len(lines) - 1 > LONGEST:
        raise here.error(
            f"{table.file}: has {len(lines) - 1} rows: expected at most {LONGEST}; give a summary of it"
        )
    (_, header), *rows = lines
    for number, row in rows:
        if len(row) != len(header):
            raise here.error(
                f"{table.file}, line {number}: expected {len(header)} fields, as many as headings, "
                f"came {len(row)}"
            )
    return Appendix(table.title, table.note, table.command, header, tuple(row for _, row in rows))


def _lines(path: Path, shown: str, place: Place) -> list[_Line]:
    """Lines of a CSV file that hold something."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as stream:
            reader = csv.reader(stream, strict=True, skipinitialspace=True)
            return [(reader.line_num, tuple(map(str.strip, row))) for row in reader if any(row)]
    except UnicodeDecodeError:
        raise place.error(f"{shown}: is not a text in UTF-8: expected a CSV file") from None
    except (FileNotFoundError, ValueError):
        raise place.error(f"{shown}: there is no such file (looked for {path})") from None
    except IsADirectoryError:
        raise place.error(f"{shown}: is a directory: expected a CSV file") from None
    except OSError as error:
        raise place.error(f"{shown}: cannot be read ({error.strerror}): check its permissions") from None
    except csv.Error as error:
        raise place.error(f"{shown}: is not a CSV file: {error}") from None
