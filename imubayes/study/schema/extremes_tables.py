"""The ``[extremes]`` table becomes an `ExtremesStudy`."""

from __future__ import annotations

from pathlib import Path

from imubayes.extremes.cases import FAMILIES
from imubayes.extremes.plan import ExtremesStudy
from imubayes.study.schema.shapes import ExtremesTable, Place, hint, shaped
from imubayes.study.schema.tables import HeaderTable, StudyFile


def extremes_study(tables: StudyFile, path: Path, text: str) -> ExtremesStudy:
    """Check a study of how many digits are right at the extremes.

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
    here = place.at("extremes")
    table = shaped(ExtremesTable, tables.extremes, here)
    families = table.families or tuple(FAMILIES)
    for k, name in enumerate(families):
        if name not in FAMILIES:
            raise here.at("families").at(k).error(f"'{name}' is no family: {hint(name, tuple(FAMILIES))}")
        if name in families[:k]:
            raise here.at("families").at(k).error(f"'{name}' is there already: expected each once")
    return ExtremesStudy(header.title or path.stem, header.seed, families, table.every, path, text)
