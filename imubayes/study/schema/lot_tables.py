"""The ``[lots]`` table becomes a `LotStudy`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass as shape

from imubayes.campaign.study import Mission, SensorSpec
from imubayes.population.lots import Against, LotStudy
from imubayes.sensors.catalogue import sensor
from imubayes.sensors.sensor_class import SensorClass
from imubayes.sensors.terms import Kind
from imubayes.study.schema.measured import STRICT, Count, Holds, key
from imubayes.study.schema.scene_tables import scenes_of
from imubayes.study.schema.sensor_tables import own_classes, sensor_spec
from imubayes.study.schema.shapes import Place, hint, shaped, unique
from imubayes.study.schema.tables import CAMPAIGN, HeaderTable, LibraryOf, Names, ReferenceOf, Runs, StudyFile


@shape(config=STRICT, frozen=True, kw_only=True)
class AgainstTable:
    """``[lots.asks]``."""

    needed_by: Names = key("the first of two groups: which terms these need", ["fog_tactical"])
    not_by: Names = key("and these do not", ["mems_tactical"])


@shape(config=STRICT, frozen=True, kw_only=True)
class LotsTable:
    """``[lots]``."""

    kind: Kind = key("`accelerometer` or `gyroscope`", "accelerometer")
    classes: Names = key(
        "classes of the catalogue (`imubayes catalogue`), in the order of the report",
        ["mems_tactical", "strategic_piga"],
    )
    units: Annotated[int, Field(ge=2)] = key("simulated of each class", 10, 8)
    basic: bool = key(
        "say too what the basic triad of 12 parameters would leave, by class and scene", True, False
    )
    asks: Annotated[Any, Holds({"enum": ["classes", "scenes", "triad"]}, AgainstTable)] = key(
        "what the report answers first, as its title asks: what each class needs (`classes`), what each"
        " scene requires (`scenes`), whether the basic triad is enough (`triad`), or what some classes need"
        " and others do not (a table `[lots.asks]`)",
        "classes",
        "classes",
    )
    processes: Count = key("that share the work", 4, 2)
    library: LibraryOf = key("candidate terms, as `[sensor.library]`", {"powers": 2}, dict, "its defaults")
    reference: ReferenceOf = key(
        "errors of the test bench, as `[sensor.reference]`: drawn anew for each unit, and allowed for in its"
        " analysis",
        {"gravity": True},
        dict,
    )
    run: Runs = key("the campaign, as `[[sensor.run]]` with `simulate`", CAMPAIGN, list, "needed")


def lot_study(tables: StudyFile, path: Path, text: str) -> LotStudy:
    """Check a class-level study.

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
    here = place.at("lots")
    table = shaped(LotsTable, tables.lots, here)
    if header.method not in ("auto", "exact"):
        raise place.at("study").at("method").error("a class-level study is exact: leave it out")
    own = own_classes(header.catalogue, path.parent, place.at("study").at("catalogue"))
    entries = _classes(table, own, here.at("classes"))
    campaign = _campaign(table, own, path.parent, here)
    missions = _missions(tables, table.kind, header.seed, path)
    return LotStudy(
        title=header.title or path.stem,
        seed=header.seed,
        kind=table.kind,
        classes=entries,
        units=table.units,
        library=replace(campaign.library, technology="", ties=()),
        runs=campaign.runs,
        reference=campaign.reference,
        missions=missions,
        basic=table.basic,
        processes=table.processes,
        path=path,
        text=text,
        asks=_asks(table, bool(missions), here.at("asks")),
    )


def _classes(table: LotsTable, own: Sequence[SensorClass], place: Place) -> tuple[SensorClass, ...]:
    ids, found = table.classes, list[SensorClass]()
    if not ids:
        raise place.error("expected the id of at least one class ('imubayes catalogue' lists them)")
    for k, name in enumerate(ids):
        if name in ids[:k]:
            raise place.at(k).error(f"'{name}' is there already: expected each class once")
        with place.at(k).blamed():
            found.append(sensor(name, kind=table.kind, catalogue=own))
    return tuple(found)


def _asks(table: LotsTable, scenes: bool, place: Place) -> Literal["classes", "scenes", "triad"] | Against:
    """What the report answers first, which the study must give an answer to."""
    if isinstance(table.asks, dict):
        return _against(table.classes, shaped(AgainstTable, table.asks, place), place)
    if table.asks == "classes":
        return "classes"
    if table.asks == "scenes":
        if not scenes:
            raise place.error("'scenes' asks what each scene requires: expected at least one [[scene]]")
        return "scenes"
    if table.asks == "triad":
        if not (scenes and table.basic):
            raise place.error(
                "'triad' asks where the basic triad is enough: expected basic = true, and at least one"
                " [[scene]]"
            )
        return "triad"
    raise place.error(
        "expected 'classes', 'scenes', 'triad' or { needed_by = [...], not_by = [...] }, came"
        f" {table.asks!r}"
    )


def _against(classes: Sequence[str], table: AgainstTable, place: Place) -> Against:
    for group, names in (("needed_by", table.needed_by), ("not_by", table.not_by)):
        if not names:
            raise place.at(group).error("expected at least one of the study's classes")
        for k, name in enumerate(names):
            if name not in classes:
                raise place.at(group).at(k).error(f"'{name}' is not among the classes: {hint(name, classes)}")
    both = sorted(set(table.needed_by) & set(table.not_by))
    if both:
        raise place.error(f"'{both[0]}' is in needed_by and in not_by: expected it in one of them")
    return Against(table.needed_by, table.not_by)


def _campaign(table: LotsTable, own: Sequence[SensorClass], folder: Path, place: Place) -> SensorSpec:
    """Check the test campaign as that of a sensor of the first class: it is the same for all."""
    raw = {
        "id": table.classes[0],
        "kind": table.kind,
        "class": table.classes[0],
        "library": table.library,
        "reference": table.reference,
        "run": table.run,
    }
    spec = sensor_spec(raw, folder, place, catalogue=own)
    for k, run in enumerate(spec.runs):
        if run.simulate is None:
            raise place.at("run").at(k).error("units of a lot are simulated: expected simulate, not a file")
    return spec


def _missions(tables: StudyFile, kind: Kind, seed: int, path: Path) -> tuple[Mission, ...]:
    place = Place(str(path)).at("scene")
    missions = scenes_of(tables.scene, path.parent, place, seed, {kind})
    unique([one.name for one in missions], "name", place)
    return missions
