"""Results of any studies side by side: which comparison their kinds allow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from imubayes.reporting.blocks import Page
from imubayes.reporting.comparison.lots import LOTS
from imubayes.reporting.comparison.page import comparison_page, comparison_record
from imubayes.reporting.comparison.sensors import SENSORS
from imubayes.reporting.comparison.units import UNITS
from imubayes.reporting.result.entries import SensorsResult
from imubayes.reporting.result.file import no_result, read, written
from imubayes.reporting.result.many import LotsResult


def side_by_side(paths: Sequence[Path]) -> tuple[Page, Mapping[str, Any]]:
    """Compare results of studies: as a page, and as the values of its ``result.json``."""
    files = [written(path) for path in paths]
    for one in files:
        if not {"lots", "sensors"} & one.raw.keys():
            raise no_result(one.path, "it holds no sensors or classes")
    results = [
        read(one, LotsResult, "classes") if "lots" in one.raw else read(one, SensorsResult, "sensors")
        for one in files
    ]
    kinds = frozenset("lots" if "lots" in one else "sensors" for one in results)
    kind = {frozenset({"sensors"}): SENSORS, frozenset({"lots"}): LOTS}.get(kinds, UNITS)
    found = kind.compared(files, results)
    return comparison_page(found, kind), comparison_record(found, kind)
