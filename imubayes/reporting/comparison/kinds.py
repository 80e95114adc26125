"""Results of any studies side by side: which comparison their kinds allow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from imubayes.reporting.blocks import Page
from imubayes.reporting.comparison.lot_files import lots_of
from imubayes.reporting.comparison.lots import lots_compared
from imubayes.reporting.comparison.lots_page import lots_page, lots_record
from imubayes.reporting.comparison.result_files import sensors_of
from imubayes.reporting.comparison.results import compared
from imubayes.reporting.comparison.results_page import comparison_record, results_page
from imubayes.reporting.comparison.units import units_compared
from imubayes.reporting.comparison.units_page import units_page, units_record
from imubayes.reporting.html import write_page
from imubayes.reporting.result.file import Written, json_text, no_result, written

SENSORS, LOTS = "a study of sensors", "a class-level study"
"""Kinds of studies whose results can be compared."""

KEYS = {"lots": LOTS, "sensors": SENSORS}
"""Kind by the key that only its results have."""


@dataclass(frozen=True, slots=True)
class SideBySide:
    """A comparison: as a page, and as the values of its ``result.json``."""

    page: Page
    record: Mapping[str, Any]


def side_by_side(paths: Sequence[Path]) -> SideBySide:
    """Compare results of studies.

    Parameters
    ----------
    paths : of files ``result.json``, or of their folders: of sensors, of classes, or of sensors and one of
        their class.

    Raises
    ------
    InputError : if they cannot be read, or their kinds cannot be compared.
    """
    files = [written(path) for path in paths]
    kinds = [_kind(one) for one in files]
    if set(kinds) == {SENSORS}:
        found = compared([sensors_of(one) for one in files])
        return SideBySide(results_page(found), comparison_record(found))
    if set(kinds) == {LOTS}:
        lots = lots_compared([lots_of(one) for one in files])
        return SideBySide(lots_page(lots), lots_record(lots))
    pairs = zip(files, kinds, strict=True)
    units = units_compared([lots_of(one) if kind == LOTS else sensors_of(one) for one, kind in pairs])
    return SideBySide(units_page(units), units_record(units))


def _kind(one: Written) -> str:
    for key, kind in KEYS.items():
        if key in one.raw:
            return kind
    raise no_result(one.path, "it holds no sensors or classes")


def write_comparison(found: SideBySide, folder: Path) -> tuple[Path, ...]:
    """Write ``report.html`` and ``result.json`` into a folder."""
    return write_page(found.page, comparison_json(found.record), folder)


def comparison_json(record: Mapping[str, Any]) -> str:
    """Text of ``result.json``, SI; what is not finite becomes null."""
    return json_text(record)
