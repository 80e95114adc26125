"""The ``[speed]`` table becomes a `SpeedStudy`."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

from imubayes.speed.contests import Quantity, SpeedStudy, Subject
from imubayes.speed.growth import FEWEST
from imubayes.study.schema.shapes import GrowthTable, Place, SpeedTable, shaped
from imubayes.study.schema.tables import HeaderTable, StudyFile

SMALLEST: dict[Subject, tuple[int, int]] = {
    "least squares": (100, 10_000_000),
    "one-sided": (100, 10_000_000),
    "subsets": (8, 16),
    "g-prior": (8, 20),
    "enumeration": (8, 26),
    "noise": (1_000, 10_000_000),
    "posterior": (1_200, 100_000),
}
"""Smallest and largest size of each subject: below there is nothing to time, above somebody takes hours."""


def speed_study(tables: StudyFile, path: Path, text: str) -> SpeedStudy:
    """Check a study of speed.

    Parameters
    ----------
    tables : of the file.
    path, text : of the file.

    Raises
    ------
    StudyError : naming the key.
    """
    place = Place(str(path))
    header = shaped(HeaderTable, tables.study, place.at("study"))
    here = place.at("speed")
    table = shaped(SpeedTable, tables.speed, here)
    growth = shaped(GrowthTable, table.growth, here.at("growth"))
    contests: dict[Subject, tuple[int, ...]] = {
        "least squares": table.least_squares,
        "one-sided": table.one_sided,
        "subsets": table.subsets,
        "g-prior": table.g_prior,
        "enumeration": table.enumeration,
        "noise": table.noise,
        "posterior": table.posterior,
    }
    laws: dict[Quantity, tuple[int, ...]] = {
        "rows": growth.rows,
        "terms": growth.terms,
        "models": growth.models,
        "runs": growth.runs,
        "units": growth.units,
    }
    for subject, asked in contests.items():
        _check_contest(asked, SMALLEST[subject], here.at(subject.replace(" ", "_").replace("-", "_")))
    for quantity, asked in laws.items():
        _check_law(asked, here.at("growth").at(quantity))
    return SpeedStudy(header.title or path.stem, header.seed, table.repeats, contests, laws, path, text)


def _check_contest(asked: tuple[int, ...], between: tuple[int, int], place: Place) -> None:
    least, most = between
    for k, size in enumerate(asked):
        if not least <= size <= most:
            raise place.at(k).error(f"expected a size from {least:,} to {most:,}, came {size:,}")


def _check_law(asked: tuple[int, ...], place: Place) -> None:
    if asked and (len(asked) < FEWEST or any(a >= b for a, b in pairwise(asked))):
        raise place.error(f"expected {FEWEST} sizes or more, each larger than the one before, or none")
