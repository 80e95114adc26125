"""From a result to something to fly: compensation, simulator models, filter parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from imubayes.errors import InputError
from imubayes.reporting.export.characterized import Characterized, characterized
from imubayes.reporting.export.parameters import filter_files, json_files, kalibr_files, px4_files
from imubayes.reporting.export.source_texts import c_files, matlab_files, python_files

__all__ = ["FORMATS", "exported"]

FORMATS: Mapping[str, Callable[[Characterized], dict[str, str]]] = {
    "kalibr": kalibr_files,
    "px4": px4_files,
    "c": c_files,
    "python": python_files,
    "matlab": matlab_files,
    "json": json_files,
    "filter": filter_files,
}
"""Texts by file name, of each format."""


def exported(path: Path | str, to: str, **which: Any) -> dict[str, str]:
    """Texts by file name of a result in one of `FORMATS`; `which` are the options of `characterized`.

    Raises
    ------
    InputError : if the format, sensor or model is not known, the format needs what the result lacks, or the
        data reject the model.
    """
    if to not in FORMATS:
        raise InputError(f"format '{to}' is not known: expected one of {', '.join(FORMATS)}")
    return FORMATS[to](characterized(path, **which))
