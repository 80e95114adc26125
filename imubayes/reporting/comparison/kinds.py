"""Results of any studies side by side: which comparison their kinds allow."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from imubayes.errors import InputError
from imubayes.reporting.blocks import Page
from imubayes.reporting.comparison.lot_files import lots_of
from imubayes.reporting.comparison.lots import lots_compared
from imubayes.reporting.comparison.lots_page import lots_page, lots_record
from imubayes.reporting.comparison.quality import quality_compared, quality_of
from imubayes.reporting.comparison.quality_page import quality_page, quality_record
from imubayes.reporting.comparison.result_files import Written, no_result, sensors_of, written
from imubayes.reporting.comparison.results import compared
from imubayes.reporting.comparison.results_page import comparison_record, results_page
from imubayes.reporting.comparison.units import units_compared
from imubayes.reporting.comparison.units_page import units_page, units_record
from imubayes.reporting.html import write_page
from imubayes.reporting.quality_page import finite

SENSORS, LOTS, QUALITY = "a study of sensors", "a class-level study", "a study of the decision's quality"
"""Kinds of studies whose results can be compared."""

KEYS = {"lots": LOTS, "scores": QUALITY, "sensors": SENSORS}
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
    paths : of files ``result.json``, or of their folders: of sensors, of classes, of the decision's quality,
        or of sensors and one of their class.

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
    if set(kinds) == {QUALITY}:
        scores = quality_compared([quality_of(one) for one in files])
        return SideBySide(quality_page(scores), quality_record(scores))
    if QUALITY in kinds:
        raise InputError(_mixed(files, kinds))
    pairs = zip(files, kinds, strict=True)
    units = units_compared([lots_of(one) if kind == LOTS else sensors_of(one) for one, kind in pairs])
    return SideBySide(units_page(units), units_record(units))


def _kind(one: Written) -> str:
    for key, kind in KEYS.items():
        if key in one.raw:
            return kind
    raise no_result(one.path, "it holds no sensors, classes or scores")


def _mixed(files: Sequence[Written], kinds: Sequence[str]) -> str:
    came = "; ".join(f"{one.path} is of {kind}" for one, kind in zip(files, kinds, strict=True))
    return (
        f"{came}: expected results of one kind of study, or of sensors and of one class-level study that has"
        " their class"
    )


def write_comparison(found: SideBySide, folder: Path) -> tuple[Path, ...]:
    """Write ``report.html`` and ``result.json`` into a folder."""
    return write_page(found.page, comparison_json(found.record), folder)


def comparison_json(record: Mapping[str, Any]) -> str:
    """Text of ``result.json``, SI; what is not finite becomes null."""
    return json.dumps(finite(dict(record)), indent=1, allow_nan=False, ensure_ascii=False) + "\n"
