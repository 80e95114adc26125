"""The ``[quality]`` table becomes a `QualityStudy`."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

from imubayes.quality.trials import MODELLED, TREATMENTS, QualityStudy
from imubayes.sensors.catalogue import classes
from imubayes.sensors.terms import Kind, library
from imubayes.study.schema.shapes import Place, QualityTable, hint, shaped
from imubayes.study.schema.tables import HeaderTable, StudyFile


def quality_study(tables: StudyFile, path: Path, text: str) -> QualityStudy:
    """Check a study of how good the decision is.

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
    here = place.at("quality")
    table = shaped(QualityTable, tables.quality, here)
    with here.blamed():
        library("accelerometer", powers=table.powers, asymmetry=table.asymmetry)
    _check_treatments(table.treatments, here.at("treatments"))
    _check_classes(table.classes, here.at("classes"))
    return QualityStudy(
        title=header.title or path.stem,
        seed=header.seed,
        sensors=table.sensors,
        treatments=table.treatments,
        misspecified=min(table.misspecified or table.sensors, table.sensors),
        powers=table.powers,
        asymmetry=table.asymmetry,
        resamples=table.resamples,
        processes=table.processes,
        classes=table.classes,
        path=path,
        text=text,
    )


def _check_classes(asked: tuple[str, ...], place: Place) -> None:
    known = {kind: [entry.id for entry in classes(kind)] for kind in get_args(Kind)}
    ids = [name for names in known.values() for name in names]
    for k, name in enumerate(asked):
        if name not in ids:
            raise place.at(k).error(f"'{name}' is no class of the catalogue: {hint(name, ids)}")
    for kind, names in known.items():
        if asked and not set(asked) & set(names):
            raise place.error(f"there is no {kind} among them: expected classes of both kinds")


def _check_treatments(treatments: tuple[str, ...], place: Place) -> None:
    for k, treatment in enumerate(treatments):
        if treatment not in TREATMENTS:
            raise place.at(k).error(f"'{treatment}' is no treatment: {hint(treatment, TREATMENTS)}")
        if treatment in treatments[:k]:
            raise place.at(k).error(f"'{treatment}' is there already: expected each once")
    if MODELLED not in treatments:
        raise place.error(f"expected '{MODELLED}' among them: the others are held against it")
