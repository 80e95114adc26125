"""Studies of another kind than sensors that are tested: measured, and ready to be shown and written."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from imubayes.processes import Progress

if TYPE_CHECKING:
    from imubayes.extremes.plan import ExtremesStudy
    from imubayes.lots.plan import LotStudy
    from imubayes.quality.trials import QualityStudy
    from imubayes.speed.contests import SpeedStudy

Done = tuple[object, Callable[[Path], tuple[Path, ...]]]
"""What a console shows, and a function that writes the report into a folder and gives its files."""


def measured(study: LotStudy | QualityStudy | ExtremesStudy | SpeedStudy, progress: Progress) -> Done:
    """Run a study of simulated lots, of how good the decision is, of the extremes, or of speed."""
    from imubayes.extremes import measure as extremes
    from imubayes.extremes.plan import ExtremesStudy
    from imubayes.lots import measure as lots
    from imubayes.lots.plan import LotStudy
    from imubayes.quality import measure as quality
    from imubayes.reporting.extremes_page import terminal_extremes, write_extremes
    from imubayes.reporting.lots_page import terminal_lots, write_lots
    from imubayes.reporting.quality_page import terminal_quality, write_quality
    from imubayes.reporting.speed_page import terminal_speed, write_speed
    from imubayes.speed import measure as speed
    from imubayes.speed.contests import SpeedStudy

    if isinstance(study, LotStudy):
        lot = lots.measure(study, progress=progress)
        return terminal_lots(lot), partial(write_lots, lot)
    if isinstance(study, SpeedStudy):
        timed = speed.measure(study, progress=progress)
        return terminal_speed(timed), partial(write_speed, timed)
    if isinstance(study, ExtremesStudy):
        grid = extremes.measure(study, progress=progress)
        return terminal_extremes(grid), partial(write_extremes, grid)
    found = quality.measure(study, progress=progress)
    return terminal_quality(found), partial(write_quality, found)


def traded(
    path: Path,
    rungs: Sequence[str],
    only: Sequence[str],
    *,
    repeats: int,
    limit: float,
    progress: Progress,
) -> Done:
    """Measure the rungs of the ladder on a study of sensors, or of simulated lots.

    Parameters
    ----------
    path : of the study.
    rungs : by name; none for all.
    only : sensors or classes; none for all.
    repeats : simulated sensors.
    limit : s, of all.
    progress : is told what goes on.

    Raises
    ------
    InputError : if the study cannot be read, or has nothing of what was asked.
    """
    from imubayes.config import read_lots, read_study
    from imubayes.reporting.trade_page import terminal_trade, write_trade
    from imubayes.trade.measure import measure
    from imubayes.trade.plan import NAMES, rungs_of
    from imubayes.trade.subjects import of_lots, of_study, with_options

    asked = rungs_of(rungs) if rungs else NAMES
    lot = read_lots(path)
    trade = of_lots(lot, only, repeats) if lot else of_study(read_study(path), only)
    found = measure(with_options(trade, rungs=asked, repeats=repeats, limit=limit), progress=progress)
    return terminal_trade(found), partial(write_trade, found)
